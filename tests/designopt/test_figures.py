"""One look for all figures, without touching anybody's Matplotlib."""

import matplotlib
import numpy as np
import pytest

from designopt.plot.figures import (
    STYLE,
    TEXT_WIDTH,
    angle_ticks,
    label_plainly,
    legend_below,
    new_figure,
    save,
    share_limits,
    style,
)
from tests.designopt.tables import cases


def test_style_comes_and_goes():
    before = matplotlib.rcParams["font.size"]
    with style():
        assert matplotlib.rcParams["font.size"] == STYLE["font.size"]
    assert matplotlib.rcParams["font.size"] == before


def test_the_same_drawing_gives_the_same_files(tmp_path):
    def write(name):
        with style():
            drawing, axes = new_figure()
            axes[0, 0].plot([1, 2], [3, 4])
            return [path.read_bytes() for path in save(drawing, tmp_path, name)]

    assert write("a") == write("b")
    assert (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")
    assert b"<svg" in (tmp_path / "a.svg").read_bytes()


@pytest.mark.parametrize(("width", "height"), [(90.0, 20.0), (20.0, 90.0)])
@pytest.mark.parametrize(("rows", "columns"), [(1, 1), (2, 3)])
def test_axes_of_a_fixed_aspect_leave_no_band_empty(tmp_path, width, height, rows, columns):
    with style(), matplotlib.rc_context({"savefig.dpi": 20}):
        drawing, grid = new_figure(rows, columns)
        for axes in grid.flat:
            axes.plot([0, width], [0, height], label="a line")
            axes.set(aspect="equal", xlabel="x (mm)")
        drawing.legend(*grid[0, 0].get_legend_handles_labels(), loc="outside lower center")
        save(drawing, tmp_path, "drawing")
        box = drawing.get_tightbbox()
    margins = [box.x0, box.y0, *drawing.get_size_inches() - [box.x1, box.y1]]
    assert min(margins) > -0.02
    assert max(margins) < 0.15
    assert drawing.get_figwidth() <= TEXT_WIDTH
    # Nor between the rows: ticks and a label stand there, and nothing else.
    if rows == 2:
        upper, lower = (axes.get_position() for axes in grid[:, 0])
        assert (upper.y0 - lower.y1) * drawing.get_figheight() < 0.6


def test_a_figure_without_fixed_aspect_keeps_its_size(tmp_path):
    drawing, grid = new_figure(height=3.0)
    grid[0, 0].plot([0, 1], [0, 5])
    save(drawing, tmp_path, "drawing")
    assert drawing.get_size_inches().tolist() == [TEXT_WIDTH, 3.0]


@pytest.mark.parametrize(("length", "lines"), [(4, 2), (25, 3), (90, 5)])
def test_a_legend_has_as_many_columns_as_fit(length, lines):
    """Five names, one of them in both axes."""
    drawing, grid = new_figure(1, 2)
    for number in range(5):
        grid[0, number % 2].plot([0, 1], [0, number], label=f"{number}" * length)
    grid[0, 1].plot([0, 1], [1, 0], label="0" * length)
    assert legend_below(drawing) == lines
    (legend,) = drawing.legends
    assert len(legend.get_texts()) == 5
    drawing.draw_without_rendering()
    box = legend.get_window_extent()
    assert lines == 5 or (box.x0 >= 0 and box.x1 <= drawing.bbox.width)


def test_shared_limits_hold_what_is_drawn_anywhere():
    drawing, grid = new_figure(1, 2)
    grid[0, 0].plot([-10, 5], [0, 7])
    grid[0, 1].fill([0, 80, 80], [-40, -40, 3])
    share_limits(grid[0])
    for axes in grid[0]:
        (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
        assert left < -10 < 80 < right
        assert low < -40 < 7 < high
    drawing.clear()


@pytest.mark.parametrize(("last", "most", "ticks"), cases("angle_ticks"))
def test_ticks_of_angles(last, most, ticks):
    assert angle_ticks(last, most).tolist() == ticks


@pytest.mark.parametrize(
    "limits", [(0.03, 4), (4.3, 9.2), (470, 800), (2e-16, 5e-16), (1, 2e4), (1e-8, 1)]
)
def test_a_logarithmic_axis_has_several_plain_numbers(limits):
    drawing, grid = new_figure(height=2.0)
    axis = grid[0, 0].yaxis
    grid[0, 0].set(yscale="log", ylim=limits)
    label_plainly(axis)
    drawing.draw_without_rendering()
    inside = [
        text.get_text().replace("\N{MINUS SIGN}", "-")
        for place, text in zip(axis.get_majorticklocs(), axis.get_ticklabels(), strict=True)
        if limits[0] <= place <= limits[1]
    ]
    assert len(inside) >= 3
    assert [f"{float(text):g}" for text in inside] == inside


def test_the_label_of_a_colour_bar_stands_apart_from_the_next_axes_label():
    with style():
        drawing, grid = new_figure(1, 2, height=3.4)
        labels = []
        for axes in grid[0]:
            shown = axes.contourf([0, 45, 90], [0, 45, 90], np.eye(3))
            axes.set(ylabel="DIP (°)", aspect="equal")
            bar = drawing.colorbar(shown, ax=axes, label="turn of the crank (°)")
            labels.append((bar.ax.yaxis.label, axes.yaxis.label))
        drawing.draw_without_rendering()
        gap = labels[1][1].get_window_extent().x0 - labels[0][0].get_window_extent().x1
    assert gap > drawing.dpi * STYLE["font.size"] / 72
