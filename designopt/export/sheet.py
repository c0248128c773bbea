"""An assembly sheet: a design in pictures, what it is made of, and what lies where across it."""

from __future__ import annotations

import io
import textwrap
from collections.abc import Callable, Sequence

from matplotlib.axes import Axes
from matplotlib.backends.backend_pdf import PdfPages
from matplotlib.figure import Figure

from designopt.export.parts import Assembly, Part, Span
from designopt.export.shaded import draw_parts
from designopt.plot.figures import TEXT_WIDTH

PAGE = (11.69, 8.27)
"""A4 across, inches."""

ROWS, ROW, CELL = 28, 0.23, 46
"""Rows of a table on one page, height of one, inches, and characters of a cell's line."""

VIEWS: tuple[tuple[str, tuple[float, float], Callable[[Part], bool]], ...] = (
    ("assembled", (-35.0, 25.0), lambda part: True),
    ("from below, without what the shells carry", (-35.0, -35.0), lambda part: part.shell),
    (
        "inside: one side, without the shells",
        (30.0, 25.0),
        lambda part: not part.shell and max(prism.across[1] for prism in part.prisms) > 0,
    ),
)
"""Title, eye (turn and lift, degrees), and which parts are drawn."""


def draw_assembly(assembly: Assembly, height: float = 5.2) -> Figure:
    """Pictures of all parts: assembled, the shells alone, and what lies inside them."""
    figure = Figure(figsize=(TEXT_WIDTH, height), layout="constrained")
    below = figure.add_gridspec(2, 2, height_ratios=(1.4, 1.0))
    places = (below[0, :], below[1, 0], below[1, 1])
    for (title, eye, is_drawn), place in zip(VIEWS, places, strict=True):
        parts = [part for part in assembly.parts if is_drawn(part)]
        if parts:
            axes = figure.add_subplot(place, title=title)
            axes.imshow(draw_parts(parts, *eye), interpolation="antialiased")
            axes.set_axis_off()
    return figure


def sheet_pdf(assembly: Assembly) -> bytes:
    """The sheet as a PDF: pictures, bill of materials, and the width's table with its section."""
    stream = io.BytesIO()
    undated = {"CreationDate": None, "ModDate": None, "Title": assembly.name}
    with PdfPages(stream, metadata=undated) as pages:
        views = draw_assembly(assembly)
        views.suptitle(f"{assembly.name}: assembly")
        views.set_size_inches(*PAGE)
        pages.savefig(views)
        bill = [(number, *row) for number, row in enumerate(assembly.bill(), 1)]
        for start in range(0, len(bill), ROWS):
            pages.savefig(_bill_page(assembly.name, bill[start : start + ROWS]))
        pages.savefig(_width_page(assembly))
    return stream.getvalue()


def _bill_page(name: str, rows: Sequence[Sequence[object]]) -> Figure:
    figure = Figure(figsize=PAGE)
    axes = figure.add_axes((0.04, 0.04, 0.92, 0.86))
    axes.set_title(f"{name}: bill of materials")
    heads = ("no.", "item", "material", "size", "pieces")
    _table(axes, heads, rows, (0.05, 0.28, 0.23, 0.36, 0.08))
    return figure


def _width_page(assembly: Assembly) -> Figure:
    figure = Figure(figsize=PAGE)
    spans = assembly.spans
    width = 2 * max((span.high for span in spans), default=0.0)
    top = figure.add_axes((0.06, 0.55, 0.88, 0.3))
    top.set_title(f"{assembly.name}: across its width of {width:.4g} mm, lengths in mm")
    _draw_spans(top, spans)
    axes = figure.add_axes((0.06, 0.05, 0.88, 0.42))
    rows = [
        (number, span.parts, f"{span.low:.4g}", f"{span.high:.4g}", f"{span.high - span.low:.4g}")
        for number, span in enumerate(spans)
    ]
    heads = ("layer", "what lies in it, at both sides", "from the middle", "to", "thickness")
    _table(axes, heads, rows, (0.08, 0.5, 0.16, 0.12, 0.14))
    figure.text(0.06, 0.03, textwrap.fill(assembly.order, 150), fontsize=8)
    return figure


def _draw_spans(axes: Axes, spans: Sequence[Span]) -> None:
    for number, span in enumerate(spans):
        color = f"C{number % 10}"
        for low, high in ((span.low, span.high), (-span.high, -span.low)):
            axes.fill_between([low, high], 0, 1, facecolor=color, edgecolor="black", alpha=0.5)
        axes.text((span.low + span.high) / 2, 1.05, f"{number}", ha="center")
    axes.set(xlabel="across, mm", ylim=(0, 1.3), yticks=[])


def _table(
    axes: Axes, heads: Sequence[str], rows: Sequence[Sequence[object]], widths: Sequence[float]
) -> None:
    axes.set_axis_off()
    cells = [[textwrap.fill(str(cell), CELL) for cell in row] for row in rows]
    row_height = ROW / PAGE[1] / axes.get_position().height
    table = axes.table(cells, colLabels=heads, colWidths=widths, cellLoc="left", loc="upper center")
    table.auto_set_font_size(False)
    table.set_fontsize(8)
    for (row, _), cell in table.get_celld().items():
        lines = max((text.count("\n") for text in cells[row - 1]), default=0) if row else 0
        cell.set_height(row_height * (1 + 0.7 * lines))
        cell.set_linewidth(0.4)
