"""Lines of which many are drawn anew with every move of a slider."""

from __future__ import annotations

from typing import Any

from matplotlib.lines import Line2D
from matplotlib.transforms import Transform


class QuickLine(Line2D):
    """A line that is clipped to the box of its axes.

    So is any line, but to a box of its own, which Matplotlib works out from the outline of the
    axes when it takes the line in, and again when it draws it: half the time of a short line.
    """

    def set_clip_path(self, path: Any, transform: Transform | None = None) -> None:
        """Clip it to the axes' own box instead of to their background."""
        if self.axes is not None and path is self.axes.patch:
            self.set_clip_box(self.axes.bbox)
        else:
            super().set_clip_path(path, transform)
