"""Errors of assembly: drawn, and put into a finger."""

from __future__ import annotations

from dataclasses import replace

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import scipy.stats
from jaxtyping import Array, Float

from designopt.numerics import as_float
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
"""Of the entries of `Errors.of`, in order."""


class Errors(eqx.Module):
    """Errors of one assembled finger, or of many along the first axes.

    Attributes:
        camera: of its position, mm.
        camera_tilt: rad, counter-clockwise.
        mirror_tilt: of the distal and the proximal mirror about their middles, rad.
        mirror_offset: of both along their normals (to the left of their direction), mm.
    """

    camera: Float[Array, "*batch 2"] = eqx.field(converter=as_float)
    camera_tilt: Float[Array, "*batch"] = eqx.field(converter=as_float)
    mirror_tilt: Float[Array, "*batch 2"] = eqx.field(converter=as_float)
    mirror_offset: Float[Array, "*batch 2"] = eqx.field(converter=as_float)

    @classmethod
    def of(cls, entries: Float[Array | np.ndarray, "*batch 7"]) -> Errors:
        """From seven numbers in the order of `NAMES`, mm and rad."""
        return cls(entries[..., :2], entries[..., 2], entries[..., 3:5], entries[..., 5:])


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


def perturb(finger: Finger, errors: Errors) -> Finger:
    """The finger as it is assembled with given errors; a single one, its mirrors as in `NAMES`."""
    camera = camera_of(finger)
    # Errors are those of a plane whose y points up, and depths point down.
    ends = jnp.stack([mirror.ends for mirror in finger.mirrors])
    up = jnp.array([[[1.0, -1.0]]], ends.dtype)
    moved = up * displaced(up * ends, errors.mirror_tilt, errors.mirror_offset)
    return replace(
        finger,
        camera=replace(
            camera,
            along=camera.along + errors.camera[0],
            depth=camera.depth - errors.camera[1],
            tilt=camera.tilt + errors.camera_tilt,
        ),
        mirrors=tuple(
            replace(mirror, ends=its) for mirror, its in zip(finger.mirrors, moved, strict=True)
        ),
    )
