"""The command ``designopt render``: trial pictures of a finger or a scene, with their truth."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from designopt.cli.completion import complete_toml
from designopt.cli.verbosity import is_quiet
from designopt.compilation_cache import NoCache, keep_programs
from designopt.io.files import check_new_folder, check_toml, printable


class Light(StrEnum):
    """How pads are lit."""

    even = "even"
    soft = "soft"
    lamps = "lamps"


def render(
    file: Annotated[
        Path,
        typer.Argument(
            metavar="FINGER.toml|SCENE.toml",
            help="The finger, or its scene.",
            autocompletion=complete_toml,
        ),
    ],
    out: Annotated[
        Path,
        typer.Option(
            metavar="FOLDER",
            help="Folder to make: pictures 000.png ..., frames.csv with their joint angles, "
            "contacts.csv with what is pressed in, truth.json with errors, results.json.",
        ),
    ],
    pose: Annotated[
        list[str] | None,
        typer.Option(
            metavar="JOINT=DEG,...",
            help="A picture with these joint angles, degrees; those not named are 0. May be "
            "repeated; with --sweep, the angles that are not swept.",
        ),
    ] = None,
    sweep: Annotated[
        list[str] | None,
        typer.Option(
            metavar="JOINT=START:STOP:COUNT",
            help="Values of a joint angle, both ends included, degrees. Several sweeps make a "
            "grid.",
        ),
    ] = None,
    random: Annotated[
        int | None,
        typer.Option(
            min=1,
            help="So many random poses, in the joints' ranges; in a scene, which has none, from 0 "
            "to 90 degrees.",
        ),
    ] = None,
    press: Annotated[
        list[str] | None,
        typer.Option(
            metavar="PAD:ALONG,ACROSS,DIAMETER[,DEPTH]",
            help="Press a ball into a pad, mm: its place from the pad's first end and from its "
            "middle across the section, the diameter of the contact, and how deep it goes (0.6, "
            "or a quarter of the diameter if that is less). May be repeated.",
        ),
    ] = None,
    untouched: Annotated[
        bool,
        typer.Option(
            "--untouched", help="Of every pose first a picture in which nothing is pressed in."
        ),
    ] = False,
    errors: Annotated[
        str,
        typer.Option(
            metavar="SEED|none",
            help="A finger with errors of fabrication, as the study proprioception samples them.",
        ),
    ] = "none",
    light: Annotated[
        Light,
        typer.Option(
            help="Even light; soft light that falls off, and is weaker on the outer phalanges; or "
            "line lamps beside the pads, in view."
        ),
    ] = Light.soft,
    gamma: Annotated[
        float, typer.Option(min=0.2, max=5, help="The camera stores light^(1/gamma).")
    ] = 1.0,
    noise: Annotated[
        float,
        typer.Option(
            min=0, max=1, help="Standard deviation at full scale, as a part of it; photon noise."
        ),
    ] = 0.02,
    blur: Annotated[
        float, typer.Option(min=0, max=20, help="Standard deviation of the point spread, px.")
    ] = 0.8,
    jpeg: Annotated[
        int | None,
        typer.Option(
            min=1, max=100, metavar="QUALITY", help="Pictures are JPEG.", show_default="PNG"
        ),
    ] = None,
    rows: Annotated[
        int | None, typer.Option(help="Height of the pictures, px.", show_default="the camera's")
    ] = None,
    width: Annotated[
        float | None,
        typer.Option(
            help="Of the pads across the section, mm.", show_default="that in the file, or 24"
        ),
    ] = None,
    seed: Annotated[
        int, typer.Option(min=0, help="Of random poses, noise and the pads' rough edges.")
    ] = 0,
    force: Annotated[
        bool, typer.Option("--force", help="Replace an earlier result in the folder.")
    ] = False,
    no_cache: NoCache = False,
) -> int:
    """Render pictures as the camera in a finger takes them, to try calibration and analysis on.

    Example:
      designopt render finger.toml --random 2 --errors 1 --rows 480 --out trial
    """
    check_toml(file, "scene")
    check_new_folder(out, force=force)
    # Loaded here, so that listing the commands loads neither JAX nor OpenCV.
    from designopt.interrupts import interruptible

    with interruptible() as check:
        keep_programs()
        from studies.commands.trial_pictures import Asked, write_pictures

        check()
    asked = Asked(
        poses=pose or (),
        sweeps=sweep or (),
        random=random,
        presses=press or (),
        untouched=untouched,
        errors=errors,
        light=light.value,
        gamma=gamma,
        noise=noise,
        blur=blur,
        jpeg=jpeg,
        rows=rows,
        width=width,
        seed=seed,
    )
    written = write_pictures(file, asked, out, force=force)
    print(printable(str(out)) if is_quiet() else written)
    return 0
