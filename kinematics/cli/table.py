"""The columns of the table of ``designopt solve``, as one function of arrays that JAX traces."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Mapping
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array

from kinematics.cli.solving import CODE
from kinematics.model.linkage import Linkage
from kinematics.model.topology import Structure
from kinematics.solve.rates import solve_rates
from kinematics.solve.transmission import solve_poses_and_angles


def solve_columns(
    given: Mapping[str, Any],
    structure: Structure,
    assembly: tuple[int, ...],
    of: tuple[str, ...] | None,
) -> OrderedDict[str, Array]:
    """Columns by name, one entry per pose; NaN stands for an empty cell.

    ``ok``, ``margin`` (mm), ``closure`` (mm), positions (mm), angles (degrees), rates (mm/s, rad/s
    and so on), transmission angles (degrees).

    Args:
        given: ``linkage``: `AssembledSketch.numbers`; ``inputs``: rad or mm, shape (poses,
            inputs); ``rates`` and ``accelerations``: of the inputs, ``None`` if not asked for.
        structure: the linkage's.
        assembly: its signs.
        of: joints and bodies asked for; all if none.
    """
    linkage = Linkage.of(given["linkage"], structure, assembly)
    inputs, rates, accelerations = (given[name] for name in ("inputs", "rates", "accelerations"))
    found, transmission = solve_poses_and_angles(linkage, inputs, of=of)
    pose, ok = found.value, found.ok
    columns = OrderedDict[str, Array](ok=ok.astype(int), margin=found.margin)

    def add(name: str, values: Array) -> None:
        columns[name] = jnp.where(ok, values, jnp.nan)

    add("closure", found.residual * linkage.size())
    joints = [name for name in structure.joints if name in pose.joints]
    bodies = [body.name for body in structure.bodies if body.name in pose.bodies]
    for name in joints:
        add(f"{name}.x", pose.joints[name].x)
        add(f"{name}.y", pose.joints[name].y)
    for name in bodies:
        add(f"{name}.angle_deg", jnp.rad2deg(pose.angle(name)))
    if rates is not None:
        motion = solve_rates(linkage, inputs, rates, accelerations, of=of)
        orders = [(motion.velocity, "v", "omega"), (motion.acceleration, "a", "alpha")]
        for one, letter, turn in orders[: 1 if accelerations is None else 2]:
            for name in joints:
                add(f"{name}.{letter}x", one.joints[name].x)
                add(f"{name}.{letter}y", one.joints[name].y)
            for name in bodies:
                add(f"{name}.{turn}", one.bodies[name])
    for name, angle in transmission.items():
        add(f"{name}.mu_deg", jnp.rad2deg(angle))
    (columns[CODE],) = jax.tree.leaves(found.result)
    return columns
