"""Coverage of a finger's pads by the labels of a path tracer's rays, from the finger's file alone.

Rays of the camera's section go through mirrors and clear layers to the membranes, where Mitsuba
takes them (`judge.tracing`). Each is labelled with the pad on which it ends, its path and the face
by which it enters. What two neighbouring rays of one label enclose is seen. Between rays of
different labels, and between places that are far apart, more rays are traced, until neighbours of
different labels differ by no more than float32's rounding of a direction.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from studies.oracles.finger_tables import scene_of_finger
from studies.oracles.judge.solids import Pose, Tables, motion_of
from studies.oracles.judge.tracing import Tracer

RAYS = 1000
"""Of the fan over the field of view before it is refined."""

PARTS, ROUNDS = 8, 7
"""An interval between two rays is divided so often into so many parts: 160° into 1.3e-9 rad."""

APART = 0.02
"""Neighbouring rays of one label land no farther apart, in parts of the pad."""


def traced_coverage(path: str | Path, degrees: np.ndarray) -> np.ndarray:
    """The part of every pad that some ray reaches.

    Only rays count that lie in the field of view, meet the surface that they enter under no less
    than the least grazing angle (in air), and bring no less than the least part of the light.

    Args:
        path: of a finger's file.
        degrees: flexions of PIP and DIP, shape (poses, 2).

    Returns:
        Of the proximal, intermediate and distal pad, 0 to 1, shape (poses, 3).
    """
    tables = scene_of_finger(path)
    poses = [{"pip": pip, "dip": dip} for pip, dip in np.asarray(degrees, float).tolist()]
    return np.array([coverage_in_pose(tables, pose) for pose in poses])


def coverage_in_pose(tables: Tables, pose: Pose) -> np.ndarray:
    """The same of every pad of a scene's tables with `judge.tracing.Tracer`'s words in one pose."""
    camera = tables["camera"]
    turn, shift = motion_of(tables, pose, camera.get("body", "world"))
    tracer = Tracer(tables, pose, turn * complex(*camera["position"]) + shift)
    axis = turn * np.exp(1j * np.radians(camera["direction_deg"]))
    lengths = np.array([frame.length for frame in tracer.pads])

    def trace(angles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Labels, and coordinates on the membranes, 0 to 1."""
        way = axis * np.exp(1j * angles)
        rays = tracer.trace(np.stack([way.real, way.imag, np.zeros_like(angles)], axis=-1))
        return rays.labels(), rays.along / lengths[rays.pad]

    half = math.radians(camera["fov_deg"]) / 2
    angles = np.linspace(-half, half, RAYS)
    labels, along = trace(angles)
    for _ in range(ROUNDS):
        same = np.all(labels[1:] == labels[:-1], axis=-1)
        wide = np.flatnonzero(~same | ((labels[1:, 0] >= 0) & (np.abs(np.diff(along)) > APART)))
        steps = np.arange(1, PARTS) / PARTS
        finer = (angles[wide, None] + np.diff(angles)[wide, None] * steps).ravel()
        places = np.repeat(wide + 1, PARTS - 1)
        found = finer, *trace(finer)
        angles, labels, along = (
            np.insert(old, places, new, axis=0)
            for old, new in zip((angles, labels, along), found, strict=True)
        )
    seen = np.all(labels[1:] == labels[:-1], axis=-1) & (labels[1:, 0] >= 0)
    spans = np.sort(np.stack([along[:-1], along[1:]], axis=-1)[seen], axis=-1)
    pads = labels[1:, 0][seen]
    return np.array([_union(spans[pads == pad]) for pad in range(len(lengths))])


def _union(spans: np.ndarray) -> float:
    """Length of a union of intervals, shape (intervals, 2)."""
    spans = spans[np.argsort(spans[:, 0])]
    reached = np.maximum.accumulate(np.append(-np.inf, spans[:, 1]))
    return float(np.sum(np.maximum(spans[:, 1] - np.maximum(spans[:, 0], reached[:-1]), 0.0)))
