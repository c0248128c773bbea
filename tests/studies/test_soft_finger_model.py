"""The soft finger as a pytree: from the chamber's dimensions to places in the image."""

import dataclasses
import functools
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.flatten_util import ravel_pytree

from optics import Chamber
from optics.chamber import Endoscope, Posture
from studies.models import SoftFinger

FINGER = SoftFinger(
    Chamber(40.0, 30.0, 30.0, 4.1, 2.0, 0.035, 2.5, 4.0, 3.5, 8.6, 0.84),
    Endoscope(1.6, -0.05, np.array([0.01, -0.02]), 0.03),
)
RINGS = 60
STRAIGHT = Posture(jnp.zeros(()), jnp.zeros(()), jnp.zeros(RINGS))
STRUCTURAL_ZEROS = {"chamber.focal_length", "chamber.image_distance"}
"""They choose η; the image is that of the endoscope."""


def posture(bend: float, dtype: Any = float) -> Posture:
    pressed = jnp.linspace(0, 0.3, RINGS, dtype=dtype)
    return Posture(jnp.asarray(bend, dtype), jnp.asarray(0.4, dtype), pressed)


def places(finger: SoftFinger, bend: float = 0.3) -> jax.Array:
    """Weighted means of outlines at the middle and the end of each region: columns and rows."""
    outlines = finger.outlines(posture(bend, finger.chamber.length_ab.dtype), 24)
    weights = jnp.asarray(1 + np.sin(np.arange(24)), outlines.dtype)
    return jnp.einsum("rap,a->rp", outlines[9::10], weights) / 24


@functools.cache
def slopes() -> SoftFinger:
    """Of `places`, in double precision."""
    return jax.jit(jax.jacrev(places))(FINGER)


@pytest.mark.parametrize("distortion", [0.0, -0.1])
def test_a_straight_fingers_outlines_are_circles_of_known_radius(distortion):
    """Similar triangles and Brown's lens: f ρ (1 + k1 ρ²) with ρ = r / (s + δ)."""
    finger = dataclasses.replace(FINGER, endoscope=Endoscope(1.6, distortion))
    chamber = jax.tree.map(float, finger.chamber)
    focal = 400.0 / np.tan(0.8)
    along = np.array([40.0, 70.0, 100.0]) + chamber.pinhole_offset
    radius = np.array([
        chamber.reference_height + chamber.offset_b,
        chamber.reference_height + chamber.offset_b - 30.0 * np.tan(chamber.wall_angle_bc),
        chamber.reference_height - chamber.offset_d,
    ])  # fmt: skip
    outlines = jax.jit(lambda one: one.outlines(STRAIGHT, 32))(finger)
    found = np.asarray(outlines)[19::20] - np.array([319.5, 239.5])
    tangents = (radius / along)[:, None]
    wanted = focal * tangents * (1 + distortion * tangents**2)
    np.testing.assert_allclose(np.hypot(*np.moveaxis(found, -1, 0)), wanted + np.zeros(32), 1e-6)


def test_slopes_are_central_differences():
    point, build = ravel_pytree(FINGER)
    steps = 1e-5 * np.eye(len(point))
    points = jnp.asarray(np.asarray(point) + np.concatenate([steps, -steps]))
    ends = jax.jit(jax.vmap(lambda flat: places(build(flat))))(points)
    high, low = np.split(np.asarray(ends), 2)
    found = np.concatenate([leaf.reshape(6, 2, -1) for leaf in jax.tree.leaves(slopes())], axis=-1)
    wanted = np.moveaxis(high - low, 0, -1) / 2e-5
    np.testing.assert_allclose(found, wanted, rtol=1e-6, atol=1e-5)


def test_only_what_no_ray_meets_has_no_slope():
    of_leaves = {
        jax.tree_util.keystr(path)[1:]: np.abs(leaf).max()
        for path, leaf in jax.tree.leaves_with_path(slopes())
    }
    assert {name for name, size in of_leaves.items() if not size > 1e-4} == STRUCTURAL_ZEROS
    assert np.isfinite(list(of_leaves.values())).all()


def test_slopes_of_a_batch_are_those_of_each():
    other = dataclasses.replace(
        FINGER, chamber=dataclasses.replace(FINGER.chamber, offset_d=jnp.asarray(2.0))
    )
    batch = jax.tree.map(lambda *leaves: jnp.stack(leaves), other, FINGER)
    found = jax.jit(jax.vmap(jax.grad(lambda one: places(one)[2, 0])))(batch)
    for many, its in zip(*map(jax.tree.leaves, (found, slopes())), strict=True):
        np.testing.assert_allclose(many[1], its[2, 0], rtol=1e-9, atol=1e-9)
    assert found.chamber.offset_b[0] != found.chamber.offset_b[1]


def test_slopes_in_single_precision():
    single = jax.tree.map(lambda leaf: np.asarray(leaf, np.float32), FINGER)
    with jax.enable_x64(False):
        found = jax.jit(jax.jacrev(places))(single)
    for one, other in zip(*map(jax.tree.leaves, (found, slopes())), strict=True):
        assert one.dtype == jnp.float32
        scale = max(float(np.abs(other).max()), 1e-3)
        np.testing.assert_allclose(one, other, rtol=1e-3, atol=1e-3 * scale)
