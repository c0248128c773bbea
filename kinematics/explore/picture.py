"""The picture of a linkage's bench: the pose with its curves, the margin, transmission angles."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import SubFigure
from matplotlib.patches import Rectangle
from matplotlib.transforms import ScaledTranslation

from designopt.plot.figures import PALETTE
from designopt.plot.lettering import Lettering
from designopt.plot.quick_text import QuickText
from designopt.plot.ruling import Ruling, hold
from designopt.plot.typesetting import drawn_name
from kinematics.explore.survey import EDGES, InputSweep
from kinematics.model.topology import Structure
from kinematics.plot.drawing import (
    LABELS,
    ROOM,
    Scene,
    draw_faint,
    draw_fixed,
    draw_scene,
    offsets_of,
)
from kinematics.plot.label_layout import FONT, turned
from kinematics.plot.motion_figures import draw_paths, traced_joints
from kinematics.plot.symbols import INK, Points

Place = tuple[float, float, float, float]

SPARE = 0.15
"""How much farther than needed axes reach that had to be changed, as a part of what is needed."""

LEAST_TRANSMISSION_DEG = 40.0
"""A common limit of design: R. L. Norton, Design of Machinery, 6th ed., section 4.10."""

LOCK = "#B00020"
"""Colour of the limits of what can be assembled."""

CLEAR = math.radians(35)
"""Between a fixed joint's name and a body, seen from the joint."""

LEFT = {"loc": "left", "fontsize": 9}
SMALL = 8
"""Size of ticks and names of axes, in points."""
BELOW = -22.5
"""From an axis along an input to the line its name is written on, in points."""
DEGREES = (1, 1.5, 2, 3, 4.5, 5, 6, 9, 10)
"""Round steps of an angle, times a power of ten."""


@dataclass(frozen=True)
class Layout:
    """Where the axes stand: left, bottom, width and height as parts of the area.

    Attributes:
        pose: of the pose.
        margin: of the margin.
        angle: of the transmission angles.
        steps: most intervals between ticks: of the pose, along an input, and of the margin.
        pins: pins side by side in the legend.
        angles: title of the angles.
    """

    pose: Place
    margin: Place
    angle: Place
    steps: tuple[int, int, int]
    pins: int
    angles: str


WIDE = Layout(
    (0.078, 0.09, 0.472, 0.84),
    (0.62, 0.56, 0.36, 0.37),
    (0.62, 0.09, 0.36, 0.37),
    steps=(8, 8, 6),
    pins=4,
    angles="Transmission angle μ (°)",
)
"""The pose on the left, the others on the right."""

NARROW = Layout(
    (0.155, 0.46, 0.825, 0.49),
    (0.155, 0.09, 0.325, 0.24),
    (0.61, 0.09, 0.36, 0.24),
    steps=(6, 3, 4),
    pins=3,
    angles="μ (°)",
)
"""The pose above, the others below, in an area that is higher than wide."""


class Picture:
    """Three axes, and everything in them that changes."""

    def __init__(
        self,
        area: SubFigure,
        structure: Structure,
        pins: Sequence[str],
        surveys: Sequence[InputSweep],
    ) -> None:
        """Make the axes.

        Args:
            area: where.
            structure: of the linkage.
            pins: those with a transmission angle.
            surveys: one for every input; the axes are as large as all of these need.
        """
        layout = WIDE if area.bbox.width >= area.bbox.height else NARROW
        self._structure, self._layout = structure, layout
        self._pose = area.add_axes(layout.pose)
        self._margin = area.add_axes(layout.margin)
        self._angle = area.add_axes(layout.angle)
        self._low, self._high = np.full(2, np.inf), np.full(2, -np.inf)
        self._top = 0.0
        self._column: int | None = None
        self._set_up()
        draw_paths(
            self._pose, structure, {j: np.full((1, 2), np.nan) for j in traced_joints(structure)}
        )
        self._paths = list(self._pose.lines)
        self._zero = self._margin.axhline(0.0, color="0.3", linewidth=0.9)
        self._curve = self._margin.plot([], [], color=INK, linewidth=1.4)[0]
        self._angles = {
            pin: self._angle.plot([], [], label=drawn_name(pin), color=PALETTE[n % len(PALETTE)])[0]
            for n, pin in enumerate(pins)
        }
        both = (self._margin, self._angle)
        self._here = [axes.axvline(0.0, color=INK, linewidth=0.9, zorder=3) for axes in both]
        self._dot = self._margin.plot([0.0], [0.0], "o", color=INK, clip_on=False, zorder=4)[0]
        self._spans = [_span(axes) for axes in both for _ in range(EDGES + 1)]
        self._edges = [
            axes.axvline(0.0, color=LOCK, linewidth=1.1, zorder=2.5)
            for axes in both
            for _ in range(EDGES)
        ]
        self._values = [
            self._margin.text(0.0, 0.98, "", color=LOCK, fontsize=8, va="top", zorder=5)
            for _ in range(EDGES)
        ]
        for text in self._values:
            text.set_transform(self._margin.get_xaxis_transform())
        if pins:
            self._angle.legend(
                loc="lower right",
                bbox_to_anchor=(1.0, 1.0),
                ncols=min(len(pins), layout.pins),
                fontsize=SMALL,
                handlelength=1.2,
                handletextpad=0.4,
                columnspacing=0.9,
                borderaxespad=0.2,
                borderpad=0.1,
            )
        self._kept: list[Artist] = [
            *(*self._rulings, *self._abscissas, *self._paths, self._zero, self._curve),
            *(*self._angles.values(), *self._here, self._dot),
            *(*self._spans, *self._edges, *self._values),
        ]
        for artist in self._kept:
            artist.set_animated(True)
        self._fit_places(np.vstack([survey.places() for survey in surveys]), 0.0)
        self._fit(surveys[0])
        self._hold()
        self._drawn: list[Artist] = []
        self._good = surveys[0].scene()
        self._at = self._good.angles
        paths = [surveys[0].joints[joint] for joint in traced_joints(structure)]
        seen = [path[np.isfinite(path[:, 0])] for path in paths]
        offsets = offsets_of(self._pose, [self._good], seen)
        self._offsets = {name: np.array(offset) for name, offset in offsets.items()}
        transforms = self._pose.transData, area.dpi_scale_trans
        style = {"color": INK, "rim": 2.0, "zorder": LABELS, "animated": True}
        self._names = {name: Lettering(name, FONT, *transforms, **style) for name in offsets}
        for text in self._names.values():
            self._pose.add_artist(text)
        self._kept += self._names.values()
        self._move_names()

    def _set_up(self) -> None:
        self._pose.set(xlabel="x (mm)", ylabel="y (mm)")
        self._pose.set_title(drawn_name(self._structure.name), **LEFT)
        self._margin.set_title("Margin (mm)", **LEFT)
        self._angle.set(ylim=(0, 92), yticks=range(0, 91, 15 if self._layout is WIDE else 30))
        self._angle.set_title(self._layout.angles, **LEFT)
        self._angle.tick_params(labelsize=SMALL)
        places, inputs, margins = self._layout.steps
        self._rulings = [
            Ruling(self._pose, "x", places, SMALL),
            Ruling(self._pose, "y", places, SMALL),
            Ruling(self._margin, "x", inputs, SMALL, steps=DEGREES),
            Ruling(self._margin, "y", margins, SMALL),
            Ruling(self._angle, "x", inputs, SMALL, steps=DEGREES),
        ]
        for text in (self._pose.xaxis.label, self._pose.yaxis.label):
            text.set_fontsize(SMALL)
        # One above the other, they have the abscissa in common.
        named = (self._angle,) if self._layout is WIDE else (self._margin, self._angle)
        below = ScaledTranslation(0.0, BELOW / 72, self._angle.figure.dpi_scale_trans)  # pyright: ignore[reportArgumentType]
        style: Any = {"fontsize": SMALL, "ha": "center", "clip_on": False}
        self._abscissas = [
            QuickText(0.5, 0.0, "", transform=axes.transAxes + below, **style) for axes in named
        ]
        for axes, text in zip(named, self._abscissas, strict=True):
            axes.add_artist(text)
        self._angle.axhline(
            LEAST_TRANSMISSION_DEG, color="0.3", linewidth=0.9, linestyle=(0, (4, 3))
        )

    def show(self, survey: InputSweep | None) -> list[Artist]:
        """Draw a survey, or where it has no pose the last one that was good, faintly.

        Args:
            survey: what to draw; none where the bodies have no shape, so that nothing else
                changes.

        Returns:
            Everything that changes, in the order of drawing.
        """
        for artist in self._drawn:
            artist.remove()
        if survey is not None:
            self._fit(survey)
            self._draw_curves(survey)
        self._hold()
        before = set(map(id, self._pose.get_children()))
        for text in self._names.values():
            text.set_visible(survey is not None and survey.ok)
        if survey is not None and survey.ok:
            self._good = survey.scene()
            draw_scene(self._pose, self._good, {})
            self._move_names()
        else:
            draw_fixed(self._pose, self._good)
            draw_faint(self._pose, self._good)
        self._drawn = [one for one in self._pose.get_children() if id(one) not in before]
        for artist in self._drawn:
            artist.set_animated(True)
        shown = [one for one in (*self._kept, *self._drawn) if one.get_visible()]
        return sorted(shown, key=lambda artist: artist.get_zorder())

    def _move_names(self) -> None:
        scene = self._good
        for name, text in self._names.items():
            x, y = scene.joints[name].tolist()
            offset = turned(self._offsets[name], scene.angles[name] - self._at[name])
            if name in self._structure.fixed_joints:
                offset = _beside(scene, name, offset)
            text.move((x, y), (float(offset[0]), float(offset[1])))

    def _draw_curves(self, survey: InputSweep) -> None:
        across = survey.across()
        for line in self._paths:
            path = survey.joints[str(line.get_gid()).removeprefix("path:")]
            line.set_data(path[:, 0], path[:, 1])
        self._curve.set_data(across, survey.margin)
        for pin, line in self._angles.items():
            line.set_data(across, np.degrees(survey.angles[pin]))
        here = survey.shown(survey.here)
        for line in self._here:
            line.set_xdata([here, here])
        # What is missing lies below the axes; its mark stays at their lower end.
        self._dot.set_data([here], [max(survey.margin_here, self._margin.get_ylim()[0])])
        self._dot.set_color(INK if survey.ok else LOCK)
        self._draw_edges(survey)

    def _draw_edges(self, survey: InputSweep) -> None:
        low, high = self._margin.get_xlim()
        bad = [(survey.shown(start), survey.shown(end)) for start, end in survey.gaps()]
        for half in (0, 1):
            for number in range(EDGES + 1):
                patch = self._spans[half * (EDGES + 1) + number]
                patch.set_visible(number < len(bad))
                if number < len(bad):
                    patch.set_x(bad[number][0])
                    patch.set_width(bad[number][1] - bad[number][0])
            for number in range(EDGES):
                line = self._edges[half * EDGES + number]
                line.set_visible(number < len(survey.edges))
                if number < len(survey.edges):
                    line.set_xdata([survey.shown(survey.edges[number].value)] * 2)
        for number, text in enumerate(self._values):
            text.set_visible(number < len(survey.edges))
            if number < len(survey.edges):
                value = survey.shown(survey.edges[number].value)
                left = value < (low + high) / 2
                text.set_text(f" {survey.told(survey.edges[number].value)} ")
                text.set(x=value, ha="left" if left else "right")

    def _fit(self, survey: InputSweep) -> None:
        """Make the axes large enough."""
        self._fit_places(survey.places(), SPARE)
        self._fit_margin(survey.margin)
        if survey.column != self._column:
            self._column = survey.column
            for axes in (self._margin, self._angle):
                axes.set_xlim(*survey.across()[[0, -1]].tolist())
            for text in self._abscissas:
                text.set_text(f"{survey.swept.name} ({'°' if survey.turns else 'mm'})")

    def _fit_places(self, places: Points, spare: float) -> None:
        if len(places):
            low, high = np.min(places, axis=0), np.max(places, axis=0)
            more = spare * float(np.max(high - low))
            self._low = np.where(low < self._low, low - more, self._low)
            self._high = np.where(high > self._high, high + more, self._high)

    def _hold(self) -> None:
        """Let the pose fill its axes, whatever the size of the window."""
        room = ROOM * float(np.max(self._high - self._low))
        hold(self._pose, self._low - room, self._high + room)

    def _fit_margin(self, margin: np.ndarray) -> None:
        top = float(np.max(margin, initial=0.0, where=np.isfinite(margin)))
        if top > 0.0 and not self._top / 3 <= top <= self._top:
            self._top = (1 + SPARE) * top
            self._margin.set_ylim(-0.04 * self._top, 1.1 * self._top)


def _beside(scene: Scene, joint: str, offset: np.ndarray) -> np.ndarray:
    """The offset of a fixed joint's name, turned off the bodies that are over it now."""
    x, y = scene.joints[joint].tolist()
    taken = [-math.pi / 2]  # by its support
    for body in scene.structure.bodies:
        if joint in body.joints:
            ends = [scene.joints[one].tolist() for one in body.joints if one != joint]
            taken += [math.atan2(end[1] - y, end[0] - x) for end in ends]
    first = math.atan2(offset[1], offset[0])

    def room(turn: float) -> float:
        return min(abs(math.remainder(first + turn - one, 2 * math.pi)) for one in taken)

    turns = [number * math.pi / 8 for number in range(16)]
    turn = 0.0 if room(0.0) >= CLEAR else max(turns, key=room)
    return turned(offset, turn)


def _span(axes: Axes) -> Rectangle:
    """A grey ground for where there is no pose."""
    patch = Rectangle((0.0, 0.0), 1.0, 1.0, color="0.88", linewidth=0, zorder=0.5)
    patch.set_transform(axes.get_xaxis_transform())
    axes.add_artist(patch)
    return patch
