"""A chamber drawn so that it can be redrawn fast: its section, its image, and Δl_D over η."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from matplotlib.artist import Artist
from matplotlib.figure import SubFigure
from matplotlib.patches import Circle

from designopt.plot.figures import PALETTE
from designopt.plot.ruling import Ruling

REGIONS = {"red AB": "#C0392B", "blue BC": PALETTE[0], "yellow CD": "#E0A800", "top DE": "#555555"}
"""Regions of the wall from the lens to the end, and their colours."""

FAINT = 0.25
"""How opaque the last good picture is while there is none of the present values."""

ROOM = 0.15
"""Part of a view that is left free around what it shows when its limits are chosen."""

LEAST_FILLED = 0.5
"""A view that shows less than this part of itself is narrowed."""

STEPS = 6
"""Most intervals between ticks along an axis."""
SMALL = 9
"""Size of their numbers, points."""

ALONG: tuple[Literal["x", "y"], ...] = ("x", "y")

Span = tuple[float, float]


@dataclass(frozen=True)
class ChamberLook:
    """What is drawn of one chamber. Lengths in mm.

    Attributes:
        points: of the wall, A, B, C, D, and E on the reference ray: distance along the centre
            line and height.
        pinhole: its place, likewise.
        image_radii: of the rings' edges at B, C and D on the sensor.
        ratio: η.
        offset_d: Δl_D.
        line: Δl_D at both ends of η's axis.
        offset_a: Δl_A, which |Δl_D| stays inside of.
    """

    points: Sequence[tuple[float, float]]
    pinhole: tuple[float, float]
    image_radii: Sequence[float]
    ratio: float
    offset_d: float
    line: Span
    offset_a: float


class ChamberPicture:
    """The views of a chamber in an area of a figure.

    Args:
        area: where the axes are made.
        ratios: ends of η's axis.
    """

    def __init__(self, area: SubFigure, ratios: Span) -> None:
        grid = area.add_gridspec(2, 2, width_ratios=(1.5, 1), height_ratios=(1.5, 1))
        self._section = area.add_subplot(grid[0, 0])
        self._line = area.add_subplot(grid[1, 0])
        self._sensor = area.add_subplot(grid[:, 1])
        self._ratios = ratios
        self._make_section()
        self._make_line()
        self._make_sensor()
        self._rulings = [
            Ruling(axes, along, STEPS, SMALL, grid=axes is not self._sensor)
            for axes in (self._section, self._line, self._sensor)
            for along in ALONG
        ]

    @property
    def artists(self) -> list[Artist]:
        """All that changes, in the order of drawing."""
        return [*self._rulings, self._center, *self._chamber]

    @property
    def _chamber(self) -> list[Artist]:
        return [
            self._room,
            self._ray,
            self._sights,
            *self._walls,
            self._pinhole,
            *self._names,
            self._rising,
            self._mark,
            self._red,
            *self._rings,
        ]

    def draw(self, look: ChamberLook) -> None:
        """Draw a chamber."""
        for artist in self._chamber:
            artist.set_alpha(None)
        places = dict(zip("ABCDE", look.points, strict=True))
        for wall, start, end in zip(self._walls, "ABCD", "BCDE", strict=True):
            wall.set_data(*zip(places[start], places[end], strict=True))
        nowhere = (math.nan, math.nan)
        ends = [place for name in "BCD" for place in (look.pinhole, places[name], nowhere)]
        self._sights.set_data(*zip(*ends, strict=True))
        self._pinhole.set_data([look.pinhole[0]], [look.pinhole[1]])
        self._ray.set_ydata([look.pinhole[1]] * 2)
        for text, place in zip(self._names, (*look.points, look.pinhole), strict=True):
            text.xy = place
        self._room.set(y=-look.offset_a, height=2 * look.offset_a)
        self._rising.set_ydata(look.line)
        self._mark.set_data([look.ratio], [look.offset_d])
        for ring, radius in zip(self._rings, look.image_radii, strict=True):
            ring.set_radius(radius)
        self._fit(look)

    def fade(self) -> None:
        """Show that the picture is not that of the present values."""
        for artist in self._chamber:
            artist.set_alpha(FAINT)

    def _make_section(self) -> None:
        axes = self._section
        axes.set(xlabel="distance s along the centre line (mm)", ylabel="height (mm), enlarged")
        axes.set_title("Section, with the sight lines to B, C and D")
        self._center = axes.axhline(0, color="0.55", linewidth=0.8, linestyle="-.", animated=True)
        (self._ray,) = axes.plot(
            [0, 1], [0, 0], ":", color="0.55", linewidth=0.8, transform=axes.get_yaxis_transform()
        )
        (self._sights,) = axes.plot([], [], color="0.3", linewidth=0.9)
        self._walls = [
            axes.plot([], [], color=color, linewidth=3.5, solid_capstyle="butt", label=name)[0]
            for name, color in REGIONS.items()
        ]
        (self._pinhole,) = axes.plot([], [], "o", color="black")
        self._names = [
            axes.annotate(name, (0, 0), beside, textcoords="offset points", ha="center")
            for name, beside in [*((name, (0, 6)) for name in "ABCD"), ("E", (0, -12))]
        ]
        self._names.append(
            axes.annotate("pinhole", (0, 0), (0, -12), textcoords="offset points", ha="left")
        )
        for artist in (self._ray, self._sights, *self._walls, self._pinhole, *self._names):
            artist.set_animated(True)

    def _make_line(self) -> None:
        axes = self._line
        axes.set(xlabel="η, yellow ring over blue ring", ylabel=r"$\Delta l_D$ (mm)")
        axes.set_title(r"$\Delta l_D$ over η; grey: inside $\Delta l_A$")
        self._room = axes.axhspan(-1, 1, color="0.9", animated=True)
        (self._rising,) = axes.plot(self._ratios, [0, 0], color=PALETTE[0], animated=True)
        (self._mark,) = axes.plot([], [], "o", color="black", animated=True)
        axes.set_xlim(self._ratios)

    def _make_sensor(self) -> None:
        axes = self._sensor
        axes.set(xlabel="on the sensor (mm)", aspect="equal")
        axes.set_title("Image rings")
        axes.grid(visible=False)
        red, *inner = REGIONS.values()
        # The red wall reaches to the lens, farther out than any sensor.
        self._red = axes.axhspan(0, 1, color=red, linewidth=0, animated=True)
        self._red.set_transform(axes.transAxes)
        self._rings = [Circle((0, 0), 0, color=c, linewidth=0, animated=True) for c in inner]
        for ring in self._rings:
            axes.add_patch(ring)

    def _fit(self, look: ChamberLook) -> None:
        """Choose limits of every view that what is drawn leaves, or no longer fills."""
        along, heights = zip(*look.points, look.pinhole, strict=True)
        offsets = (*look.line, -look.offset_a, look.offset_a)
        largest = max(look.image_radii)
        image = (-largest, largest)
        spans = {
            self._section: {"xlim": _span(along), "ylim": _span((*heights, 0.0))},
            self._line: {"ylim": _span(offsets)},
            self._sensor: {"xlim": image, "ylim": image} if largest > 0 else {},
        }
        for axes, shown in spans.items():
            views = {"xlim": axes.get_xlim(), "ylim": axes.get_ylim()}
            unfit = [name for name, span in shown.items() if not _holds(views[name], span)]
            axes.set(**{name: _wider(shown[name]) for name in unfit})


def _span(values: Sequence[float]) -> Span:
    return min(values), max(values)


def _wider(span: Span) -> Span:
    more = ROOM * (span[1] - span[0])
    return span[0] - more, span[1] + more


def _holds(view: Span, shown: Span) -> bool:
    """Whether a view shows all of it, and not mainly what is around it."""
    inside = view[0] <= shown[0] and shown[1] <= view[1]
    return bool(inside and shown[1] - shown[0] >= LEAST_FILLED * (view[1] - view[0]))
