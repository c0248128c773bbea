"""A line taken in by axes quickly, against Matplotlib's own."""

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.path import Path
from matplotlib.transforms import Bbox, TransformedPath

from designopt.plot.quick_line import QuickLine

BEYOND = np.array([(-1.0, 0.3), (0.4, 0.7), (2.0, -1.0)])


def drawn(kind, **style):
    """A line that leaves its axes, after the axes have moved and their limits changed."""
    figure = Figure(figsize=(4, 3), dpi=100)
    canvas = FigureCanvasAgg(figure)
    axes = figure.add_axes((0.1, 0.1, 0.5, 0.5))
    line = kind(*BEYOND.T, linewidth=7, **style)
    axes.add_artist(line)
    canvas.draw()
    axes.set_position((0.3, 0.2, 0.5, 0.6))
    axes.set(xlim=(0, 1.2), ylim=(0, 0.9))
    canvas.draw()
    return axes, line, np.array(canvas.buffer_rgba())


@pytest.mark.parametrize("style", [{}, {"marker": "o", "linestyle": "--"}, {"clip_on": False}])
def test_it_looks_as_any_line_does(style):
    np.testing.assert_array_equal(drawn(QuickLine, **style)[-1], drawn(Line2D, **style)[-1])


def test_it_is_clipped_to_the_box_of_its_axes():
    axes, line, _ = drawn(QuickLine)
    assert line.get_clip_box() is axes.bbox
    assert line.get_clip_path() is None


def test_another_clip_is_kept():
    axes, line, _ = drawn(QuickLine)
    circle = Path.unit_circle()
    line.set_clip_path(circle, axes.transData)
    assert isinstance(line.get_clip_path(), TransformedPath)
    box = Bbox([(0, 0), (9, 9)])
    line.set_clip_path(None)
    line.set_clip_box(box)
    assert line.get_clip_path() is None
    assert line.get_clip_box() is box
