"""Numbers and words that change with every move of a slider, drawn in one go."""

from __future__ import annotations

import functools
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.backends.backend_agg import RendererAgg
from matplotlib.colors import to_rgb
from matplotlib.font_manager import findfont
from matplotlib.text import Text
from PIL import Image, ImageDraw, ImageFont

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.backend_bases import RendererBase

ANCHORS = {"left": "ls", "center": "ms", "right": "rs"}


class QuickText(Text):
    """A level line of text that stands on its place, or to the left or to the right of it.

    Matplotlib lays out and draws every glyph by itself, about a millisecond for a number: of a
    table of them, longer than all the rest of a picture.
    """

    def __init__(self, *args: Any, **style: Any) -> None:
        """As `Text`; dollar signs have no meaning."""
        super().__init__(*args, parse_math=False, **style)

    def draw(self, renderer: RendererBase) -> None:
        """Draw it, as pixels where pixels are drawn."""
        if not isinstance(renderer, RendererAgg):
            super().draw(renderer)
            return
        self.stale = False
        words = self.get_text()
        if not words or not self.get_visible():
            return
        left, bottom, image = _inked(
            words,
            findfont(self.get_fontproperties()),
            self.get_fontsize() * renderer.dpi / 72,
            ANCHORS[self.get_horizontalalignment()],
            to_rgb(self.get_color()),
        )
        x, y = self.get_transform().transform(self.get_unitless_position())
        draw_pixels(renderer, self, round(x) + left, round(y) - bottom, image)


def draw_pixels(
    renderer: RendererAgg, artist: Artist, left: float, low: float, image: np.ndarray
) -> None:
    """Draw an artist as an image, where the artist is not clipped.

    Args:
        renderer: draws it.
        artist: what the image is of.
        left: where the image begins, pixels.
        low: likewise.
        image: rows from the bottom, columns, and red, green, blue and opacity (uint8).
    """
    gc = renderer.new_gc()
    within = artist.get_clip_box()
    if artist.get_clip_on() and within is not None:
        gc.set_clip_rectangle(within)
    renderer.draw_image(gc, left, low, image)
    gc.restore()


@functools.lru_cache(maxsize=256)
def _inked(
    words: str, path: str, pixels: float, anchor: str, color: tuple[float, float, float]
) -> tuple[int, int, np.ndarray]:
    """Where an image of words begins, to the right of their place and below it; and the image."""
    font = _font(path, pixels)
    left, top, right, bottom = map(round, font.getbbox(words, anchor=anchor))
    ink = Image.new("L", (right - left, bottom - top))
    ImageDraw.Draw(ink).text((-left, -top), words, fill=255, font=font, anchor=anchor)
    image = np.empty((ink.height, ink.width, 4), np.uint8)
    image[:, :, :3] = np.round(255 * np.array(color))
    image[:, :, 3] = np.asarray(ink)
    return left, bottom, image[::-1]


@functools.lru_cache(maxsize=8)
def _font(path: str, pixels: float) -> ImageFont.FreeTypeFont:
    return ImageFont.truetype(path, pixels)
