"""Quick ticks, against Matplotlib's own."""

from typing import Any

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator
from matplotlib.transforms import Bbox

from designopt.plot.figures import style
from designopt.plot.quick_text import QuickText
from designopt.plot.ruling import Ruling, hold, numbers, ticks
from tests.designopt.tables import cases

MOST = 6
SIZE = 9
WIDE = [(0.0, 10.0), (-0.37, 0.41), (-130.0, 55.0), (7.0, -3.0), (-1000.0, 1000.0)]


def ruled(limits, along: Any, **options) -> tuple[Any, Ruling]:
    """Axes with quick ticks along one of its axes, and those."""
    with style():
        figure = Figure(figsize=(5, 4), dpi=100)
        canvas = FigureCanvasAgg(figure)
        axes = figure.add_axes((0.2, 0.2, 0.7, 0.7))
        axes.set(**{f"{along}lim": limits, f"{along}label": "name"})
        ruling = Ruling(axes, along, MOST, SIZE, **options)
        canvas.draw()
        figure.draw_artist(ruling)
    return axes, ruling


def shown(ruling, kind: Any) -> list[Any]:
    return [each for each in ruling.get_children() if isinstance(each, kind) and each.get_visible()]


def numbers_of(ruling):
    return [text for text in shown(ruling, QuickText) if text.get_text()]


@pytest.mark.parametrize("along", ["x", "y"])
@pytest.mark.parametrize("limits", WIDE)
def test_numbers_stand_where_matplotlib_draws_them(along, limits):
    _, ruling = ruled(limits, along)
    with style():
        figure = Figure(figsize=(5, 4), dpi=100)
        axes = figure.add_axes((0.2, 0.2, 0.7, 0.7))
        axes.set(**{f"{along}lim": limits})
        axis: Any = axes.xaxis if along == "x" else axes.yaxis
        axis.set_major_locator(MaxNLocator(MOST, steps=[1, 2, 2.5, 5, 10]))
        figure.draw_without_rendering()
    inside = [
        label
        for place, label in zip(axis.get_majorticklocs(), axis.get_ticklabels(), strict=True)
        if min(limits) <= place <= max(limits)
    ]
    assert [text.get_text() for text in numbers_of(ruling)] == [text.get_text() for text in inside]
    for ours, own in zip(numbers_of(ruling), inside, strict=True):
        boxes = ours.get_window_extent().extents, own.get_window_extent().extents
        np.testing.assert_allclose(*boxes, atol=3)


@pytest.mark.parametrize("along", ["x", "y"])
def test_they_follow_the_limits_and_leave_room_for_the_name(along):
    axes, ruling = ruled((0.0, 1.0), along)
    axes.set(**{f"{along}lim": (-200.0, 100.0)})
    ruling.draw(axes.figure.canvas.get_renderer())
    _, wanted = ruled((-200.0, 100.0), along)
    [lines], [marks] = shown(ruling, LineCollection), shown(ruling, Line2D)
    [other_lines], [other_marks] = shown(wanted, LineCollection), shown(wanted, Line2D)
    np.testing.assert_array_equal(lines.get_segments(), other_lines.get_segments())
    np.testing.assert_array_equal(marks.get_xydata(), other_marks.get_xydata())
    own = "xy".index(along)
    assert marks.get_xydata()[:, own].tolist() == [-200, -150, -100, -50, 0, 50, 100]
    # None at the first limit, where the spine is; the others cross the axes.
    segments = np.array(lines.get_segments())
    assert segments[:, :, own].tolist() == [[place] * 2 for place in (-150, -100, -50, 0, 50, 100)]
    assert segments[:, :, 1 - own].tolist() == [[0, 1]] * 6
    covered = ruling.get_window_extent()
    assert covered.bounds == wanted.get_window_extent().bounds
    name: Any = (axes.xaxis if along == "x" else axes.yaxis).label
    assert not Bbox.intersection(name.get_window_extent(), covered)
    assert covered.y1 < axes.bbox.y0 if along == "x" else covered.x1 < axes.bbox.x0


def test_lines_can_be_left_out():
    _, ruling = ruled((0.0, 1.0), "x", grid=False)
    assert not shown(ruling, LineCollection)


def test_outside_its_part_of_the_figure_nothing_is_drawn():
    figure = Figure(figsize=(4, 2), dpi=100)
    canvas = FigureCanvasAgg(figure)
    halves: Any = figure.subfigures(1, 2)
    axes = halves[1].add_axes((0.02, 0.2, 0.9, 0.7))
    axes.set_ylim(-1000, 1000)
    ruling = Ruling(axes, "y", MOST, SIZE)
    canvas.draw()
    before = np.array(canvas.buffer_rgba())
    figure.draw_artist(ruling)
    changed = np.flatnonzero((before != np.array(canvas.buffer_rgba())).any(axis=(0, 2)))
    assert changed.size
    assert changed[0] >= halves[0].bbox.x1


@pytest.mark.parametrize(("limits", "words"), cases("tick_numbers"))
def test_numbers_in_words(limits, words):
    found = ticks(MaxNLocator(MOST, steps=[1, 2, 2.5, 5, 10]), (limits[0], limits[1]))
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
