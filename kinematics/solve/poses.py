"""Poses of a linkage, batched: every joint and body, with margin, closure error and result."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from designopt.batching import map_in_chunks
from designopt.numerics import as_float
from designopt.solution import Solution
from designopt.vectors import Vector
from kinematics.model.linkage import Linkage
from kinematics.solve.continuation import ROUNDING_UNITS
from kinematics.solve.evaluation import Drive, State, closure
from kinematics.solve.solver import Pose, Solver

BLOCK = 8192
"""Poses computed at a time, so that what lies between inputs and results stays in the cache."""


FEW = 512
"""Fewer poses are computed at once. More go through a loop, even if twice only: outside of one XLA
computes the sines anew for every output."""


class PoseResult(eqx.Enumeration):
    """Why a pose is none."""

    successful = ""
    too_far = (
        "Two pins are farther apart than the links between them reach: lengthen these links, "
        "bring the pins together, or keep the input within its limits."
    )
    too_near = (
        "Two pins are nearer to each other than the links between them can fold: make these "
        "links more equal, move the pins apart, or keep the input within its limits."
    )
    off_the_line = (
        "A link does not reach the line that its end slides along: lengthen it, bring its pin "
        "nearer to the line, or keep the input within its limits."
    )
    inside_the_slot = (
        "A slot's pin is nearer to the pivot than the slot's line: reduce the slot's offset, or "
        "keep the input within its limits."
    )
    parallel = "Two lines along which a joint slides are parallel: turn one of them."
    locked = (
        "The linkage locks before it comes here from the sketch: keep the input within its "
        "limits, or sketch the assembly beyond them."
    )
    not_followed = (
        "The way from the sketch to this pose could not be followed: sketch the linkage nearer "
        "to it."
    )
    no_number = "An input is not a finite number."


_CODES = {
    "RRR": (PoseResult.too_far, PoseResult.too_near),
    "RRP": (PoseResult.off_the_line,),
    "RPR": (PoseResult.inside_the_slot,),
    "PRP": (PoseResult.parallel,),
    "RPP": (PoseResult.parallel,),
    "iterated": (PoseResult.locked, PoseResult.not_followed),
}


def solve_poses(
    linkage: Linkage,
    inputs: Float[Array, "*batch inputs"],
    *,
    of: Iterable[str] | None = None,
    signs: Float[Array, " groups"] | None = None,
) -> Solution[Pose]:
    """Poses at given inputs, in the linkage's assembly.

    Args:
        linkage: the linkage; ``jax.vmap`` over it for a batch of designs.
        inputs: values of the inputs in the order of ``linkage.input_names``, rad or mm.
        of: joints and bodies asked for; only what they depend on is solved. All by default.
        signs: an assembly other than the linkage's own, one sign per group of the plan.

    Returns:
        The poses. ``margin`` is the least over the groups, in mm: for RRR how far the outer pins
        are from the distance at which the links stretch or fold; for RRP how far the link reaches
        beyond the line; for RPR how far the slot's pin is outside the circle that the slot
        touches; for crossing lines the sine of their angle times the linkage's size; for an
        iterated group the smallest singular value of its scaled Jacobian (`solve_transmission`)
        times that size where the pose was reached, and minus the part of the way that was not
        where the linkage locked. ``residual`` is the closure error in units of the linkage's
        size: the largest gap between the places that two bodies give to their common joint, or
        the stretch of a body.

    Raises:
        PlanError: ``of`` names something the linkage does not have.

    Example:
        >>> import numpy as np
        >>> from importlib.resources import files
        >>> from kinematics import read_linkage
        >>> linkage = read_linkage(files("studies") / "gallery/linkages/four-bar.toml")
        >>> poses = jax.jit(solve_poses)(linkage, jnp.deg2rad(jnp.array([[40.0], [90.0]])))
        >>> (
        ...     poses.ok.tolist(),
        ...     np.rad2deg(poses.value.angle("rocker")).astype(float).round(2).tolist(),
        ... )
        ([True, True], [57.32, 80.26])
    """
    inputs = as_float(inputs)
    solver = Solver.of(linkage, inputs.dtype, of, signs)
    batch = inputs.shape[:-1]
    inputs = inputs.reshape(-1, inputs.shape[-1])
    solved = map_states(solver, inputs, lambda *state: pose_solution(solver, *state))
    return jax.tree.map(lambda leaf: leaf.reshape(*batch, *leaf.shape[1:]), solved)


def map_states(
    solver: Solver,
    inputs: Float[Array, "poses inputs"],
    answer: Callable[[State, Bool[Array, ""]], Any],
) -> Any:
    """In every pose the answer from its state and from whether its inputs are numbers.

    Args:
        solver: computes the states.
        inputs: rad or mm.
        answer: of one pose.
    """
    finite = jnp.all(jnp.isfinite(inputs), axis=-1)
    # Angles become unit vectors here: XLA would compute their sines anew for every output.
    drive = solver.drive(jnp.where(finite[:, None], inputs, 0.0))

    def of_one(values: Array, turns: Vector, finite: Bool[Array, ""]) -> Any:
        return answer(solver.state(Drive(values, turns, solver.home)), finite)

    given, of_some = (drive.values, drive.turns, finite), jax.vmap(of_one)
    if (count := len(inputs)) < FEW:
        return of_some(*given)
    chunk = min(BLOCK, -(-count // 2))
    return map_in_chunks(jax.checkpoint(lambda some: of_some(*some)), given, chunk)


def pose_solution(solver: Solver, state: State, finite: Bool[Array, ""]) -> Solution[Pose]:
    """The pose of a state, as `solve_poses` returns it.

    Args:
        solver: which computed the state.
        state: of one pose.
        finite: whether its inputs are numbers.
    """
    margin, result = _result_of(state, finite)
    return Solution(solver.pose(state), margin * solver.size, closure(state), result)


def is_pose(state: State, finite: Bool[Array, ""]) -> tuple[Float[Array, ""], Bool[Array, ""]]:
    """The margin of a state in units of the linkage's size, and whether it is a pose.

    Args:
        state: of one pose.
        finite: whether its inputs are numbers.
    """
    margin, result = _result_of(state, finite)
    return margin, result == PoseResult.successful


def _result_of(state: State, finite: Bool[Array, ""]) -> tuple[Float[Array, ""], Any]:
    one = state.identity.x
    touching = -ROUNDING_UNITS * jnp.finfo(one.dtype).eps
    result, margin = PoseResult.successful, None
    for group in reversed(state.plan.groups):
        for value, code in reversed(
            list(zip(state.margins[group.index], _CODES[group.kind], strict=True))
        ):
            result = PoseResult.where(value >= touching, result, code)
            margin = value if margin is None else jnp.minimum(margin, value)
    if margin is None:  # nothing to solve, so nothing to fail
        margin = one
    return margin, PoseResult.where(finite, result, PoseResult.no_number)
