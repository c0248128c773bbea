"""Quick ticks, against Matplotlib's own."""

from typing import Any

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from matplotlib.transforms import Bbox

from designopt.plot.figures import style
from designopt.plot.ruling import Ruling, hold, numbers, ticks

MOST = 6
SIZE = 9


def drawn(limits, quick, along: Any = "x", **options):
    """Axes with ticks along one of its axes, and their pixels."""
    with style():
        figure = Figure(figsize=(5, 4), dpi=100)
        canvas = FigureCanvasAgg(figure)
        axes = figure.add_axes((0.2, 0.2, 0.7, 0.7))
        axes.set(**{f"{along}lim": limits, f"{along}label": "name"})
        other: Any = axes.yaxis if along == "x" else axes.xaxis
        other.set_visible(False)
        if quick:
            ruling = Ruling(axes, along, MOST, SIZE, **options)
            canvas.draw()
            figure.draw_artist(ruling)
        else:
            own: Any = axes.xaxis if along == "x" else axes.yaxis
            own.set_major_locator(MaxNLocator(MOST, steps=[1, 2, 2.5, 5, 10]))
            canvas.draw()
    return axes, 255.0 - np.array(canvas.buffer_rgba())[:, :, :3]


@pytest.mark.parametrize("along", ["x", "y"])
@pytest.mark.parametrize("limits", [(0.0, 10.0), (-0.37, 0.41), (-130.0, 55.0), (7.0, -3.0)])
def test_it_looks_as_matplotlib_draws_it(along, limits):
    _, quick = drawn(limits, True, along)
    axes, own = drawn(limits, False, along)
    box = np.round(axes.bbox.extents).astype(int)
    inside = np.s_[400 - box[3] : 400 - box[1], box[0] : box[2]]
    # The same lines in the same places.
    np.testing.assert_allclose(quick[inside], own[inside], atol=15)
    assert np.abs(quick[inside] - own[inside]).mean() < 0.01
    # Numbers and the axis' name lie around it, nearly in the same places.
    for image in (quick, own):
        image[inside] = 0
    across = 1 if along == "x" else 0
    beside = [np.flatnonzero(image.max(axis=(2, 1 - across)) > 60) for image in (quick, own)]
    assert abs(beside[0][0] - beside[1][0]) <= 3
    assert abs(beside[0][-1] - beside[1][-1]) <= 3
    assert quick.sum() == pytest.approx(own.sum(), rel=0.1)  # as much ink


def test_it_follows_the_limits():
    axes, before = drawn((0.0, 1.0), True)
    (ruling,) = (child for child in axes.get_children() if isinstance(child, Ruling))
    axes.set_xlim(-200, 100)
    figure: Any = axes.figure
    figure.canvas.draw()
    figure.draw_artist(ruling)
    after = 255.0 - np.array(figure.canvas.buffer_rgba())[:, :, :3]
    np.testing.assert_array_equal(after, drawn((-200.0, 100.0), True)[1])
    assert (after != before).any()
    covered = ruling.get_window_extent()
    left, right = (axes.transData.transform((x, 0))[0] for x in (-200, 100))
    assert covered.x0 < left < right < covered.x1
    assert covered.y1 < axes.bbox.y0


@pytest.mark.parametrize("along", ["x", "y"])
@pytest.mark.parametrize("limits", [(-12.5, -10.0), (-1000.0, 1000.0), (-0.02, 0.01)])
def test_there_is_room_for_numbers(along, limits):
    axes, _ = drawn(limits, True, along)
    (ruling,) = (child for child in axes.get_children() if isinstance(child, Ruling))
    name: Any = (axes.xaxis if along == "x" else axes.yaxis).label
    assert not Bbox.intersection(name.get_window_extent(), ruling.get_window_extent())


def test_lines_can_be_left_out():
    axes, _ = drawn((0.0, 1.0), True, grid=False)
    (ruling,) = (child for child in axes.get_children() if isinstance(child, Ruling))
    shown = [child for child in ruling.get_children() if child.get_visible()]
    assert not any(isinstance(child, LineCollection) for child in shown)


def test_outside_its_part_of_the_figure_nothing_is_drawn():
    figure = Figure(figsize=(4, 2), dpi=100)
    canvas = FigureCanvasAgg(figure)
    halves: Any = figure.subfigures(1, 2)
    left, right = halves
    axes = right.add_axes((0.02, 0.2, 0.9, 0.7))
    axes.set_ylim(-1000, 1000)
    ruling = Ruling(axes, "y", MOST, SIZE)
    canvas.draw()
    before = np.array(canvas.buffer_rgba())
    figure.draw_artist(ruling)
    after = np.array(canvas.buffer_rgba())
    changed = np.flatnonzero((before != after).any(axis=(0, 2)))
    assert changed.size
    assert changed[0] >= left.bbox.x1


@pytest.mark.parametrize(
    ("limits", "words"),
    [
        ((0.0, 1.0), ["0.0", "0.2", "0.4", "0.6", "0.8", "1.0"]),
        ((-3.0, 9.0), ["−2", "0", "2", "4", "6", "8"]),
        ((0.0, 1.5), ["0.00", "0.25", "0.50", "0.75", "1.00", "1.25", "1.50"]),
        ((0.0, 2.9e-5), ["0", "5e−06", "1e−05", "1.5e−05", "2e−05", "2.5e−05"]),
        ((0.0, 4.1e7), ["0", "1e+07", "2e+07", "3e+07", "4e+07"]),
    ],
)
def test_numbers_in_words(limits, words):
    found = ticks(MaxNLocator(MOST, steps=[1, 2, 2.5, 5, 10]), limits)
    assert numbers(found) == words
    np.testing.assert_allclose([float(word.replace("−", "-")) for word in words], found, rtol=1e-9)


def test_a_circle_that_is_held_looks_like_one():
    figure = Figure(figsize=(6, 3))
    for at in ((0.1, 0.1, 0.8, 0.8), (0.1, 0.1, 0.2, 0.8)):
        axes = figure.add_axes(at)
        for low, high in (((0, 0), (10, 1)), ((-5, 3), (-4, 90)), ((2, 2), (2, 3))):
            hold(axes, np.array(low, float), np.array(high, float))
            place: Any = axes.bbox
            corners = axes.transData.transform([low, high])
            assert (corners >= place.min - 1e-6).all()
            assert (corners <= place.max + 1e-6).all()
            # It fills them one way, and is in their middle the other way.
            assert np.max(np.ptp(corners, axis=0) / place.size) == pytest.approx(1)
            np.testing.assert_allclose(corners.mean(axis=0), (place.min + place.max) / 2)
            scales = np.diff(axes.transData.transform([(0, 0), (1, 1)]), axis=0)[0]
            assert scales[0] == pytest.approx(scales[1], rel=1e-9)


def test_around_a_point_a_millimetre_is_held():
    axes = Figure(figsize=(6, 3)).add_axes((0.1, 0.1, 0.8, 0.8))
    hold(axes, np.array([5.0, -3.0]), np.array([5.0, -3.0]))
    assert axes.get_ylim() == pytest.approx((-3.5, -2.5))
    assert np.mean(axes.get_xlim()) == pytest.approx(5.0)
