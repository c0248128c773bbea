"""The command ``designopt calibrate``: a lens from pictures of a board, a finger from frames."""

from __future__ import annotations

import logging
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from designopt.cli.verbosity import is_quiet
from designopt.compilation_cache import NoCache, keep_programs
from designopt.errors import UserError

LOG = logging.getLogger("designopt.calibrate")

calibrate = typer.Typer(help="Calibrate a lens, or a finger, from pictures.", no_args_is_help=True)


class Part(StrEnum):
    """What may be calibrated alone."""

    PADS = "pads"


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
        LOG.warning("%s", line)
    print("\n".join(lines[:1] if is_quiet() else lines))
    return 0


@calibrate.command("finger")
def calibrate_finger(
    frames: Annotated[
        Path,
        typer.Argument(
            metavar="FRAMES.csv",
            help="Pictures and joint angles: the columns are image and, of each joint, "
            "<joint>_deg, which is empty where the angle is not known.",
        ),
    ],
    lens: Annotated[
        Path | None,
        typer.Option(metavar="LENS.toml", help="The lens, as 'designopt calibrate lens' has it."),
    ] = None,
    finger: Annotated[
        Path | None,
        typer.Option(metavar="FINGER.toml", help="The finger as designed, or its scene."),
    ] = None,
    only: Annotated[
        Part | None,
        typer.Option(help="Find the pads alone, after they were replaced; the rest is --sensor's."),
    ] = None,
    sensor: Annotated[
        Path | None,
        typer.Option(metavar="OLD.sensor", help="With --only: the sensor before, with its lens."),
    ] = None,
    out: Annotated[
        Path, typer.Option(metavar="NAME.sensor", help="The folder of the sensor.")
    ] = Path("finger.sensor"),
    width: Annotated[
        float | None,
        typer.Option(metavar="MM", help="Of the pads.", show_default="as the file states"),
    ] = None,
    gamma: Annotated[
        float | None,
        typer.Option(
            metavar="G",
            help="The camera's codes are light^(1/G).",
            show_default="that of the frames",
            min=0.3,
            max=4.0,
        ),
    ] = None,
    label_deviation: Annotated[
        float, typer.Option(metavar="DEG", help="Standard deviation of the joint angles.")
    ] = 0.1,
    light: Annotated[
        str | None,
        typer.Option(
            metavar="even|LIGHT.toml",
            help="How the pads are lit: evenly from all sides, or by the lamps in the file's "
            "[light.red], [light.green] and [light.blue]. 'designopt see' needs it for contacts.",
            show_default="that of --sensor, if any",
        ),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace an earlier sensor.")] = False,
    no_cache: NoCache = False,
) -> int:
    """Find the errors of a finger from frames, some with known joint angles, and make a sensor.

    Example:
      designopt calibrate finger frames.csv --lens lens.toml --finger finger.toml --out my.sensor
    """
    if (only is None) != (sensor is None):
        raise UserError("--only pads goes with --sensor OLD.sensor; give both or none")
    given = {"--lens": lens, "--finger": finger, "--width": width}
    own = [name for name, value in given.items() if value is not None]
    if sensor is not None and own:
        raise UserError(f"{own[0]} is that of --sensor; leave it out")
    keep_programs()
    from studies.commands.finger import calibrate_finger_from, read_design, read_with_new_pads
    from studies.models.sensor.light import read_light

    lit = None if light is None else read_light(light)
    if sensor is not None:
        known = read_with_new_pads(sensor)
    elif lens is None or finger is None:
        raise UserError("--lens LENS.toml and --finger FINGER.toml are missing; name the files")
    else:
        known = read_design(lens, finger, width)
    if lit is not None:
        known = known._replace(light=lit)
    lines, warnings = calibrate_finger_from(
        frames,
        known,
        out,
        gamma=gamma,
        label_deviation_deg=label_deviation,
        force=force,
    )
    for line in warnings:
        LOG.warning("%s", line)
    print("\n".join(lines[:1] if is_quiet() else lines))
    return 0
