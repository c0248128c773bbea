"""A linkage of pins alone, from where its joints are: no file and no iteration in between."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from designopt.vectors import vector
from kinematics.io.assembling import Configuration, Dimensions
from kinematics.io.assembly_mode import group_sines
from kinematics.io.writer import sketch_tables
from kinematics.model.linkage import (
    Line,
    Link,
    Linkage,
    ReferenceConfiguration,
    Spring,
    direction_of,
)
from kinematics.model.topology import WORLD, Structure
from kinematics.solve.plan import make_plan

Joints = Mapping[str, Float[Array, "2"]]


def pinned_linkage(
    structure: Structure,
    joints: Joints,
    assembly: tuple[int, ...],
    springs: Sequence[Spring] = (),
) -> Linkage:
    """The linkage that is assembled with its joints at given places; differentiable in them.

    Two joints of a body that coincide leave its direction open: it is then that of +x, without
    derivative.

    Args:
        structure: who is joined to whom; without sliders.
        joints: place of every joint, mm.
        assembly: see `assembly_signs`.
        springs: one for every pair of bodies in the structure.

    Returns:
        A linkage whose reference configuration is this one.
    """
    at = {name: vector(jnp.asarray(place)) for name, place in joints.items()}
    steps = {
        body.name: at[body.joints[1]] - at[body.joints[0]]
        for body in structure.bodies
        if len(body.joints) > 1
    }
    angles = {name: step.angle() for name, step in steps.items()}

    def link(name: str, names: Sequence[str]) -> Link:
        step = steps[name]
        length, along = step.length(), direction_of(step)
        rest = [(at[j] - at[names[0]]).turned(along.conjugate()).stacked() for j in names[2:]]
        return Link(length, jnp.stack(rest) if rest else jnp.zeros((0, 2), length.dtype))

    def angle_of(body: str) -> Float[Array, ""]:
        return jnp.zeros(()) if body == WORLD else angles.get(body, jnp.zeros(()))

    inputs = []
    for part in structure.inputs:
        assert part.body is not None  # it would be a slider
        turn = angle_of(part.body) - angle_of(part.relative_to)
        inputs.append(turn - 2 * jnp.pi * jnp.round(turn / (2 * jnp.pi)))
    reference = ReferenceConfiguration(
        jnp.stack(inputs),
        jnp.stack([angles[body.name] for body in structure.moving]),
        jnp.zeros(0),
    )
    no_lines: tuple[Line, ...] = ()
    return Linkage(
        anchors=jnp.stack([at[joint].stacked() for joint in structure.fixed_joints]),
        links={body.name: link(body.name, body.joints) for body in structure.moving},
        lines=no_lines,
        springs=tuple(springs),
        reference=jax.lax.stop_gradient(reference),
        structure=structure,
        assembly=assembly,
    )


def pinned_tables(
    structure: Structure, joints: Joints, springs: Sequence[Spring] = ()
) -> dict[str, Any]:
    """The tables of the file of such a linkage: `parse_linkage` makes the same linkage of them.

    Args:
        structure: who is joined to whom; without sliders.
        joints: place of every joint, mm; plain numbers, which come back as they are.
        springs: one for every pair of bodies in the structure.
    """
    bodies = {
        body.name: {"joints": list(body.joints), **({"fixed": True} if body.fixed else {})}
        for body in structure.bodies
    }
    return sketch_tables(structure, joints, bodies, springs)


def assembly_signs(structure: Structure, joints: Mapping[str, np.ndarray]) -> tuple[int, ...]:
    """On which side each closed-form group is assembled with the joints at given places.

    Args:
        structure: who is joined to whom; without sliders.
        joints: place of every joint, mm; plain numbers, for a side has no derivative.

    Returns:
        One sign per group of the plan, 0 for a group without sides, as in `Linkage.assembly`.
    """
    none = np.zeros(0)
    dimensions = Dimensions(structure, {}, none, none, none)
    sines = group_sines(make_plan(structure), dimensions, Configuration(joints, {}, ()))
    return tuple(0 if sine is None else int(math.copysign(1, sine)) for sine in sines)
