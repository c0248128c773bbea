"""Outlines of pads against the method of images by hand, rays in space, and what is seen."""

from __future__ import annotations

import dataclasses
import functools
import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from optics.scene.imaging import Imaging
from optics.visibility.boundary_codes import FIRST_PAD_END, SECOND_PAD_END
from optics.visibility.outlines import CORNERS, Outlines, find_corners, find_outlines
from optics.visibility.unfolding import paths_of
from optics.visibility.views import name_paths
from tests.helpers import central_differences
from tests.optics.extruded import POSES, finger, followed, looked, unfolded, views_at_poses
from tests.optics.scenes import posed

ROUNDING = 1e-11
"""Of lengths of some 50 mm, of pixels, and of angles, after two reflections."""

SLOPES = 1e-8
"""What central differences leave, of a function and a design of order one."""

WIDTH, LATERAL = 20.0, 1.5

every_pose = pytest.mark.parametrize("index", range(len(POSES)))


@functools.cache
def words(bounces: int) -> list[tuple[int, ...]]:
    return paths_of(finger().layout, bounces)


@functools.cache
def outlines_at_poses() -> Outlines:
    """Up to two reflections, in all poses at once."""
    found = jax.jit(jax.vmap(functools.partial(find_outlines, bounces=2), (None, 0)))
    return jax.tree.map(np.asarray, found(finger(), jnp.asarray(POSES)))


def outlines(index: int) -> Outlines:
    return jax.tree.map(lambda leaf: jnp.asarray(leaf[index]), outlines_at_poses())


def test_ends_of_pads_that_are_seen_are_where_views_end():
    pieces, whole = views_at_poses().value, set()
    for pose, pad, piece in np.argwhere(pieces.present):
        at = pose, pad, piece
        path = int(pieces.path[at])
        labels = np.array([pieces.start_label[at], pieces.end_label[at]])
        at_ends = labels == [FIRST_PAD_END, SECOND_PAD_END]
        found = outlines(int(pose))
        pixels = finger().camera.pixel(found.angle[path, pad])
        for ours, theirs in (
            (pixels, pieces.pixels[at]),
            (found.distance[path, pad], pieces.distance[at]),
        ):
            np.testing.assert_allclose(ours[at_ends], theirs[at_ends], rtol=ROUNDING)
        if at_ends.all():
            whole.add((name_paths(finger().layout)[path], int(pad)))
    # Something was compared: all pads directly, and all by mirrors.
    assert {("direct", pad) for pad in range(3)} < whole
    assert {("mirror:proximal", 0), ("mirror:distal", 1), ("mirror:distal", 2)} < whole


@every_pose
def test_ends_of_pads_are_their_images_in_the_mirrors(index):
    section, found = posed(finger(), POSES[index]), outlines(index)
    pads = section.complex_ends[2:5]
    wanted = np.array([unfolded(section, word, pads) for word in words(2)])
    ends = found.ends()
    np.testing.assert_allclose(found.distance, np.abs(wanted), rtol=ROUNDING)
    np.testing.assert_allclose(found.angle, np.angle(wanted), atol=ROUNDING)
    np.testing.assert_allclose(ends[..., 0], np.real(wanted), atol=100 * ROUNDING)
    np.testing.assert_allclose(ends[..., 1], np.imag(wanted), atol=100 * ROUNDING)


def test_paths_of_fewer_reflections_come_first_and_are_the_same():
    find = jax.jit(find_outlines, static_argnames="bounces")
    pose, many = jnp.asarray(POSES[1]), outlines(1)
    for less, count in (
        (find(finger(), pose, bounces=0), 1),
        (find(finger(), pose), len(name_paths(finger().layout))),
    ):
        assert less.angle.shape == (count, 3, 2)
        np.testing.assert_allclose(less.angle, many.angle[:count], rtol=ROUNDING)
        np.testing.assert_allclose(less.distance, many.distance[:count], rtol=ROUNDING)


@every_pose
def test_a_ray_is_as_far_beside_the_section_as_its_slope_times_the_path(index):
    section, found = posed(finger(), POSES[index]), outlines(index)
    for (path, word), slope in itertools.product(enumerate(words(2)), (-0.7, 1.3)):
        for pad, end in np.ndindex(3, 2):
            angle, distance = (
                float(part[path, pad, end]) for part in (found.angle, found.distance)
            )
            place = followed(section, word, pad, angle, slope)
            wanted = [*section.ends[2 + pad, end], slope * distance]
            np.testing.assert_allclose(place, wanted, atol=100 * ROUNDING)


@every_pose
def test_rays_through_imaged_corners_meet_the_corners(index):
    camera, section = finger().camera, posed(finger(), POSES[index])
    imaging = Imaging.of(camera)
    corners = np.asarray(find_corners(imaging, outlines(index), WIDTH, LATERAL))
    half_view = float(camera.field_of_view) / 2
    rays = looked(corners, half_view, *imaging.shape)
    for path, word in enumerate(words(2)):
        for pad, corner in np.ndindex(3, 4):
            angle, slope = rays[path, pad, corner]
            end, side = CORNERS[corner]
            place = followed(section, word, pad, angle, slope, LATERAL)
            wanted = [*section.ends[2 + pad, end], side * WIDTH / 2]
            np.testing.assert_allclose(place, wanted, atol=1000 * ROUNDING)


def test_corners_are_imaged_in_their_order_about_the_middle_column():
    imaging = Imaging.of(finger().camera)
    corners = np.asarray(find_corners(imaging, outlines(0), WIDTH))
    np.testing.assert_allclose(corners[..., ::-1, 1], corners[..., 1], atol=100 * ROUNDING)
    middle = np.full(corners.shape[:-1], imaging.shape[1] - 1.0)
    np.testing.assert_allclose(corners[..., ::-1, 0] + corners[..., 0], middle, rtol=ROUNDING)
    assert np.all(corners[..., :2, 0] < corners[..., 2:, 0])
    # When the finger is straight, the distal pad is imaged above the middle, and its tip highest.
    first, last = corners[0, 2, :2, 1]
    assert last < first < imaging.shape[0] / 2


def test_derivatives_of_corners():
    scene, size = finger(), 50.0
    weights = np.random.default_rng(0).uniform(-1, 1, (3, 3, 4, 2)) / 1000

    def weighed(design: list[jax.Array]) -> jax.Array:
        pip, dip, x, y, turn, mirror, pad, width, lateral = design
        camera = dataclasses.replace(
            scene.camera,
            position=scene.camera.position + size * jnp.stack([x, y]),
            direction=scene.camera.direction + turn,
        )
        mirrors = scene.mirrors.at[0, 1].add(size * mirror)
        pads = scene.pads.at[2, 0].add(size * pad)
        moved = dataclasses.replace(scene, camera=camera, mirrors=mirrors, pads=pads)
        found = find_outlines(moved, jnp.stack([pip, dip]))
        corners = find_corners(Imaging.of(scene.camera), found, size * width, size * lateral)
        return jnp.sum(weights * corners)

    rows = [[*pose, 0.01, -0.02, 0.03, 0.004, -0.005, 0.4, 0.03] for pose in POSES]
    designs = [jnp.asarray(part) for part in np.transpose(rows)]
    found = np.stack(jax.jit(jax.vmap(jax.grad(weighed)))(designs), axis=-1)
    compiled = jax.jit(weighed)
    for index in range(len(POSES)):
        wanted = central_differences(compiled, [part[index] for part in designs])
        np.testing.assert_allclose(found[index], wanted, rtol=10 * SLOPES, atol=10 * SLOPES)


def test_curved_mirrors_are_refused():
    scene = finger()
    layout = dataclasses.replace(scene.layout, curved=(1,))
    curved = dataclasses.replace(
        scene, layout=layout, radii=jnp.array([100.0]), conics=jnp.zeros(1)
    )
    with pytest.raises(ValueError, match="curved mirror has no corners"):
        find_outlines(curved, jnp.zeros(2))
