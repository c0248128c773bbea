"""What changes in a figure, drawn over what does not, without drawing all of it anew."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, cast

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.backend_bases import Event
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.transforms import BboxBase


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
            self._canvas.restore_region(patch.background)
            self._draw_artists(patch)
        self._canvas.blit(self._figure.bbox)

    def _keep_backgrounds(self, event: Event) -> None:
        if event.canvas is not self._canvas or self._canvas.is_saving():
            return
        for patch in self._patches:
            patch.background = self._canvas.copy_from_bbox(patch.box)
        for patch in self._patches:
            self._draw_artists(patch)

    def _draw_artists(self, patch: Patch) -> None:
        for artist in patch.artists:
            self._figure.draw_artist(artist)
