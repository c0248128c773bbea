"""What is seen through the rings against rays that march to the wall, and its symmetries."""

import functools
import itertools
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from optics.chamber import Apertures, Posture, Rings, find_apertures, press_wall
from optics.chamber.rings import FIELD_STOP
from tests.optics.chambers import chamber as finger
from tests.optics.soft_finger.marched import Press, Tube, regions_met

ANGLES = 256
FINE = 80
"""Rings per region; between rings s apart the wall bulges by s²/8R."""

FOCAL = 400.0
"""px: of a camera of 640 × 480 px with a field of view of a right angle."""

COARSE = 0.25
"""px at `FOCAL`: what 20 rings per region, some 2 mm apart, leave of a wall that bulges by 0.02 mm
between them; 0.20 is found under the object and 0.14 without one."""

OUTLINE = 1e-4
"""Of a tangent, 0.04 px: how far the rings, where the wall bulges between them, are off."""

CORNER = 2e-3
"""Of a tangent, 0.8 px: what chords between the points of an outline cut off of its corners."""

STOPPED = 1e-6
"""Nearer to the field stop than this nothing is compared."""

NONE = Press()
PRESSES = {
    "none": NONE,
    "inside": Press(70.0, 20.0, 4.0),
    "outside": Press(55.0, 20.0, -4.0),
    "deep": Press(70.0, 20.0, 12.0),
    "deep outside": Press(80.0, 15.0, -9.0),
}
TUBE = Tube.of(finger())
BENDS_DEG = (0.0, 0.01, 10.0, 30.0, 60.0, 90.0, 120.0)
DIRECTIONS = (0.0, np.pi / 2, 2.3, -1.0)
CASES = [
    (bend, DIRECTIONS[(i + j) % len(DIRECTIONS)], press)
    for i, bend in enumerate((*BENDS_DEG, 170.0, 250.0, -10.0, -60.0))
    for j, press in enumerate(PRESSES)
]

seen_through = eqx.filter_jit(find_apertures)


@functools.cache
def rings(per_region: int) -> Rings:
    return Rings.of(finger(), per_region)


@functools.cache
def look(bend_deg: float, direction: float, press: Press, per_region: int = FINE) -> Any:
    """What is seen through the rings (`Apertures`), in NumPy arrays."""
    values = (jnp.asarray(value) for value in (press.place, press.radius, press.depth))
    pressed = press_wall(rings(per_region).arc, *values)
    posture = Posture(jnp.asarray(np.deg2rad(bend_deg)), jnp.asarray(direction), pressed)
    return jax.tree.map(np.asarray, seen_through(rings(per_region), posture, ANGLES))


def at_ends(found: Any) -> tuple[np.ndarray, np.ndarray]:
    """Outlines at B, C and D, and whether anything is seen through them."""
    count = len(found.seen)
    ends = np.array([count // 3, 2 * count // 3, count]) - 1
    return found.outline[ends], found.seen[ends]


def cross(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    return one[..., 0] * other[..., 1] - one[..., 1] * other[..., 0]


def depths_inside(outline: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Distances of points from a convex outline, negative outside; −1 if it is only a point."""
    step = np.roll(outline, -1, axis=0) - outline
    kept = np.hypot(*step.T) > 1e-12
    if not kept.any():
        return np.full(len(points), -1.0)
    start, step = outline[kept], step[kept]
    off = points[:, None] - start
    along = np.clip(np.sum(off * step, axis=-1) / np.sum(step**2, axis=-1), 0, 1)
    nearest = np.linalg.norm(off - along[..., None] * step, axis=-1).min(axis=1)
    return np.where((cross(step, off) >= 0).all(axis=1), nearest, -nearest)


@pytest.mark.parametrize(("bend_deg", "direction", "press"), CASES)
def test_rays_meet_the_region_between_the_outlines_that_they_are_between(
    bend_deg, direction, press
):
    outlines, seen = at_ends(look(bend_deg, direction, PRESSES[press]))
    rng = np.random.default_rng(int(10 * abs(bend_deg)))
    near = outlines[:, ::16].reshape(-1, 2)
    near = near + rng.normal(0, 0.01, near.shape)
    rays = np.concatenate([rng.uniform(-FIELD_STOP, FIELD_STOP, (400, 2)), near])
    rays = rays[np.hypot(*rays.T) < FIELD_STOP]
    met = regions_met(TUBE, rays, np.deg2rad(bend_deg), direction, PRESSES[press])
    for region, outline in enumerate(outlines):
        inside = depths_inside(outline, rays)
        assert seen[region] or (met <= region).all()
        clear = np.abs(inside) > CORNER
        assert clear.mean() > 0.8
        np.testing.assert_array_equal((inside > 0)[clear], (met > region)[clear])


@pytest.mark.parametrize(("bend_deg", "direction", "press"), CASES)
def test_points_of_outlines_are_where_the_region_changes(bend_deg, direction, press):
    outlines, seen = at_ends(look(bend_deg, direction, PRESSES[press]))
    for region in np.flatnonzero(seen):
        points = outlines[region, 3::8]
        outward = points - outlines[seen][-1].mean(axis=0)
        size = np.hypot(*outward.T)
        for move in (OUTLINE, -OUTLINE):
            moved = points + move * outward / size[:, None]
            # Beyond the field stop nothing is followed, and across the pole is the other side.
            compared = (np.hypot(*moved.T) < FIELD_STOP - STOPPED) & (size > 2 * OUTLINE)
            rays, bend = moved[compared], np.deg2rad(bend_deg)
            met = regions_met(TUBE, rays, bend, direction, PRESSES[press])
            assert ((met > region) == (move < 0)).all()


def test_all_that_is_bounded_and_all_that_is_hidden_is_among_the_cases():
    seen = {
        tuple(at_ends(look(bend, direction, PRESSES[press]))[1]) for bend, direction, press in CASES
    }
    assert seen == {(True, True, True), (True, True, False), (True, False, False)}


@pytest.mark.parametrize("bend_deg", BENDS_DEG)
@pytest.mark.parametrize("press", ["none", "inside", "outside"])
def test_few_rings_do_as_well_as_many(bend_deg, press):
    few, seen = at_ends(look(bend_deg, 0.4, PRESSES[press], 20))
    many, really = at_ends(look(bend_deg, 0.4, PRESSES[press]))
    np.testing.assert_array_equal(seen, really)
    for one, other in zip(few[seen], many[seen], strict=True):
        assert FOCAL * np.abs(depths_inside(other, one)).max() < COARSE


@pytest.mark.parametrize("bend_deg", [0.0, 10.0, 60.0, 170.0])
@pytest.mark.parametrize("press", PRESSES)
def test_outlines_are_convex_and_lie_in_each_other(bend_deg, press):
    found = look(bend_deg, 0.7, PRESSES[press])
    outlines, seen = found.outline, found.seen
    step = np.roll(outlines, -1, axis=1) - outlines
    # From right to down, that is from x to y.
    assert cross(step, np.roll(step, -1, axis=1)).min() > -1e-14
    # What is seen is an unbroken row of rings, and what is not is a point.
    assert (np.diff(seen.astype(int)) <= 0).all()
    assert not np.ptp(outlines[~seen], axis=1).any()
    shown = outlines[seen][:: FINE // 8]
    for outer, inner in itertools.pairwise(shown):
        assert depths_inside(outer, inner).min() > -1e-12


def test_nothing_is_nan_however_a_finger_is_bent():
    bends = jnp.asarray(np.deg2rad([-720.0, -180, 0, 170, 180, 250, 359, 360, 400, 460, 600, 3000]))
    depth = jnp.asarray([0.0, 4.0, -4.0, 30.0])

    def one(bend: jax.Array, depth: jax.Array) -> Apertures:
        pressed = press_wall(rings(20).arc, jnp.asarray(70.0), jnp.asarray(20.0), depth)
        return find_apertures(rings(20), Posture(bend, jnp.asarray(0.3), pressed), 32)

    found = jax.jit(jax.vmap(jax.vmap(one, in_axes=(None, 0)), in_axes=(0, None)))(bends, depth)
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(found))
    assert (np.hypot(*np.moveaxis(np.asarray(found.outline), -1, 0)) < FIELD_STOP + 1e-9).all()


def test_a_ring_that_is_imaged_as_a_hyperbola_leaves_its_outline_to_the_object_that_presses():
    # Bent to a radius below its own, a ring reaches behind the camera but for what is pressed in.
    rings = Rings.of(finger(length_ab=10.0, length_bc=10.0, length_cd=10.0))
    posture = Posture(jnp.asarray(np.deg2rad(200.0)), jnp.asarray(0.0), jnp.full(60, 3.0))
    found = jax.tree.map(np.asarray, seen_through(rings, posture, 64))
    assert found.seen.any()
    outermost = found.outline[found.seen, 0, 0]
    np.testing.assert_allclose(outermost, found.spans.seen_high[found.seen], atol=1e-9)
