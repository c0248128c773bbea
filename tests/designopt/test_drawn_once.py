"""A legend whose pixels are kept, against one that is drawn every time."""

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg, RendererAgg
from matplotlib.figure import Figure
from matplotlib.legend import Legend
from matplotlib.lines import Line2D
from matplotlib.transforms import Bbox

from designopt.plot.drawn_once import DrawnOnce


class Counted(Legend):
    """Counts how often it is drawn."""

    draws = 0

    def draw(self, renderer):
        self.draws += 1
        super().draw(renderer)


def pictured():
    figure = Figure(figsize=(4, 2), dpi=100, facecolor="#dddddd")
    canvas = FigureCanvasAgg(figure)
    axes = figure.add_axes((0, 0, 1, 1))
    axes.axis("off")
    lines = [Line2D([], [], color=color, linewidth=3) for color in ("red", "#0072B2")]
    legend = Counted(axes, lines, ["some words", "and others"], loc="center")
    return figure, canvas, axes, legend


def pixels(canvas):
    return np.array(canvas.buffer_rgba()).astype(int)


def test_its_pixels_are_those_of_the_artist():
    figure, canvas, axes, legend = pictured()
    canvas.draw()
    blank = pixels(canvas)
    figure.draw_artist(legend)
    wanted = pixels(canvas)
    kept = DrawnOnce(legend)
    axes.add_artist(kept)
    for _ in range(3):
        canvas.draw()
        # But for the rounding of what is drawn over the ground in two steps.
        np.testing.assert_allclose(pixels(canvas), wanted, atol=3)
    assert (wanted != blank).any()
    assert legend.draws == 2
    assert kept.get_window_extent().bounds == legend.get_window_extent().bounds


def test_at_another_size_it_is_drawn_anew():
    figure, canvas, axes, legend = pictured()
    axes.add_artist(DrawnOnce(legend))
    canvas.draw()
    assert legend.draws == 1
    small = np.count_nonzero((pixels(canvas) != pixels(canvas)[0, 0]).any(-1))
    figure.dpi = 200
    canvas.draw()
    assert legend.draws == 2
    large = np.count_nonzero((pixels(canvas) != pixels(canvas)[0, 0]).any(-1))
    assert 2.5 < large / small < 5


def test_it_stays_what_it_is_where_no_pixels_are_drawn(tmp_path):
    figure, _, axes, legend = pictured()
    axes.add_artist(DrawnOnce(legend))
    figure.savefig(tmp_path / "legend.svg")
    assert "<image" not in (tmp_path / "legend.svg").read_text()
    assert legend.draws == 1


def test_it_is_clipped_and_hidden():
    _, canvas, _, legend = pictured()
    canvas.draw()
    blank = pixels(canvas)
    kept = DrawnOnce(legend)
    kept.set(clip_box=Bbox([[0, 0], [200, 200]]), clip_on=True)
    kept.draw(canvas.get_renderer())
    changed = (pixels(canvas) != blank).any(axis=(0, 2))
    assert changed[:200].any()
    assert not changed[201:].any()
    canvas.draw()
    kept.set_visible(False)
    kept.draw(canvas.get_renderer())
    np.testing.assert_array_equal(pixels(canvas), blank)


def test_one_that_shows_nothing_is_nothing():
    _, canvas, _, legend = pictured()
    legend.set_visible(False)
    canvas.draw()
    blank = pixels(canvas)
    DrawnOnce(legend).draw(canvas.get_renderer())
    assert isinstance(canvas.get_renderer(), RendererAgg)
    np.testing.assert_array_equal(pixels(canvas), blank)
