"""The command ``designopt doctor``: what may be wrong with an installation, and its cure."""

from __future__ import annotations

import math
import os
import platform
from collections.abc import Callable, Iterator
from importlib.metadata import (
    PackageNotFoundError,
    entry_points,
    metadata,
    packages_distributions,
    requires,
    version,
)
from pathlib import Path
from typing import NamedTuple

from designopt.compilation_cache import OFF, VARIABLE, folder_fault, keep_programs, program_folder
from designopt.errors import UserError, load_plug_in, one_line, reason_of
from designopt.installation import DISTRIBUTION, PACKAGES, REINSTALL, find_clashes

OPENCV = "opencv-contrib-python-headless"

PLUG_INS = ("designopt.commands", "designopt.designs", "designopt.studies", "designopt.templates")
"""Groups of entry points."""

COMPLETIONS = (
    ".bash_completions/designopt.sh",
    ".zfunc/_designopt",
    ".config/fish/completions/designopt.fish",
)
"""Where ``--install-completion`` writes, in the home folder."""


class Check(NamedTuple):
    """One line: whether all is well, ``None`` where that is for the user to decide; and what."""

    is_well: bool | None
    text: str


def doctor() -> int:
    """Check the installation: versions, name clashes, JAX, OpenCV, cache, plug-ins, extras.

    Each check is a line, with the cure of what is wrong. Exit code 1: something is wrong.

    Example:
      designopt doctor
    """
    found = []
    for check in CHECKS:
        for line in _lines_of(check):
            found.append(line)
            state = {True: "ok", False: "WRONG", None: "note"}[line.is_well]
            print(f"{state:6}{one_line(line.text)}", flush=True)
    wrong = sum(line.is_well is False for line in found)
    print(f"{wrong} of {len(found)} checks found something wrong." if wrong else "All is well.")
    return 1 if wrong else 0


def _lines_of(check: Callable[[], Iterator[Check]]) -> Iterator[Check]:
    """The lines of a check; of one that an installation is too broken for, what ended it."""
    try:
        yield from check()
    except Exception as error:
        what = check.__name__.replace("_", " ")
        yield Check(False, f"{what}: {type(error).__name__}: {error}; reinstall: {REINSTALL}")


def check_python() -> Iterator[Check]:
    """Python's version."""
    from packaging.specifiers import SpecifierSet

    bound, found = metadata(DISTRIBUTION)["Requires-Python"], platform.python_version()
    is_well = SpecifierSet(bound).contains(found, prereleases=True)
    cure = "" if is_well else f"; designopt needs {bound}: make an environment with such a Python"
    yield Check(is_well, f"Python {found}{cure}")


def check_requirements() -> Iterator[Check]:
    """Versions of what is required, against their lower bounds; and which extras are there."""
    from packaging.requirements import Requirement

    needed = [Requirement(line) for line in requires(DISTRIBUTION) or ()]
    plain = [one for one in needed if one.marker is None or one.marker.evaluate({"extra": ""})]
    faults = [fault for one in plain if (fault := _fault_of(one))]
    for fault in faults:
        yield Check(False, fault)
    if not faults:
        yield Check(True, f"{len(plain)} required packages, none older than it must be")
    for extra in metadata(DISTRIBUTION).get_all("Provides-Extra") or ():
        own = [one for one in needed if one.marker and one.marker.evaluate({"extra": extra})]
        missing = [one.name for one in own if one not in plain and _fault_of(one)]
        cure = f": without {', '.join(missing)}; pip install '{DISTRIBUTION}[{extra}]'"
        yield Check(None if missing else True, f"extra '{extra}'{cure if missing else ''}")


def _fault_of(requirement: object) -> str:
    """Why a requirement is not met, with the cure; empty if it is."""
    from packaging.requirements import Requirement

    assert isinstance(requirement, Requirement)
    asked = f"{requirement.name}{requirement.specifier}"
    try:
        found = version(requirement.name)
    except PackageNotFoundError:
        return f"{requirement.name} is not installed; pip install '{asked}'"
    if requirement.specifier.contains(found, prereleases=True):
        return ""
    return f"{requirement.name} {found} is installed; pip install '{asked}'"


def check_packages() -> Iterator[Check]:
    """Whether our packages are what is imported under their names."""
    clashes = find_clashes()
    for clash in clashes:
        yield Check(False, clash)
    if not clashes:
        yield Check(True, f"{', '.join(PACKAGES)} are those of designopt {version(DISTRIBUTION)}")


def check_jax() -> Iterator[Check]:
    """What JAX computes on, and whether in float64."""
    try:
        keep_programs()
        import jax
        import jax.numpy as jnp

        with jax.enable_x64(True):
            sine = jax.jit(jnp.sin)(jnp.asarray(1.0, jnp.float64))
            error = abs(float(sine) - math.sin(1.0))
        device = jax.devices()[0]
    except Exception as error:  # whatever a broken installation raises
        yield Check(False, f"JAX cannot compute: {reason_of(error)}; reinstall jax and jaxlib")
        return
    place = f"JAX {jax.__version__} on {device.platform} ({device.device_kind})"
    if sine.dtype == jnp.float64 and error < 1e-15:
        yield Check(True, f"{place} computes in float64")
    else:
        fault = f"does not compute in float64 (sin 1 is off by {error:g})"
        yield Check(False, f"{place} {fault}; set JAX_PLATFORMS=cpu")


def check_opencv() -> Iterator[Check]:
    """Whether OpenCV is that without windows, and the only one."""
    owners = sorted(set(packages_distributions().get("cv2", ())))
    others = [name for name in owners if name != OPENCV]
    if others:
        names = " ".join(others)
        yield Check(
            False,
            f"OpenCV is installed by {' and '.join(owners)}, which overwrite each other's files: "
            f"pip uninstall {names} && pip install --force-reinstall --no-deps {OPENCV}",
        )
        return
    try:
        import cv2
    except Exception as error:
        cure = f"pip install --force-reinstall --no-deps {OPENCV}"
        yield Check(False, f"OpenCV cannot be imported: {reason_of(error)}; {cure}")
        return
    yield Check(True, f"OpenCV {cv2.__version__} ({OPENCV})")


def check_cache() -> Iterator[Check]:
    """Whether compiled programs can be kept."""
    folder = program_folder()
    if folder is None:
        reason = f"{VARIABLE}={OFF}" if os.environ.get(VARIABLE) else "there is no home folder"
        yield Check(None, f"compiled programs are not kept: {reason}")
        return
    fault = folder_fault(folder)
    if not fault and not os.access(folder, os.W_OK):
        fault = "it cannot be written into"
    cure = f": {fault}; change its permissions, or name another folder by {VARIABLE}"
    yield Check(not fault, f"compiled programs are kept in {folder}{cure if fault else ''}")


def check_plug_ins() -> Iterator[Check]:
    """Whether commands, kinds of designs, studies and files to begin with can be loaded."""
    count, faults = 0, []
    for group in PLUG_INS:
        for point in entry_points(group=group):
            count += 1
            try:
                load_plug_in(point, f"plug-in of {group}")
            except UserError as error:
                faults.append(str(error))
    if faults and find_clashes():  # which are why, and have their cure
        yield Check(False, f"{len(faults)} of {count} plug-ins cannot be loaded for that reason")
        return
    for fault in faults:
        yield Check(False, fault)
    if not faults:
        yield Check(True, f"{count} plug-ins can be loaded")


def check_completion() -> Iterator[Check]:
    """Whether the shell completes."""
    try:
        installed = [Path.home() / name for name in COMPLETIONS if (Path.home() / name).is_file()]
    except RuntimeError:
        installed = []
    if installed:
        yield Check(True, f"shell completion is installed in {installed[0]}")
    else:
        yield Check(None, "no shell completion; designopt --install-completion")


CHECKS: tuple[Callable[[], Iterator[Check]], ...] = (
    check_python,
    check_requirements,
    check_packages,
    check_plug_ins,
    check_jax,
    check_opencv,
    check_cache,
    check_completion,
)
