"""What is drawn many times a second, against Matplotlib's own artists."""

import matplotlib
import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.legend import Legend
from matplotlib.lines import Line2D
from matplotlib.path import Path
from matplotlib.text import Text
from matplotlib.transforms import Bbox, TransformedPath

from designopt.plot.drawn_once import DrawnOnce
from designopt.plot.lettering import Lettering
from designopt.plot.quick_line import QuickLine
from designopt.plot.quick_text import QuickText

BEYOND = np.array([(-1.0, 0.3), (0.4, 0.7), (2.0, -1.0)])
FINE = 16
"""Samples across a pixel, and down it, of the reference that letters are compared with."""
PIXELS = 8.0
"""The room that Matplotlib leaves on both sides of a text."""


def canvas_of(*size, dpi=100):
    figure = Figure(figsize=size, dpi=dpi, facecolor="#dddddd")
    return figure, FigureCanvasAgg(figure)


def pixels(canvas):
    return np.array(canvas.buffer_rgba()).astype(int)


def line_drawn(kind, **style):
    """A line that leaves its axes, after the axes have moved and their limits changed."""
    figure, canvas = canvas_of(4, 3)
    axes = figure.add_axes((0.1, 0.1, 0.5, 0.5))
    line = kind(*BEYOND.T, linewidth=7, **style)
    axes.add_artist(line)
    canvas.draw()
    axes.set_position((0.3, 0.2, 0.5, 0.6))
    axes.set(xlim=(0, 1.2), ylim=(0, 0.9))
    canvas.draw()
    return axes, line, pixels(canvas)


@pytest.mark.parametrize("style", [{}, {"marker": "o", "linestyle": "--"}, {"clip_on": False}])
def test_a_quick_line_looks_as_any_line_does(style):
    wanted = line_drawn(Line2D, **style)[-1]
    np.testing.assert_array_equal(line_drawn(QuickLine, **style)[-1], wanted)


def test_a_quick_line_is_clipped_to_the_box_of_its_axes_unless_it_has_another_clip():
    axes, line, _ = line_drawn(QuickLine)
    assert (line.get_clip_box(), line.get_clip_path()) == (axes.bbox, None)
    line.set_clip_path(Path.unit_circle(), axes.transData)
    assert isinstance(line.get_clip_path(), TransformedPath)
    box = Bbox([(0, 0), (9, 9)])
    line.set_clip_path(None)
    line.set_clip_box(box)
    assert (line.get_clip_box(), line.get_clip_path()) == (box, None)


def text_drawn(kind, **style):
    figure, canvas = canvas_of(2, 1)
    figure.set_facecolor("white")
    figure.add_artist(kind(0.5, 0.5, "-12.3456", transform=figure.transFigure, **style))
    canvas.draw()
    return 255.0 - pixels(canvas)[:, :, :3]


@pytest.mark.parametrize("style", [("left", "bold"), ("right", "normal")])
def test_a_quick_text_covers_what_a_text_covers(style):
    style = {"ha": style[0], "weight": style[1], "size": 12, "color": "#1b2530"}
    quick, slow = text_drawn(QuickText, **style), text_drawn(Text, **style)
    assert quick.sum() == pytest.approx(slow.sum(), rel=0.1)  # as much ink
    for axis in (0, 1):  # and in the same place, but for the rounding of each glyph's width
        inked = [np.flatnonzero(image.max(axis=(2, 1 - axis)) > 60) for image in (quick, slow)]
        ours, theirs = (rows[[0, -1]] for rows in inked)
        np.testing.assert_allclose(ours, theirs, atol=2)
    assert not text_drawn(QuickText, visible=False).any()
    assert text_drawn(QuickText, color="#ff0000")[:, :, 0].max() == 0  # red stays red


def inked(canvas):
    """How many pixels are not of the ground."""
    image = pixels(canvas)
    return np.count_nonzero((image != image[0, 0]).any(axis=-1))


def counted(monkeypatch):
    """A legend on a canvas, and how often any legend was drawn."""
    draws, draw = [], Legend.draw
    monkeypatch.setattr(
        Legend, "draw", lambda self, renderer: (draws.append(self), draw(self, renderer))
    )
    figure, canvas = canvas_of(4, 2)
    axes = figure.add_axes((0, 0, 1, 1))
    axes.axis("off")
    lines = [Line2D([], [], color=color, linewidth=3) for color in ("red", "#0072B2")]
    canvas.draw()
    return figure, canvas, axes, Legend(axes, lines, ["words", "others"], loc="center"), draws


def test_what_is_drawn_once_has_the_pixels_of_its_artist(monkeypatch):
    figure, canvas, axes, legend, draws = counted(monkeypatch)
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
    assert len(draws) == 2
    assert kept.get_window_extent().bounds == legend.get_window_extent().bounds
    whole = inked(canvas)
    kept.set(clip_box=Bbox([[0, 0], [200, 200]]), clip_on=True)
    canvas.draw()
    np.testing.assert_array_equal(pixels(canvas)[:, 201:], blank[:, 201:])
    assert 0 < inked(canvas) < whole
    kept.set_clip_on(False)
    figure.dpi = 200  # at another size it is drawn anew
    canvas.draw()
    assert len(draws) == 3
    assert 2.5 < inked(canvas) / whole < 5
    kept.set_visible(False)
    canvas.draw()
    legend.set_visible(False)  # of nothing there are no pixels
    DrawnOnce(legend).draw(canvas.get_renderer())
    assert (pixels(canvas) == blank[0, 0]).all()


def test_quick_artists_stay_what_they_are_where_no_pixels_are_drawn(monkeypatch, tmp_path):
    figure, _, axes, legend, draws = counted(monkeypatch)
    axes.add_artist(DrawnOnce(legend))
    figure.add_artist(QuickText(0.5, 0.5, "$-12.3456$"))
    with matplotlib.rc_context({"svg.fonttype": "none"}):
        figure.savefig(tmp_path / "figure.svg")
    written = (tmp_path / "figure.svg").read_text()
    assert "<image" not in written
    assert "$-12.3456$" in written
    assert len(draws) == 1


@pytest.fixture
def axes():
    figure, _ = canvas_of(4, 3)
    axes = figure.add_axes((0.1, 0.1, 0.8, 0.8))
    axes.set(xlim=(-3, 7), ylim=(10, 20))
    return axes


def lettering(axes, words, **settings):
    made = Lettering(words, 30.0, axes.transData, axes.figure.dpi_scale_trans, **settings)
    axes.add_artist(made)
    return made


def box_of(made):
    return made.get_path().transformed(made.get_transform()).get_extents()


@pytest.mark.parametrize(("side", "across"), [("left", 0.0), ("center", 0.5), ("right", 1.0)])
@pytest.mark.parametrize("angle", [0.0, 90.0])
def test_lettering_stands_like_a_text(axes, side, across, angle):
    made = lettering(axes, "HAND", anchor=(across, 0.0))
    made.move((2.0, 14.0), (3.0, -5.0), np.radians(angle))
    text = axes.annotate("HAND", (2.0, 14.0), (3.0, -5.0), textcoords="offset points", fontsize=30)
    text.set(rotation=angle, ha=side, va="baseline", rotation_mode="anchor")
    axes.figure.canvas.draw()
    theirs = text.get_window_extent(axes.figure.canvas.get_renderer()).extents
    # The text's box has room for letters with a tail, below or to the right.
    beside = np.delete(np.arange(4), 2 if angle else 1)
    np.testing.assert_allclose(box_of(made).extents[beside], theirs[beside], atol=PIXELS)


def test_other_words_and_places(axes):
    made = lettering(axes, "A", anchor=(0.5, 0.5), rim=2.0, color="black")
    made.move((2.0, 14.0))
    for words, left in (("A", -3), ("HHH", -3), ("$5", -30)):
        made.say(words)
        assert made.words == words
        axes.set(xlim=(left, 7))
        box, (x, y) = box_of(made), axes.transData.transform((2.0, 14.0))
        assert (box.x0 + box.x1) / 2 == pytest.approx(x, abs=1e-6)
        assert box.y0 < y < box.y1


@pytest.mark.parametrize(("size", "rim"), [(6.0, 0.0), (8.5, 1.6)])
def test_every_bar_of_a_small_letter_is_drawn_wherever_it_stands(size, rim):
    figure, canvas = canvas_of(0.3, 0.3)
    figure.set_facecolor("white")
    made = Lettering("", size, figure.transFigure, figure.dpi_scale_trans, rim=rim, color="black")
    figure.add_artist(made)
    grid = (np.arange(30 * FINE) + 0.5) / FINE
    samples = np.stack(np.meshgrid(grid, grid), axis=-1).reshape(-1, 2)
    for number, letter in enumerate("EFHLTIV"):
        made.say(letter)
        made.move((0.5 + 0.13 * number / 30, 0.5 + 0.29 * number / 30))
        canvas.draw()
        ink = 1 - pixels(canvas)[::-1, :, 0] / 255
        path = made.get_path().transformed(made.get_transform())
        inside = path.contains_points(samples).reshape(30, FINE, 30, FINE)
        np.testing.assert_allclose(ink, inside.mean(axis=(1, 3)), atol=2 / FINE)
