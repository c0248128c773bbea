"""How tests read what was exported, and what it was made from."""

from __future__ import annotations

import io
from collections.abc import Iterator
from typing import Any

from ezdxf.document import Drawing as DxfDocument
from ezdxf.entities.dimension import Dimension
from ezdxf.entities.lwpolyline import LWPolyline
from ezdxf.entities.mtext import MText
from ezdxf.filemanagement import read

from designopt.export.drawing import Drawing
from designopt.export.dxf import dxf_text


def opened(sheet: Drawing) -> DxfDocument:
    """A sheet written as DXF and read back."""
    return read(io.StringIO(dxf_text(sheet)))


def dimensions(document: DxfDocument) -> list[Dimension]:
    """The dimensions in model space."""
    return [part for part in document.modelspace() if isinstance(part, Dimension)]


def polylines(document: DxfDocument, layer: str) -> list[LWPolyline]:
    """The lines of more than two places on a layer."""
    space = document.modelspace()
    return [p for p in space if isinstance(p, LWPolyline) and p.dxf.layer == layer]


def words_of(dimension: Dimension) -> MText:
    """The text of a dimension."""
    (words,) = (p for p in dimension.virtual_entities() if isinstance(p, MText))
    return words


def numbers_in(value: Any) -> Iterator[float]:
    """Every number in the tables of a TOML file."""
    if isinstance(value, dict):
        for part in value.values():
            yield from numbers_in(part)
    elif isinstance(value, list):
        for part in value:
            yield from numbers_in(part)
    elif isinstance(value, int | float) and not isinstance(value, bool):
        yield float(value)
