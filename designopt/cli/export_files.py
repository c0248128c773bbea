"""What ``designopt export`` does: check, load, draw, and write all files or none."""

from __future__ import annotations

import importlib
import os
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path

import jax

from designopt.design_kind import Design
from designopt.designs import kind_of, load_design
from designopt.errors import UserError
from designopt.export.json import json_text
from designopt.export.parts import bill_text
from designopt.export.svg import svg_text
from designopt.io.files import check_targets, replaced_when_complete

ENDINGS = {
    "dxf": ".dxf",
    "svg": ".svg",
    "mjcf": ".xml",
    "json": ".json",
    "step": ".step",
    "bom": "-parts.csv",
    "sheet": "-sheet.pdf",
}
"""Endings of the files by their format."""

MODULES = {"dxf": "dxf", "step": "solids"}
NEEDED = {"dxf": ("ezdxf", "export"), "step": ("cadquery-ocp-novtk", "cad")}
"""Modules of the formats that need more packages: what is missing then, and the extra with it."""


def export_design(
    named: str,
    formats: Sequence[str],
    out: Path,
    *,
    settings: Sequence[str] = (),
    configs: Sequence[Path] = (),
    force: bool = False,
) -> list[Path]:
    """Write a design as files, all of them or none.

    Args:
        named: a study, a folder that ``designopt run`` wrote, or a file.
        formats: keys of `ENDINGS`.
        out: folder to write into; made if there is none.
        settings: ``key=value`` texts, for a study.
        configs: files with settings, for a study; see `read_config`.
        force: whether existing files are replaced.

    Returns:
        The files; they are called as what was named is.

    Raises:
        UserError: something of it is wrong; nothing is written.
    """
    writers = {form: _writer(form) for form in formats}
    names = {form: f"{_stem(named)}{ENDINGS[form]}" for form in formats}
    # Folders that are missing on the way do not hide where it leads: missing/.. is here.
    _check(Path(os.path.realpath(out)) if not os.path.isdir(out) else out, names, force=force)
    with jax.enable_x64(True):
        design = load_design(named, settings, configs)
        texts = {form: write(design) for form, write in writers.items()}
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UserError(f"--out {out}: cannot be made: {error.strerror}; choose another") from error
    _check(out, names, force=force)
    paths = [out / name for name in names.values()]
    with ExitStack() as stack:
        # All are complete before the first takes its place.
        for path, text in zip(paths, texts.values(), strict=True):
            partial = stack.enter_context(replaced_when_complete(path))
            partial.write_bytes(text if isinstance(text, bytes) else text.encode())
    return paths


def _stem(named: str) -> str:
    """What a file of a design is called: as what was named, a file without its ending."""
    kind = kind_of(named)
    if kind == "study":
        return named
    # Not the name of what a link leads to.
    return os.path.basename(os.path.abspath(named)) if kind == "folder" else Path(named).stem


def _check(out: Path, names: Mapping[str, str], *, force: bool) -> None:
    """Refuse files, by their formats, that could not be written or must not be replaced."""
    if _is_folder(out):
        targets = {f"--to {form}": out / name for form, name in names.items()}
        check_targets(targets, force=force)


def _is_folder(out: Path) -> bool:
    """Whether the folder is there; if not, that it can be made."""
    try:
        nearest = next(folder for folder in (out, *out.absolute().parents) if folder.exists())
    except OSError as error:
        raise UserError(f"--out {out}: {error.strerror}; choose another") from error
    if not nearest.is_dir():
        raise UserError(f"--out {out}: {nearest} is no folder; choose another")
    return nearest == out


def _writer(form: str) -> Callable[[Design], str | bytes]:
    """From a design to a file's content."""
    match form:
        case "svg":
            return lambda design: svg_text(design.drawing())
        case "json":
            return lambda design: json_text(design.name, design.quantities())
        case "mjcf":
            return lambda design: design.mjcf()
        case "bom":
            return lambda design: bill_text(design.assembly())
        case "sheet":
            return _sheet
    try:
        module = importlib.import_module(f"designopt.export.{MODULES[form]}")
    except ModuleNotFoundError as error:
        package, extra = NEEDED[form]
        raise UserError(
            f"--to {form}: the package {package} is missing; install designopt[{extra}]"
        ) from error
    if form == "dxf":
        return lambda design: module.dxf_text(design.drawing())
    return lambda design: module.step_text(design.name, design.assembly().parts)


def _sheet(design: Design) -> bytes:
    from designopt.export.sheet import sheet_pdf
    from designopt.plot.figures import style

    with style():
        return sheet_pdf(design.assembly())
