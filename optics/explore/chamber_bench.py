"""A chamber with knobs: η and the wall's dimensions, its section and its image rings."""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from designopt.errors import UserError
from designopt.explore.bench import Bench, Knob, Reading, Shown, Step, Values
from designopt.io.spec import SpecFile
from designopt.solution import Solution
from optics.chamber.chamber import Chamber, ChamberResult
from optics.chamber.file import format_chamber
from optics.chamber.ratio import solve_dimension_for_ratio
from optics.explore.chamber_improving import Improver, rings_problem
from optics.plot.chamber_drawing import ChamberLook, ChamberPicture

if TYPE_CHECKING:
    from matplotlib.figure import SubFigure

    from optics.chamber.designed import DesignedChamber

ETA, THETA_BC = "η, imaging ratio", "θ_BC, blue wall"
OFFSET_A, OFFSET_B = "Δl_A, offset of A", "Δl_B, offset of B"
HEIGHT, PINHOLE = "h, reference height", "δ, pinhole offset"

FIELDS = {
    OFFSET_A: "offset_a",
    OFFSET_B: "offset_b",
    "a, red length": "length_ab",
    "b, blue length": "length_bc",
    "c, yellow length": "length_cd",
    "f, focal length": "focal_length",
    "v, image distance": "image_distance",
    HEIGHT: "reference_height",
    PINHOLE: "pinhole_offset",
}
"""Fields of a chamber by the names of the knobs that are they, in mm."""

SIGNED = (OFFSET_B, HEIGHT, PINHOLE)
"""Those of them that may be negative."""

RATIOS = (0.3, 1.2)
"""Range of η; wider where the chamber needs it."""

ANGLES_DEG = (-15.0, 15.0)
"""Range of θ_BC, likewise: about what is left until the camera looks along the blue wall."""

SHORTEST, LONGEST = 0.25, 2.0
"""Range of a length, in units of what it is at first."""

SHIFT = 0.05
"""How far a signed offset goes either way, in units of the chamber's length."""

ROUNDING = 1e-6
"""Mm that D may lie outside the wall without a word: an optimised D lies in it."""

WITHOUT_MARGIN = (ChamberResult.no_solution, ChamberResult.out_of_range)
"""Results whose margin measures something else than a chamber."""


class Look(NamedTuple):
    """What is computed of one set of values.

    Attributes:
        chamber: with the Δl_D that gives η.
        solved: Δl_D, mm.
        wall_angle_cd_deg: θ_CD, degrees.
        offset_c: Δl_C, mm.
        widths: of the rings: blue, yellow, top, mm.
        heights: of the images of B, C and D, mm.
        line: Δl_D at both ends of η's range, mm.
    """

    chamber: Chamber
    solved: Solution[Float[Array, ""]]
    wall_angle_cd_deg: Float[Array, ""]
    offset_c: Float[Array, ""]
    widths: Float[Array, "3"]
    heights: Float[Array, "3"]
    line: Float[Array, "2"]


@jax.jit
def looked_at(chamber: Chamber, ratio: Float[Array, ""], ratios: Float[Array, "2"]) -> Look:
    """Everything that is shown of a chamber at an imaging ratio.

    Args:
        chamber: all but its Δl_D.
        ratio: η wanted.
        ratios: both ends of its range.
    """
    solved = solve_dimension_for_ratio(chamber, "offset_d", ratio)
    chamber = dataclasses.replace(chamber, offset_d=solved.value)
    line = jax.vmap(lambda end: solve_dimension_for_ratio(chamber, "offset_d", end).value)(ratios)
    return Look(
        chamber,
        solved,
        jnp.rad2deg(chamber.wall_angle_cd),
        chamber.offset_c,
        chamber.ring_widths().value,
        chamber.image_heights().value,
        line,
    )


class ChamberBench(Bench):
    """A chamber's section beside its image, turned by its dimensions.

    η stands for Δl_D, which it decides: of the two, η is the knob and Δl_D a reading.

    Attributes:
        title: the chamber's name.
        knobs: η, θ_BC, the wall's offsets and lengths, and the camera's constants.
        aim: see `optics.explore.chamber_improving`.
    """

    aim = (
        "widen the narrowest ring by η, θ_BC and Δl_B, with B, C and D inside Δl_A; "
        "lengths and camera stay"
    )

    def __init__(self, design: DesignedChamber) -> None:
        chamber = self._chamber = design.chamber
        self.title = design.name
        self._name = design.name
        ratio = float(chamber.imaging_ratio().value)
        angle = math.degrees(float(chamber.wall_angle_bc))
        length = float(chamber.length_ab + chamber.length_bc + chamber.length_cd)
        self._ratios = _widened(RATIOS, ratio)
        knobs = [
            Knob(ETA, ratio, *self._ratios, "", "dimension"),
            Knob(THETA_BC, angle, *_widened(ANGLES_DEG, angle), "°", "dimension"),
        ]
        for name, field in FIELDS.items():
            value = float(getattr(chamber, field))
            low, high = SHORTEST * value, LONGEST * value
            if name in SIGNED:
                low, high = value - SHIFT * length, value + SHIFT * length
            knobs.append(Knob(name, value, low, high, "mm", "dimension"))
        self.knobs = tuple(knobs)
        self._picture: ChamberPicture | None = None

    def draw(self, area: SubFigure) -> None:
        """Make the section, the line of Δl_D over η, and the image."""
        self._picture = ChamberPicture(area, self._ratios)

    def show(self, values: Values) -> Shown:
        """The chamber at these values; where there is none, the last one is left, faint."""
        if self._picture is None:
            raise RuntimeError("draw an area before anything is shown in it")
        look = self._look(values)
        message = _failure(look)
        if message:
            self._picture.fade()
        else:
            self._picture.draw(_drawn(look, values[ETA]))
            message = _remark(look)
        return Shown(_readings(look, values[ETA]), self._picture.artists, message)

    def specs(self, values: Values) -> Sequence[SpecFile]:
        """The chamber's file.

        Raises:
            UserError: these values give no chamber.
        """
        chamber = self._buildable(values, "no chamber to write")
        text = format_chamber(self._name, chamber)
        return [SpecFile("chamber.toml", "the chamber, for `designopt explore`", text)]

    def optimise(self, values: Values) -> Iterator[Step]:
        """Widen the narrowest ring from here; see `optics.explore.chamber_improving`.

        Raises:
            UserError: these values give no image to improve.
        """
        chamber = self._buildable(values, "nothing to improve")
        if float(chamber.focal_length) == float(chamber.image_distance):
            raise UserError("nothing to improve: at f = v no ring has a width; change f or v")
        for walls, message in self._improver.steps(chamber, values[ETA]):
            turned = {
                ETA: float(walls.ratio),
                THETA_BC: math.degrees(float(walls.wall_angle_bc)),
                OFFSET_B: float(walls.offset_b),
            }
            yield Step({**values, **turned}, message)

    @functools.cached_property
    def _improver(self) -> Improver:
        ranges = {knob.name: (knob.low, knob.high) for knob in self.knobs}
        problem = rings_problem(
            self._chamber,
            ratios=ranges[ETA],
            angles=(math.radians(ranges[THETA_BC][0]), math.radians(ranges[THETA_BC][1])),
            offsets=ranges[OFFSET_B],
        )
        return Improver(problem, self._chamber)

    def _look(self, values: Values) -> Look:
        fields = {field: values[name] for name, field in FIELDS.items()}
        chamber = Chamber(**fields, wall_angle_bc=math.radians(values[THETA_BC]), offset_d=0.0)
        look = looked_at(chamber, jnp.asarray(values[ETA]), jnp.asarray(self._ratios))
        return jax.device_get(look)

    def _buildable(self, values: Values, otherwise: str) -> Chamber:
        look = self._look(values)
        if message := _failure(look):
            raise UserError(f"{otherwise}: {message}")
        return jax.tree.map(jnp.asarray, look.chamber)


def _widened(span: tuple[float, float], value: float) -> tuple[float, float]:
    """A range around a value that may lie outside of it."""
    low, high = span
    more = (high - low) / 4
    return (
        low if value >= low else value - more,
        high if value <= high else value + more,
    )


def _failure(look: Look) -> str:
    return look.solved.messages()[0]


def _remark(look: Look) -> str:
    """What keeps a chamber that has an image from being a good one."""
    chamber = look.chamber
    if chamber.offset_d > chamber.reference_height:
        return (
            "D lies beyond the reference ray, so the top has no ring: "
            "lower the imaging ratio or raise the reference height."
        )
    if _room(chamber) < -ROUNDING:
        return (
            f"D lies outside the wall at the lens, by {-_room(chamber):.3g} mm: "
            "change the imaging ratio, or raise Δl_A."
        )
    return ""


def _room(chamber: Chamber) -> float:
    return float(chamber.offset_a) - abs(float(chamber.offset_d))


def _drawn(look: Look, ratio: float) -> ChamberLook:
    chamber = jax.tree.map(float, look.chamber)
    s_b = chamber.length_ab
    s_c = s_b + chamber.length_bc
    s_d = s_c + chamber.length_cd
    bottom = -chamber.reference_height
    return ChamberLook(
        points=[
            (0.0, chamber.offset_a),
            (s_b, chamber.offset_b),
            (s_c, float(look.offset_c)),
            (s_d, -chamber.offset_d),
            (s_d, bottom),
        ],
        pinhole=(-chamber.pinhole_offset, bottom),
        # Beyond f = v the image is turned over; a top beyond the reference ray has no ring.
        image_radii=np.maximum(look.heights * np.sign(look.heights[0]), 0).tolist(),
        ratio=ratio,
        offset_d=chamber.offset_d,
        line=(float(look.line[0]), float(look.line[1])),
        offset_a=chamber.offset_a,
    )


def _readings(look: Look, ratio: float) -> list[Reading]:
    result = look.solved.result
    measures = not any(bool(result == other) for other in WITHOUT_MARGIN)
    ok = bool(look.solved.ok)
    blue, yellow, top = look.widths.tolist()
    height_b, height_c, height_d = look.heights.tolist()
    of_image = {
        ETA: (ratio, ""),
        "Δl_D, offset of D": (float(look.chamber.offset_d), "mm"),
        "θ_CD, yellow wall": (float(look.wall_angle_cd_deg), "°"),
        "Δl_C, offset of C": (float(look.offset_c), "mm"),
        "Δd_b, blue ring": (blue, "mm"),
        "Δd_c, yellow ring": (yellow, "mm"),
        "Δd_d, top": (top, "mm"),
        "T_B, image height": (height_b, "mm"),
        "T_C, image height": (height_c, "mm"),
        "T_D, image height": (height_d, "mm"),
        "room of D inside Δl_A": (_room(look.chamber), "mm"),
    }
    readings = [
        Reading(name, value if ok else None, unit) for name, (value, unit) in of_image.items()
    ]
    margin = float(look.solved.margin) if measures else None
    return [*readings, Reading("margin", margin, "mm")]
