"""A finger's solids as faces for the path tracer: what of a STEP file stands in light's way."""

# The kernel's binding has no stubs.
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

import tomllib
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from OCP.BRep import BRep_Tool
from OCP.BRepMesh import BRepMesh_IncrementalMesh
from OCP.TopAbs import TopAbs_FACE
from OCP.TopExp import TopExp_Explorer
from OCP.TopLoc import TopLoc_Location
from OCP.TopoDS import TopoDS, TopoDS_Shape

from studies.oracles.judge.solids import Face
from studies.oracles.solids import bodies_of, motions_of, read_solids

CHORD = 0.01
"""The farthest that triangles may lie from a solid, mm."""

ON_FACE = 1e-4
"""Triangles so near to a mirror's reflecting plane are this plane, mm: the tracer has it."""


def solid_faces(step: str | Path, finger: str | Path) -> Callable[[float, float], Sequence[Face]]:
    """From angles of PIP and DIP, degrees, to the opaque faces of a finger's solids.

    The layers on the pads are left out, for light passes them, and so are the faces by which the
    mirrors reflect. Places are those of the intermediate phalanx.

    Args:
        step: file of the straight finger.
        finger: its own file.
    """
    tables = tomllib.loads(Path(finger).read_text(encoding="utf-8"))
    triangles: dict[str, list[np.ndarray]] = {}
    for name, solid in read_solids(step).items():
        if "layer" not in name:
            own = _triangles(solid)
            if name.endswith("mirror"):
                own = own[~_reflecting(own)]
            triangles.setdefault(bodies_of(name, tables)[0], []).append(own)
    bodies = {body: np.concatenate(parts) for body, parts in triangles.items()}

    def faces(pip: float, dip: float) -> list[Face]:
        motions = motions_of(tables, *np.deg2rad([pip, dip]))
        turn, shift = motions["intermediate"]
        found = []
        for body, own in bodies.items():
            its_turn, its_shift = motions[body]
            places = own[..., 0] + 1j * own[..., 1]
            places = (its_turn * places + its_shift - shift) / turn
            moved = np.stack([places.real, places.imag, own[..., 2]], axis=-1)
            half = (moved[:, 1] + moved[:, 2]) / 2
            quads = np.stack([moved[:, 0], moved[:, 1], half, moved[:, 2]], axis=1)
            found += [Face("blocker", f"solid of {body}", corners) for corners in quads]
        return found

    return faces


def _triangles(solid: TopoDS_Shape) -> np.ndarray:
    BRepMesh_IncrementalMesh(solid, CHORD, False, 0.2, False)
    explorer, found = TopExp_Explorer(solid, TopAbs_FACE), []
    while explorer.More():
        mesh = BRep_Tool.Triangulation_s(TopoDS.Face(explorer.Current()), TopLoc_Location())
        nodes = [mesh.Node(n + 1) for n in range(mesh.NbNodes())]
        places = np.array([(node.X(), node.Y(), node.Z()) for node in nodes])
        numbers = [mesh.Triangle(n + 1).Get() for n in range(mesh.NbTriangles())]
        found.append(places[np.array(numbers) - 1])
        explorer.Next()
    return np.concatenate(found)


def _reflecting(triangles: np.ndarray) -> np.ndarray:
    """Which triangles of a mirror lie in its reflecting plane: that of its palmar face."""
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    areas = np.linalg.norm(normals, axis=-1)
    # Of its two large faces the lower one.
    flat = np.abs(normals[:, 2]) < 1e-9 * areas
    large = np.flatnonzero(flat & (areas > 0.5 * np.max(areas[flat])))
    lowest = large[np.argmin(triangles[large].mean(axis=1)[:, 1])]
    normal = normals[lowest] / areas[lowest]
    return np.all(np.abs((triangles - triangles[lowest, 0]) @ normal) < ON_FACE, axis=-1)
