"""Focus: blur and depth of field along views, against dense sampling of the unfolded path."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from optics import ThinLens, find_focus, find_views, parse_scene
from tests.helpers import central_differences, load_toml

SCENE = load_toml("scenes/lens.toml")

focused = jax.jit(find_focus)


def test_blur_and_sharp_part_agree_with_dense_sampling():
    scene = parse_scene(SCENE)
    pieces = find_views(scene, scene.pose()).value
    found = focused(scene, pieces, accepted=2.0)
    pitch = (1 / (1 / 2.0 - 1 / 20.0)) / float(scene.camera.focal_pixels)
    assert int(pieces.present.sum()) == 2
    for piece in range(2):
        path = int(pieces.path[0, piece])
        source = np.array([0.0, 12.0]) if path == 0 else np.array([60.0, 12.0])
        t = np.linspace(float(pieces.start[0, piece]), float(pieces.end[0, piece]), 200_001)
        distance = np.hypot(25 * t - source[0], source[1])
        aperture, sensor = 2.0 / 2.8, 1 / (1 / 2.0 - 1 / 20.0)
        image = 1 / (1 / 2.0 - 1 / distance)
        blur = aperture * np.abs(sensor - image) / image / pitch
        np.testing.assert_allclose(found.blur[0, piece], blur[[0, -1]], rtol=1e-9)
        assert float(found.sharp[0, piece]) == pytest.approx(np.mean(blur <= 2.0), abs=2e-5)


def test_everything_is_sharp_beyond_the_hyperfocal_distance():
    scene = parse_scene(SCENE)
    pieces = find_views(scene, scene.pose()).value
    lens = ThinLens(2.0, 1e-3, 1 / (1 / 2.0 - 1 / 20.0))
    scene = eqx.tree_at(lambda scene: scene.camera.lens, scene, lens)
    found = focused(scene, pieces, accepted=1.0)
    assert np.isinf(found.limits[1])
    np.testing.assert_allclose(found.sharp[pieces.present], 1.0)


@pytest.mark.slow
def test_gradient_of_sharpness_and_of_blur():
    scene = parse_scene(SCENE)

    def total(design: tuple[jax.Array, jax.Array, jax.Array]) -> jax.Array:
        height, focal, aperture = design
        moved = eqx.tree_at(
            lambda scene: (scene.camera.position, scene.camera.lens),
            scene,
            (jnp.stack([jnp.zeros_like(height), height]), ThinLens(focal, aperture, 2.2)),
        )
        pieces = find_views(moved, moved.pose()).value
        found = find_focus(moved, pieces, accepted=2.0)
        return found.sharp.sum() + found.blur.sum()

    design = tuple(jnp.asarray([12.0, 2.0, 0.7]))  # of one type, moved or not
    both = jax.jit(jax.value_and_grad(total))  # one program: compiling is most of the time
    wanted = central_differences(lambda moved: both(moved)[0], design)
    np.testing.assert_allclose(both(design)[1], wanted, rtol=1e-6)


def test_a_camera_without_a_lens_is_told():
    bare = dict(SCENE, camera={k: v for k, v in SCENE["camera"].items() if k != "lens"})
    scene = parse_scene(bare)
    with pytest.raises(ValueError, match="no lens"):
        find_focus(scene, find_views(scene, scene.pose()).value)
