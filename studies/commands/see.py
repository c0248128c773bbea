"""The command ``designopt see``: joint angles and pads from pictures, a video or a camera."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import typer

from designopt.compilation_cache import NoCache, keep_programs
from designopt.errors import UserError
from designopt.interrupts import deferred

PORT = 8989


def see(
    source: Annotated[
        str,
        typer.Argument(
            metavar="SOURCE",
            help="A picture, a folder of pictures, a video, a camera by its number (0) or an "
            "address (http://..., rtsp://...).",
        ),
    ],
    sensor: Annotated[
        Path,
        typer.Option(
            metavar="NAME.sensor", help="The sensor, as 'designopt calibrate finger' makes it."
        ),
    ],
    out: Annotated[
        Path,
        typer.Option(
            metavar="FOLDER",
            help="Folder to make: readings.csv has a row for each frame, readings.jsonl a line "
            "with everything for each, lost ones too.",
        ),
    ] = Path("out/see"),
    overlay: Annotated[
        bool,
        typer.Option(
            "--overlay",
            help="Write what is found over the frames: pictures in overlay/, or overlay.avi of a "
            "video or a camera.",
        ),
    ] = False,
    pads: Annotated[
        bool,
        typer.Option(
            "--pads",
            help="Write every pad as seen from straight above, 10 px per mm, and its change since "
            "the calibration (128 is none, 255 is +50 %) to pads/, and the greatest change and "
            "what is pressed in (center, diameter, deviations) to the readings. Contacts ask for "
            "[light] in the sensor's sensor.toml.",
        ),
    ] = False,
    frames: Annotated[
        int | None,
        typer.Option(
            min=1, metavar="N", help="End after so many frames.", show_default="the source's end"
        ),
    ] = None,
    as_json: Annotated[
        bool,
        typer.Option("--json", help="Print the lines of readings.jsonl, too, as they come."),
    ] = False,
    live: Annotated[
        bool,
        typer.Option("--live", help="Serve a page for a browser on this machine meanwhile."),
    ] = False,
    port: Annotated[
        int | None,
        typer.Option(
            min=0, max=65535, help="Of the page; 0 takes any free one.", show_default=str(PORT)
        ),
    ] = None,
    force: Annotated[
        bool, typer.Option("--force", help="Replace an earlier result in the folder.")
    ] = False,
    no_cache: NoCache = False,
) -> int:
    """Read joint angles, views and pads from the pictures of a calibrated finger.

    A camera is read until Ctrl-C. Lost frames are lines on standard error, and stand in
    readings.jsonl. Where a picture contradicts the finger there is no angle, but a reason.

    Example:
      designopt see 0 --sensor my.sensor --live
    """
    if port is not None and not live:
        raise UserError(f"--port {port}: only a page has a port; add --live")
    # Loaded here, so that listing the commands loads neither JAX nor OpenCV.
    with deferred() as is_interrupted:
        keep_programs()
        # XLA's threads: a frame's programs are small, and processes of ours have the other cores.
        os.environ.setdefault("NPROC", "1")
        from studies.commands.seen import Asked, see_source
    if is_interrupted():
        raise KeyboardInterrupt
    asked = Asked(
        overlay=overlay,
        pads=pads,
        frames=frames,
        json=as_json,
        port=(PORT if port is None else port) if live else None,
        force=force,
    )
    return see_source(source, sensor, out, asked)
