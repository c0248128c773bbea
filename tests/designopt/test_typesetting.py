"""What people read: subscripts, code, units; and what is left as it stands."""

import pytest

from designopt.plot.figures import new_figure
from designopt.plot.typesetting import as_html, as_mathtext, heading
from tests.designopt.tables import cases


@pytest.mark.parametrize(("text", "page"), cases("as_html"))
def test_plain_text_as_html(text, page):
    assert as_html(text) == page


@pytest.mark.parametrize(("column", "words"), cases("heading"))
def test_the_head_of_a_column(column, words):
    assert heading(column) == words


def test_a_subscript_is_drawn_below_the_line():
    """Smaller than the letters beside each other would be, and without the underscore."""
    drawing, axes = new_figure()
    widths = []
    for text in (as_mathtext("μ_C"), "μ_C", as_mathtext("5 $ and μ")):
        shown = axes[0, 0].text(0, 0, text)
        drawing.draw_without_rendering()
        widths.append(shown.get_window_extent().width)
    assert widths[0] < widths[1]
    assert as_mathtext("5 $ and μ") == r"5 \$ and μ"
