"""Errors of assembly: drawn, and put into a finger."""

from __future__ import annotations

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import scipy.stats
from jaxtyping import Array, Float

from optics.scene.fabrication import displaced
from studies.models.finger import Finger, camera_of
from studies.models.mirror_design.spec import ToleranceSpec

NAMES = (
    "camera along x",
    "camera along y",
    "camera tilt",
    "distal mirror tilt",
    "proximal mirror tilt",
    "distal mirror offset",
    "proximal mirror offset",
)
"""What the entries of a row of errors are, in mm and rad. Tilts are counter-clockwise, those of
mirrors about their middles; offsets are along a mirror's normal, to the left of its direction."""


def deviations(tolerances: ToleranceSpec) -> Float[np.ndarray, "7"]:
    """Standard deviations in the order of `NAMES`, mm and rad."""
    tilts = np.deg2rad([tolerances.camera_tilt_deg, *[tolerances.mirror_tilt_deg] * 2])
    places = [tolerances.camera_position] * 2
    return np.concatenate([places, tilts, [tolerances.mirror_offset] * 2])


def sample_errors(tolerances: ToleranceSpec, count: int, seed: int) -> Float[np.ndarray, "draws 7"]:
    """Independent normal errors in the order of `NAMES`: a Monte-Carlo sample; mm and rad."""
    generator = np.random.default_rng([seed, 2])
    return deviations(tolerances) * generator.standard_normal((count, len(NAMES)))


def spread_evenly(
    tolerances: ToleranceSpec, count: int, seed: int
) -> Float[np.ndarray, "copies 7"]:
    """Normal errors spread evenly by a scrambled Sobol sequence; as `sample_errors` otherwise.

    Source: I. M. Sobol, USSR Comput. Math. Math. Phys. 7 (1967) 86; A. B. Owen, J. Complexity 14
    (1998) 466 (scrambling).
    """
    # Asked for in a power of two, as its balance needs.
    sobol = scipy.stats.qmc.Sobol(len(NAMES), rng=np.random.default_rng([seed, 1]))
    even = sobol.random_base2(int(np.ceil(np.log2(count))))[:count]
    return deviations(tolerances) * scipy.stats.norm.ppf(even)


def perturb(finger: Finger, errors: Float[Array, "7"]) -> Finger:
    """The finger as it is assembled with errors in the order of `NAMES`, as its mirrors are."""
    camera, (x, y, tilt) = camera_of(finger), errors[:3]
    # Errors are those of a plane whose y points up, and depths point down.
    ends = jnp.stack([mirror.ends for mirror in finger.mirrors])
    up = jnp.array([[[1.0, -1.0]]], ends.dtype)
    moved = up * displaced(up * ends, errors[3:5], errors[5:])
    mirrors = zip(finger.mirrors, moved, strict=True)
    place = {"along": camera.along + x, "depth": camera.depth - y, "tilt": camera.tilt + tilt}
    mirrors = tuple(replace(mirror, ends=its) for mirror, its in mirrors)
    return replace(finger, camera=replace(camera, **place), mirrors=mirrors)
