"""Whether what is imported is what this distribution installed.

Its packages have plain names, and so have other distributions on the package index: pip installs
two of them into one folder without a word, and the later one overwrites files of the earlier one.
"""

from __future__ import annotations

import base64
import hashlib
import importlib.util
import re
from collections.abc import Iterator, Sequence
from importlib.metadata import (
    PackageNotFoundError,
    distribution,
    distributions,
)
from pathlib import Path
from typing import Any

DISTRIBUTION = "designopt"

PACKAGES = ("designopt", "kinematics", "optics", "perception", "studies")

AnyDistribution = Any
"""A distribution, or what a backport of the standard library's module has in place of one."""

REINSTALL = f"pip install --force-reinstall --no-deps {DISTRIBUTION}"


def find_clashes() -> list[str]:
    """Packages of ours that are not imported as they were installed, with the cure; a line each.

    Of an editable installation, which lists no files, only what stands in front of it is found.
    Nothing is imported.
    """
    others = [one for one in distributions() if _name(one) not in ("", DISTRIBUTION)]
    lines = (_shadowed(name, others) or _overwritten(name, others) for name in PACKAGES)
    return [line for line in lines if line]


def _shadowed(package: str, others: Sequence[AnyDistribution]) -> str:
    """What is imported in place of a package; empty if that is the one beside this file."""
    ours = Path(__file__).resolve().parents[1] / package
    try:
        spec = importlib.util.find_spec(package)
    except ValueError:  # a module without a specification has taken its name
        spec = None
    if spec is None or (spec.origin is None and ours.is_dir()):
        return f"the package '{package}' has lost its files; reinstall designopt: {REINSTALL}"
    found = Path(spec.origin or next(iter(spec.submodule_search_locations or [""]))).resolve()
    if found in (ours, ours / "__init__.py"):
        return ""
    for other in others:
        if any(_place(other, file) == found for file in _files(other, package)):
            return (
                f"another installed distribution, {other.name} {other.version}, is imported as "
                f"'{package}' in place of designopt's; {_cure(other)}"
            )
    return (
        f"'{package}' is imported from {found}, which is not designopt's; rename that, or take its "
        "folder out of PYTHONPATH"
    )


def _overwritten(package: str, others: Sequence[AnyDistribution]) -> str:
    """Which distribution has overwritten files of a package; empty if all are as installed."""
    try:
        ours = distribution(DISTRIBUTION)
    except PackageNotFoundError:  # a folder on the path: nothing was installed
        return ""
    altered = {
        place: file
        for file in _files(ours, package)
        if file.hash is not None and _checksum(place := _place(ours, file)) != file.hash.value
    }
    if not altered:
        return ""
    for other in others:
        theirs = {_place(other, file) for file in _files(other, package)} & altered.keys()
        if theirs:
            return (
                f"another installed distribution, {other.name} {other.version}, has overwritten "
                f"the package '{package}' ({len(theirs)} of its files); {_cure(other)}"
            )
    first = next(iter(altered.values()))
    return (
        f"the package '{package}' is not as it was installed ({first} is altered or missing, "
        f"{len(altered)} files in all); reinstall designopt: {REINSTALL}"
    )


def _cure(other: AnyDistribution) -> str:
    return f"uninstall it and reinstall designopt: pip uninstall {other.name} && {REINSTALL}"


def _files(of: AnyDistribution, package: str) -> Iterator[Any]:
    """The files that a distribution lists for an importable package or module."""
    for file in of.files or ():
        if file.parts[0] == package or file.parts == (f"{package}.py",):
            yield file


def _place(of: AnyDistribution, file: Any) -> Path:
    return Path(str(of.locate_file(file))).resolve()


def _checksum(path: Path) -> str | None:
    """As RECORD has it: SHA-256 in URL-safe base64 without padding; ``None`` without the file."""
    try:
        digest = hashlib.sha256(path.read_bytes()).digest()
    except OSError:
        return None
    return base64.urlsafe_b64encode(digest).rstrip(b"=").decode()


def _name(of: AnyDistribution) -> str:
    """As package indexes compare it; empty of what an interrupted installation has left."""
    try:
        metadata = of.metadata
    except FileNotFoundError:  # raised by the backport; before, and elsewhere, there is none
        metadata = None
    name = "" if metadata is None else metadata.get("Name") or ""
    return re.sub(r"[-_.]+", "-", name).lower()
