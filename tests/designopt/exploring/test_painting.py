"""What is drawn anew, against the whole figure drawn anew."""

from typing import Any

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from designopt.exploring.painting import Painter


class Drawn:
    """Three axes side by side, the names of the middle one so wide that they reach its
    neighbours' places, and a line that moves in each."""

    def __init__(self):
        self.figure = Figure(figsize=(6, 3))
        self.canvas = FigureCanvasAgg(self.figure)
        self.figure.add_axes((0, 0, 1, 1)).axis("off")
        area: Any = self.figure.subfigures()
        places = [(x, 0.2, 0.25, 0.6) for x in (0.06, 0.38, 0.72)]
        self.axes = [area.add_axes(place) for place in places]
        self.axes[1].set_xlabel("much longer than the axes are wide, on both of their sides")
        self.lines = [axes.plot([0, 1], [0, 1])[0] for axes in self.axes]
        self.painter = Painter(self.figure)
        self.patch = self.painter.patch(area.bbox, self.lines)
        self.painter.draw()

    def pixels(self):
        return np.array(self.canvas.buffer_rgba())

    def redrawn(self):
        self.painter.draw()
        return self.pixels()


@pytest.mark.parametrize("changed", [[0], [1], [2], [0, 2]])
def test_axes_drawn_anew_leave_their_neighbours_whole(changed):
    drawn = Drawn()
    before = drawn.pixels()
    for _ in range(2):  # there and back
        for number in changed:
            axes = drawn.axes[number]
            axes.set_ylim(0, 1e4 if axes.get_ylim()[1] < 2 else 1)
        drawn.painter.renew(drawn.patch, [drawn.axes[number] for number in changed])
        drawn.painter.paint([drawn.patch])
        painted = drawn.pixels()
        assert (painted != before).any()
        np.testing.assert_array_equal(painted, drawn.redrawn())
        before = painted


def test_only_axes_that_changed_and_their_neighbours_are_drawn_anew():
    drawn = Drawn()
    drawn.axes[1].set_xlabel("short")
    drawn.painter.draw()
    drawn.axes[0].set_title("new")
    drawn.axes[2].set_title("later")
    drawn.painter.renew(drawn.patch, [drawn.axes[0]])
    drawn.painter.paint([drawn.patch])
    painted, whole = drawn.pixels(), drawn.redrawn()
    columns = np.flatnonzero((painted != whole).any(axis=(0, 2)))
    assert columns.size
    assert columns.min() > 0.7 * painted.shape[1]
