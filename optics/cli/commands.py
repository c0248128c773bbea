"""The command ``designopt trace``: what the camera of a scene file sees, and where rays go."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Annotated

import typer

from designopt.cli.completion import complete_toml
from designopt.cli.verbosity import NOTE
from designopt.compilation_cache import NoCache, keep_programs
from designopt.io.files import check_toml

LOG = logging.getLogger("designopt.trace")


def trace(
    file: Annotated[
        Path,
        typer.Argument(metavar="SCENE.toml", help="The scene.", autocompletion=complete_toml),
    ],
    pose: Annotated[
        list[str] | None,
        typer.Option(metavar="ANGLE=DEG,...", help="Joint angles, degrees; those not named are 0."),
    ] = None,
    sweep: Annotated[
        list[str] | None,
        typer.Option(
            metavar="ANGLE=START:STOP:COUNT",
            help="Values of a joint angle, both ends included, degrees. Several sweeps make a "
            "grid; --pose gives the other angles.",
        ),
    ] = None,
    ray: Annotated[
        list[str] | None,
        typer.Option(
            metavar="X,Y,DEG",
            help="Follow a ray from a point (mm) in a direction (degrees counter-clockwise from "
            "+x); may be repeated.",
        ),
    ] = None,
    bounces: Annotated[
        int | None,
        typer.Option(metavar="N", help="Most reflections; by default as the scene says."),
    ] = None,
    json: Annotated[
        str, typer.Option(metavar="FILE|-", help="Where the result goes; - is standard output.")
    ] = "-",
    figure: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Draw the section into this file (png, svg, pdf), in up to six of the poses.",
        ),
    ] = None,
    chart: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Draw coverage and resolution over one or two swept angles."
        ),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace existing files.")] = False,
    no_cache: NoCache = False,
) -> int:
    """Trace what the camera of a scene sees, and rays.

    Example:
      designopt trace finger.toml --sweep pip=0:90:4 --json finger.json
    """
    check_toml(file, "scene")
    # Loaded here, so that neither listing the commands nor a file that cannot be read loads JAX.
    keep_programs()
    from optics.cli.tracing import trace_file

    remarks = trace_file(
        file,
        poses=pose or (),
        sweeps=sweep or (),
        rays=ray or (),
        bounces=bounces,
        json=json,
        figure=figure,
        chart=chart,
        force=force,
    )
    for line in remarks:
        LOG.log(NOTE, "%s", line)
    return 0
