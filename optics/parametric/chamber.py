"""A chamber as named numbers: η and the wall's dimensions, and the widths of its image rings."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from designopt.errors import UserError
from designopt.io.spec import SpecFile
from designopt.optimize.parametric import Measure, MeasureBound, Parameter, ParametricDesign, Values
from designopt.solution import Solution
from optics.chamber.chamber import Chamber
from optics.chamber.designed import DesignedChamber
from optics.chamber.file import format_chamber
from optics.chamber.ratio import solve_dimension_for_ratio

LABELS = {
    "imaging_ratio": "η, imaging ratio",
    "wall_angle_bc": "θ_BC, blue wall",
    "offset_a": "Δl_A, offset of A",
    "offset_b": "Δl_B, offset of B",
    "length_ab": "a, red length",
    "length_bc": "b, blue length",
    "length_cd": "c, yellow length",
    "focal_length": "f, focal length",
    "image_distance": "v, image distance",
    "reference_height": "h, reference height",
    "pinhole_offset": "δ, pinhole offset",
}
"""The parameters: fields of a chamber, but η in place of Δl_D, which it decides."""

NAMES = tuple(LABELS)

SIGNED = ("offset_b", "reference_height", "pinhole_offset")
"""Those of the lengths that may be negative."""

RATIOS = (0.3, 1.2)
"""Range of η; wider where the chamber needs it."""

ANGLES_DEG = (-15.0, 15.0)
"""Range of θ_BC, likewise: about what is left until the camera looks along the blue wall."""

SHORTEST, LONGEST = 0.25, 2.0
"""Range of a length, in units of what it is at first."""

SHIFT = 0.05
"""How far a signed offset goes either way, in units of the chamber's length."""

ROOM = MeasureBound("room", ">=", 0.0, "B, C and D inside Δl_A")
"""Paper A's requirement for D (|Δl_D| inside Δl_A, §II.A) asked of all three: a reading."""

RINGS = ("ring_blue", "ring_yellow", "ring_top")


def chamber_at(numbers: Float[Array, " parameters"]) -> tuple[Chamber, Solution[Array]]:
    """The chamber of the numbers of `NAMES`, and its Δl_D (mm) as it was found.

    η decides Δl_D. Traced by JAX.
    """
    fields = dict(zip(NAMES, numbers, strict=True))
    ratio, angle = fields.pop("imaging_ratio"), jnp.deg2rad(fields.pop("wall_angle_bc"))
    chamber = Chamber(**fields, wall_angle_bc=angle, offset_d=jnp.zeros_like(ratio))
    solved = solve_dimension_for_ratio(chamber, "offset_d", ratio)
    return dataclasses.replace(chamber, offset_d=solved.value), solved


_found = jax.jit(chamber_at)


class ChamberParameters(ParametricDesign):
    """The wall and the camera of a chamber.

    Only η, θ_BC and Δl_B are free unless others are named. The camera's constants are bought, not
    designed; and every ring widens as its region nears the pinhole, without end, until the camera's
    field of view cuts it off, of which a chamber has no number.
    """

    free = ("imaging_ratio", "wall_angle_bc", "offset_b")

    def __init__(self, design: DesignedChamber) -> None:
        """The parameters of a chamber, with their ranges.

        Args:
            design: the chamber.
        """
        chamber, self.title = design.chamber, design.name
        ratio = float(chamber.imaging_ratio().value)
        angle = math.degrees(float(chamber.wall_angle_bc))
        length = float(chamber.length_ab + chamber.length_bc + chamber.length_cd)
        parameters = [
            Parameter("imaging_ratio", ratio, *_widened(RATIOS, ratio), ""),
            Parameter("wall_angle_bc", angle, *_widened(ANGLES_DEG, angle), "°"),
        ]
        for name in NAMES[2:]:
            value = float(getattr(chamber, name))
            low, high = SHORTEST * value, LONGEST * value
            if name in SIGNED:
                low, high = value - SHIFT * length, value + SHIFT * length
            parameters.append(Parameter(name, value, low, high))
        self.parameters = tuple(
            dataclasses.replace(one, label=LABELS[one.name]) for one in parameters
        )
        largest = float(jnp.max(jnp.abs(chamber.image_heights().value))) or 1.0
        self._slope = largest / length
        colors = ("blue ring", "yellow ring", "top")
        which = ("B", "C", "D")
        self.measures = (
            Measure(
                "ring",
                "mm",
                "width of the narrowest ring",
                scale=largest,
                where=lambda index: colors[index[0]],
            ),
            *(
                Measure(name, "mm", f"width of the {color} in the image", scale=largest)
                for name, color in zip(RINGS, colors, strict=True)
            ),
            Measure("imaging_ratio", "", "η, width of the yellow ring over that of the blue one"),
            Measure(
                "room",
                "mm",
                "how far B, C and D are inside Δl_A",
                scale=float(chamber.offset_a),
                where=lambda index: which[index[0]],
            ),
        )
        self.requirements = (ROOM,)

    def evaluate(
        self, values: Float[Array, " parameters"], of: tuple[str, ...]
    ) -> dict[str, Float[Array, "..."]]:
        """As `ParametricDesign.evaluate`.

        Where there is no image, rings have a width below 0 that grows with what is missing.
        """
        chamber, solved = chamber_at(values)
        # Beyond f = v the image is turned over, and as wide.
        side = jnp.sign(chamber.focal_length - chamber.image_distance)
        missing = jnp.broadcast_to(self._slope * jnp.minimum(solved.margin, 0.0), (3,))
        rings = jnp.where(solved.ok, side * chamber.ring_widths().value, missing)
        offsets = jnp.stack([chamber.offset_b, chamber.offset_c, chamber.offset_d])
        found = {
            "ring": rings,
            "imaging_ratio": values[NAMES.index("imaging_ratio")],
            "room": chamber.offset_a - jnp.abs(offsets),
        }
        found |= dict(zip(RINGS, rings, strict=True))
        return {name: found[name] for name in of}

    def judge(self, values: Values) -> dict[str, float]:
        """As `ParametricDesign.judge`: by the image heights of B, C and D (paper A, Eq. 1)."""
        chamber = self.chamber(values)
        upright = math.copysign(1.0, float(chamber.focal_length - chamber.image_distance))
        heights = upright * np.asarray(chamber.image_heights().value, float)
        blue, yellow, top = (heights - np.append(heights[1:], 0.0)).tolist()
        offsets = (chamber.offset_b, chamber.offset_c, chamber.offset_d)
        return {
            "ring": min(blue, yellow, top),
            "ring_blue": blue,
            "ring_yellow": yellow,
            "ring_top": top,
            "imaging_ratio": yellow / blue if blue else math.nan,
            "room": float(chamber.offset_a) - max(abs(float(offset)) for offset in offsets),
        }

    def files(self, values: Values) -> Sequence[SpecFile]:
        """The chamber's file."""
        text = format_chamber(self.title, self.chamber(values))
        return [SpecFile("chamber.toml", "the chamber, for `designopt explore`", text)]

    def chamber(self, values: Values) -> Chamber:
        """The chamber with these values.

        Raises:
            UserError: there is none, and why.
        """
        chamber, solved = _found(self.vector(values))
        if not bool(solved.ok):
            raise UserError(f"{self.title}: {solved.messages()[0]}")
        return chamber


def _widened(span: tuple[float, float], value: float) -> tuple[float, float]:
    """A range around a value that may lie outside of it."""
    low, high = span
    more = (high - low) / 4
    return (
        low if value >= low else value - more,
        high if value <= high else value + more,
    )
