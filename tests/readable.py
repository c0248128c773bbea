"""What every figure owes to who looks at it."""

from __future__ import annotations

import re

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.text import Text

UNIT = re.compile(
    r"\((°|%|mm|mm²|cm|µm|px|px/mm|px/°|mm/°|N|N mm|rad|s|ms|rows|1000 px|px of \d+ rows)\)"
)
"""At the end of an axis's label, or before what varies with it."""

HAS_A_UNIT = re.compile(
    r"\b(angle|bend|flexion|turn|PIP|DIP|diameter|height|length|width|distance|displacement|moment"
    r"|force|time|sagitta|roughness|coverage|yield|resolution|threshold|x|y|z)\b",
)
"""Quantities that have a unit."""

WITHOUT = re.compile(r"over|log₁₀|relative|distance from a change of views|of the")
"""Of these the unit cancels, or the words name what they are counted in."""

RAW = re.compile(r"`|\(deg\b|\(degrees\)|[A-Za-z]\w*_\w")


def assert_readable(figure: Figure) -> None:
    """Nothing sticks out or is cut off, nothing is raw, and axes of quantities have their unit."""
    figure.draw_without_rendering()
    box, (width, height) = figure.get_tightbbox(), figure.get_size_inches()
    outside = max(-box.x0, -box.y0, box.x1 - width, box.y1 - height)
    assert outside < 0.02, f"something is {outside:.2f} in outside of the figure"
    for text in figure.findobj(Text):
        # Mathematics is set as such, and a setting's key is typed as it stands.
        words = re.sub(r"\$.*?\$|\w+(\.\w+)+", "", text.get_text())
        assert not RAW.search(words), f"raw: {words!r}"
    for axes in figure.axes:
        if not axes.get_visible():
            continue
        for label in (axes.get_xlabel(), axes.get_ylabel()):
            if HAS_A_UNIT.search(label) and not WITHOUT.search(label):
                assert UNIT.search(label), f"an axis without its unit: {label!r}"
        if isinstance(axes.get_aspect(), float) and axes.axison:
            assert_whole(axes)
        assert_legend_apart(axes)


def assert_whole(axes: Axes) -> None:
    """A drawing to scale is not cut off: all points of its lines lie inside the axes."""
    (left, right), (low, high) = sorted(axes.get_xlim()), sorted(axes.get_ylim())
    room = 1e-6 * max(right - left, high - low)
    for line in axes.lines:
        if line.get_transform() == axes.transData and line.get_visible():
            x, y = (np.asarray(part, float) for part in line.get_data())
            good = np.isfinite(x) & np.isfinite(y)
            cut = (x < left - room) | (x > right + room) | (y < low - room) | (y > high + room)
            assert not np.any(cut & good), f"{line.get_label()}: cut off by the axes"


def assert_legend_apart(axes: Axes) -> None:
    """A legend inside the axes hides no point of a curve."""
    legend = axes.get_legend()
    if legend is None:
        return
    box = legend.get_window_extent()
    for line in axes.lines:
        if line.get_transform() == axes.transData and line.get_visible():
            points = axes.transData.transform(line.get_xydata())
            hidden = [box.contains(x, y) for x, y in points if np.isfinite([x, y]).all()]
            assert not any(hidden), f"the legend hides {sum(hidden)} points of {line.get_label()}"
