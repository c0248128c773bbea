"""Outlines of pads against the method of images by hand, and rays in space."""

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from optics import parse_scene
from optics.scene.imaging import Imaging
from optics.visibility.outlines import CORNERS, Outlines, find_corners, find_outlines
from optics.visibility.unfolding import paths_of
from optics.visibility.views import name_paths
from tests.helpers import check_gradients
from tests.optics.extruded import POSES, finger, followed, looked, unfolded
from tests.optics.scenes import pairs, posed

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


@every_pose
def test_ends_of_pads_are_their_images_in_the_mirrors(index):
    section, found = posed(finger(), POSES[index]), outlines(index)
    pads = section.ends[2:5]
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
            wanted = [*pairs(section.ends[2 + pad, end]), side * WIDTH / 2]
            np.testing.assert_allclose(place, wanted, atol=1000 * ROUNDING)


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
    check_gradients(weighed, [*jnp.array(rows).T], rtol=10 * SLOPES, atol=10 * SLOPES)


def test_curved_mirrors_are_refused():
    scene = finger()
    layout = dataclasses.replace(scene.layout, curved=(1,))
    curved = dataclasses.replace(
        scene, layout=layout, radii=jnp.array([100.0]), conics=jnp.zeros(1)
    )
    with pytest.raises(ValueError, match="curved mirror has no corners"):
        find_outlines(curved, jnp.zeros(2))


def test_a_scene_without_pads_has_no_outlines():
    camera = {"position": [0.0, 0.0], "direction_deg": 0.0, "fov_deg": 90.0, "pixels": 100}
    lid = {"name": "lid", "from": [30.0, 20.0], "to": [35.0, 2.0], "side": "right"}
    bare = parse_scene({"scene": {"bounces": 1}, "camera": camera, "mirrors": [lid]})
    assert jax.jit(find_outlines)(bare, jnp.zeros(0)).angle.shape == (2, 0, 2)
