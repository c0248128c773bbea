"""Focus: blur and depth of field along views, against dense sampling of the unfolded path."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import root_scalar

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


LAYERS = ((3.0, 1.49), (2.0, 1.41))
"""Thickness and index, from the camera's side on; ends are at right angles to the pad."""


def layered(camera: complex, direction: float, sides: str):
    layers = [{"thickness": t, "index": n, "sides": sides} for t, n in LAYERS]
    layers[1]["sides"] = "black"
    pad = {"name": "pad", "from": [0.0, 0.0], "to": [20.0, 0.0], "side": "left", "layers": layers}
    eye = {"position": [camera.real, camera.imag], "direction_deg": direction, "fov_deg": 150.0}
    lens = {"focal_length": 2.0, "f_number": 2.8, "focus": 20.0}
    return parse_scene({"camera": eye | {"pixels": 1000, "lens": lens}, "pads": [pad]})


def leaving(place: complex, turn: float, end: float | None) -> tuple[complex, complex]:
    """Where a ray from the membrane comes out into air, and its direction.

    It goes up by all surfaces, or by the last layer's and then by the first one's end at x = end.
    """
    place, ray = complex(place), 1j * np.exp(1j * turn)
    for height, inside, outside in ((2.0, 1.41, 1.49), (5.0, 1.49, 1.0)):
        if outside == 1.0 and end is not None:
            place += ray * (end - place.real) / ray.real
            up = np.sign(ray.real) * np.sqrt(1 - (inside * ray.imag) ** 2) + 1j * inside * ray.imag
            return place, up
        place += ray * (height - place.imag) / ray.imag
        across = inside / outside * ray.real
        ray = across + 1j * np.sqrt(1 - across**2)
    return place, ray


def missed(turn: float, place: complex, end: float | None, camera: complex) -> float:
    out, ray = leaving(place, turn, end)
    return ((camera - out) * np.conj(ray)).imag


@pytest.mark.parametrize(
    ("camera", "direction", "sides", "end", "turns"),
    [
        (2 + 12j, -80.0, "black", None, (-0.74, 0.74)),
        (-4 + 12j, -60.0, "clear", 0.0, (0.91, 1.5)),
        (24 + 12j, 240.0, "clear", 20.0, (-1.5, -0.91)),
    ],
)
def test_behind_layers_neighbouring_rays_cross_at_the_apparent_distance(
    camera, direction, sides, end, turns
):
    scene = layered(camera, direction, sides)
    pieces = find_views(scene, scene.pose()).value
    by_end = np.zeros(pieces.present.shape, bool) if pieces.face is None else pieces.face > 0
    seen = np.argwhere(pieces.present & (by_end == (end is not None)))
    assert len(seen) == 1
    piece = tuple(seen[0])
    wanted = []
    for at in (pieces.start[piece], pieces.end[piece]):
        place = 20 * float(at)
        turn = root_scalar(missed, (place, end, camera), bracket=turns, xtol=1e-15).root
        rays = [leaving(place, turn + change, end) for change in (-1e-5, 1e-5)]
        (first, along), (second, other) = rays
        # Backwards to where both rays meet.
        back = ((second - first) * np.conj(other)).imag / (along * np.conj(other)).imag
        wanted.append(abs(camera - (first + back * along)))
    np.testing.assert_allclose(pieces.apparent[piece], wanted, rtol=1e-7)
    distance = np.array(wanted)
    image = 1 / (1 / 2.0 - 1 / distance)
    sensor = 1 / (1 / 2.0 - 1 / 20.0)
    blur = 2.0 / 2.8 * np.abs(sensor - image) / image * float(scene.camera.focal_pixels) / sensor
    found = focused(scene, pieces)
    assert found.sharp is None
    np.testing.assert_allclose(found.blur[piece], blur, rtol=1e-6)


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
        assert found.sharp is not None
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
