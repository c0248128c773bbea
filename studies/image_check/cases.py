"""What is photographed: fingers with errors, layers on their pads, light, things pressed in."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from optics import Fabrication, Scene, parse_scene
from optics.scene.writer import scene_tables
from studies.image_check import ImageCheckSpec
from studies.models.finger_file import bare_finger
from studies.models.sensor.poses import spread_angles
from studies.models.sensor.spec import WIDTH
from studies.oracles.judge.capture import Capture
from studies.oracles.judge.contacts import Contact
from studies.oracles.judge.fabrication import sample_errors
from studies.oracles.judge.frames import ASPECT
from studies.oracles.judge.lens import Lens
from studies.oracles.judge.solids import FOOT, TOP
from studies.oracles.judge.solids import GAP as GAP_IN_AIR
from studies.oracles.judge.wide_lens import WideLens

ACRYLIC = {"red": 1.489, "green": 1.493, "blue": 1.499}
"""Refractive indices at 630, 530 and 465 nm, by the dispersion of N. Sultanova et al., Acta Phys.
Pol. A 116 (2009) 585, as tabulated at refractiveindex.info."""

GEL = 1.41

PLATE = {"thickness": 3, "index": ACRYLIC}
POLISHED, GLOWING = ({"from": "black", "to": "black", "beside": kind} for kind in ("clear", "lamp"))
"""Walls beside the section that mirror, and that lamps are coupled to: these are no mirrors."""

PADS: dict[str, dict[str, Any]] = {
    "none": {},
    "3 mm": {"layers": [PLATE]},
    "3+2 mm": {
        "layers": [
            PLATE | {"overhang": 1, "bevel_deg": -10},
            {"thickness": 2, "index": GEL, "overhang": [0.5, 1]},
        ]
    },
    "3 mm, polished": {"layers": [PLATE | {"sides": POLISHED}]},
    "3 mm, lamps": {"layers": [PLATE | {"sides": GLOWING}]},
    "3 mm, pupil": {"layers": [PLATE]},
}
"""Keys of the pads, by the name of their layers."""

PUPIL = {"3 mm, pupil": [0.4, 0.02]}
"""Shift of the camera's entrance pupil, mm per rad² and rad⁴."""

RANGES_DEG = {"3+2 mm": 70.0}
"""Of both joints: beyond, layers that overhang run into each other."""

EVEN, GAP, COUPLED = "even", "lamps behind a gap", "lamps coupled"

CONDITIONS = (
    (EVEN, "none"),
    (GAP, "none"),
    (EVEN, "3 mm"),
    (GAP, "3 mm, polished"),
    (EVEN, "3+2 mm"),
    (COUPLED, "3 mm, lamps"),
    (EVEN, "3 mm, polished"),
    (GAP, "3 mm, polished"),
    (EVEN, "3 mm, pupil"),
    (COUPLED, "3 mm, lamps"),
)
"""Light and layers of one finger after the other."""

CALIBRATED = (EVEN, "3 mm"), (GAP, "none"), (COUPLED, "3 mm, lamps")
"""Of those whose lens is not the designed one."""

LENS_SPREADS, OFFSET_PX = (0.03, 5e-3, 5e-4), 15.0
"""Standard deviations of k₁, k₂ and k₃ of such a lens, and of where its axis is imaged."""

PUPILS = (0.2, 0.6), 0.03
"""Range of e₂ of such a lens, mm per rad², and the standard deviation of e₄."""

WIDEST = math.radians(88)
"""Angle from the axis up to which such a lens has an image."""

UNTOUCHED = 5
"""Of so many frames beside the labelled ones, one has nothing pressed in."""

KINDS = ("sphere", "ball", "edge", "studs")

GAMMA = 2.2
"""Of the pictures in the light of lamps."""


class Finger(NamedTuple):
    """One fabricated finger.

    Attributes:
        number: of it.
        light: how its frames are lit.
        layers: name of what lies on its pads.
        tables: of its scene's file as the judge takes it: to that a wall with a lamp is clear.
        errors: as the judge has drawn them; estimators never get them.
        poses: joint angles of its frames, the labelled ones first, degrees.
        captures: of its frames.
        lens: that of its camera, if it is not the designed one.
    """

    number: int
    light: str
    layers: str
    tables: dict[str, Any]
    errors: dict[str, Any]
    poses: Float[np.ndarray, "frames joints"]
    captures: list[Capture]
    lens: WideLens | None = None


def pose_of(angles: Float[np.ndarray, " joints"]) -> dict[str, float]:
    """Joint angles by their names, degrees."""
    return dict(zip(("pip", "dip"), angles.tolist(), strict=True))


def nominal(layers: str) -> dict[str, Any]:
    """Tables of the bare finger with layers on its pads, plain numbers and lists."""
    tables = json.loads(json.dumps(scene_tables(bare_finger().scene())))
    tables["pads"] = [pad | PADS[layers] | {"width": WIDTH} for pad in tables["pads"]]
    if layers in PUPIL:
        tables["camera"]["pupil_shift"] = PUPIL[layers]
    return tables


def with_lamps(tables: dict[str, Any]) -> dict[str, Any]:
    """With what hides pads behind the lamps that stand across the section, in air."""
    lamps = []
    for pad in tables["pads"]:
        start, end = (complex(*pad[one]) for one in ("from", "to"))
        along = (end - start) / abs(end - start)
        up = 1j * along if pad["side"] == "left" else -1j * along
        foot, top = (start - GAP_IN_AIR * along + height * up for height in (FOOT, TOP))
        place = {"from": [foot.real, foot.imag], "to": [top.real, top.imag]}
        body = {"body": pad["body"]} if "body" in pad else {}
        lamps.append({"name": f"lamp of {pad['name']}"} | place | body)
    return {**tables, "blockers": [*tables["blockers"], *lamps]}


def without_layers(tables: Mapping[str, Any]) -> Scene:
    """The finger as the model of bare pads in air has it."""
    pads = [{k: v for k, v in pad.items() if k != "layers"} for pad in tables["pads"]]
    camera = {k: v for k, v in tables["camera"].items() if k != "pupil_shift"}
    return parse_scene({**tables, "pads": pads, "camera": camera}, "finger in air")


def fingers(spec: ImageCheckSpec, deviations: Mapping[str, Any], seed: int) -> Iterator[Finger]:
    """All fingers of a run."""
    for number in range(spec.fingers + spec.calibrated):
        further = number - spec.fingers
        conditions = CONDITIONS if further < 0 else CALIBRATED
        light, layers = conditions[(number if further < 0 else further) % len(conditions)]
        generator = np.random.default_rng([seed, number])
        tables = nominal("3 mm, polished" if light == COUPLED else layers)
        lens = None if further < 0 else _own_lens(tables["camera"], generator)
        has = {"thickness", "index"} if "layers" not in tables["pads"][0] else set()
        has |= set() if layers in PUPIL else {"pupil"}
        has |= set() if lens is None else {"distortion"}  # it has its own coefficients
        own = {name: value for name, value in deviations.items() if name not in has}
        errors = sample_errors(tables, own, generator)
        top = RANGES_DEG.get(layers, 90.0)
        labelled = spread_angles([(0.0, top)] * 2, spec.labelled)
        poses = np.concatenate([labelled, generator.uniform(0, top, (spec.frames, 2))]).round(3)
        capture = _capture(light, generator)
        captures = [
            dataclasses.replace(
                capture,
                exposure=float(generator.uniform(0.5, 0.9)),
                contacts=_contacts(tables, generator) if _pressed(i - spec.labelled) else (),
            )
            for i in range(len(poses))
        ]
        yield Finger(number, light, layers, tables, errors, poses, captures, lens)


def _own_lens(camera: dict[str, Any], generator: np.random.Generator) -> WideLens:
    """Put another lens into ``[camera]``, and return it as boards are photographed with it."""
    coefficients = (*(generator.normal(0, 1, 3) * LENS_SPREADS).tolist(), 0.0)
    pupil = generator.uniform(*PUPILS[0]), generator.normal(0, PUPILS[1])
    offset = generator.normal(0, OFFSET_PX, 2)
    camera |= {"projection": list(coefficients), "axis_offset_px": offset.tolist()}
    camera |= {"pupil_shift": list(pupil)}
    made = Lens.of(camera, (1 + 0j, 0j), ASPECT)
    size = made.columns, made.rows
    return WideLens(size, made.focal, made.middle, ((1.0, coefficients),), pupil, WIDEST)


def _pressed(frame: int) -> bool:
    return frame >= 0 and (frame + 1) % UNTOUCHED != 0


def _capture(light: str, generator: np.random.Generator) -> Capture:
    blur = float(generator.uniform(0.4, 0.8))
    if light == EVEN:
        return Capture(blur=blur)
    return Capture(
        light="lamps",
        coupling="coupled" if light == COUPLED else "air",
        walls=float(generator.uniform(0.02, 0.08)),
        gamma=GAMMA,
        blur=blur,
        defocus=float(generator.uniform(0, 20)),
        flare=float(generator.uniform(0, 0.02)),
        jpeg=int(generator.integers(85, 96)),
    )


def _contacts(tables: Mapping[str, Any], generator: np.random.Generator) -> tuple[Contact, ...]:
    """One thing pressed somewhere into every pad, near its corners, too."""
    found = []
    for pad in tables["pads"]:
        kind = KINDS[int(generator.integers(len(KINDS)))]
        depth = generator.uniform(0.1, 0.5 if kind == "studs" else 0.8)
        along, turn = generator.uniform(0, [math.dist(pad["from"], pad["to"]), math.pi])
        across = generator.uniform(-WIDTH / 2, WIDTH / 2)
        found.append(Contact(pad["name"], kind, *map(float, (along, across, depth, turn))))
    return tuple(found)


def plain(deviations: Fabrication) -> dict[str, Any]:
    """Errors by their names, as numbers and lists."""
    named = {
        field.name: getattr(deviations, field.name) for field in dataclasses.fields(deviations)
    }
    return {name: np.asarray(value).tolist() for name, value in named.items() if value is not None}


def in_deviations(
    errors: Mapping[str, Any], deviations: Fabrication
) -> Float[np.ndarray, " errors"]:
    """Errors in units of their standard deviations, in the order of the estimators."""
    stated = plain(deviations)
    parts = [np.ravel(errors[name]) / np.ravel(stated[name]) for name in stated]
    return np.concatenate(parts)
