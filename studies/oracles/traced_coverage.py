"""Coverage of a finger's pads by the labels of a path tracer's rays, from the finger's file alone.

Rays of the camera's section go through mirrors and clear layers to the membranes, where Mitsuba
takes them (`judge.tracing`). Each is labelled with the pad on which it ends, its path and the face
by which it enters. What two neighbouring rays of one label enclose is seen. Between rays of
different labels, and between places that are far apart, more rays are traced, until neighbours of
different labels differ by no more than float32's rounding of a direction. That limits it: to 1e-6
of a pad in general, and to 1e-4 where the least transmission ends a view or where light enters a
clear end within 0.01 mm of the membrane.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from studies.oracles.finger_tables import scene_of_finger
from studies.oracles.judge.frames import union
from studies.oracles.judge.solids import Face, Pose, Tables, motion_of
from studies.oracles.judge.tracing import Tracer

RAYS = 2000
"""Of the fan over the field of view before it is refined."""

PARTS, ROUNDS = 8, 7
"""An interval between two rays is divided so often into so many parts: 160° into 7e-10 rad."""

APART, TURN = 0.02, 3e-3
"""Neighbours of one view land no farther apart (parts of the pad), in directions that differ no
more (rad): a ray that slips through the seam of two faces misses a refraction, and is none of it.
"""


def traced_coverage(
    path: str | Path,
    degrees: np.ndarray,
    solids: Callable[[float, float], Sequence[Face]] | None = None,
) -> np.ndarray:
    """The part of every pad that some ray reaches.

    Only rays count that lie in the field of view, meet the surface that they enter under no less
    than the least grazing angle (in air), and bring no less than the least part of the light.

    Args:
        path: of a finger's file.
        degrees: flexions of PIP and DIP, shape (poses, 2).
        solids: from these angles to opaque faces in the intermediate phalanx's frame, which stand
            in the way in place of the section's blockers.

    Returns:
        Of the proximal, intermediate and distal pad, 0 to 1, shape (poses, 3).
    """
    tables = scene_of_finger(path)
    if solids is not None:
        tables["blockers"] = []
    return np.array(
        [
            _in_pose(tables, {"pip": pip, "dip": dip}, solids(pip, dip) if solids else ())
            for pip, dip in np.asarray(degrees, float).tolist()
        ]
    )


def _in_pose(tables: Tables, pose: Pose, solids: Sequence[Face]) -> list[float]:
    """Coverage of every pad in one pose."""
    camera = tables["camera"]
    turn, shift = motion_of(tables, pose, camera["body"])
    eye = turn * complex(*camera["position"]) + shift
    tracer = Tracer(tables, pose, eye, solids=solids)
    lengths = np.array([frame.length for frame in tracer.pads])
    axis, half = (math.radians(camera[key]) for key in ("direction_deg", "fov_deg"))
    axis, half = axis + cmath.phase(turn), half / 2

    def trace(angles: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Labels, coordinates on the membranes (0 to 1), and directions there."""
        x, y = np.cos(axis + angles), np.sin(axis + angles)
        rays = tracer.trace(np.stack([x, y, np.zeros_like(angles)], axis=-1))
        return rays.labels(), rays.along / lengths[rays.pad], rays.way

    angles = np.linspace(-half, half, RAYS)
    labels, along, ways = trace(angles)
    for _ in range(ROUNDS):
        pads, joined = _neighbours(labels, ways)
        wide = np.flatnonzero(~joined | ((pads >= 0) & (np.abs(np.diff(along)) > APART)))
        steps = np.diff(angles)[wide, None] * np.arange(1, PARTS) / PARTS
        finer = (angles[wide, None] + steps).ravel()
        old, new = (angles, labels, along, ways), (finer, *trace(finer))
        places = np.repeat(wide + 1, PARTS - 1)
        angles, labels, along, ways = (
            np.insert(*both, axis=0) for both in zip(old, [places] * len(old), new, strict=True)
        )
    pads, joined = _neighbours(labels, ways)
    spans = np.stack([along[:-1], along[1:]], axis=-1)
    return [union(spans[joined & (pads == pad)].tolist()) for pad in range(len(lengths))]


def _neighbours(labels: np.ndarray, ways: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The pad that the first of every two neighbouring rays sees, and whether they see one view."""
    pads, turn = labels[:-1, 0], np.linalg.norm(np.diff(ways, axis=0), axis=-1)
    return pads, np.all(labels[1:] == labels[:-1], axis=-1) & ((pads < 0) | (turn < TURN))
