"""A design on the command line: a file of some kind, a study's design, or a study's result."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any, Literal

from designopt.design_kind import Design, installed_kinds, kind_of_tables
from designopt.errors import UserError
from designopt.io.files import check_toml, read_toml
from designopt.study.result_folders import DOCUMENT, recorded_spec
from designopt.study.settings import spec_of, spec_with
from designopt.study.settings_file import read_config
from designopt.study.study import STUDY_GROUP, Study, installed_studies, load_study


def load_design(named: str, settings: Sequence[str] = (), configs: Sequence[Path] = ()) -> Design:
    """The design that a person names.

    Args:
        named: a study, a file, or a folder that ``designopt run`` wrote; a study's name is the
            study even where a file or a folder has it too, which ``./NAME`` names.
        settings: ``key=value`` texts, for a study.
        configs: files with settings, for a study; see `read_config`.

    Raises:
        UserError: there is no such thing, or it has no design to show.

    Example:
        >>> design = load_design("studies/gallery/linkages/four-bar.toml")
        >>> design.name, design.kind.name
        ('four-bar', 'linkage')
    """
    kind, path = kind_of(named), Path(named)
    if kind == "study":
        study = load_study(named)
        config = read_config(configs, study)
        return _designed(study)(spec_with(study.spec, settings, study=named, config=config), None)
    given = [f"--set {text}" for text in settings] + [f"--config {path}" for path in configs]
    if given:
        raise UserError(f"{given[0]}: only a study has settings; change {named} itself")
    return _of_result(path) if kind == "folder" else _of_file(path)


def check_design(named: str) -> None:
    """Refuse what `load_design` would, as far as that can be seen before JAX is loaded.

    Raises:
        UserError: there is no such thing, or it has no design to show.
    """
    match kind_of(named):
        case "study":
            _designed(load_study(named))
        case "folder":
            _result_in(Path(named))
        case "file":
            check_toml(Path(named), "design")


def kind_of(named: str) -> Literal["study", "folder", "file"]:
    """What a person names; a study's name is the study even where a file or a folder has it too.

    Raises:
        UserError: the name is empty.
    """
    if not named:
        raise UserError("STUDY|FILE: it is empty; name a study, a file or a folder of a result")
    if named in {point.name for point in entry_points(group=STUDY_GROUP)}:
        return "study"
    # Not by a path's own methods, which raise where it cannot be looked at.
    if os.path.isdir(named):
        return "folder"
    return "file" if Path(named).suffix or os.path.exists(named) else "study"


def _of_file(path: Path) -> Design:
    kind = kind_of_tables(read_toml(path, "design"))
    if kind is not None:
        return Design(kind, kind.read(path))
    known = ", ".join(sorted(f"a {kind.name} has [{kind.table}]" for kind in installed_kinds()))
    raise UserError(
        f"{path}: it describes no design that is known here: {known}; correct it, or name the "
        f"study whose settings it has, with --config {path}"
    )


def _of_result(folder: Path) -> Design:
    name, tables = _result_in(folder)
    try:
        study = load_study(name)
    except UserError as error:
        raise UserError(f"{folder}: {error}") from error
    return _designed(study)(spec_of(study.spec, tables, source=str(folder)), folder / "specs")


def _result_in(folder: Path) -> tuple[str, dict[str, Any]]:
    """The name of a result's study, and its settings."""
    try:
        return recorded_spec(folder / DOCUMENT)
    except UserError as error:
        raise UserError(
            f"{folder}: a folder without a result of designopt run; name a file or a study"
        ) from error


def _designed(study: Study) -> Callable[..., Design]:
    if study.design is None:
        offered = [name for name, one in installed_studies() if getattr(one, "design", None)]
        raise UserError(
            f"study '{study.name}' measures and designs nothing that could be shown; "
            f"these design: {', '.join(offered)}"
        )
    return study.design
