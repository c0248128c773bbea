"""The finger on a surface: how it bends, and the heights that its design predicts."""

from __future__ import annotations

import math

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from designopt.errors import UserError
from designopt.roots import find_root
from optics.chamber import Endoscope, Posture, bend_center_line, find_extreme_points, press_wall
from optics.chamber.chamber import Chamber
from perception.chamber import ChamberMap
from studies.models.soft_finger.finger import DOWN, SoftFinger
from studies.surface_profile import SurfaceProfileSpec
from studies.surface_profile.surfaces import FLAT_RMS, SAGITTA, TILT_DEG

UP = -DOWN
"""Direction in the image of a finger that a surface below it bends."""

PLACES = 65
"""Of a map: between two, a straight line is off by less than 1e-4 mm."""

LIMB = 40.0
"""Radius along the finger of what presses its wall, mm."""

RESERVE = 1.2
"""A map reaches so much farther than the highest surface."""


def highest(spec: SurfaceProfileSpec) -> float:
    """Deflection at the highest place of the highest surface, mm."""
    tilt = spec.slide * math.tan(math.radians(TILT_DEG))
    return spec.preload + SAGITTA[1] + tilt + 4 * FLAT_RMS[1]


def _bend(
    part: Float[Array, ""], contact: Float[Array, ""], length: Float[Array, ""]
) -> Float[Array, ""]:
    def off(bend: Float[Array, ""], part: Float[Array, ""]) -> Float[Array, ""]:
        return bend_center_line(contact, bend, length).across / contact - part

    return find_root(off, 2 * part * length / contact, part).value


_bends = jax.jit(jax.vmap(_bend, in_axes=(0, None, None)))


def bends_at(
    deflections: Float[np.ndarray, " frames"], contact: float, length: float
) -> Float[np.ndarray, " frames"]:
    """Bends at which a finger of constant curvature is deflected so far at the contact, rad.

    Args:
        deflections: mm, below 0.7 of the contact's place.
        contact: where along the finger, mm.
        length: of the finger, mm.
    """
    parts = jnp.asarray(deflections / contact)
    return np.asarray(_bends(parts, jnp.asarray(contact), jnp.asarray(length)))


def postures_on(
    finger: SoftFinger,
    spec: SurfaceProfileSpec,
    deflections: Float[np.ndarray, " frames"],
    directions: Float[np.ndarray, " frames"],
) -> Posture:
    """Of a finger deflected so far, its wall pressed in on the side away from the bend."""
    bends = bends_at(deflections, spec.contact, finger.length)
    depths = jnp.asarray(-(spec.pressed + spec.pressed_more * deflections))
    arc, contact, radius = (jnp.asarray(each) for each in (finger.arc, spec.contact, LIMB))
    pressed = jax.vmap(press_wall, in_axes=(None, None, None, 0))(arc, contact, radius, depths)
    return finger.postures(bends, directions, np.asarray(pressed))


def _edges(
    chamber: Chamber, endoscope: Endoscope, bend: Float[Array, ""]
) -> tuple[Float[Array, "3"], Float[Array, "3"]]:
    """Rows of the lowest and of the uppermost points of blue, yellow and the top; bent up."""
    lowest = find_extreme_points(chamber, endoscope, -bend, DOWN).value
    return lowest[:, 1], find_extreme_points(chamber, endoscope, bend, UP).value[:, 1]


_all_edges = jax.jit(jax.vmap(_edges, in_axes=(None, None, 0)))


def designed_map(finger: SoftFinger, spec: SurfaceProfileSpec) -> ChamberMap:
    """What the finger's design predicts: heights over movements of b, e and g.

    b and e are where the outlines of blue and of yellow are lowest. g, the middle of blue, is
    taken midway between blue's lowest and highest place.

    Raises:
        UserError: a point leaves the image, or does not move on while the finger bends.
    """
    heights = np.linspace(0.0, RESERVE * highest(spec), PLACES)
    bends = jnp.asarray(bends_at(heights, spec.contact, finger.length))
    low, high = (np.asarray(rows) for rows in _all_edges(finger.chamber, finger.endoscope, bends))
    places = np.stack([low[:, 0], low[:, 1], (low[:, 0] + high[:, 0]) / 2], axis=1)
    moved = places[0] - places
    inside = high[:, 0].min() > 0 and places.max() < finger.endoscope.rows - 1
    if not (inside and (np.diff(moved, axis=0) > 0).all()):
        raise UserError(
            f"--set contact={spec.contact:g}: bent by {heights[-1]:.1f} mm there, the finger no "
            "longer shows its points; let it touch nearer to its tip, or with a lesser preload"
        )
    return ChamberMap(heights, moved)
