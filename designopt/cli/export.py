"""The command ``designopt export``: a design as files for other programs."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from designopt.cli.completion import complete_design, complete_setting
from designopt.cli.studies import ConfigFiles
from designopt.compilation_cache import NoCache, keep_programs
from designopt.errors import UserError


class Format(StrEnum):
    """Kinds of files that a design is written as."""

    dxf = "dxf"
    svg = "svg"
    mjcf = "mjcf"
    json = "json"
    step = "step"
    bom = "bom"
    sheet = "sheet"


def _folder(text: str | Path) -> Path:
    if text == "":
        raise UserError("--out: it is empty; name a folder, '.' for this one")
    return Path(text)


def export(
    named: Annotated[
        str,
        typer.Argument(
            metavar="STUDY|FILE",
            help="A study that designs something, a folder that 'run' wrote, or a file.",
            autocompletion=complete_design,
        ),
    ],
    to: Annotated[
        list[Format],
        typer.Option(
            "--to",
            help="DXF for CAD, SVG, MJCF for MuJoCo, JSON with every number; of a finger also STEP "
            "solids, a bill of materials (CSV) and an assembly sheet (PDF); may be repeated.",
        ),
    ],
    out: Annotated[
        Path,
        typer.Option(
            parser=_folder, metavar="DIR", help="Folder of the files; made if there is none."
        ),
    ] = Path("out/export"),
    settings: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="KEY=VALUE",
            help="Change a study's setting; repeatable.",
            autocompletion=complete_setting,
        ),
    ] = None,
    config: ConfigFiles = None,
    force: Annotated[bool, typer.Option("--force", help="Replace existing files.")] = False,
    no_cache: NoCache = False,
) -> int:
    """Export a design to CAD, drawing, simulation or numbers.

    Example:
      designopt export finger --to dxf --to bom --out cad
    """
    # Imported here, so that neither listing the commands nor a wrong name loads JAX.
    from designopt.designs import check_design

    check_design(named)
    keep_programs()
    from designopt.cli.export_files import export_design
    from designopt.io.files import printable

    formats = list(dict.fromkeys(part.value for part in to))
    files = export_design(
        named, formats, out, settings=settings or [], configs=config or [], force=force
    )
    for path in files:
        print(printable(str(path)))
    return 0
