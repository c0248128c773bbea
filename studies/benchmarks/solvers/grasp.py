"""The finger's equilibrium: complementarity equations beside minimisers of the same energy.

The minimisers are jaxopt's QP and box solvers and SciPy's SLSQP; they do not use the
complementarity equations: where both agree, these describe a minimum. Circles only.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
import scipy.optimize
from jaxtyping import Array, Float

from designopt import jaxopt_adapter
from designopt.study.benchmark import BenchmarkMethod, benchmark, compile_methods, find_undominated
from designopt.study.results import PrecisionRow
from studies.benchmarks.measuring import keep_closest
from studies.models.grasp.closing import Path
from studies.models.grasp.comparing import reference
from studies.models.grasp.conditions import (
    Problem,
    Unknowns,
    energy,
    equations,
    linear_at,
    parts_at,
    touches,
)
from studies.models.grasp.equilibrium import solve
from studies.models.grasp.transfer import Joints, transfer
from studies.oracles.grasp import DIGITS

TOLERANCES = (1e-2, 1e-5, 1e-8, 1e-15)
PROGRAMS = (3, 6, 12, 24)
"""Quadratic programs in a row, the setting of the sequential method."""
STATES = np.arange(4, 81, 5)
"""States of the check's closing that are solved anew, each from the one 2° of the motor before."""
PENALTIES = 10.0 ** np.linspace(2.0, 4.0, 8)
"""Of the augmented Lagrangian's rounds; from the start stiff enough that the finger is not pushed
through the object and past it. Each round cuts what is left of the overlap by about 1e-2."""

OURS = "complementarity, Newton"
REFERENCE = f"the equations of what holds, in {DIGITS} digits"

Scalar = Float[Array, ""]
Gaps = Float[Array, " gaps"]
Solver = Callable[[Problem, Any, Any], Joints]
"""From a problem, a start and a setting to joints."""


class Workload(NamedTuple):
    """States of one closing, each solved from the one before it.

    Attributes:
        problem: of the closing.
        commands: motor angles, rad.
        guesses: the states before.
        exact: joints in many digits, rounded.
    """

    problem: Problem
    commands: Float[Array, " states"]
    guesses: Unknowns
    exact: np.ndarray

    @property
    def panel(self) -> str:
        """Its name in figures and tables."""
        return f"{len(self.exact)} states of the check's closing"

    @classmethod
    def of(cls, path: Path) -> Workload | None:
        """From a closing; ``None`` if no state of it has a reference."""
        # What is undetermined, or was not found, is no reference.
        found = {i: reference(path, i) for i in STATES[path.ok[STATES]].tolist()}
        exact = {i: one.joints for i, one in found.items() if one is not None and one.right}
        if not exact:
            return None
        at, unit = np.array(list(exact)), path.problem.spring.moment_unit
        forces = jnp.asarray(path.forces[at - 1]) * path.problem.length_unit / unit
        guesses = Unknowns(
            jnp.asarray(path.joints[at - 1]), jnp.asarray(path.motor[at - 1]) / unit, forces
        )
        joints = np.array([[float(q) for q in pair] for pair in exact.values()])
        return cls(path.problem, jnp.asarray(path.commands[at]), guesses, joints)

    def error(self, found: Any) -> float:
        """Worst error of a joint, rad."""
        return float(np.max(np.abs(np.asarray(found) - self.exact)))

    def at(self, command: Scalar) -> Problem:
        """The problem at a motor angle."""
        return eqx.tree_at(lambda p: p.command, self.problem, command)

    def compile(
        self,
        name: str,
        solver: Solver,
        start: Any,
        settings: Sequence[float],
        word: str = "tolerance",
    ) -> list[BenchmarkMethod]:
        """A solver of one state as a method for all of them, at each of its settings."""
        values = {f"{word} {value:g}": jnp.asarray(value) for value in settings}

        def one(command: Scalar, start: Any, setting: Array) -> Joints:
            return solver(self.at(command), start, setting)

        shared = (jax.vmap(one, (0, 0, None)), self.commands, start)
        return compile_methods(name, self.panel, self.error, *shared, settings=values)


def measure(path: Path, repeats: int) -> list[PrecisionRow]:
    """Error against run time over the check's closing; nothing if no state has a reference."""
    work = Workload.of(path)
    if work is None:
        return []
    return benchmark(newton(work) + energy_minimizers(work), repeats=repeats)


def newton(work: Workload) -> list[BenchmarkMethod]:
    """Our iteration on the complementarity equations."""
    return work.compile(OURS, _newton, work.guesses, TOLERANCES)


def optimistix_newton(work: Workload) -> list[BenchmarkMethod]:
    """Optimistix' Newton on the same equations."""
    return work.compile("Optimistix Newton", _optimistix, work.guesses, TOLERANCES)


def energy_minimizers(work: Workload) -> list[BenchmarkMethod]:
    """Minimisers of the energy, which take a minute to compile."""
    near = work.guesses.joints
    made = work.compile("jaxopt QP, sequential", minimize_by_programs, near, PROGRAMS, "programs")
    made += work.compile("jaxopt LBFGSB, augmented", minimize_penalized, near, TOLERANCES)
    states = list(zip(map(work.at, work.commands), np.asarray(near), strict=True))

    def slsqp(tolerance: float) -> np.ndarray:
        return np.array([minimize_slsqp(*state, tolerance) for state in states])

    entered = partial(BenchmarkMethod, "SciPy SLSQP", panel=work.panel, error=work.error)
    settings = (1e-4, 1e-8, 1e-15)
    return made + [entered(f"tolerance {x:g}", call=partial(slsqp, x)) for x in settings]


def compare_with_minimizers(rows: Sequence[PrecisionRow]) -> tuple[list[str], bool]:
    """Newton's closest setting against every minimiser's, and whether none is faster and closer."""
    return find_undominated(keep_closest(rows, OURS), OURS)


@jax.custom_jvp
def _energy(joints: Joints, problem: Problem) -> Scalar:
    # Its slope comes from the mechanism's ratios: traced through both dyads it compiles twice as
    # slowly. None is taken in the problem.
    return energy(problem, joints)


@_energy.defjvp
def _energy_slope(at: tuple[Joints, Problem], towards: tuple[Joints, Any]) -> tuple[Array, Array]:
    joints, problem = at
    posture = _posture(problem, joints, jnp.zeros_like(touches(problem, joints).gaps))
    return energy(problem, joints), parts_at(problem, posture).slack @ towards[0]


def _newton(problem: Problem, guess: Unknowns, tolerance: Scalar) -> Joints:
    return solve(problem, guess, tolerance=tolerance).value.joints


def _optimistix(problem: Problem, guess: Unknowns, tolerance: Any) -> Joints:
    newton = optx.Newton(tolerance, tolerance)
    return optx.root_find(equations, newton, guess, problem, max_steps=64, throw=False).value.joints


def _posture(problem: Problem, joints: Joints, forces: Gaps) -> Unknowns:
    """A posture with the moment that the motor has in it."""
    lag = problem.command - transfer(problem.finger, joints).crank
    return Unknowns(joints, lag / problem.spring.contrast, forces)


def minimize_by_programs(problem: Problem, guess: Joints, count: Array) -> Joints:
    """Joints of least energy by quadratic programs in a row, each solved by jaxopt's BoxOSQP."""
    upper = jnp.broadcast_to(problem.finger.body.flexion, guess.shape)

    def step(_: Array, state: tuple[Joints, Gaps]) -> tuple[Joints, Gaps]:
        joints, forces = state
        linear = linear_at(problem, _posture(problem, joints, forces))
        touch, ratios = linear.parts.touch, linear.parts.ratios
        slope = linear.parts.slack + touch.slopes.T @ forces
        hessian = linear.curvature + jnp.outer(ratios, ratios) / problem.spring.contrast
        # A convex program: directions of negative curvature get a small positive one.
        sizes, axes = jnp.linalg.eigh((hessian + hessian.T) / 2)
        least, scale = 1e-3 * jnp.max(jnp.abs(sizes)), jnp.max(sizes)
        hessian = (axes * jnp.maximum(sizes, least)[None, :]) @ axes.T
        rows = jnp.concatenate([touch.slopes, jnp.eye(2, dtype=joints.dtype)])
        low = jnp.concatenate([-touch.gaps, -joints])
        high = jnp.concatenate([jnp.full_like(touch.gaps, jnp.inf), upper - joints])
        tight = jnp.asarray(1e-12, joints.dtype)
        move = jaxopt_adapter.quadratic_program(
            hessian / scale, slope / scale, rows, (low, high), tolerance=tight, max_steps=4000
        )
        # Forces for the next program's curvature: what balances this one, contacts only.
        closed = touch.gaps + touch.slopes @ move < 1e-6
        active = jnp.where(closed[:, None], touch.slopes, 0.0)
        pushed = jnp.linalg.lstsq(active.T, slope + hessian @ move)[0]
        return jnp.clip(joints + move, 0.0, upper), jnp.where(closed, jnp.maximum(pushed, 0.0), 0.0)

    nothing = jnp.zeros_like(touches(problem, guess).gaps)
    return jax.lax.fori_loop(0, count, step, (guess, nothing))[0]


def minimize_penalized(problem: Problem, guess: Joints, tolerance: Scalar) -> Joints:
    """Joints of least energy by an augmented Lagrangian of the gaps around jaxopt's LBFGSB.

    J. Nocedal, S. J. Wright, *Numerical Optimization*, 2nd ed., §17.3; within the stops.
    """
    upper = jnp.broadcast_to(problem.finger.body.flexion, guess.shape)
    scale = problem.spring.contrast + 1 / problem.spring.contrast

    def pushed(problem: Problem, joints: Joints, forces: Gaps, penalty: Scalar) -> Gaps:
        return jnp.maximum(forces - penalty * touches(problem, joints).gaps, 0.0)

    def augmented(joints: Joints, args: tuple[Problem, Gaps, Scalar]) -> Scalar:
        forces = pushed(args[0], joints, *args[1:])
        return _energy(joints, args[0]) / scale + forces @ forces / (2 * args[2])

    def one_round(state: tuple[Joints, Gaps], penalty: Scalar) -> tuple[tuple[Joints, Gaps], None]:
        joints, _ = jaxopt_adapter.minimize_in_box(
            augmented,
            state[0],
            (jnp.zeros_like(upper), upper),
            (problem, state[1], penalty),
            method="jaxopt-lbfgsb",
            tolerance=tolerance,
            max_steps=100,
        )
        return (joints, pushed(problem, joints, state[1], penalty)), None

    start = (guess, jnp.zeros_like(touches(problem, guess).gaps))
    return jax.lax.scan(one_round, start, jnp.asarray(PENALTIES, guess.dtype))[0][0]


_touches = jax.jit(touches)
_value = jax.jit(lambda problem, joints: jax.value_and_grad(_energy)(joints, problem))


def minimize_slsqp(problem: Problem, guess: np.ndarray, tolerance: float) -> np.ndarray:
    """Joints of least energy by SciPy's SLSQP (D. Kraft 1988), for one problem."""
    found = scipy.optimize.minimize(
        lambda q: [np.asarray(part, float) for part in _value(problem, jnp.asarray(q))],
        guess,
        jac=True,
        method="SLSQP",
        bounds=[(0.0, float(problem.finger.body.flexion))] * 2,
        constraints={
            "type": "ineq",
            "fun": lambda q: np.asarray(_touches(problem, jnp.asarray(q)).gaps),
            "jac": lambda q: np.asarray(_touches(problem, jnp.asarray(q)).slopes),
        },
        options={"ftol": tolerance, "maxiter": 200},
    )
    return found.x
