"""How far an input can go: the exact values at which a linkage locks, and change points."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
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
    loop_gaps,
    newton_correct,
)
from kinematics.solve.solver import Solver

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
    solver = Solver.of(linkage, start.dtype, targets)
    group = next(group for group in solver.plan.groups if group.index == limit.group)
    if group.kind == "iterated":
        return _turn(linkage, index, guess, start, targets)

    def margin(value: Float[Array, ""], design: Linkage) -> Float[Array, ""]:
        inputs = start.at[index].set(value)
        return _margins_at(design, inputs, targets)[limit.group][limit.margin]

    return find_root(margin, guess, linkage, tolerance=1e-15)


def _margins_at(
    linkage: Linkage, inputs: Float[Array, " inputs"], of: tuple[str, ...] | None
) -> dict[int, tuple[Float[Array, ""], ...]]:
    solver = Solver.of(linkage, inputs.dtype, of)
    return solver.state(solver.drive(inputs)).margins


def _turn(
    linkage: Linkage,
    index: int,
    guess: Float[Array, ""],
    start: Float[Array, " inputs"],
    of: tuple[str, ...] | None,
) -> Solution[Float[Array, ""]]:
    """Turning point of iterated groups: gaps vanish, and so does a direction's change of them.

    Source: R. Seydel, Numerical computation of branch points in nonlinear equations, Numer.
    Math. 33, 1979.
    """
    followed, direction = jax.lax.stop_gradient(_end_of_the_way(linkage, index, guess, start, of))

    def equations(
        unknowns: Float[Array, " extended"], design: Linkage
    ) -> Float[Array, " extended"]:
        solver = Solver.of(design, start.dtype, of)
        q, v, value = unknowns[: len(followed)], unknowns[len(followed) : -1], unknowns[-1]
        drive = solver.drive(start.at[index].set(value))

        def gaps(q: Float[Array, " unknowns"]) -> Float[Array, " gaps"]:
            return loop_gaps(solver.unit, solver.plan, q, drive.values, solver.signs)

        # The null vector v is an unknown too, and what normalises it is linear. At a simple turn
        # these equations are regular, which those of the pose alone are not.
        gap, change = jax.jvp(gaps, (q,), (v,))
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


def _end_of_the_way(
    linkage: Linkage,
    index: int,
    guess: Float[Array, ""],
    start: Float[Array, " inputs"],
    of: tuple[str, ...] | None,
) -> tuple[Float[Array, " unknowns"], Float[Array, " unknowns"]]:
    """Unknowns near the turning point, and the direction in which they are free to move there."""
    solver = Solver.of(linkage, start.dtype, of)
    # A little beyond it, so that the way ends at the turn.
    beyond = guess + jnp.sign(guess - start[index]) * 1e-3
    followed = _way(solver, start, index, beyond)
    drive = solver.drive(start.at[index].set(beyond))
    jacobian = jax.jacfwd(
        lambda q: loop_gaps(solver.unit, solver.plan, q, drive.values, solver.signs)
    )(followed.unknowns)
    return followed.unknowns, jnp.linalg.svd(jacobian)[2][-1]


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
    """Looks for the limits of one input, with programs compiled once."""

    def __init__(
        self,
        linkage: Linkage,
        index: int,
        start: Float[Array, " inputs"],
        of: tuple[str, ...] | None,
    ) -> None:
        self.linkage, self.index, self.start, self.of = linkage, index, start, of
        self.solver = Solver.of(linkage, start.dtype, of)
        self.groups = [
            (group, number)
            for group in self.solver.plan.groups
            for number in range(2 if group.kind in ("RRR", "iterated") else 1)
        ]
        self.is_angle = linkage.structure.inputs[index].slider is None

        @jax.jit
        def margins(values: Float[Array, " poses"]) -> Float[Array, "poses margins"]:
            def one(value: Float[Array, ""]) -> Float[Array, " margins"]:
                found = _margins_at(linkage, start.at[index].set(value), of)
                return jnp.stack([found[group.index][number] for group, number in self.groups])

            return jax.vmap(one)(values)

        self._margins = margins
        self._follow = jax.jit(lambda end: _way(self.solver, start, index, end))

    def margins(self, values: np.ndarray) -> np.ndarray:
        """Margins at input values, in units of the linkage's size, shape (poses, margins)."""
        if not self.groups:
            return np.ones((len(values), 1))
        return np.asarray(self._margins(jnp.asarray(values, self.start.dtype)))

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
        if not self.solver.plan.iterated:
            return stretch, None
        followed = self._follow(jnp.asarray(first + stretch, self.start.dtype))
        if int(followed.status) == REACHED:
            return stretch, None
        # It turned, or was lost: then it may not be locked, but nothing farther is known.
        stretch *= float(followed.part)
        drive = self.solver.drive(self.start.at[self.index].set(first + stretch))
        jacobian = jax.jacfwd(
            lambda q: loop_gaps(
                self.solver.unit, self.solver.plan, q, drive.values, self.solver.signs
            )
        )(followed.unknowns)
        indices = group_indices(self.solver.plan, jacobian)
        group = min(self.solver.plan.iterated, key=lambda group: float(indices[group.index]))
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
                return self._root(margin, values[inside], values[k]), touches
            inside = k
            if k > 1 and self._may_dip(*margins[k - 2 : k + 1].tolist()):
                lowest = self._lowest(margin, values[k - 2], values[k])
                least = margin(lowest)
                if least < -TOUCHING:
                    return self._root(margin, values[k - 2], lowest), touches
                if self._touches(least):
                    touches.append(lowest)
        return None, touches

    @staticmethod
    def _touches(margin: float) -> bool:
        return bool(abs(margin) <= TOUCHING)

    @staticmethod
    def _may_dip(before: float, least: float, after: float) -> bool:
        """Whether a least margin of three, a step apart, may hide a zero beside it.

        A parabola through them goes less than the larger rise below the least; four times that
        leaves room for what is not a parabola.
        """
        rise = max(before - least, after - least)
        return bool(before >= least <= after and least <= 4 * rise + TOUCHING)

    @staticmethod
    def _lowest(margin: Callable[[float], float], low: float, high: float) -> float:
        found = scipy.optimize.minimize_scalar(
            margin, bounds=sorted((low, high)), method="bounded", options={"xatol": 1e-12}
        )
        return float(found.x)

    @staticmethod
    def _root(margin: Callable[[float], float], inside: float, outside: float) -> float:
        # At lock-up to rounding there is no change of sign to bracket: this is the root.
        if margin(inside) <= 0:
            return inside
        root: Any = scipy.optimize.brentq(
            margin, inside, outside, xtol=1e-15, rtol=np.float64(1e-14)
        )
        return float(root)
