"""Fingers as they are made: the errors that a scene can have, and samples of them."""

from __future__ import annotations

import math
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from optics import Equidistant, Fabrication, KannalaBrandt, Scene, scale_errors
from optics.scene.sold import projection_entry
from perception.proprioception import FingerErrors
from studies.models.sensor.spec import MadeSpec

BODY = "camera body"
"""Name of the blocker that moves with the camera."""

OUT_OF_SECTION = ("yaw", "roll", "mirror_lean", "mirror_bow", "pad_lean", "lateral_color")


def carried_by_camera(scene: Scene) -> tuple[int, ...]:
    """Indices of the blockers that move with the camera: its body."""
    return tuple(i for i, part in enumerate(scene.layout.blockers) if part.name == BODY)


def lens_fault(scene: Scene) -> str:
    """What makes a lens one without errors of its own; empty if nothing."""
    if isinstance(scene.camera.projection, Equidistant | KannalaBrandt):
        return ""
    name = projection_entry(scene.camera.projection)
    return f'its lens is {name}; errors of the lens need projection = "equidistant"'


def sample_finger(
    deviations: Fabrication, seed: int, number: int
) -> tuple[Fabrication, Float[np.ndarray, " errors"]]:
    """Normal errors of one of many fingers, and the same in units of their deviations.

    Args:
        deviations: standard deviation of every error.
        seed: of all fingers.
        number: of the finger.
    """
    count = sum(leaf.size for leaf in jax.tree.leaves(deviations))
    errors = np.random.default_rng([seed, 4, number]).standard_normal(count)
    return scale_errors(deviations, jnp.asarray(errors)), errors


def in_section(errors: Fabrication) -> Fabrication:
    """The same errors but for those that turn parts out of the section, or concern colors."""
    return replace(errors, **dict.fromkeys(OUT_OF_SECTION))


def deviations_of(tolerances: MadeSpec, scene: Scene) -> Fabrication:
    """Standard deviation of every error of fabrication that a scene can have."""
    mirrors, pads, layers = len(scene.mirrors), len(scene.pads), scene.layers
    moves = scene.camera.pupil_shift is not None
    of_layers = (0, 0) if layers is None else layers.thickness.shape

    def angles(degrees: float, count: int) -> Float[Array, " parts"]:
        return jnp.full(count, math.radians(degrees))

    return Fabrication(
        camera=jnp.full(2, tolerances.camera_position),
        lateral=tolerances.camera_position,
        tilt=math.radians(tolerances.camera_tilt_deg),
        mirror_tilt=angles(tolerances.mirror_tilt_deg, mirrors),
        mirror_offset=jnp.full(mirrors, tolerances.mirror_offset),
        pad_tilt=angles(tolerances.pad_tilt_deg, pads),
        pad_offset=jnp.full(pads, tolerances.pad_position),
        pad_shift=jnp.full(pads, tolerances.pad_position),
        distortion=tolerances.lens_k1,
        yaw=math.radians(tolerances.camera_yaw_deg),
        roll=math.radians(tolerances.camera_roll_deg),
        mirror_lean=angles(tolerances.mirror_lean_deg, mirrors),
        mirror_bow=jnp.full(mirrors, tolerances.mirror_bow),
        pad_lean=angles(tolerances.pad_lean_deg, pads),
        thickness=None if layers is None else jnp.full(of_layers, tolerances.layer_thickness),
        index=None if layers is None else jnp.full(of_layers, tolerances.layer_index),
        pupil=tolerances.pupil_shift if moves else None,
        lateral_color=jnp.full(2, tolerances.lateral_color),
    )


OF_PADS = "pad_tilt", "pad_offset", "pad_shift", "pad_lean", "thickness", "index"
"""Errors of fabrication that a pad brings along."""


def with_new_pads(errors: FingerErrors, deviations: Fabrication) -> FingerErrors:
    """What is known of a finger when its pads have been replaced: of these, their tolerances.

    Args:
        errors: as they were found with the pads of before.
        deviations: standard deviation of every error of fabrication.
    """
    nothing = jax.tree.map(jnp.zeros_like, deviations)
    parts = {name: getattr(deviations, name) for name in OF_PADS}
    marked = replace(nothing, **jax.tree.map(jnp.ones_like, parts))
    is_new = np.concatenate([np.ravel(leaf) > 0 for leaf in jax.tree.leaves(marked)])
    # Corners are off in all frames alike as edges of pads are round.
    is_new = np.append(is_new, np.ones(errors.offsets.size, bool))
    kept = np.outer(~is_new, ~is_new)
    return FingerErrors(
        jnp.where(is_new[: errors.mean.size], 0.0, errors.mean),
        jnp.zeros_like(errors.offsets),
        jnp.where(kept, errors.covariance, 0.0) + jnp.diag(jnp.asarray(is_new, float)),
        errors.scale,
    )
