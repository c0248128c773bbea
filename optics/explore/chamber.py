"""A chamber that a person turns: its section, its image rings, and Δl_D over η."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from designopt.explore.explorer import (
    Chart,
    Explorer,
    ExplorerState,
    Handle,
    Numbers,
    Readout,
    Series,
    View,
    inside_ranges,
    number_text,
)
from designopt.export.drawing import Place
from designopt.optimize.parametric import Values
from designopt.programs import Program
from designopt.solution import Solution
from optics.chamber.chamber import Chamber, ChamberResult
from optics.chamber.designed import DesignedChamber
from optics.export.chamber_drawing import draw_chamber, draw_light, draw_rings
from optics.parametric.chamber import ChamberParameters, chamber_at

SECTION, IMAGE, LINE = "section", "image", "Δl_D over η"
"""Names of the panels."""

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


@Program
def look_at(numbers: Float[Array, " parameters"], ratios: Float[Array, "2"]) -> Look:
    """Everything that is shown of a chamber.

    Args:
        numbers: of its parameters, in their order and units.
        ratios: both ends of η's range.
    """
    chamber, solved = chamber_at(numbers)
    ends = jax.vmap(lambda ratio: chamber_at(numbers.at[0].set(ratio))[0].offset_d)(ratios)
    return Look(
        chamber,
        solved,
        jnp.rad2deg(chamber.wall_angle_cd),
        chamber.offset_c,
        chamber.ring_widths().value,
        chamber.image_heights().value,
        ends,
    )


@Program
def _ratio(chamber: Chamber) -> Solution[Float[Array, ""]]:
    return chamber.imaging_ratio()


class ChamberExplorer(Explorer):
    """A chamber's section beside its image, turned by its dimensions; nothing of it moves.

    η stands for Δl_D, which it decides: of the two, η is turned and Δl_D is read.
    """

    joints = ()

    def __init__(self, design: DesignedChamber) -> None:
        """Nothing is compiled yet.

        Args:
            design: the chamber.
        """
        self.design = self._parameters = ChamberParameters(design)
        ranges = {one.name: (one.low, one.high) for one in self.design.parameters}
        self._ratios = ranges["imaging_ratio"]
        self._designed = design.chamber
        ratio = self.values()["imaging_ratio"]
        line = _line(self._ratios, None, float(design.chamber.offset_a), ratio)
        self._views, self._line = self.sketch(), line

    def sketch(self) -> Sequence[View]:
        """Section and image as they are in the file."""
        return self._drawn(self._designed, {}, {})

    def show(self, values: Values) -> ExplorerState:
        """The chamber at these values; where there is none, the picture stays that of the last."""
        look = look_at(self._parameters.vector(values), jnp.asarray(self._ratios, float))
        ratio, message = values["imaging_ratio"], look.solved.messages()[0]
        if bool(look.solved.ok):
            self._views = self._drawn(look.chamber, _wall_notes(look), _ring_notes(look))
            self._line = _line(
                self._ratios, look.line.tolist(), float(look.chamber.offset_a), ratio
            )
            message = _remark(look.chamber)
        numbers = Numbers(_readouts(look, ratio), [self._line], message)
        return ExplorerState(self._views, lambda: numbers)

    def drag(self, values: Values, handle: str, place: Place) -> dict[str, float]:
        """As `Explorer.drag`."""
        found = {**values}
        x, y = place
        if handle == "A":
            self._set(found, offset_a=y)
        elif handle == "B":
            self._set(found, length_ab=x, offset_b=y)
        elif handle == "C":
            self._set(found, length_bc=x - values["length_ab"])
            fall = math.atan2(values["offset_b"] - y, found["length_bc"])
            self._set(found, wall_angle_bc=math.degrees(fall))
        elif handle == "D":
            self._set(found, length_cd=x - values["length_ab"] - values["length_bc"])
            chamber, _ = chamber_at(self._parameters.vector(found))
            ratio = _ratio(dataclasses.replace(chamber, offset_d=jnp.asarray(-y, float)))
            if bool(ratio.ok):
                self._set(found, imaging_ratio=float(ratio.value))
        else:
            self._set(found, pinhole_offset=-x, reference_height=-y)
        return found

    def _set(self, found: dict[str, float], **moved: float) -> None:
        """Change values, inside their ranges."""
        found |= inside_ranges(self.design.parameters, moved)

    def _drawn(
        self, chamber: Chamber, walls: dict[str, str], rings: dict[str, str]
    ) -> Sequence[View]:
        title = self.design.title
        section = draw_chamber(chamber, title=title)
        layers, light = draw_light(chamber)
        section = section._replace(
            layers=[*layers, *section.layers], polylines=[*light, *section.polylines]
        )
        places = {label.text: label.place for label in section.labels}
        moved = {
            "A": ("offset_a",),
            "B": ("length_ab", "offset_b"),
            "C": ("length_bc", "wall_angle_bc"),
            "D": ("length_cd", "imaging_ratio"),
            "pinhole": ("pinhole_offset", "reference_height"),
        }
        handles = [Handle(name, places[name], names) for name, names in moved.items()]
        return [
            View(SECTION, section, handles, walls),
            View(IMAGE, draw_rings(chamber, title=title), notes=rings),
        ]


def _line(
    ratios: tuple[float, float], ends: Sequence[float] | None, offset_a: float, at: float
) -> Chart:
    """Δl_D over η, which is a straight line, and the Δl_A that it stays inside of."""
    series = [Series("Δl_A", ratios, (offset_a,) * 2), Series("−Δl_A", ratios, (-offset_a,) * 2)]
    if ends is not None:
        series.insert(0, Series("Δl_D", ratios, ends))
    return Chart(LINE, "η, yellow ring over blue ring", "Δl_D (mm)", series, at)


def _remark(chamber: Chamber) -> str:
    """What keeps a chamber that has an image from being a good one."""
    if chamber.focal_length == chamber.image_distance:
        return "At f = v no ring has a width: change f or v."
    if chamber.offset_d > chamber.reference_height:
        return (
            "D lies beyond the reference ray, so the top has no ring: "
            "lower the imaging ratio or raise the reference height."
        )
    room = _room(chamber)
    if room < -ROUNDING:
        return (
            f"D lies outside the wall at the lens, by {-room:.3g} mm: "
            "change the imaging ratio, or raise Δl_A."
        )
    return ""


def _room(chamber: Chamber) -> float:
    return float(chamber.offset_a) - abs(float(chamber.offset_d))


def _wall_notes(look: Look) -> dict[str, str]:
    chamber = jax.tree.map(float, look.chamber)
    blue = math.degrees(chamber.wall_angle_bc)
    return {
        "red wall": f"a = {chamber.length_ab:.4g} mm",
        "blue wall": f"b = {chamber.length_bc:.4g} mm, θ_BC = {blue:.4g}°",
        "yellow wall": f"c = {chamber.length_cd:.4g} mm, θ_CD = {look.wall_angle_cd_deg:.4g}°",
        "top": f"Δl_D = {chamber.offset_d:.4g} mm",
        "pinhole": f"h = {chamber.reference_height:.4g} mm, δ = {chamber.pinhole_offset:.4g} mm",
    }


def _ring_notes(look: Look) -> dict[str, str]:
    widths = zip(("blue ring", "yellow ring", "top"), look.widths.tolist(), strict=True)
    return {name: f"{number_text(abs(width))} mm wide" for name, width in widths}


def _readouts(look: Look, ratio: float) -> list[Readout]:
    result, ok = look.solved.result, bool(look.solved.ok)
    measures = not any(bool(result == other) for other in WITHOUT_MARGIN)
    blue, yellow, top = look.widths.tolist()
    height_b, height_c, height_d = look.heights.tolist()
    of_image = {
        "η, imaging ratio": (ratio, ""),
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
    found = [Readout(name, value if ok else None, unit) for name, (value, unit) in of_image.items()]
    return [*found, Readout("margin", float(look.solved.margin) if measures else None, "mm")]
