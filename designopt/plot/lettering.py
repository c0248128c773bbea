"""Short texts as outlines, for names that move with what they name many times a second.

Matplotlib lays out and draws every glyph of a text anew each time; an outline is laid out once.
"""

from __future__ import annotations

import functools
from typing import Any

import numpy as np
from matplotlib.patches import PathPatch
from matplotlib.path import Path
from matplotlib.patheffects import withStroke
from matplotlib.textpath import TextPath
from matplotlib.transforms import Affine2D, ScaledTranslation, Transform

from designopt.plot.typesetting import drawn_name


class Lettering(PathPatch):
    """A line of text about a place."""

    def __init__(
        self,
        words: str,
        size: float,
        places: Transform,
        points: Transform,
        *,
        anchor: tuple[float, float] = (0.5, 0.5),
        rim: float = 0.0,
        **style: Any,
    ) -> None:
        """A text that stands nowhere yet; see `move`.

        Args:
            words: the text.
            size: of its letters, points.
            places: from places to the display.
            points: from inches to the display, such as a figure's ``dpi_scale_trans``.
            anchor: what of the text stands at its place: across from 0 (its left end) to 1, and up
                from 0 (the line it is written on) to 1 (the top of capitals).
            rim: width of a white rim around its letters, points.
            style: of the patch, such as ``color`` and ``zorder``.
        """
        self._size, self._anchor = size, anchor
        self._places, self._points = places, points
        super().__init__(outline(words, size, anchor), linewidth=0, clip_on=False, **style)
        self.words = words
        self.set_in_layout(False)
        # Where all lines of a path are level or upright, as in an E, Agg moves its corners to whole
        # pixels: bars as thin as those of a small letter vanish, and the E becomes an F.
        self.set_snap(False)
        if rim:
            self.set_path_effects([withStroke(linewidth=rim, foreground="white")])

    def say(self, words: str) -> None:
        """Change the text."""
        if words != self.words:
            self.words = words
            self.set_path(outline(words, self._size, self._anchor))

    def move(
        self, place: tuple[float, float], offset: tuple[float, float] = (0.0, 0.0), angle: float = 0
    ) -> None:
        """Put it at an offset (points) from a place, turned by an angle (rad)."""
        turned = Affine2D().rotate(angle).translate(*offset).scale(1 / 72)
        self.set_transform(turned + self._points + ScaledTranslation(*place, self._places))  # pyright: ignore[reportArgumentType]


@functools.lru_cache(maxsize=1024)
def outline(words: str, size: float, anchor: tuple[float, float]) -> Path:
    """The outline of a line of text, in points, with its anchor at the origin; see `Lettering`."""
    if not words.strip():
        return Path(np.zeros((1, 2)))
    path = TextPath((0, 0), drawn_name(words), size=size)
    box = path.get_extents()
    capital = TextPath((0, 0), "H", size=size).get_extents().y1
    origin = np.array([box.x0 + anchor[0] * box.width, anchor[1] * capital])
    return Path(path.vertices - origin, path.codes)
