"""Numbers drawn in one go, against Matplotlib's own."""

import matplotlib
import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Text

from designopt.plot.quick_text import QuickText


def drawn(kind, **style):
    figure = Figure(figsize=(2, 1), dpi=100)
    canvas = FigureCanvasAgg(figure)
    figure.add_artist(kind(0.5, 0.5, "-12.3456", transform=figure.transFigure, **style))
    canvas.draw()
    return 255.0 - np.array(canvas.buffer_rgba())[:, :, :3]


@pytest.mark.parametrize("side", ["left", "right"])
@pytest.mark.parametrize("weight", ["normal", "bold"])
def test_it_looks_as_matplotlib_draws_it(side, weight):
    style = {"ha": side, "weight": weight, "size": 12, "color": "#1b2530"}
    quick, slow = drawn(QuickText, **style), drawn(Text, **style)
    assert quick.sum() == pytest.approx(slow.sum(), rel=0.1)  # as much ink
    for axis in (0, 1):  # and in the same place, but for the rounding of each glyph's width
        inked = [np.flatnonzero(image.max(axis=(2, 1 - axis)) > 60) for image in (quick, slow)]
        assert abs(inked[0][0] - inked[1][0]) <= 2
        assert abs(inked[0][-1] - inked[1][-1]) <= 2


def test_it_is_text_where_no_pixels_are_drawn(tmp_path):
    with matplotlib.rc_context({"svg.fonttype": "none"}):
        figure = Figure()
        figure.add_artist(QuickText(0.5, 0.5, "$-12.3456$"))
        figure.savefig(tmp_path / "number.svg")
    assert "$-12.3456$" in (tmp_path / "number.svg").read_text()


def test_nothing_is_drawn_of_an_empty_or_hidden_one():
    assert not drawn(QuickText, visible=False).any()
    assert drawn(QuickText, color="#ff0000", ha="left")[:, :, 0].max() == 0  # red stays red
