"""How well a pose transmits motion: the angle at every pin that does, and an index per group."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from designopt.numerics import as_float
from designopt.solution import Solution
from designopt.vectors import Vector, fold_angle
from kinematics.model.linkage import Linkage, direction_of
from kinematics.solve.continuation import smallest_singular_value
from kinematics.solve.evaluation import group_columns
from kinematics.solve.poses import pose_solution
from kinematics.solve.solver import Pose, Solver, each_pose
from kinematics.solve.steps import Group


class Transmission(eqx.Module):
    """Transmission of a pose.

    Attributes:
        angles: by pin, rad, 0 to π/2. At a pin between two links the angle between them; at a
            joint that slides that between the link and the normal of its line.
        indices: by number of the group in the plan: smallest singular value of the derivatives
            of its loops with respect to its unknowns, each scaled to length 1; 0 (locked) to 1.
    """

    angles: dict[str, Float[Array, "*batch"]]
    indices: dict[int, Float[Array, "*batch"]]


def solve_transmission(
    linkage: Linkage, inputs: Float[Array, "*batch inputs"], *, of: Iterable[str] | None = None
) -> Transmission:
    """Transmission angles and indices of poses, differentiable in every dimension and input.

    The transmission angle is that between the two directions in which the two unknowns of a group
    move the joint they share: for a four-bar the angle between coupler and rocker (H. Alt, 1932);
    for a slider-crank that between the rod and the normal of the slide's line. A group that has
    no closed form has no such angle, but it has the index.

    Args:
        linkage: the linkage.
        inputs: values of the inputs, rad or mm.
        of: joints and bodies asked for; all by default.

    Returns:
        Angles and indices; without meaning where `solve_poses` is not ok.

    Example:
        >>> import math
        >>> from importlib.resources import files
        >>> from kinematics import read_linkage
        >>> linkage = read_linkage(files("studies") / "gallery/linkages/four-bar.toml")
        >>> found = solve_transmission(linkage, jnp.deg2rad(jnp.array([40.0])))
        >>> {pin: round(math.degrees(angle), 2) for pin, angle in found.angles.items()}
        {'B': 37.03}
    """
    inputs = as_float(inputs)
    solver = Solver.of(linkage, inputs.dtype, of)

    def one(values: Float[Array, " inputs"]) -> Transmission:
        state = solver.state(solver.drive(values))
        columns = {group: group_columns(state, group) for group in solver.plan.groups}
        indices = {group.index: _index(rows) for group, rows in columns.items()}
        return Transmission(_pin_angles(columns), indices)

    return each_pose(one, inputs)


def solve_poses_and_angles(
    linkage: Linkage, inputs: Float[Array, "*batch inputs"], *, of: Iterable[str] | None = None
) -> tuple[Solution[Pose], dict[str, Float[Array, "*batch"]]]:
    """What `solve_poses` returns, and the angles of `solve_transmission`, each pose solved once.

    Args:
        linkage: the linkage.
        inputs: values of the inputs, rad or mm.
        of: joints and bodies asked for; all by default.
    """
    inputs = as_float(inputs)
    solver = Solver.of(linkage, inputs.dtype, of)

    def one(values: Float[Array, " inputs"]) -> tuple[Solution[Pose], dict[str, Array]]:
        state = solver.state(solver.drive(values))
        pins = [group for group in solver.plan.groups if group.pin is not None]
        angles = _pin_angles({group: group_columns(state, group) for group in pins})
        return pose_solution(solver, state, jnp.all(jnp.isfinite(values))), angles

    return each_pose(one, inputs)


def _index(rows: Sequence[Sequence[Vector]]) -> Float[Array, ""]:
    """The smallest singular value of a group's Jacobian, its columns scaled to length 1."""
    if len(rows) == 1:
        # Of two unit vectors at an angle θ it is √(1 − |cos θ|), here without a difference.
        first, second = map(direction_of, rows[0])
        sine, cosine = first.cross(second), first.dot(second)
        return jnp.abs(sine) / jnp.sqrt(1 + jnp.abs(cosine))
    matrix = [[getattr(c, axis) for c in row] for row in rows for axis in ("x", "y")]
    return smallest_singular_value(jnp.stack([jnp.stack(line) for line in matrix]))


def _pin_angles(
    columns: Mapping[Group, Sequence[Sequence[Vector]]],
) -> dict[str, Float[Array, ""]]:
    """The angles at the pins of groups, of the derivatives of their loops by their unknowns."""
    angles: dict[str, Array] = {}
    for group, rows in columns.items():
        if group.pin is not None:
            first, second = rows[0]
            angle = fold_angle(first, second)
            # A pin of three bodies may serve two groups: the worse one counts.
            angles[group.pin] = jnp.minimum(angles.get(group.pin, angle), angle)
    return angles
