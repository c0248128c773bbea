"""A drawing as DXF: the design in model space, 1:1 in mm, and a drawing sheet in paper space."""

from __future__ import annotations

import io
import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager

from ezdxf import colors, units
from ezdxf._options import options
from ezdxf.document import Drawing as DxfDocument
from ezdxf.enums import TextEntityAlignment
from ezdxf.filemanagement import new
from ezdxf.layouts.layout import Modelspace

from designopt.export.drawing import Drawing, LinearDimension, unused_name
from designopt.export.layout import Paper, coded, draw_paper
from designopt.export.line_styles import THIN, line_styles_of
from designopt.export.placing import Clutter, readable

PROGRAM = "DESIGNOPT"
"""Under this name every circle carries that of what it stands for (extended data)."""

TEXT, ARROW = 2.5, 2.5
"""Height of texts and length of arrows on paper, mm."""

STYLE = "SHEET"
"""Name of the styles of texts and dimensions."""

DIMENSIONS, NAMES, FRAME, VIEW = "dimensions", "names", "sheet", "view"
"""Layers beside the design's own."""

FORBIDDEN = '<>/\\":;?*|=`,'
"""Characters that a layer's name must not hold."""


def dxf_text(sheet: Drawing) -> str:
    """The text of a DXF file (R2010); the same sheet gives the same text.

    Model space holds the design on its layers, and on layers of their own names and dimensions,
    sized for the drawing sheet in paper space. A layer is called as in the design but for
    characters that DXF does not allow there.
    """
    paper = Paper.of(sheet)
    with _same_every_time():
        document = new("R2010", setup=["linetypes"])
        document.units = units.MM
        layers = _add_layers(document, sheet)
        _add_styles(document, paper)
        _draw_design(document.modelspace(), sheet, layers)
        _annotate(document.modelspace(), sheet, paper)
        draw_paper(document, sheet, paper, (FRAME, VIEW, STYLE))
        stream = io.StringIO()
        document.write(stream)
    return stream.getvalue()


@contextmanager
def _same_every_time() -> Iterator[None]:
    """Neither times nor random identifiers in what is written."""
    before = options.write_fixed_meta_data_for_testing
    options.write_fixed_meta_data_for_testing = True
    try:
        yield
    finally:
        options.write_fixed_meta_data_for_testing = before


def _add_layers(document: DxfDocument, sheet: Drawing) -> Mapping[str, str]:
    """Make all layers; the names in the file of the design's."""
    for name in (DIMENSIONS, NAMES, FRAME, VIEW):
        document.layers.add(name, lineweight=round(100 * THIN))
    document.layers.get(VIEW).dxf.plot = 0
    taken = {"0", "defpoints", DIMENSIONS, NAMES, FRAME, VIEW}
    names = {}
    for name, look in line_styles_of(sheet.layers).items():
        stem = "".join("_" if char in FORBIDDEN else char for char in name)
        names[name] = unused_name(stem, taken, str.lower)
        taken.add(names[name].lower())
        document.layers.add(
            names[name],
            true_color=colors.rgb2int(colors.RGB.from_hex(look.color)),
            lineweight=round(100 * look.width),
            linetype="DASHED2" if look.dashed else "CONTINUOUS",
        )
    return names


def _add_styles(document: DxfDocument, paper: Paper) -> None:
    document.styles.add(STYLE, font="arial.ttf")
    document.dimstyles.add(
        STYLE,
        dxfattribs={
            "dimscale": 1 / paper.scale,
            "dimtxt": TEXT,
            "dimtxsty": STYLE,
            "dimasz": ARROW,
            "dimexo": 1.0,  # from what is measured to the extension line
            "dimexe": 1.25,  # how far that reaches beyond the dimension line
            "dimgap": 0.8,
            "dimtad": 1,  # texts above the line …
            "dimtih": 0,  # … and along it
            "dimtoh": 0,
            "dimtix": 1,  # between the extension lines even if they hardly fit
            "dimdec": paper.decimals,
            "dimzin": 8,  # without zeros at the end
            "dimdsep": ord("."),
            "dimlunit": 2,
        },
    )


def _draw_design(space: Modelspace, sheet: Drawing, layers: Mapping[str, str]) -> None:
    space.doc.appids.add(PROGRAM)
    for polyline in sheet.polylines:
        attributes = {"layer": layers[polyline.layer]}
        if len(polyline.places) == 2 and not polyline.bulges:
            space.add_line(polyline.places[0], polyline.places[1], attributes)
        else:
            bulges = [*polyline.bulges, *[0.0] * (len(polyline.places) - len(polyline.bulges))]
            points = [(*at, bulge) for at, bulge in zip(polyline.places, bulges, strict=True)]
            closed = polyline.closed
            space.add_lwpolyline(points, "xyb", close=closed, dxfattribs=attributes)
    for circle in sheet.circles:
        attributes = {"layer": layers[circle.layer]}
        entity = space.add_circle(circle.center, circle.radius, attributes)
        entity.set_xdata(PROGRAM, [(1000, circle.name)])


def _annotate(space: Modelspace, sheet: Drawing, paper: Paper) -> None:
    """Dimensions, then names, each where it covers least."""
    looks, scale = line_styles_of(sheet.layers), paper.scale
    low, high = ((x * scale, y * scale) for x, y in paper.shown())
    clutter = Clutter.of(sheet, scale, (low, high))
    for measure in sorted(map(readable, sheet.dimensions), key=_length):  # short ones inside
        distance = _length(measure)
        words = f"{distance:.{paper.decimals}f}".rstrip("0").rstrip(".")
        offset = clutter.place_dimension(measure, words, TEXT) / scale
        style = {"dimstyle": STYLE, "dxfattribs": {"layer": DIMENSIONS}}
        space.add_aligned_dim(measure.start, measure.end, offset, **style).render()
    for label in sheet.labels:
        x, y = (clutter.place_label(label, TEXT) / scale).tolist()
        color = colors.rgb2int(colors.RGB.from_hex(looks[label.layer].color))
        attributes = {"layer": NAMES, "style": STYLE, "true_color": color}
        text = space.add_text(coded(label.text), height=TEXT / scale, dxfattribs=attributes)
        text.set_placement((x, y), align=TextEntityAlignment.MIDDLE_CENTER)


def _length(measure: LinearDimension) -> float:
    return math.dist(measure.start, measure.end)
