"""What errors of the pins' places do to a coupled finger's least transmission angle."""

from __future__ import annotations

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from studies.models.finger import Finger, coupling_pins_of
from studies.models.linkage_design.coupling.postures import find_coupled_postures
from studies.models.linkage_design.coupling.searching import pip_angles
from studies.models.linkage_design.tolerance import draw_pins


def least_coupled_angles(
    finger: Finger, deviation: float, draws: int, seed: int
) -> Float[np.ndarray, " draws"]:
    """The least transmission angle of finger after finger with errors in it, degrees.

    As `tolerance.least_angles`, over the range of PIP.
    """
    pip = jnp.asarray(pip_angles(finger.body))

    @jax.jit
    @jax.vmap
    def least(pins: object) -> Float[Array, ""]:
        found = find_coupled_postures(replace(finger, pins=pins), pip)
        angle = jnp.rad2deg(jnp.min(found.transmission))
        return jnp.where(jnp.min(found.reach) > 0, angle, 0.0)

    return np.asarray(least(draw_pins(coupling_pins_of(finger), deviation, draws, seed)))
