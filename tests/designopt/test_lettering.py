"""Texts as outlines stand where Matplotlib's own texts stand, and are as large."""

import math

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from designopt.lettering import Lettering

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
