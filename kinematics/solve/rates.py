"""Velocity, acceleration and jerk of every joint and body, by forward-mode derivatives."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from designopt.numerics import as_float
from designopt.vectors import Vector
from kinematics.model.linkage import Linkage
from kinematics.solve.solver import Solver, each_pose


class Rates(eqx.Module):
    """A derivative of the pose with respect to time, of first, second or third order.

    Attributes:
        joints: of every joint's position, mm/sⁿ.
        bodies: of every body's angle, rad/sⁿ.
        slides: of every slider's place, mm/sⁿ, by its number.
    """

    joints: dict[str, Vector]
    bodies: dict[str, Float[Array, "*batch"]]
    slides: dict[int, Float[Array, "*batch"]]


class Motion(eqx.Module):
    """The derivatives of a pose with respect to time.

    Attributes:
        velocity: first derivatives.
        acceleration: second derivatives.
        jerk: third derivatives.
    """

    velocity: Rates
    acceleration: Rates
    jerk: Rates


def solve_rates(
    linkage: Linkage,
    inputs: Float[Array, "*#batch inputs"],
    rates: Float[Array, "*#batch inputs"],
    accelerations: Float[Array, "*#batch inputs"] | None = None,
    jerks: Float[Array, "*#batch inputs"] | None = None,
    *,
    of: Iterable[str] | None = None,
) -> Motion:
    """Derivatives of poses when the inputs move.

    The pose is differentiated along input(t) = u + u̇ t + ü t²/2 + u⃛ t³/6 at t = 0. Orders that
    are not used are not computed under ``jax.jit``.

    Args:
        linkage: the linkage.
        inputs: values of the inputs, rad or mm.
        rates: their velocities, rad/s or mm/s.
        accelerations: their accelerations; 0 by default.
        jerks: their jerks; 0 by default.
        of: joints and bodies asked for; all by default.

    Returns:
        The derivatives; finite everywhere, but without meaning where `solve_poses` is not ok, and
        at a turning point, where true rates are infinite.

    Example:
        >>> from importlib.resources import files
        >>> from kinematics import read_linkage
        >>> linkage = read_linkage(files("studies") / "gallery/linkages/four-bar.toml")
        >>> motion = solve_rates(linkage, jnp.array([0.7]), jnp.array([1.0]))
        >>> round(float(motion.velocity.bodies["rocker"]), 4)  # rad per rad of the crank
        0.2813
    """
    inputs, velocity = as_float(inputs), as_float(rates)
    acceleration = jnp.zeros_like(velocity) if accelerations is None else as_float(accelerations)
    jerk = jnp.zeros_like(velocity) if jerks is None else as_float(jerks)
    parts = jnp.broadcast_arrays(inputs, velocity, acceleration, jerk)
    solver = Solver.of(linkage, inputs.dtype, of)
    return each_pose(lambda *one: _rates_of_one(solver, *one), *parts)


def _rates_of_one(
    solver: Solver,
    inputs: Float[Array, " inputs"],
    velocity: Float[Array, " inputs"],
    acceleration: Float[Array, " inputs"],
    jerk: Float[Array, " inputs"],
) -> Motion:
    followed = solver.followed(solver.drive(inputs))

    def places(time: Float[Array, ""]) -> Rates:
        moved = inputs + time * (velocity + time / 2 * (acceleration + time / 3 * jerk))
        pose = solver.pose(solver.state_near(solver.drive(moved), followed))
        angles = {name: direction.angle() for name, direction in pose.bodies.items()}
        return Rates(pose.joints, angles, pose.slides)

    def derivative(function: Callable[[Any], Any]) -> Callable[[Any], tuple[Any, Any]]:
        # Nested forward mode is exact for every order, where differences of poses would lose digits
        # with each. The function beside its derivative, so that one pass gives all orders.
        return lambda time: jax.jvp(function, (time,), (jnp.ones_like(time),))

    now = jnp.zeros((), inputs.dtype)
    _, ((first, second), (_, third)) = derivative(derivative(derivative(places)))(now)
    return Motion(first, second, third)
