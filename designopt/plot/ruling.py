"""Ticks, their numbers and grid lines of axes whose limits may change with every move of a slider.

Matplotlib draws those of one axis in 3 to 6 ms, too long for a picture of several axes that is to
follow a hand; these take a tenth of that.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import zip_longest
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from jaxtyping import Float
from matplotlib import rcParams
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.lines import Line2D
from matplotlib.markers import TICKDOWN, TICKLEFT
from matplotlib.ticker import MaxNLocator, NullLocator
from matplotlib.transforms import Bbox, ScaledTranslation

from designopt.plot.quick_text import QuickText

if TYPE_CHECKING:
    from matplotlib.backend_bases import RendererBase

STEPS = (1, 2, 2.5, 5, 10)
TICK, GAP = 3.5, 3.5
"""Length of a tick, and from its end to its number, points."""
HEIGHT, WIDTH = 0.73, 3.4
"""Of −1000, which the axis' name leaves room for, as parts of the text's size."""
ORDINARY = (1e-4, 1e6)
"""Least and greatest numbers that are written without an exponent."""


class Ruling(Artist):
    """The ticks, numbers and grid lines along one axis, at the limits that it has when drawn."""

    def __init__(
        self,
        axes: Axes,
        along: Literal["x", "y"],
        most: int,
        size: float,
        *,
        steps: Sequence[float] = STEPS,
        grid: bool = True,
    ) -> None:
        """Take the place of Matplotlib's own.

        Args:
            axes: where; in a figure that is drawn with `designopt.plot.figures.style`.
            along: which of its axes.
            most: most intervals between ticks.
            size: of the numbers, points.
            steps: between ticks, from 1 to 10, times a power of ten.
            grid: whether there are lines across the axes.
        """
        super().__init__()
        self.set(animated=True, clip_on=False, zorder=0.5)
        self._level = along == "x"
        self._locator = MaxNLocator(most, steps=list(steps))
        self._fitted: tuple[float, float] | None = None
        axes.add_artist(self)
        axis: Any = axes.xaxis if self._level else axes.yaxis
        axis.set_major_locator(NullLocator())
        away = TICK + GAP + (HEIGHT * size if self._level else 0)
        axis.labelpad = away + GAP + (0 if self._level else WIDTH * size)
        across = axes.get_xaxis_transform() if self._level else axes.get_yaxis_transform()
        shift = (0.0, -away) if self._level else (-away, -HEIGHT * size / 2)
        points: Any = axes.figure.dpi_scale_trans
        self._lines = LineCollection(
            [],
            colors=rcParams["grid.color"],
            linewidths=rcParams["grid.linewidth"],
            alpha=rcParams["grid.alpha"],
            transform=across,
            visible=grid,
        )
        self._lines.set_clip_path(axes.patch)
        mark: Any = TICKDOWN if self._level else TICKLEFT
        self._marks = Line2D(
            [],
            [],
            linestyle="none",
            marker=mark,
            markersize=TICK,
            markeredgewidth=0.8,
            color=rcParams["xtick.color"],
            transform=across,
            clip_box=axes.figure.bbox,
        )
        style: dict[str, Any] = {
            "fontsize": size,
            "ha": "center" if self._level else "right",
            "transform": across + ScaledTranslation(shift[0] / 72, shift[1] / 72, points),
            "clip_box": axes.figure.bbox,
        }
        # Ticks are one more than intervals.
        self._numbers = [QuickText(0, 0, "", **style) for _ in range(most + 1)]
        for artist in self.get_children():
            artist.set_figure(axes.figure)

    def get_children(self) -> list[Artist]:
        """The lines, the ticks, and their numbers."""
        return [self._lines, self._marks, *self._numbers]

    def get_window_extent(self, renderer: RendererBase | None = None) -> Bbox:
        """What the numbers cover, pixels."""
        self._fit()
        shown = [text for text in self._numbers if text.get_text()]
        if not shown:
            return Bbox.null()
        return Bbox.union([text.get_window_extent(renderer) for text in shown])

    def get_tightbbox(self, renderer: RendererBase | None = None) -> Bbox:
        """The same; layouts would take it to end where it is clipped."""
        return self.get_window_extent(renderer)

    def draw(self, renderer: RendererBase) -> None:
        """Draw them."""
        if not self.get_visible():
            return
        self._fit()
        for artist in self.get_children():
            artist.draw(renderer)
        self.stale = False

    @property
    def limits(self) -> tuple[float, float]:
        """Those of the axes; in axes that stay where they are, all that its looks depend on."""
        axes: Any = self.axes
        return axes.get_xlim() if self._level else axes.get_ylim()

    def _fit(self) -> None:
        limits = self.limits
        if limits == self._fitted:
            return
        self._fitted = limits
        values = ticks(self._locator, limits)
        turn = 1 if self._level else -1
        ends = np.array([0.0, 1.0])
        # At the first limit is the spine, which lies below what changes.
        crossing = values[np.abs(values - limits[0]) > 1e-6 * abs(limits[1] - limits[0])]
        self._lines.set_segments(
            [np.stack([np.full(2, value), ends][::turn], axis=-1) for value in crossing]
        )
        self._marks.set_data(*[values, np.zeros_like(values)][::turn])
        for text, value, words in zip_longest(self._numbers, values, numbers(values)):
            text.set_text(words or "")
            if words:
                text.set_position((value, 0.0) if self._level else (0.0, value))


def hold(axes: Axes, low: Float[np.ndarray, " 2"], high: Float[np.ndarray, " 2"]) -> None:
    """Choose limits that hold a rectangle, at the same scale along both axes.

    Args:
        axes: whose place in the figure does not depend on their limits; where that changes, they
            are held anew.
        low: the rectangle's lower left corner, (x, y).
        high: its upper right one.
    """
    place = np.array(axes.bbox.size)
    middle = (low + high) / 2
    scale = float(np.max((high - low) / place))
    half = (scale or 1.0 / float(np.min(place))) * place / 2  # around a point a millimetre
    (left, bottom), (right, top) = (middle - half).tolist(), (middle + half).tolist()
    axes.set(xlim=(left, right), ylim=(bottom, top))


def ticks(locator: MaxNLocator, limits: tuple[float, float]) -> Float[np.ndarray, " ticks"]:
    """The ticks between limits, without rounding noise."""
    low, high = sorted(limits)
    values = np.asarray(locator.tick_values(low, high), float)
    if len(values) > 1:
        step = values[1] - values[0]
        values = values[(values > low - 1e-6 * step) & (values < high + 1e-6 * step)]
        values = np.where(np.abs(values) < 1e-6 * step, 0.0, values)
    return values


def numbers(values: Float[np.ndarray, " ticks"]) -> list[str]:
    """Ticks in words, all with the same number of decimals or all with exponents."""
    short = [f"{value:.8g}" for value in values]
    sizes = np.abs(values[values != 0])
    if len(sizes) and not (ORDINARY[0] <= np.min(sizes) and np.max(sizes) < ORDINARY[1]):
        words = [f"{value:.4g}" for value in values]
    else:
        decimals = max((len(text.partition(".")[2]) for text in short), default=0)
        words = [f"{value:.{decimals}f}" for value in values]
    return [text.replace("-", "−") for text in words]
