"""What ``designopt solve`` reports of poses that cannot be assembled: reasons, and limits."""

from __future__ import annotations

import math
from collections import Counter

import jax
import jax.numpy as jnp
import numpy as np

from kinematics.io.assembled_sketch import AssembledSketch
from kinematics.model.linkage import Linkage
from kinematics.solve.limits import find_limits
from kinematics.solve.poses import PoseResult


def failure_messages(failures: Counter[int]) -> list[tuple[str, int]]:
    """Why poses fail and how many do, the most first.

    Args:
        failures: numbers of poses by codes of `PoseResult`.
    """
    return [
        (PoseResult[jax.tree.map(lambda _, code=code: jnp.asarray(code), PoseResult.successful)], n)
        for code, n in failures.most_common()
    ]


def limit_remarks(
    sketch: AssembledSketch, name: str, start: np.ndarray, of: tuple[str, ...] | None
) -> list[str]:
    """Where an input locks, and its change points, in words.

    Args:
        sketch: the linkage.
        name: the input.
        start: values of all inputs to look from, rad or mm.
        of: joints and bodies that have to follow; all if none.
    """
    with jax.enable_x64(True):
        linkage = Linkage.of(sketch.numbers, sketch.structure, sketch.assembly)
        try:
            limits = find_limits(linkage, name, jnp.asarray(start), of=of)
        except ValueError:  # no pose to start from
            return [f"{name}: no pose to look for its limits from"]
    is_angle = {part.name: part.slider is None for part in sketch.structure.inputs}
    held = "".join(
        f", at {other} = {_shown(value, is_angle[other])}"
        for other, value in zip(linkage.input_names, start, strict=True)
        if other != name
    )
    lines = [
        f"{name} locks at {_shown(limit.value, is_angle[name])} ({end} limit{held}): "
        f"{' and '.join(limit.bodies)} cannot follow beyond"
        if limit.locks
        else f"{name}: what is beyond {_shown(limit.value, is_angle[name])} is not known "
        f"({end} end{held}): {' and '.join(limit.bodies)} could not be followed"
        for end, limit in (("lower", limits.lower), ("upper", limits.upper))
        if limit is not None
    ]
    points = (_shown(point, is_angle[name]) for point in limits.change_points)
    return [*lines, *(f"{name} has a change point at {point}" for point in points)]


def _shown(value: float, is_angle: bool) -> str:
    return f"{math.degrees(value):.10g}°" if is_angle else f"{value:.10g} mm"
