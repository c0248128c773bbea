"""The picture of a scene as it stands: its section, and below it how much and how well it sees."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float
from matplotlib.artist import Artist
from matplotlib.collections import LineCollection
from matplotlib.colors import LinearSegmentedColormap, to_hex
from matplotlib.legend import Legend
from matplotlib.lines import Line2D

from designopt.explore.bench import Knob
from designopt.plot.drawn_once import DrawnOnce
from designopt.plot.lettering import Lettering
from designopt.plot.ruling import Ruling, hold
from designopt.plot.typesetting import drawn_name
from optics.explore.scene_seeing import Seen
from optics.plot.label_layout import FONT, Label, PlacedLabel, moved, place_labels
from optics.plot.scene_drawing import BAR as PAD
from optics.plot.scene_drawing import (
    HIDDEN,
    INK,
    SEEN,
    legend_of,
    names_of,
    scene_signs,
    seeing_paths,
    words_of,
)
from optics.plot.section import Points, Section
from optics.scene.scene import Scene

if TYPE_CHECKING:
    from matplotlib.figure import SubFigure

COVERED = LinearSegmentedColormap.from_list("covered", [HIDDEN, SEEN])
"""Colours of what is seen of a pad: from almost nothing to all of it."""

TRACK = "0.92"
"""Colour of the part of a bar that is not covered."""
CURVES: tuple[tuple[str, Any], ...] = (
    ("#222222", "-"),
    ("#8A8A8A", "-"),
    ("#222222", (0, (3, 1.5))),
    ("#AA4499", "-"),
)
"""Colours and lines of the pads' curves, in turn; no ray has one of these colours."""

SMALL = 7.5
"""Size of the text, in points."""
BAR = 8.0
"""Width of a bar, in points."""

MARGIN = 0.04
"""Room around a section, as a part of its larger side."""
SIGN = 13.0
"""And in points: the camera's sign reaches so far from its place."""
SPARE = 0.2
"""How much farther than needed axes reach that had to be changed, as a part of what is needed."""
FEW = 8
"""So many paths are told of in the legend whether they see anything or not."""
RESCALED = 0.1
"""Names are placed anew where the scale has changed by more than this part of it."""

Place = tuple[float, float, float, float]


@dataclasses.dataclass(frozen=True)
class Layout:
    """Where everything stands, as parts of the area: left, bottom, width and height.

    Attributes:
        section: of the section.
        legend: middle and upper end of what hangs below it.
        across: entries of that legend side by side.
        below: of the axes below, from left to right, if there are curves.
        without: of those if there are none.
        words: below the axis of resolution.
        steps: most intervals between its ticks.
        gap: between entries of the legend, in units of its text's size.
        digits: of the ends of a knob's range.
        name: where a knob's name stands along its range, as a part of it.
    """

    section: Place
    legend: tuple[float, float]
    across: int
    below: tuple[Place, ...]
    without: tuple[Place, ...]
    words: str
    steps: int
    gap: float
    digits: int
    name: float


WIDE = Layout(
    (0.09, 0.5, 0.88, 0.44),
    (0.5, 0.42),
    4,
    ((0.14, 0.085, 0.22, 0.19), (0.41, 0.085, 0.2, 0.19), (0.69, 0.085, 0.28, 0.19)),
    ((0.14, 0.085, 0.4, 0.19), (0.6, 0.085, 0.37, 0.19)),
    "least, median, greatest px/mm",
    6,
    2.0,
    4,
    0.5,
)
NARROW = Layout(
    (0.145, 0.51, 0.835, 0.44),
    (0.5, 0.45),
    2,
    ((0.18, 0.115, 0.2, 0.17), (0.42, 0.115, 0.19, 0.17), (0.725, 0.115, 0.26, 0.17)),
    ((0.18, 0.115, 0.36, 0.17), (0.6, 0.115, 0.37, 0.17)),
    "least, median,\ngreatest px/mm",
    3,
    1.0,
    3,
    1.0,
)
"""In an area that is higher than wide."""


class ScenePicture:
    """The axes of a scene's picture, and what is in them."""

    def __init__(
        self,
        area: SubFigure,
        scene: Scene,
        reach: Points,
        *,
        floor: float | None,
        curves: bool,
    ) -> None:
        """Make the axes.

        Args:
            area: what they fill.
            scene: whose picture it is.
            reach: places that are in it from the beginning, mm.
            floor: resolution that is asked for, px/mm; if there is one, it is marked.
            curves: whether there are curves of coverage over a knob.
        """
        self.area, self._layout = area, scene.layout
        layout = WIDE if area.bbox.width >= area.bbox.height else NARROW
        self._places = layout
        below = [area.add_axes(place) for place in (layout.below if curves else layout.without)]
        self.section = area.add_axes(layout.section)
        self.covered, self.sharp, *more = below
        self.curves = more[0] if more else None
        self._drawn: list[Artist] = []
        self._names: list[tuple[Label, PlacedLabel]] = []
        self._named_in: Any = None
        self._told: set[int] = set()
        self._legend: list[DrawnOnce] = []
        self._floor: list[Line2D] = []
        self._greatest = 0.0
        self._low, self._high = reach.min(axis=0), reach.max(axis=0)
        self._prepare_section()
        self._prepare_rows(floor)
        self._prepare_curves()
        for axes in (self.section, *below):
            axes.tick_params(labelsize=SMALL)
            for text in (axes.xaxis.label, axes.yaxis.label):
                text.set_fontsize(SMALL)

    def _prepare_section(self) -> None:
        axes = self.section
        axes.set(xlabel="x (mm)", ylabel="y (mm)", title=drawn_name(self._layout.name))
        self._rulings = [Ruling(axes, "x", 10, SMALL, grid=False)]
        self._rulings.append(Ruling(axes, "y", 8, SMALL, grid=False))
        self.fit()

    def _prepare_rows(self, floor: float | None) -> None:
        pads = self._layout.pads
        rows = np.arange(len(pads))[::-1]
        for axes in (self.covered, self.sharp):
            axes.set(ylim=(-0.6, len(pads) - 0.4), yticks=rows, yticklabels=[])
            axes.tick_params(axis="y", length=0)
            axes.grid(visible=False, axis="y")
        self.covered.set_yticklabels([drawn_name(part.name) for part in pads])
        self.covered.set(xlim=(0, 100), xlabel="coverage (%)")
        if floor is not None:
            line = self.sharp.axvline(floor, color=INK, linestyle=":", linewidth=1, gid="floor")
            line.set_animated(True)
            self._floor.append(line)
        asked = "" if floor is None else f"\n(dotted: {floor:g} asked for)"
        self.sharp.set(xlabel=f"{self._places.words}{asked}")
        for axes in (self.covered, self.sharp):
            self._rulings.append(Ruling(axes, "x", self._places.steps, SMALL))
        tracks = [[(0.0, row), (100.0, row)] for row in rows]
        track = LineCollection(tracks, colors=TRACK, linewidths=BAR, capstyle="butt")
        self.covered.add_collection(track, autolim=False)
        self._rows = rows
        self._bars = LineCollection([], linewidths=BAR, capstyle="butt", gid="coverage")
        self._spans = LineCollection([], colors="0.6", linewidths=2.5, gid="px/mm")
        dots: dict[str, Any] = {"color": INK, "linestyle": "none", "markersize": 4}
        self._least = Line2D([], [], marker="|", markeredgewidth=1.5, gid="least", **dots)
        self._median = Line2D([], [], marker="o", gid="median", **dots)
        for axes, artists in (
            (self.covered, (self._bars,)),
            (self.sharp, (self._spans, self._least, self._median)),
        ):
            for artist in artists:
                artist.set_animated(True)
                axes.add_artist(artist)

    def _prepare_curves(self) -> None:
        axes = self.curves
        if axes is None:
            return
        axes.set(xlim=(0, 1), ylim=(-5, 105), xticks=(0, 0.5, 1), xticklabels=[])
        axes.set_ylabel("coverage (%)", labelpad=1)
        self._curve_lines: list[Line2D] = []
        count = len(self._layout.pads)
        for index, part in enumerate(self._layout.pads):
            color, dashes = CURVES[index % len(CURVES)]
            width = 1.2 + 0.8 * (count - 1 - index)  # earlier ones show below later ones
            line = Line2D([], [], color=color, linestyle=dashes, linewidth=min(width, 4.0))
            line.set(label=drawn_name(part.name), gid=f"curve:{part.name}", animated=True)
            axes.add_artist(line)
            self._curve_lines.append(line)
        axes.legend(
            handles=self._curve_lines,
            loc="lower right",
            bbox_to_anchor=(1.0, 1.0),
            ncols=min(count, 3),
            fontsize=SMALL - 1,
            handlelength=1.6,
            columnspacing=0.9,
            borderaxespad=0.2,
        )
        self._now = Line2D([], [], color=HIDDEN, linewidth=1.2, gid="now", animated=True)
        axes.add_artist(self._now)
        under = axes.get_xaxis_transform()
        scale, style = self.area.dpi_scale_trans, {"color": "black", "animated": True}
        # The first, the middle and the last tick, and what they are of.
        self._words = []
        for across, down in ((0.0, 5), (0.5, 5), (1.0, 5), (self._places.name, 20)):
            text = Lettering(" ", SMALL, under, scale, anchor=(across, 1.0), **style)
            text.move((across, 0.0), (0.0, -down))
            axes.add_artist(text)
            self._words.append(text)

    def show(self, scene: Scene, angles: Float[np.ndarray, " joints"], seen: Seen) -> None:
        """Draw what is seen in a pose."""
        section = Section.of(scene, angles)
        self._widen(section)
        self.fit()
        self._tell_more(scene, seen)
        colors = [to_hex(COVERED(part)) for part in np.clip(seen.coverage, 0, 1).tolist()]
        signs = scene_signs(
            self.section, scene, angles, seen.views, section, seen=colors, joined=True
        )
        names = self._named(names_of(scene, section), signs.clutter, signs.size)
        labels = [artist for name in names for artist in self._letters(name, signs.size)]
        for artist in self._drawn:
            artist.remove()
        self._drawn = sorted([*signs.artists, *labels], key=lambda artist: artist.zorder)
        for artist in self._drawn:
            artist.set_animated(True)
            self.section.add_artist(artist)
        self._show_rows(seen, colors)

    def _letters(self, name: PlacedLabel, size: float) -> list[Artist]:
        """A name with its line; see `PlacedLabel.artists`."""
        *line, _ = name.artists(size)
        places, scale = self.section.transData, self.area.dpi_scale_trans
        text = Lettering(name.text, FONT * size, places, scale, rim=1.6, color=INK, zorder=8)
        text.set_gid(f"label:{name.text}")
        x, y = map(float, name.middle)
        text.move((x, y), angle=name.angle)
        return [*line, text]

    def _show_rows(self, seen: Seen, colors: Sequence[str]) -> None:
        """Draw coverage and resolution."""
        covered = 100 * seen.coverage
        ends = zip(covered.tolist(), self._rows.tolist(), strict=True)
        self._bars.set_segments([[(0.0, row), (end, row)] for end, row in ends])
        self._bars.set_color(list(colors))
        there = seen.px_per_mm[:, 2] > 0
        least, median, greatest = seen.px_per_mm[there].T
        rows = self._rows[there]
        self._spans.set_segments(
            [np.array([(a, y), (b, y)]) for a, b, y in zip(least, greatest, rows, strict=True)]
        )
        self._least.set_data(least, rows)
        self._median.set_data(median, rows)
        most = float(np.max(greatest, initial=0.0))
        if most > self._greatest:
            self._greatest = (1 + SPARE) * most
            self.sharp.set_xlim(0, self._greatest)

    def show_curves(
        self, knob: Knob, value: float, coverage: Float[np.ndarray, "places pads"]
    ) -> None:
        """Draw coverage at places evenly spread over a knob's range, and where the knob stands."""
        places = np.linspace(0, 1, len(coverage))
        for line, column in zip(self._curve_lines, 100 * coverage.T, strict=True):
            line.set_data(places, column)
        at = (value - knob.low) / (knob.high - knob.low)
        self._now.set_data([at, at], [-5, 105])
        marks = (knob.low, (knob.low + knob.high) / 2, knob.high)
        words = (
            *(f"{mark:.{self._places.digits}g}" for mark in marks),
            f"{knob.name} ({knob.unit})",
        )
        for text, said in zip(self._words, words, strict=True):
            text.say(said)

    @property
    def artists(self) -> list[Artist]:
        """All that changes, in the order of drawing."""
        found = [*self._rulings, *self._legend, *self._drawn]
        found += [*self._floor, self._bars, self._spans, self._least, self._median]
        if self.curves is not None:
            found += [*self._curve_lines, self._now, *self._words]
        return found

    def _widen(self, section: Section) -> None:
        """Widen the axes if the picture no longer fits."""
        places = section.places()
        low, high = places.min(axis=0), places.max(axis=0)
        under, over = low < self._low - self._room, high > self._high + self._room
        spare = SPARE * float(np.max(self._high - self._low))
        self._low = np.where(under, low - spare, self._low)
        self._high = np.where(over, high + spare, self._high)

    def fit(self) -> None:
        """Let the section fill its axes, whatever the size of the window."""
        figure: Any = self.area.figure
        sides = self._high - self._low
        self._room = MARGIN * max(float(np.max(sides)), 1e-9)
        sides = sides + 2 * self._room
        # mm for a point, with signs on either side.
        points = np.array(self.area.bbox.size) / figure.dpi * 72 * self._places.section[2:]
        sign = SIGN * float(np.max(sides / (points - 2 * SIGN)))
        around = self._room + sign
        hold(self.section, self._low - around, self._high + around)

    def _tell_more(self, scene: Scene, seen: Seen) -> None:
        """Add to the legend the paths that it does not tell of, unless there are few anyway."""
        words = words_of(scene, seen.views)
        few = len(words) <= FEW
        paths = self._told.union(range(len(words)) if few else seeing_paths(seen.views))
        if self._legend and paths == self._told:
            return
        self._told = paths
        handles, texts = legend_of(scene, words, sorted(paths), hidden=True)
        handles.insert(1, Line2D([], [], color=COVERED(0.5), linewidth=PAD))
        texts.insert(1, "pad, seen in part")
        for old in self._legend:
            old.remove()
        legend = Legend(
            self.section,
            handles,
            texts,
            loc="upper center",
            bbox_to_anchor=self._places.legend,
            bbox_transform=self.area.transSubfigure,
            ncols=self._places.across,
            columnspacing=self._places.gap,
            fontsize=SMALL,
            borderaxespad=0,
        )
        self._legend = [DrawnOnce(legend)]
        self._legend[0].set_animated(True)
        self.section.add_artist(self._legend[0])

    def _named(
        self, labels: Sequence[Label], clutter: Sequence[Points], size: float
    ) -> list[PlacedLabel]:
        """Names beside what they name; a search places them once, and they move with it."""
        axes = self.section
        # In a window of another size, or at another scale, they have other room.
        width, height = np.round(axes.bbox.size).tolist()
        scale = width / float(np.ptp(axes.get_xlim()))
        if self._named_in is None or not np.allclose(
            (width, height, scale), self._named_in, rtol=RESCALED
        ):
            self._named_in = (width, height, scale)
            placed = place_labels(axes, labels, clutter, size)
            self._names = list(zip(labels, placed, strict=True))
        pairs = zip(self._names, labels, strict=True)
        return [moved(name, before, now) for (before, name), now in pairs]
