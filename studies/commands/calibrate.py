"""The command ``designopt calibrate``: a lens from pictures of a board."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from designopt.compilation_cache import NoCache, keep_programs

calibrate = typer.Typer(help="Calibrate a lens from pictures.", no_args_is_help=True)


@calibrate.callback()
def _calibrate() -> None:
    """Calibrate a lens from pictures of a board.

    Example:
      designopt calibrate lens pictures --out lens.toml
    """


@calibrate.command("lens")
def calibrate_lens(
    pictures: Annotated[
        str, typer.Argument(metavar="FOLDER|VIDEO", help="Pictures of a calibration board.")
    ],
    board: Annotated[
        Path | None,
        typer.Option(
            metavar="BOARD.toml",
            help="The board, as 'designopt new board' writes it.",
            show_default="that command's",
        ),
    ] = None,
    distance: Annotated[
        str,
        typer.Option(
            metavar="MM:MM",
            help="Nearest and farthest distance of the board from the lens, mm: those at which "
            "the finger's pads will be. Pictures from elsewhere give a warning.",
        ),
    ] = "15:60",
    out: Annotated[
        Path, typer.Option(metavar="LENS.toml", help="Where to the lens; its figure stands beside.")
    ] = Path("lens.toml"),
    force: Annotated[bool, typer.Option("--force", help="Replace existing files.")] = False,
    no_cache: NoCache = False,
) -> int:
    """Find projection, principal point and moving pupil of a camera from pictures of a board.

    Example:
      designopt calibrate lens pictures --out lens.toml
    """
    keep_programs()
    # Loaded here, so that listing the commands loads neither JAX nor OpenCV.
    from studies.commands.lens import calibrate_from

    lines, warnings = calibrate_from(pictures, board, distance, out, force=force)
    for line in warnings:
        print(f"warning: {line}", file=sys.stderr)
    print("\n".join(lines))
    return 0
