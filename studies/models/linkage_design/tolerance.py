"""What errors of the pins' places do to the least transmission angle."""

from __future__ import annotations

import functools
from dataclasses import replace
from typing import TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from designopt.batching import map_in_chunks
from designopt.programs import QuickJit
from studies.models.finger import Finger, pins_of
from studies.models.linkage_design.postures import find_postures
from studies.models.linkage_design.problem import grids
from studies.models.pins import AnyPins, Pins

P = TypeVar("P", bound=AnyPins)

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
    drawn = draw_pins(pins_of(finger), deviation, draws, seed)
    return np.asarray(_least_of_each(finger, drawn, *grids(finger.body, STEP_DEG)))


def draw_pins(pins: P, deviation: float, draws: int, seed: int) -> P:
    """Pins with normal, independent errors of every coordinate, along a first axis.

    Args:
        pins: without errors.
        deviation: standard deviation, mm.
        draws: how many.
        seed: of the draws.
    """
    structure = jax.tree.structure(pins)
    keys = jax.random.split(jax.random.key(seed), structure.num_leaves)

    def sample(place: Float[Array, "2"], key: Array) -> Float[Array, "draws 2"]:
        return place[None] + deviation * jax.random.normal(key, (draws, 2), place.dtype)

    return jax.tree.map(sample, pins, jax.tree.unflatten(structure, list(keys)))


@QuickJit
def _least_of_each(
    finger: Finger, drawn: Pins, pip: Float[Array, " pip"], dip: Float[Array, " dip"]
) -> Float[Array, " draws"]:
    def least(one: Pins) -> Float[Array, ""]:
        found = find_postures(replace(finger, pins=one), pip, dip)
        reach = jnp.minimum(*map(jnp.min, found.reach))
        angle = functools.reduce(jnp.minimum, map(jnp.min, found.angles.values()))
        return jnp.where(reach > 0, jnp.rad2deg(angle), 0.0)

    return map_in_chunks(jax.vmap(least), drawn, BLOCK)
