"""The same equilibrium by other people's minimisers: jaxopt's QP and box solvers, SciPy's SLSQP.

They minimise the energy and never see the complementarity equations, so agreement means that those
describe a minimum. Circles only.
"""

from __future__ import annotations

from typing import Any, Literal

import jax
import jax.numpy as jnp
import numpy as np
import scipy.optimize
from jaxtyping import Array, ArrayLike, Float

from designopt import jaxopt_adapter
from studies.models.grasp.conditions import Problem, energy, gaps_of
from studies.models.grasp.transfer import Joints, transfer

Opinion = Literal["jaxopt QP", "jaxopt box"]

PENALTY_ROUNDS = 8
"""Rounds of the augmented Lagrangian; each cuts what is left of the overlap by about 1e-2."""


def minimum(
    problem: Problem,
    guess: Joints,
    *,
    opinion: Opinion,
    tolerance: ArrayLike,
    steps: ArrayLike = 24,
) -> Joints:
    """Joints of least energy by a minimiser of jaxopt.

    Args:
        problem: finger, motor angle, load and object.
        guess: joints to start from, rad.
        opinion: ``jaxopt QP``: sequential quadratic programming, each program by BoxOSQP;
            ``jaxopt box``: an augmented Lagrangian of the gaps (J. Nocedal, S. J. Wright,
            *Numerical Optimization*, 2nd ed., §17.3), each round by LBFGSB within the stops.
        tolerance: of jaxopt's own iteration.
        steps: quadratic programs, for the former.
    """
    upper = jnp.broadcast_to(problem.finger.body.flexion, guess.shape)
    if opinion == "jaxopt QP":
        return _sequential(problem, guess, upper, tolerance, steps)
    return _penalized(problem, guess, upper, tolerance)


@jax.custom_jvp
def _energy(joints: Joints, problem: Problem) -> Float[Array, ""]:
    """The energy, whose derivative in the joints is taken from φ's and Δγ's derivatives.

    A derivative traced through both dyads compiles twice as slowly. None is taken in the problem.
    """
    return energy(problem, joints)


@_energy.defjvp
def _energy_slope(at: tuple[Joints, Problem], towards: tuple[Joints, Any]) -> tuple[Array, Array]:
    joints, problem = at
    found = transfer(problem.finger, joints)
    spring = problem.contrast * (found.winding + problem.spring.preload) * found.slope
    motor = (problem.command - found.crank) / problem.contrast
    slope = -motor * found.ratios - problem.load / problem.moment_unit
    slope = slope + jnp.stack([jnp.zeros_like(spring), spring])
    return energy(problem, joints), slope @ towards[0]


def _sequential(
    problem: Problem, guess: Joints, upper: Joints, tolerance: ArrayLike, steps: ArrayLike
) -> Joints:
    def gaps(joints: Joints) -> Float[Array, " gaps"]:
        return gaps_of(problem, joints) / problem.length_unit

    def force(joints: Joints) -> Joints:
        return jax.grad(_energy)(joints, problem)

    def step(_: Array, state: tuple[Joints, Float[Array, " gaps"]]) -> tuple[Joints, Array]:
        joints, forces = state
        slope, slopes = force(joints), jax.jacfwd(gaps)(joints)
        hessian = jax.jacfwd(lambda q: force(q) - jax.grad(lambda p: forces @ gaps(p))(q))(joints)
        # A convex program: directions of negative curvature get a small positive one.
        sizes, axes = jnp.linalg.eigh((hessian + hessian.T) / 2)
        least = 1e-3 * jnp.max(jnp.abs(sizes))
        hessian = (axes * jnp.maximum(sizes, least)[None, :]) @ axes.T
        scale = jnp.max(sizes)
        rows = jnp.concatenate([slopes, jnp.eye(2, dtype=joints.dtype)])
        here = gaps(joints)
        low = jnp.concatenate([-here, -joints])
        high = jnp.concatenate([jnp.full_like(here, jnp.inf), upper - joints])
        move = jaxopt_adapter.quadratic_program(
            hessian / scale, slope / scale, rows, (low, high), tolerance=tolerance, max_steps=4000
        )
        # Forces for the next program's curvature: what balances this one, contacts only.
        left = slope + hessian @ move
        closed = here + slopes @ move < 1e-6
        active = jnp.where(closed[:, None], slopes, 0.0)
        forces = jnp.maximum(jnp.linalg.lstsq(active.T, left)[0], 0.0)
        return jnp.clip(joints + move, 0.0, upper), jnp.where(closed, forces, 0.0)

    start = (guess, jnp.zeros_like(gaps(guess)))
    return jax.lax.fori_loop(0, steps, step, start)[0]


def _penalized(problem: Problem, guess: Joints, upper: Joints, tolerance: ArrayLike) -> Joints:
    unit = problem.length_unit
    scale = problem.contrast + 1 / problem.contrast

    def augmented(
        joints: Joints, args: tuple[Problem, Float[Array, " gaps"], Float[Array, ""]]
    ) -> Float[Array, ""]:
        problem, forces, penalty = args
        pushed = jnp.maximum(forces - penalty * gaps_of(problem, joints) / unit, 0.0)
        return _energy(joints, problem) / scale + pushed @ pushed / (2 * penalty)

    def one_round(
        state: tuple[Joints, Float[Array, " gaps"]], penalty: Float[Array, ""]
    ) -> tuple[tuple[Joints, Float[Array, " gaps"]], None]:
        joints, forces = state
        joints, _ = jaxopt_adapter.minimize_in_box(
            augmented,
            joints,
            (jnp.zeros_like(upper), upper),
            (problem, forces, penalty),
            method="jaxopt-lbfgsb",
            tolerance=tolerance,
            max_steps=100,
        )
        gaps = gaps_of(problem, joints) / unit
        return (joints, jnp.maximum(forces - penalty * gaps, 0.0)), None

    start = (guess, jnp.zeros_like(gaps_of(problem, guess)))
    # From the start stiff enough that the finger is not pushed through the object and past it.
    penalties = (10.0 ** jnp.linspace(2.0, 4.0, PENALTY_ROUNDS)).astype(guess.dtype)
    return jax.lax.scan(one_round, start, penalties)[0][0]


@jax.jit
def _value(problem: Problem, joints: Joints) -> tuple[Float[Array, ""], Joints]:
    return jax.value_and_grad(lambda q: energy(problem, q))(joints)


@jax.jit
def _constraint(problem: Problem, joints: Joints) -> tuple[Float[Array, " gaps"], Array]:
    def gaps(q: Joints) -> Float[Array, " gaps"]:
        return gaps_of(problem, q) / problem.length_unit

    return gaps(joints), jax.jacfwd(gaps)(joints)


def reference(problem: Problem, guess: np.ndarray, tolerance: float = 1e-15) -> np.ndarray:
    """Joints of least energy by SciPy's SLSQP (D. Kraft 1988), for one problem.

    Args:
        problem: one finger, motor angle, load and object.
        guess: joints to start from, rad.
        tolerance: SciPy's ``ftol``.
    """
    upper = float(problem.finger.body.flexion)
    found = scipy.optimize.minimize(
        lambda q: [np.asarray(part, float) for part in _value(problem, jnp.asarray(q))],
        guess,
        jac=True,
        method="SLSQP",
        bounds=[(0.0, upper)] * 2,
        constraints={
            "type": "ineq",
            "fun": lambda q: np.asarray(_constraint(problem, jnp.asarray(q))[0]),
            "jac": lambda q: np.asarray(_constraint(problem, jnp.asarray(q))[1]),
        },
        options={"ftol": tolerance, "maxiter": 200},
    )
    return found.x
