"""Something that changes seldom among what changes with every move of a slider."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.backends.backend_agg import RendererAgg

from designopt.plot.quick_text import draw_pixels

if TYPE_CHECKING:
    from matplotlib.backend_bases import RendererBase
    from matplotlib.transforms import Bbox


class DrawnOnce(Artist):
    """An artist whose pixels are kept when it is first drawn.

    A legend of ten entries takes Matplotlib 5 to 10 ms.
    """

    def __init__(self, artist: Any) -> None:
        """Draw this.

        Args:
            artist: it; it does not change any more.
        """
        super().__init__()
        self.set(clip_on=False, zorder=artist.get_zorder())
        self.artist = artist
        self._kept: tuple[object, float, float, np.ndarray] | None = None

    def get_window_extent(self, renderer: RendererBase | None = None) -> Bbox:
        """What it covers, pixels."""
        return self.artist.get_window_extent(renderer)

    def draw(self, renderer: RendererBase) -> None:
        """Draw it, or its pixels."""
        self.stale = False
        if not self.get_visible():
            return
        if not isinstance(renderer, RendererAgg):
            self.artist.draw(renderer)
            return
        size = (renderer.width, renderer.height, renderer.dpi)
        if self._kept is None or self._kept[0] != size:
            self._kept = size, *_pixels(self.artist, RendererAgg(*size))
        _, left, low, image = self._kept
        draw_pixels(renderer, self, left, low, image)


def _pixels(artist: Any, empty: RendererAgg) -> tuple[float, float, np.ndarray]:
    """Lower left corner of what an artist covers, and its pixels there from the bottom."""
    artist.draw(empty)
    pixels = np.asarray(empty.buffer_rgba())[::-1]
    rows, columns = (np.flatnonzero(pixels[:, :, 3].any(axis=axis)) for axis in (1, 0))
    if not len(rows):
        return 0, 0, np.zeros((1, 1, 4), np.uint8)
    (low, high), (left, right) = rows[[0, -1]].tolist(), columns[[0, -1]].tolist()
    return left, low, pixels[low : high + 1, left : right + 1].copy()
