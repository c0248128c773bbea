"""A finger's solids judged by the CAD kernel, from nothing but the STEP file and the finger's file.

Whether they are closed, how thick their walls are, and what they leave between each other as the
joints bend. Which way parts move is written out a second time (`studies.oracles.clearances`).
"""

# The kernel's binding has no stubs.
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

import itertools
import math
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from OCP.Bnd import Bnd_Box
from OCP.BRep import BRep_Tool
from OCP.BRepAlgoAPI import BRepAlgoAPI_Common
from OCP.BRepBndLib import BRepBndLib
from OCP.BRepCheck import BRepCheck_Analyzer
from OCP.BRepExtrema import BRepExtrema_DistShapeShape
from OCP.BRepGProp import BRepGProp, BRepGProp_Face
from OCP.BRepMesh import BRepMesh_IncrementalMesh
from OCP.BRepPrimAPI import BRepPrimAPI_MakeBox
from OCP.collections import Sequence_TDF_Label
from OCP.gp import gp_Dir, gp_Lin, gp_Pnt, gp_Trsf, gp_Vec
from OCP.GProp import GProp_GProps
from OCP.IFSelect import IFSelect_RetDone
from OCP.IntCurvesFace import IntCurvesFace_ShapeIntersector
from OCP.STEPCAFControl import STEPCAFControl_Reader
from OCP.TCollection import TCollection_ExtendedString
from OCP.TDataStd import TDataStd_Name
from OCP.TDocStd import TDocStd_Document
from OCP.TopAbs import TopAbs_FACE, TopAbs_SHELL
from OCP.TopExp import TopExp_Explorer
from OCP.TopLoc import TopLoc_Location
from OCP.TopoDS import TopoDS, TopoDS_Shape
from OCP.XCAFDoc import XCAFDoc_DocumentTool, XCAFDoc_ShapeTool

from studies.oracles.clearances import BARS, carriers, pin_places, postures

BESIDE = 0.04
"""What lies farther beside another part than this across the finger, mm, never meets it."""

FAR = 3.0
"""Of parts that come no nearer, mm, the least distance is only known to be at least what is stated.
"""

TOUCH = 1e-6
"""Solids no farther apart touch, mm."""

Motion = tuple[complex, complex]
"""p ↦ a p + b from the straight finger to a posture, in the proximal phalanx's frame."""


class Meeting(NamedTuple):
    """How near two parts come to each other.

    Attributes:
        parts: their names.
        distance: least one of what has some z in common, mm, in the section; 0 where they touch.
            Beyond `FAR` it is a lower bound.
        shared: volume that both have there, mm³.
        degrees: of PIP and DIP there.
        postures: different ones relative to each other; 1 where they do not move so.
    """

    parts: tuple[str, str]
    distance: float
    shared: float
    degrees: tuple[float, float]
    postures: int


def read_solids(path: str | Path) -> dict[str, TopoDS_Shape]:
    """The solids of a STEP file by their names, in its one assembly.

    Raises:
        ValueError: the kernel cannot read it, or two parts have one name.
    """
    document = TDocStd_Document(TCollection_ExtendedString("XmlXCAF"))
    reader = STEPCAFControl_Reader()
    reader.SetNameMode(True)
    if reader.ReadFile(str(path)) != IFSelect_RetDone or not reader.Transfer(document):
        raise ValueError(f"{path}: the kernel reads no solids in it")
    tool = XCAFDoc_DocumentTool.ShapeTool_s(document.Main())
    wholes, found = Sequence_TDF_Label(), {}
    tool.GetFreeShapes(wholes)
    for whole in wholes:
        components = Sequence_TDF_Label()
        XCAFDoc_ShapeTool.GetComponents_s(whole, components)
        for label in components:
            title = TDataStd_Name()
            label.FindAttribute(TDataStd_Name.GetID_s(), title)
            name = title.Get().ToExtString().replace("′", "'")
            if name in found:
                raise ValueError(f"{path}: two parts are called {name}")
            found[name] = XCAFDoc_ShapeTool.GetShape_s(label)
    return found


def volume_of(shape: TopoDS_Shape) -> float:
    """mm³."""
    found = GProp_GProps()
    BRepGProp.VolumeProperties_s(shape, found)
    return found.Mass()


def is_watertight(shape: TopoDS_Shape) -> bool:
    """Whether a solid has no faults and each of its shells is closed."""
    explorer, closed = TopExp_Explorer(shape, TopAbs_SHELL), []
    while explorer.More():
        closed.append(BRep_Tool.IsClosed_s(explorer.Current()))
        explorer.Next()
    return bool(closed) and all(closed) and BRepCheck_Analyzer(shape).IsValid()


def bodies_of(name: str, tables: Mapping[str, Any]) -> tuple[str, ...]:
    """The bodies with which a part of a name moves; a pin turns with two of them.

    Args:
        name: of the part.
        tables: of the finger's file.
    """
    what = name.split(",")[0]
    if what.startswith(("pin ", "axle ")):
        return carriers(tables)[what.split(" ")[1]]
    return (what.split(" ")[0],)


def motions_of(tables: Mapping[str, Any], pip: float, dip: float) -> dict[str, Motion]:
    """How every body has moved when the joints are bent, rad."""
    straight, bent = (
        {pin: complex(place[0]) for pin, place in pin_places(dict(tables), *angles).items()}
        for angles in ((np.zeros(1), np.zeros(1)), (np.array([pip]), np.array([dip])))
    )
    knuckle = np.exp(-1j * pip)
    turns = {"proximal": 1.0 + 0j, "intermediate": knuckle, "distal": knuckle * np.exp(-1j * dip)}
    origins = {"proximal": "A", "intermediate": "A", "distal": "B"}
    for bar, (one, other, *_) in BARS.items():
        if one in straight and other in straight:
            turns[bar] = (bent[other] - bent[one]) / (straight[other] - straight[one])
            origins[bar] = one
    return {
        body: (complex(turn), complex(bent[origins[body]] - turn * straight[origins[body]]))
        for body, turn in turns.items()
    }


def find_meetings(
    solids: Mapping[str, TopoDS_Shape],
    finger: str | Path,
    steps: int = 31,
    pairs: Sequence[tuple[str, str]] | None = None,
) -> list[Meeting]:
    """How near parts come to each other in every posture that the finger reaches.

    Parts of one body are looked at once, and so are a pin and what it is in, for these turn about
    each other. Of two others only that counts which has some z in common: what lies beside each
    other across the finger never meets.

    Args:
        solids: of the straight finger, by name.
        finger: its file.
        steps: angles of each joint over its range.
        pairs: which to look at; all that can meet by default.
    """
    tables = tomllib.loads(Path(finger).read_text(encoding="utf-8"))
    poses = {
        degrees: motions_of(tables, *np.deg2rad(degrees)) for degrees in postures(tables, steps)
    }
    chosen = pairs if pairs is not None else list(meeting_pairs(solids))
    return [
        _meet(solids, pair, [bodies_of(name, tables) for name in pair], poses) for pair in chosen
    ]


def meeting_pairs(solids: Mapping[str, TopoDS_Shape]) -> Iterator[tuple[str, str]]:
    """The parts that have some z in common; of the right side only, for the left is its image."""
    spans = {name: _across(shape) for name, shape in solids.items()}
    for one, other in itertools.combinations(solids, 2):
        (low, high), (low_of, high_of) = spans[one], spans[other]
        left = "left" in one or "left" in other
        if not left and min(high, high_of) - max(low, low_of) > -BESIDE:
            yield one, other


def _across(shape: TopoDS_Shape) -> tuple[float, float]:
    low, high = _box(shape)
    return low.Z(), high.Z()


def _box(shape: TopoDS_Shape) -> tuple[gp_Pnt, gp_Pnt]:
    box = Bnd_Box()
    BRepBndLib.AddOptimal_s(shape, box, False, False)
    return box.CornerMin(), box.CornerMax()


def _meet(
    solids: Mapping[str, TopoDS_Shape],
    pair: tuple[str, str],
    bodies: Sequence[tuple[str, ...]],
    poses: Mapping[tuple[float, float], Mapping[str, Motion]],
) -> Meeting:
    one, other = (solids[name] for name in pair)
    first, second = bodies
    if {*first} & {*second}:
        apart = distance(one, other)
        shared = shared_volume(one, other) if apart <= TOUCH else 0.0
        return Meeting(pair, apart, shared, (0.0, 0.0), 1)
    slabs = _slab(one, *_across(other)), _slab(other, *_across(one))
    known: dict[tuple[float, ...], tuple[float, float]] = {}
    for degrees, motions in poses.items():
        (turn, shift), (turn_of, shift_of) = motions[first[0]], motions[second[0]]
        # The second, seen from the first.
        relative = turn_of / turn, (shift_of - shift) / turn
        key = tuple(round(part, 9) for part in (*_parts(relative[0]), *_parts(relative[1])))
        known.setdefault(key, degrees)
    return _nearest(pair, slabs, known)


def _nearest(
    pair: tuple[str, str],
    slabs: tuple[TopoDS_Shape, TopoDS_Shape],
    known: Mapping[tuple[float, ...], tuple[float, float]],
) -> Meeting:
    """The posture in which two parts are nearest.

    Circles around both are a first bound. From one posture to another the distance changes by no
    more than the corners of the second part's box move. What cannot be nearer than the nearest so
    far, or is `FAR`, is not looked at.
    """
    keys = np.array(list(known))
    turns, shifts = keys[:, 0] + 1j * keys[:, 1], keys[:, 2] + 1j * keys[:, 3]
    corners, still = _corners(slabs[1]), _corners(slabs[0])
    middle, center = np.mean(corners), np.mean(still)
    reach = np.max(np.abs(corners - middle)) + np.max(np.abs(still - center))
    moved = turns[:, None] * corners + shifts[:, None]
    bound = np.abs(turns * middle + shifts - center) - reach
    least, nearest, shared, looked = math.inf, 0, 0.0, np.zeros(len(keys), bool)
    # Far-off postures first, so that each leaves many out.
    for number in np.random.default_rng(0).permutation(len(keys)):
        if bound[number] > min(least, FAR):
            continue
        there = slabs[1].Moved(_location(complex(turns[number]), complex(shifts[number])))
        apart, looked[number] = distance(slabs[0], there), True
        if apart <= TOUCH:
            shared = max(shared, shared_volume(slabs[0], there))
        if apart < least:
            least, nearest = apart, number
        bound = np.maximum(bound, apart - np.max(np.abs(moved - moved[number]), axis=1))
    least = min(least, float(np.min(bound[~looked], initial=math.inf)))
    return Meeting(pair, least, shared, list(known.values())[nearest], len(keys))


def _slab(shape: TopoDS_Shape, low: float, high: float) -> TopoDS_Shape:
    """What of a solid has some z in common with another one, and a little more."""
    (first, last), reach = _across(shape), 1e3
    if low - BESIDE <= first and last <= high + BESIDE:
        return shape
    corner = gp_Pnt(-reach, -reach, low - BESIDE)
    box = BRepPrimAPI_MakeBox(corner, 2 * reach, 2 * reach, high - low + 2 * BESIDE).Shape()
    return BRepAlgoAPI_Common(shape, box).Shape()


def _corners(shape: TopoDS_Shape) -> np.ndarray:
    """Corners of a solid's box in the section."""
    low, high = _box(shape)
    return np.array([complex(x, y) for x in (low.X(), high.X()) for y in (low.Y(), high.Y())])


def distance(one: TopoDS_Shape, other: TopoDS_Shape) -> float:
    """Least distance of two solids, mm; 0 where they touch or share something."""
    return BRepExtrema_DistShapeShape(one, other).Value()


def shared_volume(one: TopoDS_Shape, other: TopoDS_Shape) -> float:
    """What two solids have in common, mm³."""
    return volume_of(BRepAlgoAPI_Common(one, other).Shape())


def _parts(value: complex) -> tuple[float, float]:
    return value.real, value.imag


def _location(turn: complex, shift: complex) -> TopLoc_Location:
    motion = gp_Trsf()
    motion.SetValues(
        turn.real, -turn.imag, 0, shift.real, turn.imag, turn.real, 0, shift.imag, 0, 0, 1, 0
    )
    return TopLoc_Location(motion)


class Wall(NamedTuple):
    """The thinnest place of a solid.

    Attributes:
        thickness: straight through the material from a face, mm.
        place: where, on that face.
        looked: places that were looked at.
    """

    thickness: float
    place: tuple[float, float, float]
    looked: int


def least_wall(shape: TopoDS_Shape, step: float = 0.5) -> Wall:
    """The least thickness of a solid, by lines straight into it from all its faces.

    Args:
        shape: a solid.
        step: largest distance of neighbouring places on a face, about, mm.
    """
    BRepMesh_IncrementalMesh(shape, 0.02, False, 0.2, False)
    crossing = IntCurvesFace_ShapeIntersector()
    crossing.Load(shape, 1e-7)
    explorer, best, looked = TopExp_Explorer(shape, TopAbs_FACE), math.inf, 0
    where = (math.nan, math.nan, math.nan)
    while explorer.More():
        face = TopoDS.Face(explorer.Current())
        for place, inward in _places_on(face, step):
            crossing.Perform(gp_Lin(place, inward), 1e-3, 1e3)
            looked += 1
            ends = [(crossing.WParameter(n + 1), n + 1) for n in range(crossing.NbPnt())]
            far, number = min(ends, default=(math.inf, 0))
            if far < best and _is_opposite(crossing, number, inward):
                best, where = far, (place.X(), place.Y(), place.Z())
        explorer.Next()
    return Wall(best, where, looked)


def _is_opposite(crossing: IntCurvesFace_ShapeIntersector, number: int, way: gp_Dir) -> bool:
    """Whether a line leaves by a face that lies rather across it: beside an edge is no wall."""
    place, outward = gp_Pnt(), gp_Vec()
    face = BRepGProp_Face(crossing.Face(number))
    face.Normal(crossing.UParameter(number), crossing.VParameter(number), place, outward)
    return outward.Dot(gp_Vec(way)) > 0.5 * outward.Magnitude()


def _places_on(face: TopoDS_Shape, step: float) -> Iterator[tuple[Any, Any]]:
    """Places all over a face, each with the direction straight into the solid."""
    mesh, surface = BRep_Tool.Triangulation_s(face, TopLoc_Location()), BRepGProp_Face(face)
    nodes = [mesh.UVNode(n + 1) for n in range(mesh.NbNodes())]
    flat = np.array([(node.X(), node.Y()) for node in nodes])
    places = [mesh.Node(n + 1) for n in range(mesh.NbNodes())]
    solid = np.array([(node.X(), node.Y(), node.Z()) for node in places])
    for number in range(mesh.NbTriangles()):
        own = np.array(mesh.Triangle(number + 1).Get()) - 1
        longest = max(math.dist(*pair) for pair in itertools.combinations(solid[own], 2))
        count = max(1, math.ceil(longest / step))
        for i, j in itertools.product(range(count), repeat=2):
            if i + j < count:
                second, third = (i + 1 / 3) / count, (j + 1 / 3) / count
                u, v = np.array([1 - second - third, second, third]) @ flat[own]
                place, outward = gp_Pnt(), gp_Vec()
                surface.Normal(float(u), float(v), place, outward)
                yield place, gp_Dir(outward.Reversed())
