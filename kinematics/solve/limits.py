"""How far an input can go: the exact values at which a linkage locks, and change points."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import lineax as lx
import numpy as np
import optimistix as optx
import scipy.optimize
from jaxtyping import Array, Float

from designopt.numerics import as_float
from designopt.roots import find_root
from designopt.solution import Solution
from kinematics.model.linkage import Linkage
from kinematics.solve.continuation import (
    REACHED,
    TURNED,
    Followed,
    group_indices,
    newton_correct,
)
from kinematics.solve.solver import Solver

Targets = tuple[str, ...] | None

SAMPLES = 720
"""Samples of a full turn (or stroke) that bracket the roots and minima of the margins."""

TOUCHING = 1e-10
"""A least margin of at most so many sizes of the linkage is a change point, and no lock-up."""


@dataclass(frozen=True)
class Limit:
    """An input value beyond which the linkage cannot be assembled.

    Attributes:
        value: of the input, rad or mm.
        group: number of the group of the plan that locks.
        margin: which of its margins vanishes there, in the order of `Pose.margins`.
        bodies: the bodies of that group.
        locks: whether the linkage locks there; if not, it could not be followed beyond, and what
            is there is not known.
    """

    value: float
    group: int
    margin: int
    bodies: tuple[str, ...]
    locks: bool = True


@dataclass(frozen=True)
class Limits:
    """The range of an input around the sketch, with the other inputs held.

    Attributes:
        lower: where it ends below; none if it does not.
        upper: where it ends above; none if it does not.
        change_points: values within it, rad or mm, at which a margin touches zero, so that two
            assemblies meet and the linkage may go on in either.
    """

    lower: Limit | None
    upper: Limit | None
    change_points: tuple[float, ...]

    @property
    def full_turn(self) -> bool:
        """Whether the input makes a full turn (for a slide: the longest thinkable stroke)."""
        return self.lower is None and self.upper is None


def find_limits(
    linkage: Linkage,
    name: str,
    inputs: Float[Array, " inputs"] | None = None,
    *,
    of: Iterable[str] | None = None,
) -> Limits:
    """The range of one input. Not for use under ``jax.jit``.

    Margins of closed-form groups are bracketed by samples, at each of which also their least
    values in between are looked for, and every root is then found to rounding. Groups without a
    closed form are followed to where they turn, and the turning point is solved for.

    Args:
        linkage: the linkage.
        name: the input.
        inputs: where to start, and values of the other inputs; the assembled sketch by default.
        of: joints and bodies that have to follow; all by default.

    Raises:
        ValueError: there is no input of that name, or the start is no pose.

    Example:
        >>> from importlib.resources import files
        >>> from kinematics import read_linkage
        >>> linkage = read_linkage(files("studies") / "gallery/linkages/four-bar.toml")
        >>> find_limits(linkage, "crank").full_turn  # a crank-rocker
        True
    """
    if name not in linkage.input_names:
        raise ValueError(f"no input is named {name!r}; there are {', '.join(linkage.input_names)}")
    index = linkage.input_names.index(name)
    start = linkage.reference.inputs if inputs is None else as_float(inputs)
    search = _Search(linkage, index, start, None if of is None else tuple(of))
    if any(value < -TOUCHING for value in search.margins(np.array([float(start[index])]))[0]):
        raise ValueError("the start is no pose of the linkage: its margins are negative")
    upper, above = search.ahead(1)
    if upper is None and search.is_angle:
        return Limits(None, None, tuple(sorted(above)))
    lower, below = search.ahead(-1)
    return Limits(lower, upper, tuple(sorted({*above, *below})))


def solve_turning_point(
    linkage: Linkage,
    name: str,
    limit: Limit,
    inputs: Float[Array, " inputs"] | None = None,
    *,
    of: Iterable[str] | None = None,
) -> Solution[Float[Array, ""]]:
    """The input value at which a linkage locks, differentiable in every dimension.

    Args:
        linkage: the linkage; near the one for which ``limit`` was found.
        name: the input.
        limit: what to solve for, from `find_limits`.
        inputs: values of the other inputs; the assembled sketch's by default.
        of: joints and bodies that have to follow; all by default.

    Returns:
        The value, rad or mm. ``margin`` is the magnitude of the slope of what vanishes there, per
        rad or per size of the linkage.

    Example:
        >>> import tomllib
        >>> from importlib.resources import files
        >>> from kinematics import parse_linkage
        >>> tables = tomllib.loads(
        ...     (files("studies") / "gallery/linkages/four-bar.toml").read_text()
        ... )
        >>> tables["bodies"]["crank"]["lengths"]["O2-A"] = 90.0  # too long to turn fully
        >>> linkage = parse_linkage(tables)
        >>> limit = find_limits(linkage, "crank").upper
        >>> abs(float(solve_turning_point(linkage, "crank", limit).value) - limit.value) < 1e-4
        True
    """
    index = linkage.input_names.index(name)
    start = linkage.reference.inputs if inputs is None else as_float(inputs)
    guess = jnp.asarray(limit.value, start.dtype)
    targets = None if of is None else tuple(of)
    return _turning_point(linkage, start, guess, index, limit.group, limit.margin, targets)


# The three programs of a search: further designs of the same structure compile nothing anew.


@partial(jax.jit, static_argnames=("index", "group", "margin", "of"))
def _turning_point(
    linkage: Linkage,
    start: Float[Array, " inputs"],
    guess: Float[Array, ""],
    index: int,
    group: int,
    margin: int,
    of: Targets,
) -> Solution[Float[Array, ""]]:
    iterated = Solver.of(linkage, start.dtype, of).plan.iterated
    if any(part.index == group for part in iterated):
        return _turn(linkage, index, guess, start, of)

    def vanishing(value: Float[Array, ""], design: Linkage) -> Float[Array, ""]:
        return _margins_at(design, start.at[index].set(value), of)[group][margin]

    return find_root(vanishing, guess, linkage, tolerance=1e-15)


@partial(jax.jit, static_argnames=("index", "of"))
def _margin_table(
    linkage: Linkage,
    start: Float[Array, " inputs"],
    values: Float[Array, " poses"],
    index: int,
    of: Targets,
) -> Float[Array, "poses margins"]:
    """All margins of the groups in their order."""

    def one(value: Float[Array, ""]) -> Float[Array, " margins"]:
        found = _margins_at(linkage, start.at[index].set(value), of)
        return jnp.stack([margin for margins in found.values() for margin in margins])

    return jax.vmap(one)(values)


@partial(jax.jit, static_argnames=("index", "of"))
def _follow(
    linkage: Linkage,
    start: Float[Array, " inputs"],
    end: Float[Array, ""],
    index: int,
    of: Targets,
) -> tuple[Followed, dict[int, Float[Array, ""]]]:
    """Where the iterated groups come on the way to a value, and their indices there."""
    solver = Solver.of(linkage, start.dtype, of)
    followed = _way(solver, start, index, end)
    value = start[index] + followed.part * (end - start[index])
    jacobian = solver.jacobian(followed.unknowns, solver.drive(start.at[index].set(value)))
    return followed, group_indices(solver.plan, jacobian)


def _margins_at(
    linkage: Linkage, inputs: Float[Array, " inputs"], of: Targets
) -> dict[int, tuple[Float[Array, ""], ...]]:
    solver = Solver.of(linkage, inputs.dtype, of)
    return solver.state(solver.drive(inputs)).margins


def _turn(
    linkage: Linkage,
    index: int,
    guess: Float[Array, ""],
    start: Float[Array, " inputs"],
    of: Targets,
) -> Solution[Float[Array, ""]]:
    """Turning point of iterated groups: gaps vanish, and so does a direction's change of them.

    Source: R. Seydel, Numerical computation of branch points in nonlinear equations, Numer.
    Math. 33, 1979.
    """
    # Where the search begins has no derivative; where it ends does, by the equations.
    design, held = jax.lax.stop_gradient((linkage, start))
    solver = Solver.of(design, start.dtype, of)
    # A little beyond it, so that the way ends at the turn.
    beyond = guess + jnp.sign(guess - held[index]) * 1e-3
    followed = _way(solver, held, index, beyond).unknowns
    jacobian = solver.jacobian(followed, solver.drive(held.at[index].set(beyond)))
    direction = jnp.linalg.svd(jacobian)[2][-1]  # free to move there

    def equations(
        unknowns: Float[Array, " extended"], design: Linkage
    ) -> Float[Array, " extended"]:
        solver = Solver.of(design, start.dtype, of)
        q, v, value = unknowns[: len(followed)], unknowns[len(followed) : -1], unknowns[-1]
        drive = solver.drive(start.at[index].set(value))

        # The null vector v is an unknown too, and what normalises it is linear. At a simple turn
        # these equations are regular, which those of the pose alone are not.
        gap, change = jax.jvp(lambda q: solver.gaps(q, drive), (q,), (v,))
        return jnp.concatenate([gap, change, (v @ direction - 1)[None]])

    first = jnp.concatenate([followed, direction, guess[None]])
    solved = optx.root_find(
        equations,
        optx.Newton(1e-14, 1e-14),
        first,
        linkage,
        max_steps=32,
        adjoint=optx.ImplicitAdjoint(linear_solver=lx.AutoLinearSolver(well_posed=False)),
        throw=False,
    )
    residual = jnp.max(jnp.abs(equations(solved.value, linkage)))
    return Solution(
        solved.value[-1],
        jnp.ones_like(residual),
        residual,
        optx.RESULTS.where(
            residual < 1e-11, optx.RESULTS.successful, optx.RESULTS.nonlinear_divergence
        ),
    )


def _way(
    solver: Solver, start: Float[Array, " inputs"], index: int, end: Float[Array, ""]
) -> Followed:
    """Follow the iterated groups from a pose while one input moves and the others are held."""
    first = solver.drive(start)
    near = solver.followed(first)
    assert near is not None
    begin = newton_correct(solver.unit, solver.plan, first.values, solver.signs, near.unknowns)
    last = solver.drive(start.at[index].set(end))
    return solver.followed_from((first.values, begin), last.values)


class _Search:
    """Looks for the limits of one input."""

    def __init__(
        self, linkage: Linkage, index: int, start: Float[Array, " inputs"], of: Targets
    ) -> None:
        self.linkage, self.index, self.start, self.of = linkage, index, start, of
        self.plan = Solver.of(linkage, start.dtype, of).plan
        self.groups = [
            (group, number)
            for group in self.plan.groups
            for number in range(2 if group.kind in ("RRR", "iterated") else 1)
        ]
        self.is_angle = linkage.structure.inputs[index].slider is None

    def margins(self, values: np.ndarray) -> np.ndarray:
        """Margins at input values, in units of the linkage's size, shape (poses, margins)."""
        if not self.groups:
            return np.ones((len(values), 1))
        poses = jnp.asarray(values, self.start.dtype)
        return np.asarray(_margin_table(self.linkage, self.start, poses, self.index, self.of))

    def ahead(self, sign: int) -> tuple[Limit | None, list[float]]:
        """The first limit in a direction, and the change points before it."""
        first = float(self.start[self.index])
        stretch, turn = self._stretch(first, sign)
        found = [] if turn is None else [turn]
        touches: list[float] = []
        if any(group.kind != "iterated" for group, _ in self.groups):
            # Samples bracket; a root between two of them is found by Brent's method, and a dip of
            # a margin through 0 and back within one interval by `_may_dip`.
            values = first + np.linspace(0.0, stretch, SAMPLES + 1)
            table = self.margins(values)
            for column, (group, number) in enumerate(self.groups):
                if group.kind == "iterated":
                    continue
                root, touched = self._first_root(values, table[:, column], column)
                touches += touched
                if root is not None:
                    found.append(Limit(root, group.index, number, group.bodies))
        nearest = min(found, key=lambda limit: abs(limit.value - first), default=None)
        if nearest is not None:
            name = self.linkage.input_names[self.index]
            solved = solve_turning_point(self.linkage, name, nearest, self.start, of=self.of)
            # Refined from the bracketed value, unless the solve has run to another root of the same
            # margin.
            refined = bool(solved.ok) and abs(float(solved.value) - nearest.value) < 1e-3
            if nearest.locks and refined:
                nearest = replace(nearest, value=float(solved.value))
            elif nearest is turn:  # where an iterated group is, and no more, is known
                nearest = replace(nearest, locks=False)
            touches = [t for t in touches if abs(t - first) < abs(nearest.value - first)]
        return nearest, touches

    def _stretch(self, first: float, sign: int) -> tuple[float, Limit | None]:
        """How far to look, signed, and the turning point of iterated groups at that end."""
        lengths = [self.linkage.anchors, *(link.length for link in self.linkage.links.values())]
        longest = 2 * sum(float(np.sum(np.abs(np.asarray(part)))) for part in lengths)
        stretch = sign * (2 * math.pi if self.is_angle else longest)
        if not self.plan.iterated:
            return stretch, None
        end = jnp.asarray(first + stretch, self.start.dtype)
        followed, indices = _follow(self.linkage, self.start, end, self.index, self.of)
        if int(followed.status) == REACHED:
            return stretch, None
        # It turned, or was lost: then it may not be locked, but nothing farther is known.
        stretch *= float(followed.part)
        group = min(self.plan.iterated, key=lambda group: float(indices[group.index]))
        locks = int(followed.status) == TURNED
        return stretch, Limit(first + stretch, group.index, 0, group.bodies, locks)

    def _first_root(
        self, values: np.ndarray, margins: np.ndarray, column: int
    ) -> tuple[float | None, list[float]]:
        def margin(value: float) -> float:
            return float(self.margins(np.array([value]))[0, column])

        touches: list[float] = []
        inside = 0  # the last sample that is a pose; touching, or lock-up to rounding, counts
        for k in range(1, len(values)):
            if margins[k] < -TOUCHING:
                return _root(margin, values[inside], values[k]), touches
            inside = k
            if k > 1 and _may_dip(*margins[k - 2 : k + 1].tolist()):
                found: Any = scipy.optimize.minimize_scalar(
                    margin,
                    bounds=sorted((values[k - 2], values[k])),
                    method="bounded",
                    options={"xatol": 1e-12},
                )
                lowest, least = float(found.x), margin(found.x)
                if least < -TOUCHING:
                    return _root(margin, values[k - 2], lowest), touches
                if least <= TOUCHING:
                    touches.append(lowest)
        return None, touches


def _may_dip(before: float, least: float, after: float) -> bool:
    """Whether a least margin of three, a step apart, may hide a zero beside it.

    A parabola through them goes less than the larger rise below the least; four times that
    leaves room for what is not a parabola.
    """
    rise = max(before - least, after - least)
    return before >= least <= after and least <= 4 * rise + TOUCHING


def _root(margin: Callable[[float], float], inside: float, outside: float) -> float:
    # At lock-up to rounding there is no change of sign to bracket: this is the root.
    if margin(inside) <= 0:
        return inside
    root: Any = scipy.optimize.brentq(margin, inside, outside, xtol=1e-15, rtol=np.float64(1e-14))
    return float(root)
