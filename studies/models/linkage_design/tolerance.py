"""What errors of the pins' places do to the least transmission angle."""

from __future__ import annotations

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from designopt.batching import map_in_chunks
from studies.models.finger import Finger, pins_of
from studies.models.linkage_design.postures import find_postures
from studies.models.linkage_design.problem import grid
from studies.models.pins import Pins

STEP_DEG = 7.5
"""Step of the postures in which every draw is judged, degrees."""

BLOCK = 64
"""Draws computed at a time."""


def least_angles(
    finger: Finger, deviation: float, draws: int, seed: int
) -> Float[np.ndarray, " draws"]:
    """The least transmission angle of finger after finger with errors in it, degrees.

    Args:
        finger: the design; its body is exact.
        deviation: standard deviation of every coordinate of every pin, mm; errors are normal and
            independent.
        draws: how many fingers.
        seed: of the draws.

    Returns:
        The least angle over the postures of a square in steps of `STEP_DEG`; 0 where a finger
        cannot be assembled in one of them.
    """
    pins, angles = pins_of(finger), jnp.asarray(grid(finger.body, STEP_DEG))
    keys = jax.random.split(jax.random.key(seed), len(jax.tree.leaves(pins)))
    leaves, structure = jax.tree.flatten(pins)
    errors = [
        jax.random.normal(key, (draws, 2), leaf.dtype)
        for key, leaf in zip(keys, leaves, strict=True)
    ]
    drawn = jax.tree.unflatten(
        structure,
        [leaf[None, :] + deviation * error for leaf, error in zip(leaves, errors, strict=True)],
    )

    def least(one: Pins) -> Float[Array, ""]:
        found = find_postures(replace(finger, pins=one), angles, angles)
        reach = jnp.minimum(jnp.min(found.reach[0]), jnp.min(found.reach[1]))
        angle = jnp.rad2deg(jnp.asarray(jnp.inf))
        for values in found.angles.values():
            angle = jnp.minimum(angle, jnp.rad2deg(jnp.min(values)))
        return jnp.where(reach > 0, angle, 0.0)

    return np.asarray(jax.jit(lambda batch: map_in_chunks(jax.vmap(least), batch, BLOCK))(drawn))
