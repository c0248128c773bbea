"""One pose of a linkage as plain numbers: what every drawing of it starts from."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from kinematics.model.linkage import Linkage
from kinematics.model.topology import WORLD, Structure
from kinematics.solve.solver import Pose

Points = Float[np.ndarray, "_ 2"]
Place = Float[np.ndarray, "2"]
Corner = tuple[float, ...]
Travel = Mapping[int, tuple[float, float]]

TRACK_END, SLOT_END = 0.1, 0.04
"""How far fixed lines and slots reach beyond their slider's travel, in linkage sizes."""


@dataclass(frozen=True)
class Scene:
    """One pose as plain numbers, in mm.

    Attributes:
        structure: who is joined to whom.
        size: the linkage's largest dimension.
        joints: positions.
        angles: of the first moving body that holds each joint, rad; 0 for fixed joints.
        directions: of the sliders' lines, unit vectors.
        ends: of what is drawn of the sliders' lines.
    """

    structure: Structure
    size: float
    joints: Mapping[str, Place]
    angles: Mapping[str, float]
    directions: tuple[Place, ...]
    ends: tuple[Points, ...]

    @classmethod
    def of(cls, linkage: Linkage, pose: Pose, travel: Travel | None = None) -> Scene:
        """The scene of a pose; see `draw_pose` for the arguments."""
        structure = linkage.structure
        turns = {part.name: _numbers(pose.bodies[part.name]) for part in structure.bodies}
        return cls.at(
            structure,
            float(linkage.size()),
            {name: _numbers(pose.joints[name]) for name in structure.joints},
            {name: math.atan2(turn[1], turn[0]) for name, turn in turns.items()},
            [
                (float(line.angle), float(pose.slides[index]))
                for index, line in enumerate(linkage.lines)
            ],
            travel,
        )

    @classmethod
    def at(
        cls,
        structure: Structure,
        size: float,
        joints: Mapping[str, Place],
        turns: Mapping[str, float],
        slides: Sequence[tuple[float, float]],
        travel: Travel | None = None,
    ) -> Scene:
        """The scene of a pose in plain numbers.

        Args:
            structure: who is joined to whom.
            size: the linkage's largest dimension, mm.
            joints: positions, mm.
            turns: angle of each body, rad.
            slides: of each slider the angle of its line in the frame of its body, rad, and its
                place along it, mm.
            travel: as in `draw_pose`.
        """
        directions, ends = [], []
        for index, part in enumerate(structure.sliders):
            fixed = structure.node(part.on) == WORLD
            line, slide = slides[index]
            angle = line + (0.0 if fixed else turns[part.on])
            along = np.array([math.cos(angle), math.sin(angle)])
            low, high = (travel or {}).get(index, (slide, slide))
            beyond = (TRACK_END if fixed else SLOT_END) * size
            reach = np.array([low - slide - beyond, high - slide + beyond])
            directions.append(along)
            ends.append(joints[part.joint] + reach[:, None] * along)
        angles = dict.fromkeys(joints, 0.0)
        for part in reversed(structure.moving):
            angles |= dict.fromkeys(part.joints, turns[part.name])
        angles |= dict.fromkeys(structure.fixed_joints, 0.0)
        return cls(structure, size, joints, angles, tuple(directions), tuple(ends))

    def outlines(self, body: str) -> list[Points]:
        """Lines through a body's joints: a bar, or a closed polygon; and bars to its slots."""
        places = np.array([self.joints[joint] for joint in self.structure.body(body).joints])
        lines = []
        if len(places) > 1:
            corners = hull(places)
            lines.append(np.vstack([corners, corners[:1]]) if len(corners) > 2 else places)
        return lines + [_bridge(places, ends) for ends in self.strips(body)]

    def strips(self, body: str) -> list[Points]:
        """The ends of a body's slots."""
        sliders = zip(self.structure.sliders, self.ends, strict=True)
        return [ends for part, ends in sliders if part.on == body]

    def members(self, joint: str) -> list[str]:
        """The moving bodies that hold a joint at a place of its own."""
        return [part.name for part in self.structure.moving if joint in part.joints]

    def lines(self) -> list[Points]:
        """Every line that is drawn, for labels to keep clear of."""
        moving = [line for part in self.structure.moving for line in self.outlines(part.name)]
        return [*moving, *self.ends]


def traced_joints(structure: Structure) -> list[str]:
    """Joints whose curves are worth drawing: those of bodies that turn about no fixed joint."""
    fixed = set(structure.fixed_joints)
    moving = [joint for joint in structure.joints if joint not in fixed]
    turning = {j for part in structure.moving if fixed & {*part.joints} for j in part.joints}
    straight = {part.joint for part in structure.sliders if structure.node(part.on) == WORLD}
    # A slider's fixed line is drawn anyway.
    free = [joint for joint in moving if joint not in straight]
    return [joint for joint in free if joint not in turning] or free or moving


def hull(points: Points) -> Points:
    """Corners of the convex hull, counter-clockwise; the two ends of points in one line.

    Source: A. M. Andrew, Another efficient algorithm for convex hulls in two dimensions, 1979.
    """
    order = sorted(map(tuple, points.tolist()))
    rounding = 1e-12 * max(max(part) - min(part) for part in zip(*order, strict=True)) ** 2

    def chain(sorted_points: Iterable[Corner]) -> list[Corner]:
        corners: list[Corner] = []
        for point in sorted_points:
            while len(corners) >= 2 and _cross(corners[-2], corners[-1], point) <= rounding:
                corners.pop()
            corners.append(point)
        return corners[:-1]

    return np.array(chain(order) + chain(reversed(order)))


def _cross(a: Corner, b: Corner, c: Corner) -> float:
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def _bridge(places: Points, ends: Points) -> Points:
    """The shortest bar from a body's joints to its slot."""
    step = ends[1] - ends[0]
    parts = np.clip((places - ends[0]) @ step / (step @ step), 0, 1)
    feet = ends[0] + parts[:, None] * step
    nearest = int(np.argmin(np.sum((feet - places) ** 2, axis=-1)))
    return np.array([places[nearest], feet[nearest]])


def _numbers(vector: Any) -> Place:
    return np.array([float(vector.x), float(vector.y)])
