"""Forces by virtual work: what the inputs must hold, and what they gain."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from designopt.numerics import as_float, safe_divide
from designopt.vectors import rotation
from kinematics.model.linkage import Linkage
from kinematics.model.topology import WORLD
from kinematics.solve.solver import Pose, Solver, each_pose

Output = Callable[[Pose], Float[Array, ""]]


def solve_input_efforts(
    linkage: Linkage,
    inputs: Float[Array, "*batch inputs"],
    *,
    forces: Mapping[str, Float[Array, "2"]] | None = None,
    moments: Mapping[str, Float[Array, ""]] | None = None,
) -> Float[Array, "*batch inputs"]:
    """The effort with which each input holds the linkage still, without friction or weight.

    By the principle of virtual work it is the derivative of the potential energy of springs and
    constant loads with respect to that input.

    Args:
        linkage: the linkage, springs included.
        inputs: values of the inputs, rad or mm.
        forces: forces on joints, N, (x, y) in the world.
        moments: moments on bodies, N mm, counter-clockwise.

    Returns:
        Moments (N mm) for inputs that are angles, forces (N) for slides, positive in the
        direction in which the input grows. Without meaning where `solve_poses` is not ok.

    Example:
        >>> from importlib.resources import files
        >>> from kinematics import read_linkage
        >>> linkage = read_linkage(files("studies") / "gallery/linkages/four-bar.toml")
        >>> efforts = jax.jit(solve_input_efforts)(
        ...     linkage, jnp.array([0.7]), moments={"rocker": jnp.array(100.0)}
        ... )
        >>> [round(effort, 2) for effort in efforts.tolist()]  # N mm
        [-28.13]
    """

    def energy(pose: Pose) -> Float[Array, ""]:
        total = compute_spring_energy(linkage, pose)
        for joint, force in (forces or {}).items():
            load = as_float(force)
            total = total - (load[0] * pose.joints[joint].x + load[1] * pose.joints[joint].y)
        for body, moment in (moments or {}).items():
            total = total - as_float(moment) * pose.angle(body)
        return total

    return solve_input_slopes(linkage, inputs, energy)


def compute_spring_energy(linkage: Linkage, pose: Pose) -> Float[Array, ""]:
    """Energy of the torsion springs in a pose, N mm: Σ ½ k (Δ + preload)².

    Example:
        >>> from importlib.resources import files
        >>> from kinematics import read_linkage, solve_poses
        >>> linkage = read_linkage(files("studies") / "gallery/linkages/four-bar.toml")
        >>> poses = jax.jit(solve_poses)(linkage, jnp.array([0.7]))
        >>> float(compute_spring_energy(linkage, poses.value))  # no springs
        0.0
    """
    total = jnp.zeros_like(linkage.anchors[0, 0])
    for spring, change in zip(linkage.springs, spring_turns(linkage, pose), strict=True):
        total = total + spring.stiffness / 2 * (change + spring.preload) ** 2
    return total


def spring_turns(linkage: Linkage, pose: Pose) -> list[Float[Array, ""]]:
    """By how much each spring is turned from the assembled sketch, rad."""

    def rest(body: str) -> Float[Array, ""]:
        if linkage.structure.node(body) == WORLD:
            return linkage.fixed_direction(body).angle()
        return linkage.home_angle(body)

    turns = []
    for first, second in linkage.structure.springs:
        turned = pose.bodies[second].turned(pose.bodies[first].conjugate())
        # Relative to the sketch before the angle is taken, so that it does not jump by 2π.
        turns.append(turned.turned(rotation(rest(first) - rest(second))).angle())
    return turns


def solve_input_slopes(
    linkage: Linkage, inputs: Float[Array, "*batch inputs"], output: Output
) -> Float[Array, "*batch inputs"]:
    """Derivative of an output with respect to every input: the velocity ratios.

    Args:
        linkage: the linkage.
        inputs: values of the inputs, rad or mm.
        output: from one pose to a number, such as ``lambda pose: pose.angle("rocker")``.

    Example:
        >>> from importlib.resources import files
        >>> from kinematics import read_linkage
        >>> linkage = read_linkage(files("studies") / "gallery/linkages/four-bar.toml")
        >>> slopes = jax.jit(solve_input_slopes, static_argnums=2)(
        ...     linkage, jnp.array([0.7]), lambda pose: pose.angle("rocker")
        ... )
        >>> [round(slope, 4) for slope in slopes.tolist()]
        [0.2813]
    """
    inputs = as_float(inputs)
    solver = Solver.of(linkage, inputs.dtype)

    def one(values: Float[Array, " inputs"]) -> Float[Array, " inputs"]:
        followed = solver.followed(solver.drive(values))

        def value(values: Float[Array, " inputs"]) -> Float[Array, ""]:
            return output(solver.pose(solver.state_near(solver.drive(values), followed)))

        return jax.grad(value)(values)

    # Pose by pose: outputs of one pose depend on its inputs alone, so the Jacobian of the batch is
    # block-diagonal, and one reverse pass for each block is all of it.
    return each_pose(one, inputs)


def solve_mechanical_advantage(
    linkage: Linkage, inputs: Float[Array, "*batch inputs"], output: Output
) -> Float[Array, "*batch inputs"]:
    """Effort at an output per unit of effort at each input, the other inputs held.

    Without friction it is the reciprocal of the velocity ratio (`solve_input_slopes`). Where that
    vanishes, at a toggle of the output, the advantage is unbounded; the largest finite number
    stands for it.

    Args: as `solve_input_slopes`.

    Example:
        >>> from importlib.resources import files
        >>> from kinematics import read_linkage
        >>> linkage = read_linkage(files("studies") / "gallery/linkages/four-bar.toml")
        >>> found = jax.jit(solve_mechanical_advantage, static_argnums=2)(
        ...     linkage, jnp.array([0.7]), lambda pose: pose.angle("rocker")
        ... )
        >>> [round(value, 3) for value in found.tolist()]
        [3.555]
    """
    slopes = solve_input_slopes(linkage, inputs, output)
    advantage, finite = safe_divide(jnp.ones_like(slopes), slopes)
    return jnp.where(finite, advantage, jnp.finfo(slopes.dtype).max)
