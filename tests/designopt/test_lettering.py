"""Texts as outlines stand where Matplotlib's own texts stand, and are as large."""

import math

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from designopt.plot.lettering import Lettering

FINE = 16
"""Samples across a pixel, and down it, of the reference that letters are compared with."""
PIXELS = 8.0
"""The room that Matplotlib leaves on both sides of a text."""


@pytest.fixture
def axes():
    figure = Figure(figsize=(4, 3), dpi=100)
    FigureCanvasAgg(figure)
    axes = figure.add_axes((0.1, 0.1, 0.8, 0.8))
    axes.set(xlim=(-3, 7), ylim=(10, 20))
    return axes


def lettering(axes, words, **settings):
    made = Lettering(words, 30.0, axes.transData, axes.figure.dpi_scale_trans, **settings)
    axes.add_artist(made)
    return made


@pytest.mark.parametrize(("side", "across"), [("left", 0.0), ("center", 0.5), ("right", 1.0)])
@pytest.mark.parametrize("angle", [0.0, 90.0])
def test_it_stands_like_a_text(axes, side, across, angle):
    made = lettering(axes, "HAND", anchor=(across, 0.0))
    made.move((2.0, 14.0), (3.0, -5.0), math.radians(angle))
    text = axes.annotate("HAND", (2.0, 14.0), (3.0, -5.0), textcoords="offset points", fontsize=30)
    text.set(rotation=angle, ha=side, va="baseline", rotation_mode="anchor")
    axes.figure.canvas.draw()
    renderer = axes.figure.canvas.get_renderer()
    ours = made.get_path().transformed(made.get_transform()).get_extents().extents
    theirs = text.get_window_extent(renderer).extents
    # The text's box has room for letters with a tail, below or to the right.
    tail = [2] if angle else [1]
    np.testing.assert_allclose(np.delete(ours, tail), np.delete(theirs, tail), atol=PIXELS)


def test_other_words_and_places(axes):
    made = lettering(axes, "A", anchor=(0.5, 0.5), rim=2.0, color="black")
    made.move((2.0, 14.0))
    middle = axes.transData.transform((2.0, 14.0))
    for words in ("A", "HHH", "$5"):
        made.say(words)
        assert made.words == words
        box = made.get_path().transformed(made.get_transform()).get_extents()
        assert (box.x0 + box.x1) / 2 == pytest.approx(middle[0], abs=1e-6)
        assert box.y0 < middle[1] < box.y1
    axes.set(xlim=(-30, 7))
    moved = made.get_path().transformed(made.get_transform()).get_extents()
    there = axes.transData.transform((2.0, 14.0))
    assert (moved.x0 + moved.x1) / 2 == pytest.approx(there[0], abs=1e-6)


@pytest.mark.parametrize("ratio", [1, 2])
@pytest.mark.parametrize("size", [6.0, 7.5, 8.5, 10.0])
@pytest.mark.parametrize("rim", [0.0, 1.6])
def test_every_bar_of_a_small_letter_is_drawn_wherever_it_stands(size, ratio, rim):
    figure = Figure(figsize=(0.3, 0.3), dpi=100 * ratio)
    canvas = FigureCanvasAgg(figure)
    made = Lettering("", size, figure.transFigure, figure.dpi_scale_trans, rim=rim, color="black")
    figure.add_artist(made)
    across, down = 30 * ratio, 30 * ratio
    grid = (np.arange(across * FINE) + 0.5) / FINE
    samples = np.stack(np.meshgrid(grid, grid), axis=-1).reshape(-1, 2)
    for number, letter in enumerate("EFHLTIV"):
        made.say(letter)
        made.move((0.5 + 0.13 * number / across, 0.5 + 0.29 * number / down))
        canvas.draw()
        ink = 1 - np.array(canvas.buffer_rgba())[::-1, :, 0] / 255
        path = made.get_path().transformed(made.get_transform())
        inside = path.contains_points(samples).reshape(down, FINE, across, FINE)
        np.testing.assert_allclose(ink, inside.mean(axis=(1, 3)), atol=2 / FINE)
