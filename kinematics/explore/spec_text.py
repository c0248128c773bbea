"""A linkage file of a linkage as a bench shows it: joints in its pose, exact lengths."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import jax.numpy as jnp
import numpy as np

from designopt.io.spec_files import FORMAT
from designopt.io.toml_writing import format_toml
from designopt.vectors import Vector, rotation
from kinematics.explore.dimensions import Dimensions
from kinematics.io.sketch import Sketch, SliderTable
from kinematics.model.linkage import Linkage
from kinematics.model.topology import WORLD
from kinematics.solve.poses import solve_poses
from kinematics.solve.solver import Pose

SAME = 1e-12
"""A spring that is turned by less, rad, is as it was sketched."""


def spec_text(
    sketch: Sketch,
    linkage: Linkage,
    dimensions: Dimensions,
    distances: np.ndarray,
    inputs: np.ndarray,
) -> str:
    """The text of a linkage file that is read as this linkage, sketched in this pose.

    Springs are as taut as they were: what the pose turns them by goes into their preload.

    Args:
        sketch: the file that the linkage came from.
        linkage: with its distances as they are now.
        dimensions: which these are.
        distances: all of them, mm.
        inputs: of the pose, which is one, rad or mm.
    """
    pose = solve_poses(linkage, jnp.asarray(inputs, float)).value
    joints = {name: _place(vector) for name, vector in pose.joints.items()}
    anchors = np.asarray(linkage.anchors, float).tolist()
    joints |= dict(zip(linkage.structure.fixed_joints, anchors, strict=True))
    tables: dict[str, Any] = {
        "linkage": {"name": sketch.linkage.name, "format": FORMAT},
        "joints": {name: joints[name] for name in sketch.joints},
        "bodies": _bodies(sketch, dimensions, distances),
        "sliders": [_slider(sketch, slider, joints, pose) for slider in sketch.sliders],
        "inputs": [part.model_dump(exclude_none=True) for part in sketch.inputs],
        "springs": _springs(sketch, linkage, pose),
    }
    return format_toml({name: table for name, table in tables.items() if table})


def _place(vector: Vector) -> list[float]:
    return [float(vector.x), float(vector.y)]


def _bodies(sketch: Sketch, dimensions: Dimensions, distances: np.ndarray) -> dict[str, Any]:
    tables: dict[str, dict[str, Any]] = {}
    for name, body in sketch.bodies.items():
        lengths = {
            "-".join(one.ends): float(value)
            for one, value in zip(dimensions.distances, distances, strict=True)
            if one.body == name
        }
        tables[name] = {"joints": list(body.joints)}
        # Fixed joints are where they are written, and need no lengths.
        tables[name] |= {"fixed": True} if body.fixed else {"lengths": lengths}
    return tables


def _slider(
    sketch: Sketch, slider: SliderTable, joints: Mapping[str, list[float]], pose: Pose
) -> dict[str, Any]:
    """A slider, its line in the pose; what was drawn at a joint of its body stays there."""
    body = sketch.bodies[slider.on]
    held = {sketch.joints[joint]: joint for joint in reversed(body.joints)}

    def moved(point: tuple[float, float]) -> list[float]:
        if point in held:
            return joints[held[point]]
        if body.fixed:
            return list(point)
        first, second = (complex(*sketch.joints[joint]) for joint in body.joints[:2])
        along = (second - first) / abs(second - first)
        turn = complex(*_place(pose.bodies[slider.on])) / along
        place = complex(*joints[body.joints[0]]) + turn * (complex(*point) - first)
        return [place.real, place.imag]

    table = slider.model_dump(exclude_none=True)
    return table | {"line": [moved(point) for point in slider.line]}


def _springs(sketch: Sketch, linkage: Linkage, pose: Pose) -> list[dict[str, Any]]:
    tables = []
    for spring in sketch.springs:
        change = _turned(linkage, pose, *spring.between)
        preload = spring.preload + (change if abs(change) > SAME else 0.0)
        table = {"between": list(spring.between), "stiffness": spring.stiffness}
        tables.append(table | {"preload": preload})
    return tables


def _turned(linkage: Linkage, pose: Pose, first: str, second: str) -> float:
    """By how much the second body is turned against the first, from the assembled sketch, rad."""

    def rest(body: str) -> Any:
        if linkage.structure.node(body) == WORLD:
            return linkage.fixed_direction(body).angle()
        return linkage.home_angle(body)

    turn = pose.bodies[second].turned(pose.bodies[first].conjugate())
    return float(turn.turned(rotation(rest(first) - rest(second))).angle())
