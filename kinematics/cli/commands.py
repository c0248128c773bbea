"""The command ``designopt solve``: a linkage file over a sweep of its inputs."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Annotated

import typer

from designopt.cli.completion import complete_toml
from designopt.cli.verbosity import NOTE
from designopt.compilation_cache import NoCache, keep_values
from designopt.errors import UserError
from designopt.io.files import check_toml

LOG = logging.getLogger("designopt.solve")


def solve(
    file: Annotated[
        Path,
        typer.Argument(metavar="LINKAGE.toml", help="The linkage.", autocompletion=complete_toml),
    ],
    sweep: Annotated[
        list[str] | None,
        typer.Option(
            metavar="INPUT=START:STOP:COUNT",
            help="Values of an input, both ends included, or one value; degrees or mm. "
            "Several sweeps make a grid.",
        ),
    ] = None,
    rate: Annotated[
        list[str] | None,
        typer.Option(metavar="INPUT=VALUE", help="Velocity of an input, rad/s or mm/s."),
    ] = None,
    accel: Annotated[
        list[str] | None,
        typer.Option(metavar="INPUT=VALUE", help="Its acceleration, rad/s² or mm/s²."),
    ] = None,
    of: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="Solve only for this joint or body; may be repeated."),
    ] = None,
    csv: Annotated[
        str, typer.Option(metavar="FILE|-", help="Where the table goes; - is standard output.")
    ] = "-",
    figure: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Draw the motion into this file (png, svg, pdf)."),
    ] = None,
    animation: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Animate the motion (gif, mp4).")
    ] = None,
    plan: Annotated[
        bool, typer.Option("--plan", help="Say how the linkage is solved, and stop.")
    ] = False,
    force: Annotated[bool, typer.Option("--force", help="Replace existing files.")] = False,
    no_cache: NoCache = False,
) -> int:
    """Solve a linkage over a sweep of its inputs.

    Exit code 0: the table is written. 1: it is written, and no pose in it can be assembled. 2:
    something in the file or in the command was wrong.

    Example:
      designopt solve four-bar.toml --sweep crank=0:360:37 --csv four-bar.csv
    """
    check_toml(file, "linkage")
    keep_values()
    # Loaded here, so that listing the commands loads neither NumPy nor what reads linkages.
    from kinematics.cli.solving import Request, print_plan, solve_file

    if plan:
        if sweep or rate or accel or figure or animation:
            raise UserError("--plan: it solves nothing; leave out what asks for poses")
        print_plan(file, of)
        return 0
    request = Request(
        file=file,
        sweeps=tuple(sweep or ()),
        rates=tuple(rate or ()),
        accelerations=tuple(accel or ()),
        of=None if of is None else tuple(of),
        csv=csv,
        figure=figure,
        animation=animation,
        force=force,
    )
    remarks, assembled = solve_file(request)
    for line in remarks:
        LOG.log(NOTE, "%s", line)
    return 0 if assembled else 1
