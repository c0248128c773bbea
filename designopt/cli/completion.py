"""What a shell offers for the word under the cursor; it is asked anew at every press of Tab.

Names come from the metadata of installed packages, so that no study is loaded for them; the keys of
a study's settings load that study's settings alone. Nothing loads JAX.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from importlib.metadata import entry_points

import typer


def complete_study(incomplete: str) -> list[str]:
    """Names of studies."""
    # Named here: the study's own module loads pydantic.
    names = sorted(point.name for point in entry_points(group="designopt.studies"))
    return [name for name in names if name.startswith(incomplete)]


def complete_toml(incomplete: str) -> list[str]:
    """TOML files, and folders to go on in."""
    folder, _, start = incomplete.rpartition("/")
    before = incomplete[: len(incomplete) - len(start)]
    return sorted(
        before + entry.name + ("/" if entry.is_dir() else "")
        for entry in _entries(folder or ("/" if before else "."))
        if entry.name.startswith(start)
        and (start or not entry.name.startswith("."))
        and (entry.is_dir() or entry.name.endswith(".toml"))
    )


def complete_design(incomplete: str) -> list[str]:
    """Names of studies, TOML files, and folders, which may be results of ``run``."""
    return complete_study(incomplete) + complete_toml(incomplete)


def complete_template(incomplete: str) -> list[str]:
    """Names that ``designopt new`` takes: those of studies and of files to begin with."""
    from designopt.errors import UserError, load_plug_in

    names = complete_study(incomplete)
    for point in entry_points(group="designopt.templates"):
        try:
            names += [one.name for one in load_plug_in(point, "the templates")]
        except UserError:  # 'designopt new --list' has what is wrong with it
            continue
    return [name for name in names if name.startswith(incomplete)]


def complete_setting(ctx: typer.Context, incomplete: str) -> list[tuple[str, str]]:
    """Keys of the settings of the study that the command names, each with what it means."""
    # An option that still lacks its value leaves the words before it unread.
    words = [*ctx.args, *(word for word in ctx.params.values() if isinstance(word, str))]
    named = next((word for word in words if word in complete_study("")), None)
    if named is None:
        return []
    from designopt.errors import UserError
    from designopt.study.settings import fields
    from designopt.study.study import load_study

    try:
        spec = load_study(named).spec
    except UserError:
        return []
    return [(f"{key}=", meaning) for key, _, meaning in fields(spec) if key.startswith(incomplete)]


def _entries(folder: str) -> Iterator[os.DirEntry[str]]:
    try:
        with os.scandir(folder) as entries:
            yield from entries
    except OSError:  # no such folder, or none that may be read
        return
