"""Errors of assembly: drawn, and put into a finger."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from optics.scene.fabrication import displaced
from studies.models.finger import Finger, camera_of
from studies.models.mirror_design.spec import ToleranceSpec

OF_CAMERA = ("camera along x", "camera along y", "camera tilt")


def error_names(mirrors: Sequence[str]) -> tuple[str, ...]:
    """What the entries of a row of errors are, in mm and rad.

    Tilts are counter-clockwise, those of mirrors about their middles; offsets are along a mirror's
    normal, to the left of its direction.

    Args:
        mirrors: their names, in the finger's order.

    Example:
        >>> error_names(["distal"])[3:]
        ('distal mirror tilt', 'distal mirror offset')
    """
    kinds = ("tilt", "offset")
    return (*OF_CAMERA, *(f"{name} mirror {kind}" for kind in kinds for name in mirrors))


def deviations(tolerances: ToleranceSpec, mirrors: int) -> Float[np.ndarray, " errors"]:
    """Standard deviations in the order of `error_names` with so many mirrors, mm and rad."""
    tilts = np.deg2rad([tolerances.camera_tilt_deg, *[tolerances.mirror_tilt_deg] * mirrors])
    places = [tolerances.camera_position] * 2
    return np.concatenate([places, tilts, [tolerances.mirror_offset] * mirrors])


def sample_errors(
    tolerances: ToleranceSpec, mirrors: int, count: int, seed: int
) -> Float[np.ndarray, "draws errors"]:
    """Independent normal errors in the order of `error_names`: a Monte-Carlo sample; mm and rad."""
    generator, sizes = np.random.default_rng([seed, 2]), deviations(tolerances, mirrors)
    return sizes * generator.standard_normal((count, len(sizes)))


def spread_evenly(
    tolerances: ToleranceSpec, mirrors: int, count: int, seed: int
) -> Float[np.ndarray, "copies errors"]:
    """Normal errors spread evenly by a scrambled Sobol sequence; as `sample_errors` otherwise.

    Source: I. M. Sobol, USSR Comput. Math. Math. Phys. 7 (1967) 86; A. B. Owen, J. Complexity 14
    (1998) 466 (scrambling).
    """
    sizes = deviations(tolerances, mirrors)
    import scipy.stats  # takes a second, and most commands draw no errors

    # Asked for in a power of two, as its balance needs.
    sobol = scipy.stats.qmc.Sobol(len(sizes), rng=np.random.default_rng([seed, 1]))
    even = sobol.random_base2(int(np.ceil(np.log2(count))))[:count]
    return sizes * scipy.stats.norm.ppf(even)


def perturb(finger: Finger, errors: Float[Array, " errors"]) -> Finger:
    """The finger as it is assembled with errors in the order of `error_names`."""
    camera, (x, y, tilt) = camera_of(finger), errors[:3]
    place = {"along": camera.along + x, "depth": camera.depth - y, "tilt": camera.tilt + tilt}
    finger = replace(finger, camera=replace(camera, **place))
    if not finger.mirrors:
        return finger
    # Errors are those of a plane whose y points up, and depths point down.
    ends = jnp.stack([mirror.ends for mirror in finger.mirrors])
    up = jnp.array([[[1.0, -1.0]]], ends.dtype)
    tilts, offsets = jnp.split(errors[3:], 2)
    moved = up * displaced(up * ends, tilts, offsets)
    mirrors = zip(finger.mirrors, moved, strict=True)
    return replace(finger, mirrors=tuple(replace(mirror, ends=its) for mirror, its in mirrors))
