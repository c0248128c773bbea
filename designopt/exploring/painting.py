"""What changes in a figure, drawn over what does not, without drawing all of it anew."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, cast

import numpy as np
from matplotlib.transforms import Bbox, BboxBase

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.backend_bases import Event, RendererBase
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

WHITE = 255
"""Of every channel of a pixel, opacity among them."""


class Patch:
    """A rectangle of a figure that is drawn anew by itself.

    Attributes:
        box: where it lies, pixels; patches do not overlap.
        artists: what changes in it, in the order of drawing.
    """

    def __init__(self, box: BboxBase, artists: Sequence[Artist] = ()) -> None:
        self.box = box
        self.artists: Sequence[Artist] = ()
        self.background = None
        self.put(artists)

    def put(self, artists: Sequence[Artist]) -> None:
        """Let these be what changes; nothing of them is drawn beyond the rectangle."""
        for artist in artists:
            if not artist.get_animated():
                artist.set_animated(True)  # what is animated, Matplotlib leaves to us
            if not artist.get_clip_on():
                artist.set_clip_path(None)
                artist.set_clip_box(self.box)
                artist.set_clip_on(True)
        self.artists = artists


class Painter:
    """Draws the patches of a figure.

    Everything else in the figure is drawn once and kept as pixels, patch by patch.
    """

    def __init__(self, figure: Figure) -> None:
        self._figure = figure
        self._canvas = cast("FigureCanvasAgg", figure.canvas)
        self._patches: list[Patch] = []
        self._reach: dict[Axes, Bbox] = {}
        figure.canvas.mpl_connect("draw_event", self._keep_backgrounds)

    def patch(self, box: BboxBase, artists: Sequence[Artist] = ()) -> Patch:
        """A new patch; it can be painted after the next `draw`."""
        patch = Patch(box, artists)
        self._patches.append(patch)
        return patch

    def draw(self) -> None:
        """Draw the whole figure."""
        self._canvas.draw()

    def renew(self, patch: Patch, reframed: Sequence[Axes]) -> None:
        """Draw axes in a patch once more, because what does not move in them has changed after all.

        Args:
            patch: it, white where nothing is.
            reframed: those axes, in a subfigure.
        """
        if not reframed:
            return
        self._canvas.restore_region(patch.background)
        renderer = self._canvas.get_renderer()
        due, waiting = set(), list(reframed)
        while waiting:
            axes = waiting.pop()
            due.add(axes)
            before, now = self._reach[axes], _reach(axes, renderer)
            self._reach[axes] = now
            cleared = Bbox.union([before, now])
            self._clear(cleared, patch.box)
            # Neighbours that have lost something are drawn again, too.
            waiting += {
                other
                for other, reach in self._reach.items()
                if reach.overlaps(cleared) and other not in due
            }.difference(waiting)
        for axes in self._reach:
            if axes in due:
                axes.draw(renderer)
        patch.background = self._canvas.copy_from_bbox(patch.box)

    def _clear(self, box: Bbox, within: BboxBase) -> None:
        pixels = np.asarray(self._canvas.buffer_rgba())
        left, low = np.maximum(np.floor(box.min), np.ceil(within.min)).astype(int)
        right, high = np.minimum(np.ceil(box.max), np.floor(within.max)).astype(int)
        pixels[len(pixels) - high : len(pixels) - low, left:right] = WHITE

    def paint(self, patches: Iterable[Patch]) -> None:
        """Draw what changes in these patches, and nothing else."""
        for patch in patches:
            self._canvas.restore_region(patch.background)
            self._draw_artists(patch)
        self._canvas.blit(self._figure.bbox)

    def _keep_backgrounds(self, event: Event) -> None:
        if event.canvas is not self._canvas or self._canvas.is_saving():
            return
        renderer = self._canvas.get_renderer()
        self._reach = {
            axes: _reach(axes, renderer)
            for axes in self._figure.axes
            if axes.get_figure(root=False) is not self._figure
        }
        for patch in self._patches:
            patch.background = self._canvas.copy_from_bbox(patch.box)
        for patch in self._patches:
            self._draw_artists(patch)

    def _draw_artists(self, patch: Patch) -> None:
        for artist in patch.artists:
            self._figure.draw_artist(artist)


def _reach(axes: Axes, renderer: RendererBase) -> Bbox:
    """What axes cover with all that is beside them, pixels."""
    legend = axes.get_legend()
    # What moves in the axes stays inside: to measure it all would take longer than to draw it.
    box = axes.get_tightbbox(renderer, bbox_extra_artists=[legend] if legend else [])
    assert box is not None, "only of visible axes"
    return box.padded(6)  # ticks without words are beside it
