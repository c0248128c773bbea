"""Parts as solids of a CAD kernel, and these as a STEP file (AP214, ISO 10303-214)."""

# The kernel's binding has no stubs.
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

import itertools
import re
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from OCP.BRepAlgoAPI import BRepAlgoAPI_Cut, BRepAlgoAPI_Fuse
from OCP.BRepBuilderAPI import (
    BRepBuilderAPI_MakeEdge,
    BRepBuilderAPI_MakeFace,
    BRepBuilderAPI_MakeWire,
)
from OCP.BRepCheck import BRepCheck_Analyzer
from OCP.BRepPrimAPI import BRepPrimAPI_MakePrism
from OCP.collections import List_TopoDS_Shape
from OCP.GC import GC_MakeArcOfCircle
from OCP.gp import gp_Ax2, gp_Circ, gp_Dir, gp_Pnt, gp_Vec
from OCP.IFSelect import IFSelect_RetDone
from OCP.Message import Message, Message_Gravity
from OCP.Quantity import Quantity_Color, Quantity_TOC_sRGB
from OCP.ShapeUpgrade import ShapeUpgrade_UnifySameDomain
from OCP.STEPCAFControl import STEPCAFControl_Writer
from OCP.TCollection import TCollection_ExtendedString
from OCP.TDataStd import TDataStd_Name
from OCP.TDocStd import TDocStd_Document
from OCP.TopAbs import TopAbs_SOLID
from OCP.TopExp import TopExp_Explorer
from OCP.TopoDS import TopoDS_Shape, TopoDS_Wire
from OCP.XCAFDoc import XCAFDoc_ColorSurf, XCAFDoc_DocumentTool

from designopt.errors import UserError
from designopt.export.arcs import arc_middle
from designopt.export.parts import Hole, Outline, Part, Prism
from designopt.io.files import printable

FUZZY = 1e-6
"""Faces so near to each other lie on each other, mm."""


def make_solid(part: Part) -> TopoDS_Shape:
    """A part as one solid.

    Raises:
        UserError: its prisms hang together in no or in several pieces, or bound no solid.
    """
    shapes = [_prism(prism) for prism in part.prisms]
    shape = shapes[0]
    if len(shapes) > 1:
        # Faces in one plane become one, before anything is cut: afterwards it may make faults.
        merged = ShapeUpgrade_UnifySameDomain(
            _combined(BRepAlgoAPI_Fuse(), shapes[:1], shapes[1:]), True, True, True
        )
        merged.Build()
        shape = merged.Shape()
    if part.cuts:
        shape = _combined(BRepAlgoAPI_Cut(), [shape], [_prism(prism) for prism in part.cuts])
    solids = solids_in(shape)
    if len(solids) != 1 or not BRepCheck_Analyzer(solids[0]).IsValid():
        raise UserError(
            f"{part.name}: its prisms make {len(solids)} solids in place of one without faults; "
            "move its pins or make its walls thicker"
        )
    return solids[0]


def solids_in(shape: TopoDS_Shape) -> list[TopoDS_Shape]:
    """All solids of a shape."""
    explorer, found = TopExp_Explorer(shape, TopAbs_SOLID), []
    while explorer.More():
        found.append(explorer.Current())
        explorer.Next()
    return found


def step_text(name: str, parts: Sequence[Part]) -> str:
    """The text of a STEP file with every part as a product of its own, named and coloured.

    The same parts give the same text.

    Args:
        name: of the assembly.
        parts: in one place, as they are assembled.
    """
    document = TDocStd_Document(TCollection_ExtendedString("XmlXCAF"))
    shapes = XCAFDoc_DocumentTool.ShapeTool_s(document.Main())
    colors = XCAFDoc_DocumentTool.ColorTool_s(document.Main())
    whole = shapes.NewShape()
    TDataStd_Name.Set_s(whole, _text(name))
    for part in parts:
        solid = make_solid(part)
        label = shapes.AddShape(solid, False)
        TDataStd_Name.Set_s(label, _text(part.name))
        red, green, blue = (int(part.color[at : at + 2], 16) / 255 for at in (1, 3, 5))
        color = Quantity_Color(red, green, blue, Quantity_TOC_sRGB)
        colors.SetColor(label, color, XCAFDoc_ColorSurf)
        placed = shapes.AddComponent(whole, label, solid.Location())
        TDataStd_Name.Set_s(placed, _text(part.name))
    shapes.UpdateAssemblies()
    for printer in Message.DefaultMessenger_s().Printers():
        printer.SetTraceLevel(Message_Gravity.Message_Fail)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "whole.step"
        writer = STEPCAFControl_Writer()
        writer.Transfer(document)
        if writer.Write(str(path)) != IFSelect_RetDone:
            raise ValueError(f"{name}: the kernel wrote no STEP file")
        text = path.read_text(encoding="utf-8")
    return _same_every_time(text)


def _text(name: str) -> TCollection_ExtendedString:
    """A name as the kernel has it; an apostrophe would end it when the kernel reads the file."""
    return TCollection_ExtendedString(printable(name).replace("'", "′"), True)


def _same_every_time(text: str) -> str:
    """Without the time and the place of writing, and counted from 1: the kernel counts on."""
    head = "FILE_NAME('designopt.step','',('designopt'),(''),'','designopt','');"
    text = re.sub(r"FILE_NAME\(.*?\);", lambda _: head, text, count=1, flags=re.DOTALL)
    count = itertools.count(1)
    return re.sub(r"(USAGE_OCCURRENCE\(')\d+", lambda found: f"{found[1]}{next(count)}", text)


def _prism(prism: Prism) -> TopoDS_Shape:
    low, high = prism.across
    face = BRepBuilderAPI_MakeFace(_wire(prism.outline, low), True)
    for hole in prism.holes:
        face.Add(_ring(hole, low))
    return BRepPrimAPI_MakePrism(face.Face(), gp_Vec(0, 0, high - low)).Shape()


def _wire(outline: Outline, height: float) -> TopoDS_Wire:
    wire, ends = BRepBuilderAPI_MakeWire(), [*outline.places[1:], outline.places[0]]
    for start, end, bulge in zip(outline.places, ends, outline.bulges, strict=True):
        first, last = gp_Pnt(*start, height), gp_Pnt(*end, height)
        if bulge:
            middle = gp_Pnt(*arc_middle(start, end, bulge), height)
            edge = BRepBuilderAPI_MakeEdge(GC_MakeArcOfCircle(first, middle, last).Value())
        else:
            edge = BRepBuilderAPI_MakeEdge(first, last)
        wire.Add(edge.Edge())
    return wire.Wire()


def _ring(hole: Hole, height: float) -> TopoDS_Wire:
    """Clockwise: what lies inside it is none of the face."""
    axis = gp_Ax2(gp_Pnt(*hole.center, height), gp_Dir(0, 0, -1))
    edge = BRepBuilderAPI_MakeEdge(gp_Circ(axis, hole.radius)).Edge()
    return BRepBuilderAPI_MakeWire(edge).Wire()


def _combined(
    operation: Any, first: Sequence[TopoDS_Shape], others: Sequence[TopoDS_Shape]
) -> TopoDS_Shape:
    for add, shapes in ((operation.SetArguments, first), (operation.SetTools, others)):
        listed = List_TopoDS_Shape()
        for shape in shapes:
            listed.Append(shape)
        add(listed)
    operation.SetFuzzyValue(FUZZY)
    operation.Build()
    return operation.Shape()
