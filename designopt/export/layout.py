"""The drawing sheet: size, scale, frame and title block."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from ezdxf.document import Drawing as DxfDocument
from ezdxf.enums import TextEntityAlignment
from ezdxf.layouts.layout import Paperspace

from designopt.export.drawing import Drawing, Place, round_down

NAME = "Sheet"
"""Of the paper space."""

SIZES = {"A4": (297.0, 210.0), "A3": (420.0, 297.0)}
"""Sheets across, mm (ISO 216)."""

CROWDED = 8
"""A drawing of more dimensions is made on the larger sheet."""

MARGIN, BLOCK = 10.0, 180.0
"""From the edge to the frame, and width of the title block, mm (ISO 5457, ISO 7200)."""

ROW, HEAD = 5.0, 9.0
"""Height of a row of the title block, and of the one with the title, mm."""

SMALL, LARGE = 2.5, 4.0
"""Heights of texts, mm."""

ROOM = 24.0
"""Room for dimensions around the drawing, mm."""


@dataclass(frozen=True)
class Paper:
    """A sheet and how the design lies on it.

    Attributes:
        size: its name.
        rows: lines of text in the title block beneath the title.
        scale: mm on paper per mm.
        center: of the drawing, mm in the model.
    """

    size: str
    rows: tuple[str, ...]
    scale: float
    center: Place

    @classmethod
    def of(cls, sheet: Drawing) -> Paper:
        """The sheet on which a drawing has room at a scale of 1, 2 or 5 and zeros (ISO 5455)."""
        size = "A3" if len(sheet.dimensions) > CROWDED else "A4"
        (left, low), (right, high) = sheet.box()
        center = ((left + right) / 2, (low + high) / 2)
        empty = cls(size, tuple(_rows(sheet, size, 1.0)), 1.0, center)
        width, height = empty.view()
        wanted = ((width - 2 * ROOM, right - left), (height - 2 * ROOM, high - low))
        fits = [room / extent for room, extent in wanted if extent > 0]
        scale = round_down(min(fits, default=1.0))
        return cls(size, tuple(_rows(sheet, size, scale)), scale, center)

    @property
    def decimals(self) -> int:
        """Of dimensions: 0.01 mm, and finer where the drawing is enlarged ten times and more."""
        return _decimals(self.scale)

    def block(self) -> float:
        """Height of the title block, mm."""
        return HEAD + ROW * len(self.rows)

    def view(self) -> Place:
        """Width and height of the view on paper, mm: all above the title block."""
        width, height = SIZES[self.size]
        return width - 2 * MARGIN, height - 2 * MARGIN - self.block()

    def shown(self) -> tuple[Place, Place]:
        """Lower left and upper right corner of what the view shows, mm in the model."""
        (x, y), (width, height) = self.center, self.view()
        across, up = width / 2 / self.scale, height / 2 / self.scale
        return (x - across, y - up), (x + across, y + up)


def draw_paper(
    document: DxfDocument, sheet: Drawing, paper: Paper, styles: tuple[str, str, str]
) -> None:
    """Draw frame, title block and a view of model space into paper space.

    Args:
        document: with the layers and the text style.
        sheet: the drawing.
        paper: how it lies on its sheet.
        styles: layer of the frame, layer of the view's border, style of texts.
    """
    frame, border, style = styles
    width, height = SIZES[paper.size]
    document.layouts.rename("Layout1", NAME)
    space = document.paperspace(NAME)
    space.page_setup((width, height), (0, 0, 0, 0), "mm", scale=(1, 1), name=f"ISO_{paper.size}")
    across, up = paper.view()
    foot = MARGIN + paper.block()
    space.add_viewport(
        (MARGIN + across / 2, foot + up / 2),
        (across, up),
        paper.center,
        up / paper.scale,
        dxfattribs={"layer": border},
    )
    left, right = width - MARGIN - BLOCK, width - MARGIN
    for (x, y), (x_end, y_end) in (
        ((MARGIN, MARGIN), (right, height - MARGIN)),
        ((left, MARGIN), (right, foot)),
        ((left, foot - HEAD), (right, foot)),
    ):
        corners = [(x, y), (x_end, y), (x_end, y_end), (x, y_end)]
        space.add_lwpolyline(corners, close=True, dxfattribs={"layer": frame})
    texts = {"layer": frame, "style": style}
    _write(space, sheet.title, (left + 3, foot - HEAD / 2), LARGE, texts)
    for number, row in enumerate(paper.rows):
        _write(space, row, (left + 3, foot - HEAD - (number + 0.5) * ROW), SMALL, texts)


def coded(words: str) -> str:
    """Words as a DXF text that shows them: without what would be read as codes there."""
    # After a caret a space is no code. Two signs of percent begin one and have no code themselves.
    return words.replace("^", "^ ").replace("%%", "% %").replace("%%", "% %")


def _write(
    space: Paperspace, words: str, place: Place, height: float, attributes: dict[str, str]
) -> None:
    text = space.add_text(coded(words), height=height, dxfattribs=attributes)
    text.set_placement(place, align=TextEntityAlignment.MIDDLE_LEFT)


def _rows(sheet: Drawing, size: str, scale: float) -> Iterator[str]:
    ratio = f"{scale:.15g}:1" if scale >= 1 else f"1:{1 / scale:.15g}"
    yield f"scale {ratio}     units mm     sheet {size}"
    yield f"dimensions are rounded to {10.0 ** -_decimals(scale):g} mm, the geometry is exact"
    yield from sheet.notes


def _decimals(scale: float) -> int:
    return 2 + max(0, math.floor(math.log10(scale)))
