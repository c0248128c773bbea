"""Where names and dimensions stand on paper: if possible on nothing that is drawn."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.spatial import KDTree

from designopt.export.drawing import Drawing, Label, LinearDimension, Place

Points = Float[np.ndarray, "_ 2"]
Point = Float[np.ndarray, "2"]

STEP = 1.0
"""Distance of the points that stand for a line, mm on paper."""

MOST = 2000
"""Most points that stand for one line."""

GLYPH = 0.75
"""Width of a character, as a part of its height."""

CLEAR = 1.0
"""A text closer than this to a line or to another text, mm on paper, lies on it."""

OFFSETS = (7.0, 12.0, 17.0, 22.0, 28.0, 34.0, 41.0, 48.0, 56.0, 64.0)
"""How far dimension lines may be from what they measure, mm on paper."""

GAP = 0.8
"""Between a dimension line and its text, mm on paper."""

OVER_TEXT, OVER_LINE, ALONG_LINE, OUTSIDE, PER_MM = 30.0, 20.0, 3.0, 100.0, 0.5
"""How bad it is for a point of a text to lie on a text and on a line, for a point of a dimension
line to lie on a line, for one of either to lie outside, and for each mm of offset."""


@dataclass
class Clutter:
    """What is on the paper so far, as points; everything in mm on paper, from the model's origin.

    Attributes:
        scale: mm on paper per mm.
        room: lower left and upper right corner of where things may stand.
        lines: on lines.
        texts: on texts.
    """

    scale: float
    room: tuple[Point, Point]
    lines: KDTree
    texts: KDTree

    @classmethod
    def of(cls, sheet: Drawing, scale: float, room: tuple[Place, Place]) -> Clutter:
        """The lines and circles of a sheet."""
        parts = [np.zeros((0, 2))]
        for polyline in sheet.polylines:
            line = polyline.line()
            places = np.array([*line, *line[: polyline.closed]], float) * scale
            parts += [_sampled(start, end) for start, end in itertools.pairwise(places)]
        turns = np.arange(0, 2 * np.pi, 0.3)
        ring = np.stack([np.cos(turns), np.sin(turns)], axis=-1)
        for circle in sheet.circles:
            middle = np.array(circle.center) * scale
            parts += [middle + part * circle.radius * scale * ring for part in (0.5, 1.0)]
        low, high = (np.array(corner, float) for corner in room)
        return cls(scale, (low, high), KDTree(np.vstack(parts)), KDTree(np.zeros((0, 2))))

    def place_label(self, label: Label, height: float) -> Point:
        """The middle of a label beside its place, for letters of a height; it is kept clear."""
        place = np.array(label.place, float) * self.scale
        half = np.array([GLYPH * len(label.text), 1.0]) * height / 2

        def box(middle: Point) -> Points:
            return middle + half * _BOX

        def badness(middle: Point) -> float:
            return self._text_badness(box(middle)) + PER_MM * math.dist(middle, place)

        best = min(_around(place, half, height), key=badness)
        self.texts = _with(self.texts, box(best))
        return best

    def place_dimension(self, measure: LinearDimension, text: str, height: float) -> float:
        """How far to the left of its distance a dimension line stands; it is kept clear.

        Args:
            measure: from where to where; `readable`.
            text: its characters.
            height: of its letters.
        """
        ends = np.array([measure.start, measure.end], float) * self.scale
        offsets = [sign * offset for offset in OFFSETS for sign in (1, -1)]

        def badness(offset: float) -> float:
            line, legs, box = _dimension(ends, offset, text, height)
            return (
                self._text_badness(box)
                + OVER_TEXT * self._near(np.vstack([line, legs]), self.texts)
                + ALONG_LINE * self._near(line, self.lines)
                + PER_MM * abs(offset)
                + OUTSIDE * self._outside(line)
            )

        best = min(offsets, key=badness)
        line, legs, box = _dimension(ends, best, text, height)
        self.lines = _with(self.lines, line, legs)
        self.texts = _with(self.texts, box)
        return best

    def _text_badness(self, box: Points) -> float:
        return (
            OVER_TEXT * self._near(box, self.texts)
            + OVER_LINE * self._near(box, self.lines)
            + OUTSIDE * self._outside(box)
        )

    def _near(self, points: Points, others: KDTree) -> int:
        """How many points lie on others."""
        gaps, _ = others.query(points, distance_upper_bound=CLEAR)
        return int(np.sum(np.isfinite(gaps)))

    def _outside(self, points: Points) -> int:
        low, high = self.room
        return int(np.sum(np.any((points < low) | (points > high), axis=1)))


_BOX = np.array([(x, y) for x in np.linspace(-1, 1, 7) for y in (-1.0, 0.0, 1.0)])


def readable(measure: LinearDimension) -> LinearDimension:
    """The same distance in the direction in which its text is read: from below or the right."""
    (x, y), (x_end, y_end) = measure.start, measure.end
    # A vertical one, which rounding may have tilted, upwards.
    upright = abs(x_end - x) <= 1e-9 * abs(y_end - y)
    forward = y_end > y if upright else x_end > x
    return measure if forward else LinearDimension(measure.end, measure.start)


def _with(tree: KDTree, *points: Points) -> KDTree:
    return KDTree(np.vstack([tree.data, *points]))


def _around(place: Point, half: Point, height: float) -> list[Point]:
    """Middles of a text around a place; a long one stands farther out at the sides."""
    wider = max(half[0] - half[1], 0.0)
    found = []
    for far, turn in itertools.product((1.1, 1.5, 2.0, 2.8), (1, 3, 0, 2, 4, 6, 5, 7)):
        cosine, sine = math.cos(turn * math.pi / 4), math.sin(turn * math.pi / 4)
        shift = far * height * np.array([cosine, sine])
        found.append(place + shift + np.array([wider * round(cosine), 0.0]))
    return found


def _dimension(
    ends: Points, offset: float, text: str, height: float
) -> tuple[Points, Points, Points]:
    """Points on a dimension line, on its extension lines, and on its text."""
    along = ends[1] - ends[0]
    along = along / math.hypot(*along)
    shift = offset * np.array([-along[1], along[0]])
    start, end = ends + shift
    legs = [_sampled(place, place + shift) for place in ends]
    above = np.array([-along[1], along[0]])
    middle = (start + end) / 2 + (GAP + height / 2) * above
    half = np.array([GLYPH * len(text), 1.0]) * height / 2
    box = middle + (half * _BOX) @ np.array([along, above])
    return _sampled(start, end), np.vstack(legs), box


def _sampled(start: Point, end: Point) -> Points:
    count = 2 + int(min(math.dist(start, end) / STEP, MOST))
    return start + np.linspace(0, 1, count)[:, None] * (end - start)
