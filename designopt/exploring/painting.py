"""What changes in a figure, drawn over what does not, without drawing all of it anew."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any, cast

from designopt.ruling import Ruling

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
        artists: what changes in it, in the order of drawing, above the rulings.
        rulings: what changes only with the limits of axes.
        bare: the pixels of what does not change.
        ruled: the pixels of that and of the rulings.
        limits: at which the rulings were drawn.
    """

    def __init__(self, box: BboxBase, artists: Sequence[Artist] = ()) -> None:
        self.box = box
        self.artists: Sequence[Artist] = ()
        self.rulings: Sequence[Ruling] = ()
        self.bare: Any = None
        self.ruled: Any = None
        self.limits: list[tuple[float, float]] = []
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
    drawn over them, and kept, whenever limits change.
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
            patch.bare = self._canvas.copy_from_bbox(patch.box)
            patch.ruled = None
        for patch in self._patches:
            self._paint(patch)

    def _paint(self, patch: Patch) -> None:
        renderer = self._canvas.get_renderer()
        limits = [ruling.limits for ruling in patch.rulings]
        if patch.ruled is None or limits != patch.limits:
            self._canvas.restore_region(patch.bare)
            for ruling in patch.rulings:
                ruling.draw(renderer)
            patch.ruled, patch.limits = self._canvas.copy_from_bbox(patch.box), limits
        else:
            self._canvas.restore_region(patch.ruled)
        for artist in patch.artists:
            artist.draw(renderer)
