"""The augmented Lagrangian: constraints by multipliers around an unconstrained or boxed solver.

For inequalities g ≥ 0 and equalities h = 0 it minimises, again and again,

    f + ρ/2 Σ max(0, λ/ρ − g)² + ρ/2 Σ (h + μ/ρ)²

and updates λ ← max(0, λ − ρ g), μ ← μ + ρ h (M. J. D. Powell, M. R. Hestenes and R. T. Rockafellar;
J. Nocedal, S. J. Wright, *Numerical Optimization*, 2nd ed., §17.4). It stays smooth, so BFGS and
Levenberg–Marquardt apply, and its multipliers converge without ρ having to.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal

import equinox as eqx
import jax
import jax.numpy as jnp
import lineax as lx
import optimistix as optx
from jaxtyping import Array, Bool, Float, Int

from designopt.fitting import with_jacobian
from designopt.optimize.flat import Flat, Point
from designopt.optimize.problem import Evaluation
from designopt.roots import ROUNDING_UNITS, check_default_float

Inner = Literal["bfgs", "levenberg-marquardt", "jaxopt-lbfgsb", "jaxopt-projected-gradient"]

BOXED = ("jaxopt-lbfgsb", "jaxopt-projected-gradient")
"""Solvers that keep bounds themselves; for the others bounds are inequalities."""

FIRST_PENALTY = 10.0
LARGEST_PENALTY = 1e6
GROWTH = 4.0
"""How much the penalty grows where an update has not brought the constraints nearer."""

PROGRESS = 0.3
"""What is left of the violation after an update that has."""


class Trace(eqx.Module):
    """How the iterations went, one element per update of the multipliers; the last is repeated.

    Attributes:
        objective: of the problem.
        violation: largest violation of a constraint, scaled.
        steps: steps of the inner solver so far.
    """

    objective: Float[Array, " updates"]
    violation: Float[Array, " updates"]
    steps: Int[Array, " updates"]


class State(eqx.Module):
    """Where the iterations are, after a number of updates of the multipliers.

    Attributes:
        point: in scaled units; not quite inside its bounds if the inner solver has no bounds.
        multipliers: of the equalities, and of the inequalities with bounds that the solver does
            not handle.
        penalty: ρ.
        gap: how far constraints and complementarity were from holding; infinite at first.
        objective: of the problem at the point; infinite at first.
        update: how many there were.
        done: whether constraints hold and the objective no longer changes, to the tolerance.
        trace: how it went.
    """

    point: Point
    multipliers: tuple[Float[Array, " equalities"], Float[Array, " inequalities"]]
    penalty: Float[Array, ""]
    gap: Float[Array, ""]
    objective: Float[Array, ""]
    update: Int[Array, ""]
    done: Bool[Array, ""]
    trace: Trace

    @property
    def held(self) -> bool:
        """Whether there is anything that needs multipliers."""
        return sum(part.size for part in self.multipliers) > 0


def augmented_lagrangian(
    flat: Flat,
    inner: Inner,
    start: Point,
    *,
    floor: float | None,
    tolerance: float,
    updates: int,
    steps: int,
) -> tuple[Point, Trace]:
    """One local solve; ``jax.vmap`` over ``start`` for several at once.

    Args:
        flat: the problem.
        inner: what minimises between the updates.
        start: where to start.
        floor: a value below which the objective cannot fall. Levenberg–Marquardt needs it for an
            objective that is no sum of squares: it minimises (objective − floor)² / 2 instead.
        tolerance: of the inner solver (relative and absolute), and of the constraints; not below
            `ROUNDING_UNITS` units of rounding of the dtype.
        updates: cap on updates of the multipliers.
        steps: cap on steps between two updates.

    Returns:
        The point, inside its bounds, and how it was found.

    Raises:
        ValueError: Levenberg–Marquardt without residuals or a floor, or in a float type that it
            would mix with another.
    """
    # Below rounding no step would ever be small enough, and each solve would run to its cap.
    tolerance = achievable(tolerance, start)
    solve = _inner(flat, inner, floor, tolerance, steps)
    first = first_state(flat, inner, start, updates)
    if not first.held:
        # Nothing to hold: one solve, and no multipliers.
        point, count = solve(start, (*first.multipliers, jnp.ones((), start.dtype)))
        point = flat.clipped(point)
        value = flat.terms(point).value[None]
        return point, Trace(value, jnp.zeros_like(value), count[None])

    def update(state: State) -> State:
        point, count = solve(state.point, (*state.multipliers, state.penalty))
        return updated(flat, inner, state, point, count, tolerance)

    last = jax.lax.while_loop(lambda s: ~s.done & (s.update < updates), update, first)
    return flat.clipped(last.point), last.trace


def achievable(tolerance: float, start: Point) -> float:
    """A tolerance that is not below `ROUNDING_UNITS` units of rounding of the start's dtype."""
    return max(tolerance, ROUNDING_UNITS * float(jnp.finfo(start.dtype).eps))


def first_state(flat: Flat, inner: Inner, start: Point, updates: int) -> State:
    """The state before the first update of the multipliers; see `augmented_lagrangian`."""
    dtype = start.dtype
    _, h, g = jax.eval_shape(lambda point: _evaluated(flat, inner, point), start)
    none = (jnp.zeros(h.shape, dtype), jnp.zeros(g.shape, dtype))
    penalty, infinite = jnp.asarray(FIRST_PENALTY, dtype), jnp.asarray(jnp.inf, dtype)
    zeros = jnp.zeros(updates, dtype)
    trace = Trace(zeros, zeros, jnp.zeros(updates, int))
    number, done = jnp.zeros((), int), jnp.zeros((), bool)
    return State(start, none, penalty, infinite, infinite, number, done, trace)


def updated(
    flat: Flat, inner: Inner, state: State, point: Point, count: Int[Array, ""], tolerance: float
) -> State:
    """The next state: multipliers updated after one inner solve.

    Args:
        flat: the problem; something in it has multipliers.
        inner: what solved.
        state: where it started.
        point: what it found.
        count: its number of steps.
        tolerance: see `augmented_lagrangian`.
    """
    (mu, lam), penalty = state.multipliers, state.penalty
    # A solve that ran into NaN is undone: the multipliers move on from where it began, and the next
    # solve has another merit function.
    point = jnp.where(jnp.all(jnp.isfinite(point)), point, state.point)
    terms, h, g = _evaluated(flat, inner, point)
    objective = terms.value
    # How far constraints and complementarity are from holding: min(g, λ/ρ) is 0 if and only if one
    # of the two is, and neither is negative.
    gap = _largest(jnp.abs(h), jnp.abs(jnp.minimum(g, lam / penalty)))
    better = gap <= PROGRESS * state.gap
    # Feasible is not yet optimal: the objective must rest as well, or the multipliers have not.
    settled = jnp.abs(objective - state.objective) <= tolerance * (1 + jnp.abs(objective))
    at, before = state.update, state.trace
    total = count + jnp.where(at > 0, before.steps[at - 1], 0)
    violation = _largest(jnp.abs(h), jnp.maximum(-g, 0.0))
    # Arrays of fixed length: what comes later repeats this update until it is overwritten.
    later = jnp.arange(before.steps.size) >= at
    trace = Trace(
        jnp.where(later, objective, before.objective),
        jnp.where(later, violation, before.violation),
        jnp.where(later, total, before.steps),
    )
    multipliers = (mu + penalty * h, jnp.maximum(0.0, lam - penalty * g))
    penalty = jnp.where(better, penalty, jnp.minimum(GROWTH * penalty, LARGEST_PENALTY))
    done = (gap <= tolerance) & settled
    return State(point, multipliers, penalty, gap, objective, at + 1, done, trace)


def _evaluated(
    flat: Flat, inner: Inner, point: Point
) -> tuple[Evaluation, Float[Array, " equalities"], Float[Array, " inequalities"]]:
    """The terms, and the constraints that the solver does not keep itself."""
    terms, h, g = flat.evaluated(point)
    return terms, h, g if inner in BOXED else jnp.concatenate([g, flat.bounds(point)])


def _largest(*arrays: Float[Array, "..."]) -> Float[Array, ""]:
    return jnp.max(jnp.concatenate(arrays))


def lagrangian(flat: Flat, inner: Inner) -> Callable[[Point, Any], Float[Array, ""]]:
    """What is minimised between the updates, over ρ, of a point and (μ, λ, ρ, `Flat.own`)."""

    def merit(point: Point, args: Any) -> Float[Array, ""]:
        # Over ρ: a quasi-Newton method that starts with the identity then finds the penalty's
        # curvature of order one, and does not mistake the tiny steps it needs for the end.
        terms, short = _shortfalls(flat, inner, point, args)
        return terms.value / args[2] + jnp.sum(short**2) / 2

    return merit


def _shortfalls(
    flat: Flat, inner: Inner, point: Point, args: Any
) -> tuple[Evaluation, Float[Array, " constraints"]]:
    """The terms, and what is squared of the constraints."""
    mu, lam, penalty, given = args
    terms, h, g = _evaluated(flat.given(given), inner, point)
    return terms, jnp.concatenate([h + mu / penalty, jnp.maximum(0.0, lam / penalty - g)])


def _inner(
    flat: Flat, inner: Inner, floor: float | None, tolerance: float, steps: int
) -> Callable[[Point, Any], tuple[Point, Int[Array, ""]]]:
    """The inner solve: from a start and (μ, λ, ρ) to a point and its number of steps."""
    merit = lagrangian(flat, inner)

    @with_jacobian
    def residuals(point: Point, args: Any) -> Float[Array, " residuals"]:
        terms, short = _shortfalls(flat, inner, point, args)
        if terms.residuals is not None:
            wanted = terms.residuals
        elif floor is not None:
            wanted = (terms.value - floor)[None]
        else:
            raise ValueError("levenberg-marquardt needs residuals, or a floor of the objective")
        return jnp.concatenate([wanted, jnp.sqrt(args[2]) * short])

    # Normal equations: their matrix is as small as the number of parameters, and a factorisation
    # of the tall matrix takes far longer to compile and to run.
    normal = lx.Normal(lx.Cholesky())
    marquardt = optx.LevenbergMarquardt(tolerance, tolerance, linear_solver=normal)
    options: Any = {"max_steps": steps, "throw": False}

    def solve(point: Point, args: Any) -> tuple[Point, Int[Array, ""]]:
        given, absolute = (*args, flat.own), tolerance / args[2]
        match inner:
            case "bfgs":
                bfgs = optx.BFGS(tolerance, absolute)
                found = optx.minimise(merit, bfgs, point, given, **options)
            case "levenberg-marquardt":
                check_default_float(inner, point)
                found = optx.least_squares(residuals, marquardt, point, given, **options)
            case _:
                from designopt import jaxopt_adapter  # half a second, and few solves need it

                box = jnp.asarray(flat.lower), jnp.asarray(flat.upper)
                caps: Any = {"tolerance": absolute, "max_steps": steps}
                return jaxopt_adapter.minimize_in_box(
                    merit, flat.clipped(point), box, given, method=inner, **caps
                )
        return found.value, found.stats["num_steps"]

    return solve
