"""Trial pictures of a finger in its poses, and beside them what is true of them."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from designopt.errors import UserError
from designopt.interrupts import interruptible
from designopt.io.csv_text import csv_text
from designopt.io.files import printable
from designopt.io.spec_files import FORMAT
from designopt.progress import step_display
from designopt.study.result_folders import cannot_write, result_folder, write_document
from optics import Fabrication, Imaging, Scene, name_fabrication_errors
from optics.cli.tracing import posed_angles
from optics.rendering import Effects, Imprint, Renderer, encode_picture
from studies.models.sensor.imaged import Imaged, read_imaged, width_of
from studies.models.sensor.made import (
    carried_by_camera,
    deviations_of,
    lens_fault,
    sample_finger,
)
from studies.models.sensor.spec import LEAST_ROWS, MOST_ROWS, MadeSpec

MOST_PICTURES = 10_000
MOST_PIXELS = MOST_ROWS**2
"""Rendering takes some 150 bytes for each."""

MOST_WIDTH = 1000.0
"""Of pads, mm."""

RANGE_DEG, TURN_DEG = 90.0, 360.0
"""Greatest angle of the joints of a scene: in random poses, and of all, to either side."""

DEPTH, LEAST_DEPTH = 0.6, 0.01
"""To which a ball is pressed in, mm, unless a quarter of the contact's diameter is less; least."""

ALWAYS = ("mirror_loss", "vignetting", "ambient", "rounding", "roughness")
"""Effects of a well-made finger in any light."""

LIGHTS = {
    "even": (),
    "soft": ("led_falloff", "dim_outer"),
    "lamps": ("lamps", "shadows", "strips", "walls", "dim_outer"),
}
"""Effects that each light adds."""

LONGEST_SEED = 18
"""Digits."""

PRESS = "PAD:ALONG,ACROSS,DIAMETER[,DEPTH]"


@dataclass(frozen=True)
class Asked:
    """What is asked for; see the options of ``designopt render``.

    Attributes:
        poses: ``joint=value``, several divided by commas, degrees; a picture each.
        sweeps: ``joint=start:stop:count`` or ``joint=value``, degrees.
        random: number of random poses; ``None`` for none.
        presses: ``pad:along,across,diameter`` or ``pad:along,across,diameter,depth``, mm.
        untouched: whether every pose is rendered first with nothing pressed in.
        errors: the seed of a finger's errors, or ``"none"``.
        light: a key of `LIGHTS`.
        gamma: of the camera's response.
        noise: standard deviation at full scale, as a part of it.
        blur: standard deviation of the point spread, px.
        jpeg: quality of JPEG; ``None`` for PNG.
        rows: height of the pictures, px; ``None`` for the camera's.
        width: of the pads, mm; ``None`` for that in the file.
        seed: of random poses, noise and rough edges.
    """

    poses: Sequence[str] = ()
    sweeps: Sequence[str] = ()
    random: int | None = None
    presses: Sequence[str] = ()
    untouched: bool = False
    errors: str = "none"
    light: str = "soft"
    gamma: float = 1.0
    noise: float = 0.02
    blur: float = 0.8
    jpeg: int | None = None
    rows: int | None = None
    width: float | None = None
    seed: int = 0


class Contact(NamedTuple):
    """A ball that is pressed in, mm; see `Imprint.of_contact`."""

    pad: str
    along: float
    across: float
    diameter: float
    depth: float

    def imprint(self) -> Imprint:
        """As it is rendered."""
        return Imprint.of_contact(self.along, self.across, self.diameter, self.depth)


class Shot(NamedTuple):
    """One picture: joint angles in the scene's order, degrees, and what is pressed in."""

    pose: Float[np.ndarray, " joints"]
    contacts: list[Contact]


def write_pictures(file: Path, asked: Asked, out: Path, *, force: bool) -> str:
    """Render pictures and write them to a folder, complete or not at all.

    Args:
        file: of a finger or a scene.
        asked: what is asked for.
        out: folder to make; see `result_folder`.
        force: whether an earlier result may be replaced.

    Returns:
        A line on what was written.

    Raises:
        UserError: something in the file or in the request is wrong; nothing is written.
    """
    with (
        result_folder(out, force=force) as folder,
        jax.enable_x64(True),
        step_display() as step,
        interruptible() as check,
    ):
        imaged = read_imaged(file)
        scene = imaged.scene
        width = _width(scene, asked.width)
        shots = shots_of(imaged, width, asked)
        effects, errors = effects_of(asked), errors_of(scene, asked.errors)
        with step("The finger"):
            camera = Renderer(
                scene,
                width,
                effects,
                errors=None if errors is None else errors.made,
                carried=carried_by_camera(scene),
                rows=_rows(scene, asked.rows),
                seed=asked.seed,
            )
        rows, columns = camera.imaging.shape
        document = {
            "format": FORMAT,
            "command": "render",
            "file": str(file),
            "settings": asdict(asked),
            "effects": asdict(effects),
            "width_mm": width,
            "image": {"columns": columns, "rows": rows},
        }
        try:
            with step(f"{len(shots)} pictures"):
                _write_shots(shots, camera, asked.jpeg, folder, step.count(len(shots)))
            if errors is not None:
                text = json.dumps(errors.table(scene), indent=1, ensure_ascii=False)
                (folder / "truth.json").write_text(text + "\n", encoding="utf-8")
            write_document(folder, document)
        except OSError as error:
            raise cannot_write(out, error) from error
        check()
    return f"{printable(str(out))}: {len(shots)} pictures of {columns}x{rows} px, frames.csv"


def shots_of(imaged: Imaged, width: float, asked: Asked) -> list[Shot]:
    """All pictures that are asked for.

    Args:
        imaged: the scene.
        width: of its pads, mm.
        asked: of which poses, presses and the seed matter here.

    Raises:
        UserError: there is no such joint or pad, a pose is out of its range, a contact off its pad,
            or there are too many.
    """
    poses = poses_of(imaged, asked)
    contacts = [contact_of(text, imaged.scene, width) for text in asked.presses]
    if asked.untouched and not contacts:
        raise UserError("--untouched: nothing is pressed in; add --press, or leave it out")
    of_each = [[], contacts] if asked.untouched else [contacts]
    if len(poses) * len(of_each) > MOST_PICTURES:
        raise UserError(
            f"--pose, --sweep, --random: these are {len(poses) * len(of_each):,} pictures, and at "
            f"most {MOST_PICTURES:,} are made; ask for fewer poses"
        )
    return [Shot(pose, pressed) for pose in poses for pressed in of_each]


def poses_of(imaged: Imaged, asked: Asked) -> Float[np.ndarray, "poses joints"]:
    """Joint angles of all poses, degrees; random ones are whole thousandths.

    Raises:
        UserError: a text of another form, an unknown joint, or an angle out of its range.
    """
    scene, ranges = imaged.scene, imaged.ranges_deg
    joints = scene.angle_names
    if asked.random is not None:
        if others := [*asked.poses, *asked.sweeps]:
            raise UserError(
                f"--random {asked.random}: {others[0]} gives poses, too; leave out one of them"
            )
        tops = (RANGE_DEG,) * len(joints) if ranges is None else ranges
        generator = np.random.default_rng([asked.seed, 7])
        return generator.uniform(0, tops, (asked.random, len(joints))).round(3)
    if asked.sweeps or not asked.poses:
        poses = posed_angles(scene, asked.poses, asked.sweeps)
    else:
        poses = np.concatenate([posed_angles(scene, [one], ()) for one in asked.poses])
    for joint, values, end in zip(
        joints, poses.T, ranges or (TURN_DEG,) * len(joints), strict=True
    ):
        start = 0.0 if ranges else -end
        beyond = values[(values < start) | (values > end)]
        if len(beyond):
            swept = any(text.startswith(f"{joint}=") for text in asked.sweeps)
            place = f"{'--sweep' if swept else '--pose'} {joint}={beyond[0]:g}"
            raise UserError(
                f"{place}: it bends from {start:g} to {end:g} degrees; give an angle in that range"
            )
    return poses


def contact_of(text: str, scene: Scene, width: float) -> Contact:
    """What a text such as ``distal:10,-3,5`` presses in.

    Args:
        text: as it was written after ``--press``.
        scene: with the pads.
        width: of these, mm.

    Raises:
        UserError: it has another form, there is no such pad, the contact does not lie on it, or the
            ball goes deeper than half of its diameter.
    """
    place = f"--press {text}"
    pad, _, numbers = text.rpartition(":")
    names = [one.name for one in scene.layout.pads]
    if pad not in names:
        known = ", ".join(names) or "none"
        raise UserError(f"{place}: no pad is named '{pad}'; there are: {known}; write {PRESS}")
    try:
        values = [float(part) for part in numbers.split(",")]
    except ValueError:
        values = []
    if len(values) not in (3, 4) or not np.isfinite(values).all():
        raise UserError(f"{place}: write it as {PRESS}, numbers in mm")
    along, across, diameter = values[:3]
    depth = values[3] if len(values) == 4 else min(DEPTH, diameter / 4)
    if not LEAST_DEPTH <= depth <= diameter / 2:
        raise UserError(
            f"{place}: a ball goes at least {LEAST_DEPTH:g} mm deep, and at most half as deep as "
            "its contact is wide; change DIAMETER or DEPTH"
        )
    start, end = np.asarray(scene.pads[names.index(pad)])
    length, half = float(np.hypot(*(end - start))), diameter / 2
    if not (half <= along <= length - half and abs(across) <= width / 2 - half):
        raise UserError(
            f"{place}: the contact is not all on the pad, which is {length:g} mm long and "
            f"{width:g} mm wide; move it, or make it smaller"
        )
    return Contact(pad, along, across, diameter, depth)


def effects_of(asked: Asked) -> Effects:
    """What makes the pictures worse; JPEG does so in the file."""
    named = Effects.of(dict.fromkeys([*ALWAYS, *LIGHTS[asked.light]], 1.0), gamma=asked.gamma)
    return replace(named, noise=asked.noise, blur=asked.blur)


class Errors(NamedTuple):
    """Sampled errors of a finger, and their standard deviations."""

    made: Fabrication
    deviations: Fabrication
    seed: int

    def table(self, scene: Scene) -> dict[str, Any]:
        """Every error by its name, which has its unit."""
        names = name_fabrication_errors(scene.layout, self.made)
        values, deviations = (
            np.concatenate([np.ravel(leaf) for leaf in jax.tree.leaves(one)]).tolist()
            for one in (self.made, self.deviations)
        )
        rows = zip(names, values, deviations, strict=True)
        keys = ("error", "value", "deviation")
        return {"seed": self.seed, "errors": [dict(zip(keys, row, strict=True)) for row in rows]}


def errors_of(scene: Scene, text: str) -> Errors | None:
    """Errors of the finger with the number 0 of the studies with a seed; ``None`` for ``none``.

    Raises:
        UserError: it is neither, or the lens has no errors of its own.
    """
    if text == "none":
        return None
    if not (text.isascii() and text.isdigit() and len(text) <= LONGEST_SEED):
        raise UserError(f"--errors {text}: write a seed, a whole number from 0, or none")
    if fault := lens_fault(scene):
        raise UserError(f"--errors {text}: {scene.layout.name}: {fault}; or leave --errors out")
    deviations = deviations_of(MadeSpec(), scene)
    return Errors(sample_finger(deviations, int(text), 0)[0], deviations, int(text))


def _width(scene: Scene, asked: float | None) -> float:
    if asked is None:
        return width_of(scene)
    if not 0 < asked <= MOST_WIDTH:
        raise UserError(f"--width {asked:g}: give more than 0 and at most {MOST_WIDTH:g} mm")
    return asked


def _rows(scene: Scene, asked: int | None) -> int:
    """Height of the pictures, px."""
    if asked is not None:
        scene = eqx.tree_at(lambda one: one.camera.pixels, scene, jnp.asarray(float(asked)))
    rows, columns = Imaging.of(scene.camera).shape
    if not (LEAST_ROWS <= rows <= MOST_ROWS and 2 * rows <= rows * columns <= MOST_PIXELS):
        raise UserError(
            f"{scene.layout.name}: pictures of {columns}x{rows} px cannot be made; choose --rows "
            f"from {LEAST_ROWS} to {MOST_ROWS} by which they have at least two columns and at most "
            f"{MOST_PIXELS:,} pixels"
        )
    return rows


def _write_shots(
    shots: Sequence[Shot],
    camera: Renderer,
    jpeg: int | None,
    folder: Path,
    is_done: Callable[[], None],
) -> None:
    """Write the pictures and the tables of their poses and contacts; each is reported as done."""
    joints = [f"{joint}_deg" for joint in camera.scene.angle_names]
    frames: list[list[object]] = [["image", *joints]]
    touches: list[list[object]] = [["image", "pad", "along_mm", "across_mm", "diameter_mm"]]
    digits, ending = max(3, len(str(len(shots) - 1))), "png" if jpeg is None else "jpg"
    for number, (pose, contacts) in enumerate(shots):
        imprints: dict[str, list[Imprint]] = {}
        for one in contacts:
            imprints.setdefault(one.pad, []).append(one.imprint())
        picture = camera.render(np.deg2rad(pose), imprints, frame=number)
        name = f"{number:0{digits}}.{ending}"
        (folder / name).write_bytes(encode_picture(picture.pixels, jpeg))
        frames.append([name, *pose.tolist()])
        touches += [[name, *one[:4]] for one in contacts]
        is_done()
    for name, rows in (("frames.csv", frames), ("contacts.csv", touches)):
        if len(rows) > 1:
            (folder / name).write_text(csv_text(rows), encoding="utf-8", newline="")
