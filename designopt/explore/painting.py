"""What changes in a figure, drawn over what does not, without drawing all of it anew."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from jaxtyping import Float
from matplotlib.transforms import Bbox, BboxBase

from designopt.plot.ruling import Ruling

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.backend_bases import Event
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure


EDGES = np.array([(0.0, 1.0), (-1.0, 0.0)])
"""From corners of whole pixels to those of what ink is clipped to; see `WholePixels`."""


class WholePixels(BboxBase):
    """The whole pixels in a box, but for the last ones at its right and its lower edge.

    Drawing and keeping round other boxes each in its own way, and Agg draws markers and images a
    pixel beyond the right and the lower edge of what they are clipped to.
    """

    def __init__(self, box: BboxBase) -> None:
        super().__init__()
        self._box = box
        self.set_children(box)

    def get_points(self) -> Float[np.ndarray, "2 2"]:
        """Lower left and upper right corner."""
        low, high = self._box.get_points()
        return np.stack([np.ceil(low), np.floor(high)]) + EDGES

    @property
    def reached(self) -> Bbox:
        """Where there may be ink of what is clipped to it."""
        left, low, right, high = self.extents
        return Bbox.from_extents(left, low - 1, right + 1, high)


class Patch:
    """A rectangle of a figure that is drawn anew by itself.

    Attributes:
        box: what is drawn in it is clipped to; patches do not overlap.
        artists: what changes in it, in the order of drawing, above the rulings.
        rulings: what changes only with the limits of axes.
        bare: the pixels of what does not change.
        ruled: the pixels of that and of the rulings.
        told: what the rulings were when they were kept.
    """

    def __init__(self, box: BboxBase, artists: Sequence[Artist] = ()) -> None:
        self.box = WholePixels(box)
        self.artists: Sequence[Artist] = ()
        self.rulings: Sequence[Ruling] = ()
        self.bare: Any = None
        self.ruled: Any = None
        self.told: list[tuple[Ruling, bool, tuple[float, float]]] = []
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
        self.rulings = [artist for artist in artists if isinstance(artist, Ruling)]
        self.artists = [artist for artist in artists if not isinstance(artist, Ruling)]


class Painter:
    """Draws the patches of a figure.

    Everything else in the figure is drawn once and kept as pixels, patch by patch; rulings are
    drawn over them, and kept, whenever any of them changes.
    """

    def __init__(self, figure: Figure) -> None:
        self._figure = figure
        self._canvas = cast("FigureCanvasAgg", figure.canvas)
        self._patches: list[Patch] = []
        figure.canvas.mpl_connect("draw_event", self._keep_backgrounds)

    def patch(self, box: BboxBase, artists: Sequence[Artist] = ()) -> Patch:
        """A new patch; it can be painted after the next `draw`."""
        patch = Patch(box, artists)
        self._patches.append(patch)
        return patch

    def draw(self) -> None:
        """Draw the whole figure."""
        self._canvas.draw()

    def paint(self, patches: Iterable[Patch]) -> None:
        """Draw what changes in these patches, and nothing else."""
        for patch in patches:
            self._paint(patch)
        self._canvas.blit(self._figure.bbox)

    def _keep_backgrounds(self, event: Event) -> None:
        if event.canvas is not self._canvas or self._canvas.is_saving():
            return
        for patch in self._patches:
            patch.bare = self._canvas.copy_from_bbox(patch.box.reached)
            patch.ruled = None
        for patch in self._patches:
            self._paint(patch)

    def _paint(self, patch: Patch) -> None:
        renderer = self._canvas.get_renderer()
        told = [(ruling, ruling.get_visible(), ruling.limits) for ruling in patch.rulings]
        if patch.ruled is None or told != patch.told:
            self._canvas.restore_region(patch.bare)
            for ruling in patch.rulings:
                ruling.draw(renderer)
            patch.ruled, patch.told = self._canvas.copy_from_bbox(patch.box.reached), told
        else:
            self._canvas.restore_region(patch.ruled)
        for artist in patch.artists:
            artist.draw(renderer)
