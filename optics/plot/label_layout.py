"""Names of mirrors and pads in a drawing: along them, behind them, and on nothing that is drawn."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patheffects import withStroke
from matplotlib.text import Text

from designopt.plot.typesetting import drawn_name

Point = Float[np.ndarray, "2"]
Points = Float[np.ndarray, "_ 2"]

INK, FONT = "#222222", 6.8
"""Colour of the labels, and their size in points."""
GAPS, NEAR = (2.0, 5.0, 9.0, 14.0, 20.0, 30.0), 5.0
"""Points between what is named and its label; where it is no longer near, a line leads to it."""
PARTS = (0.5, 0.4, 0.6, 0.25, 0.75, 0.1, 0.9, -0.05, 1.05, -0.3, 1.3)
"""Where along its line a label may stand."""
CLEAR = 4.0
"""Points between a label and what is drawn beyond which more does not count."""
STEP = 3.0
"""Points between the samples that stand for a line."""
GRID = np.array(list(itertools.product(np.linspace(-1, 1, 9), (-1.0, 0.0, 1.0))))
"""What stands for a label, in halves of its size."""


@dataclass(frozen=True)
class Label:
    """A label's text and the place it belongs to.

    Attributes:
        text: its text.
        ends: of the segment that it names, mm.
        back: +1 if it best stands to the segment's left, −1 if to its right, 0 if either will do.
        depth: how far the segment's sign reaches to that side, or to both, in points.
    """

    text: str
    ends: Float[np.ndarray, "2 2"]
    back: int
    depth: float


@dataclass(frozen=True)
class PlacedLabel:
    """A label and where it stands.

    Attributes:
        text: its text.
        middle: of the text, mm.
        angle: of the text, rad.
        leader: ends of the line from it to what it names, mm; no ends where there is no doubt.
    """

    text: str
    middle: Point
    angle: float
    leader: Points

    def artists(self, size: float) -> list[Artist]:
        """Its line and its text, for axes in mm; ``size`` as in `place_labels`."""
        found: list[Artist] = []
        if len(self.leader):
            line = Line2D(*self.leader.T, color=INK, linewidth=0.5, zorder=7)
            line.set_gid(f"leader:{self.text}")
            found.append(line)
        x, y = map(float, self.middle)
        text = Text(x, y, drawn_name(self.text), clip_on=False)
        text.set(rotation=math.degrees(self.angle), rotation_mode="anchor")
        text.set(ha="center", va="center_baseline", fontsize=FONT * size, color=INK)
        text.set(zorder=8, gid=f"label:{self.text}")
        text.set_path_effects([withStroke(linewidth=1.6, foreground="white")])
        text.set_in_layout(False)
        return [*found, text]


def draw_labels(
    axes: Axes, labels: Sequence[Label], drawn: Sequence[Points], size: float = 1.0
) -> None:
    """Name segments, each parallel to itself where there is most room; see `place_labels`."""
    for label in place_labels(axes, labels, drawn, size):
        for artist in label.artists(size):
            axes.add_artist(artist)


def place_labels(
    axes: Axes, labels: Sequence[Label], drawn: Sequence[Points], size: float = 1.0
) -> list[PlacedLabel]:
    """Where labels stand, in the order of the labels.

    Args:
        axes: whose limits and place are (nearly) final.
        labels: what to name.
        drawn: all lines that labels keep clear of, mm.
        size: of the labels and of their distances; 1 for a large drawing.
    """
    # All that follows is in points for a drawing of size 1.
    scale = _points_per_mm(axes) / size
    window = np.array([axes.get_xlim(), axes.get_ylim()]).T * scale
    clutter = np.vstack([_sampled(line * scale) for line in drawn])
    for label in labels:
        sign, left = _sampled(label.ends * scale), _left(label.ends)
        sides = (label.back,) if label.back else (1, -1)
        reach = [depth * side for depth in (label.depth / 2, label.depth) for side in sides]
        clutter = np.vstack([clutter, *(sign + points * left for points in reach)])
    taken = 0  # of the clutter, so many of the last points are other labels
    placed: dict[int, PlacedLabel] = {}
    # What names a short line has the least choice.
    for index in sorted(range(len(labels)), key=lambda index: math.dist(*labels[index].ends)):
        label = labels[index]
        box = _best(label, scale, clutter, taken, window)
        leader = _sampled(box.leader)
        clutter = np.vstack([clutter, box.points(), leader])
        taken += len(GRID) + len(leader)
        line = box.leader / scale if len(leader) > 1 else np.zeros((0, 2))
        placed[index] = PlacedLabel(label.text, box.middle / scale, box.angle, line)
    return [placed[index] for index in range(len(labels))]


@dataclass(frozen=True)
class _Box:
    """Where a label may stand, in points: its middle, half sizes and angle; what it costs.

    Where one may doubt what it names, a line leads there.
    """

    middle: Point
    half: Point
    angle: float
    cost: float
    leader: Points

    @property
    def axes(self) -> Float[np.ndarray, "2 2"]:
        """Unit vectors along the box and across it."""
        cosine, sine = math.cos(self.angle), math.sin(self.angle)
        return np.array([[cosine, sine], [-sine, cosine]])

    def points(self) -> Points:
        """Points all over the box."""
        return self.middle + self.half * GRID @ self.axes

    def gaps(self, places: Points) -> Float[np.ndarray, " places"]:
        """How far places are from the box; 0 in it."""
        beyond = np.abs((places - self.middle) @ self.axes.T) - self.half
        return np.linalg.norm(np.maximum(beyond, 0), axis=1)


def _best(
    label: Label, scale: float, clutter: Points, taken: int, window: Float[np.ndarray, "2 2"]
) -> _Box:
    """Where a label stands best of all places that are tried: in doubt, at the first of them."""
    places = list(itertools.product((0, 1), (1, -1), GAPS, PARTS))
    costs = [
        0.1 * gap + 1.5 * abs(part - 0.5) + 2 * across + 3 * (side * label.back < 0)
        for across, side, gap, part in places
    ]
    best, found = (-math.inf, 0), None
    for number in sorted(range(len(places)), key=costs.__getitem__):
        if CLEAR - costs[number] < best[0]:
            break  # the others cost more than any room is worth
        box = _box(label, scale, *places[number], costs[number])
        if CLEAR - box.cost < best[0]:
            continue
        merit = (_merit(box, clutter, taken, window), -number)
        if merit > best:
            best, found = merit, box
    assert found is not None
    return found


def _box(
    label: Label, scale: float, across: int, side: int, gap: float, part: float, cost: float
) -> _Box:
    """A place along a label's line, or across it, on one of its sides."""
    start, end = label.ends * scale
    left = _left(label.ends)
    half = FONT * np.array([0.28 * len(label.text), 0.42])
    angle = math.atan2(-left[0], left[1]) + across * math.pi / 2
    angle -= math.pi * round((angle - 1e-6) / math.pi)  # readable from below or the right
    front = side * label.back < 0
    depth = 0.0 if front else label.depth
    middle = start + part * (end - start) + side * (depth + gap + half[1 - across]) * left
    box = _Box(middle, half, angle, cost, np.zeros((0, 2)))
    if gap <= NEAR and abs(part - 0.5) <= 0.6 and not front and not across:
        return box
    sign = label.back * label.depth / 2 * left
    parts = start + sign + np.linspace(0.1, 0.9, 17)[:, None] * (end - start)
    leader = _shortest(box.points(), parts)
    return dataclasses.replace(box, cost=cost + (1 + 0.1 * math.dist(*leader)), leader=leader)


def _shortest(first: Points, second: Points) -> Points:
    """The two nearest of two sets of points."""
    lengths = np.linalg.norm(first[:, None] - second[None], axis=-1)
    i, j = np.unravel_index(int(np.argmin(lengths)), lengths.shape)
    return np.array([first[i], second[j]])


def _merit(box: _Box, clutter: Points, taken: int, window: Float[np.ndarray, "2 2"]) -> float:
    """How far a label is from what is drawn, less its costs and what it would cover."""
    points = box.points()
    outside = max(float(np.max(window[0] - points)), float(np.max(points - window[1])), 0.0)
    labels = np.s_[len(clutter) - taken :]
    near = np.linalg.norm(_sampled(box.leader)[:, None] - clutter[labels][None], axis=-1) < STEP
    gaps = box.gaps(clutter)
    # Other labels are the last that it may cover.
    covered = np.sum(gaps == 0) + 5 * np.sum(gaps[labels] == 0) + np.sum(near)
    return min(float(np.min(gaps)), CLEAR) - float(covered) - box.cost - 2 * outside


def _left(ends: Float[np.ndarray, "2 2"]) -> Point:
    """The unit vector to the left of a segment."""
    step = ends[1] - ends[0]
    return np.array([-step[1], step[0]]) / max(math.hypot(*step), 1e-300)


def _sampled(line: Points) -> Points:
    """Points along a line, close enough to stand for it."""
    parts = [line[:1]]
    for start, end in itertools.pairwise(line):
        count = 1 + int(min(math.hypot(*(end - start)) / STEP, 1000))
        parts.append(start + np.linspace(0, 1, count + 1)[1:, None] * (end - start))
    return np.vstack(parts)


def _points_per_mm(axes: Axes) -> float:
    figure: Any = axes.figure
    (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
    across, up = axes.bbox.width / abs(right - left), axes.bbox.height / abs(high - low)
    return 72 / figure.dpi * float(min(across, up))
