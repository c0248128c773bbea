"""Every way in which a linkage can be assembled at given inputs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import jax
import jax.numpy as jnp
import numpy as np
import scipy.optimize
from jaxtyping import Array, Float

from designopt.numerics import as_float
from kinematics.model.linkage import Linkage
from kinematics.solve.continuation import ROUNDING_UNITS, loop_gaps
from kinematics.solve.evaluation import Drive, State, evaluate
from kinematics.solve.solver import Pose, Solver
from kinematics.solve.steps import Group, Plan
from kinematics.solve.triads import CLOSED, SAME, AllSolutions, distance, solve_two_loops

STARTS = 400
"""Random starts for a group of more than two loops, for which no complete method is used."""


@dataclass(frozen=True)
class Assemblies:
    """The assemblies of a linkage at one set of inputs.

    Attributes:
        poses: one unbatched pose for each.
        complete: whether these are certainly all.
    """

    poses: tuple[Pose, ...]
    complete: bool


@dataclass(frozen=True)
class _Choice:
    """One way through the groups solved so far: their sides, or their unknowns."""

    signs: tuple[int, ...]
    unknowns: dict[int, np.ndarray]


def find_assemblies(linkage: Linkage, inputs: Float[Array, " inputs"]) -> Assemblies:
    """Every assembly of a linkage at given inputs. Not for use under ``jax.jit``.

    A closed-form group can be on either side. A group of two loops (a triad, or four bodies in a
    ring) has up to six real solutions, all of which are found by elimination
    (`triads.solve_two_loops`). Of a larger group those are listed that many random starts find,
    and the list is not called complete.

    Args:
        linkage: the linkage.
        inputs: values of the inputs, rad or mm.

    Example:
        >>> from importlib.resources import files
        >>> from kinematics import read_linkage
        >>> linkage = read_linkage(files("studies") / "gallery/linkages/four-bar.toml")
        >>> len(find_assemblies(linkage, jnp.array([0.7])).poses)  # open and crossed
        2
    """
    values = as_float(inputs)
    solver = Solver.of(linkage, values.dtype)
    drive = solver.drive(values)
    choices, complete = [_Choice((0,) * len(linkage.assembly), {})], True
    for group in solver.plan.groups:
        if group.kind != "iterated":
            choices = [_with_sign(choice, group, sign) for choice in choices for sign in (1, -1)]
            choices = [choice for choice in choices if _exists(solver, drive, choice, group)]
            continue
        found = [(choice, _solutions(solver, drive, choice, group)) for choice in choices]
        complete = complete and all(solutions.complete for _, solutions in found)
        choices = [
            replace(choice, unknowns={**choice.unknowns, group.index: unknowns})
            for choice, solutions in found
            for unknowns in solutions.unknowns
        ]
    poses: list[Pose] = []
    for choice in choices:
        pose = solver.pose(_state(solver, solver.plan, drive, choice))
        if all(_differ(pose, other, float(solver.size)) for other in poses):
            poses.append(pose)
    return Assemblies(tuple(poses), complete)


def _with_sign(choice: _Choice, group: Group, sign: int) -> _Choice:
    signs = (*choice.signs[: group.index], sign, *choice.signs[group.index + 1 :])
    return replace(choice, signs=signs)


def _state(solver: Solver, plan: Plan, drive: Drive, choice: _Choice) -> State:
    signs = jnp.asarray(choice.signs, solver.size.dtype)
    unknowns = {index: (jnp.asarray(part), ()) for index, part in choice.unknowns.items()}
    return evaluate(solver.unit, plan, drive, signs, unknowns)


def _until(plan: Plan, group: Group) -> Plan:
    """The steps of a plan up to a group, with it."""
    return Plan(plan.orientations, plan.steps[: plan.steps.index(group) + 1])


def _exists(solver: Solver, drive: Drive, choice: _Choice, group: Group) -> bool:
    margins = _state(solver, _until(solver.plan, group), drive, choice).margins[group.index]
    touching = -ROUNDING_UNITS * float(jnp.finfo(solver.size.dtype).eps)
    return all(float(margin) >= touching for margin in margins)


def _solutions(solver: Solver, drive: Drive, choice: _Choice, group: Group) -> AllSolutions:
    plan = _until(solver.plan, group)
    signs = jnp.asarray(choice.signs, solver.size.dtype)
    known = [choice.unknowns[earlier.index] for earlier in plan.iterated[:-1]]

    @jax.jit
    def gaps(unknowns: Float[Array, " unknowns"]) -> Float[Array, " gaps"]:
        every = jnp.concatenate([*map(jnp.asarray, known), unknowns])
        return loop_gaps(solver.unit, plan, every, drive.values, signs)[-unknowns.shape[0] :]

    is_angle = (True,) * len(group.angles) + (False,) * len(group.sliders)
    if len(group.loops) == 2:

        def residual(unknowns: np.ndarray) -> np.ndarray:
            pairs = np.asarray(gaps(jnp.asarray(unknowns))).reshape(-1, 2)
            return pairs[:, 0] + 1j * pairs[:, 1]

        return solve_two_loops(residual, is_angle, _reach(solver.unit))
    return _by_many_starts(gaps, is_angle, _reach(solver.unit))


def _reach(unit: Linkage) -> float:
    """A length that no slide exceeds: that of all bodies and distances together."""
    parts = [unit.anchors, *(link.length for link in unit.links.values())]
    parts += [*(link.places for link in unit.links.values()), *(line.point for line in unit.lines)]
    return float(sum(np.sum(np.abs(np.asarray(part))) for part in parts))


def _by_many_starts(
    gaps: Callable[[Array], Array], is_angle: tuple[bool, ...], reach: float
) -> AllSolutions:
    random = np.random.default_rng(0)
    scale = np.where(is_angle, np.pi, reach)
    starts = random.uniform(-1, 1, (STARTS, len(is_angle))) * scale
    slopes = jax.jit(jax.jacfwd(gaps))

    def jacobian(x: np.ndarray) -> np.ndarray:
        return np.asarray(slopes(jnp.asarray(x)))

    found: list[np.ndarray] = []
    for start in starts:
        solved = scipy.optimize.least_squares(
            lambda x: np.asarray(gaps(jnp.asarray(x))),
            start,
            jac=jacobian,  # pyright: ignore[reportArgumentType]
            xtol=1e-15,
            ftol=1e-15,
            gtol=1e-15,
            max_nfev=60,
        )
        if np.max(np.abs(solved.fun)) > CLOSED:
            continue
        unknowns = np.where(is_angle, np.angle(np.exp(1j * solved.x)), solved.x)
        if all(distance(unknowns, other, is_angle) > SAME for other in found):
            found.append(unknowns)
    return AllSolutions(np.array(found).reshape(-1, len(is_angle)), complete=False)


def _differ(first: Pose, second: Pose, size: float) -> bool:
    gaps = [float((first.joints[joint] - second.joints[joint]).length()) for joint in first.joints]
    return max(gaps) > SAME * size
