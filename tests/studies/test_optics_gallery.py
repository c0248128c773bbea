"""The gallery's scenes show what its README says; what they show is computed by hand."""

from __future__ import annotations

import functools
import re
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import Array

from optics import read_scene
from optics.scene.scene import Scene
from optics.visibility.coverage import find_views
from optics.visibility.views import Pieces, name_paths

FOLDER = Path(__file__).parents[2] / "studies/gallery/scenes"
README = (FOLDER / "README.md").read_text(encoding="utf-8")
NAMES = sorted(path.stem for path in FOLDER.glob("*.toml"))
CURVED = ["circle", "ellipse", "parabola"]
WHOLE = (0.0, 1.0)


@jax.jit
def views_of(scene: Scene, angles: Array) -> Pieces:
    """Without margins, which take most of the time to compile."""
    return find_views(scene, angles).value


@functools.cache
def gallery(name: str) -> Scene:
    return read_scene(FOLDER / f"{name}.toml")


def pieces(scene: Scene) -> dict[str, Pieces]:
    """The pieces of a scene's only pad, by the path that shows them."""
    names = name_paths(scene.layout)
    found = jax.tree.map(lambda leaf: np.asarray(leaf)[0], views_of(scene, scene.pose()))
    present = np.flatnonzero(found.present)
    by_path = {
        names[found.path[i]]: jax.tree.map(lambda leaf, i=i: leaf[i], found) for i in present
    }
    assert len(by_path) == len(present)
    return by_path


def extent(piece: Pieces) -> tuple[float, float]:
    return float(piece.start), float(piece.end)


def pixel(scene: Scene, image: np.ndarray) -> float:
    """Where the camera images what it sees straight ahead in the place of an image."""
    arrow = image - np.asarray(scene.camera.position)
    angle = np.arctan2(arrow[1], arrow[0]) - float(scene.camera.direction)
    return float(scene.camera.pixel(jnp.asarray((angle + np.pi) % (2 * np.pi) - np.pi)))


def assert_shown(scene: Scene, images: dict[str, np.ndarray]) -> None:
    """All of the only pad is seen by these paths and no other, at these images of its ends."""
    found = pieces(scene)
    assert sorted(found) == sorted(images)
    for path, ends in images.items():
        assert extent(found[path]) == WHOLE
        wanted = [pixel(scene, end) for end in ends]
        np.testing.assert_allclose(found[path].pixels, wanted, rtol=1e-12, err_msg=path)
        distances = np.linalg.norm(ends - np.asarray(scene.camera.position), axis=1)
        np.testing.assert_allclose(found[path].distance, distances, rtol=1e-12, err_msg=path)


def test_the_readme_names_every_scene_and_how_to_see_it():
    assert README.startswith("# gallery/scenes")
    for name in NAMES:
        assert f"**`{name}`**: `designopt trace studies/gallery/scenes/{name}.toml" in README
    assert sorted(set(re.findall(r"([\w-]+)\.toml", README))) == NAMES


@pytest.mark.parametrize("name", NAMES)
def test_every_scene_is_read_and_explained(name):
    assert (name in CURVED) == bool(gallery(name).layout.curved)
    assert (FOLDER / f"{name}.toml").read_text(encoding="utf-8").startswith("# ")


@pytest.mark.parametrize("distance", [500.0, 1000.0, 5000.0])
def test_half_a_height_of_mirror_shows_all_of_a_person(distance):
    scene = gallery("half-height-mirror")
    away = scene.mirrors.at[..., 0].add(distance - 1000)
    raised = away.at[0, 0, 1].add(10.0)
    away, raised = (eqx.tree_at(lambda s: s.mirrors, scene, ends) for ends in (away, raised))
    behind = 2 * distance - 1000
    assert_shown(away, {"mirror:wall": np.array([[behind, 0], [behind, 1700]])})
    eye = distance - 0.1
    hidden = 1600 - (1600 - 810) * (eye + distance) / eye
    assert hidden == pytest.approx(20, abs=0.2)
    assert extent(pieces(raised)["mirror:wall"]) == pytest.approx((hidden / 1700, 1), rel=1e-11)


def test_the_periscope_looks_straight_on():
    # Mirrored in y = x + 200 and in y = x − 100, the pad stands 700 mm ahead, upright.
    images = {"mirror:lower+upper": np.array([[700, -40], [700, 40]])}
    assert_shown(gallery("periscope"), images)


def test_a_corner_turns_by_half_a_turn():
    images = {"mirror:wall+floor": -np.array([[110, 94], [150, 54]])}
    assert_shown(gallery("corner-reflector"), images)


@pytest.mark.parametrize("angle", [90, 60])
def test_a_kaleidoscope_shows_one_image_in_every_sector(angle):
    scene = gallery(f"kaleidoscope-{angle}")
    bead = np.asarray(scene.pads)[0] @ [1, 1j]
    turn = np.exp(2j * np.radians(angle))
    # Mirror a makes z its conjugate; mirror b turns that by twice the angle between the two.
    images = {
        "direct": bead,
        "mirror:a": bead.conj(),
        "mirror:b": turn * bead.conj(),
        "mirror:a+b": bead / turn,
    }
    if angle == 60:
        images |= {"mirror:b+a": turn * bead, "mirror:a+b+a": bead.conj() / turn}
    assert len(images) == 360 / angle
    assert_shown(scene, {path: np.stack([z.real, z.imag], -1) for path, z in images.items()})


def test_the_lid_of_the_wedge_shows_its_tip_sharper():
    scene = gallery("folded-pad")
    start, end = np.asarray(scene.mirrors)[0]
    along = (end - start) / np.linalg.norm(end - start)

    def mirrored(place: np.ndarray) -> np.ndarray:
        arrow = place - start
        return start + 2 * np.outer(arrow @ along, along) - arrow

    pad = np.asarray(scene.pads)[0]
    assert_shown(scene, {"direct": pad, "mirror:lid": mirrored(pad)})
    tip = np.array([[21.9999, 0], [22.0001, 0]])
    sharpness = {
        "direct": (pixel(scene, tip[1]) - pixel(scene, tip[0])) / 2e-4,
        "mirror:lid": (pixel(scene, mirrored(tip)[1]) - pixel(scene, mirrored(tip)[0])) / 2e-4,
    }
    for path, piece in pieces(scene).items():
        assert float(piece.px_per_mm[1]) == pytest.approx(abs(sharpness[path]), rel=1e-6)
    assert 4 < abs(sharpness["mirror:lid"] / sharpness["direct"]) < 5


HAND_OVER = [0.0, 41.0, 42.0, 44.0, 45.0, 52.0, 53.0, 74.0, 75.0, 90.0]


@functools.cache
def finger_views() -> Pieces:
    """PIP alone, then DIP alone in the angles of `HAND_OVER`."""
    poses = np.concatenate([np.outer(HAND_OVER, [1, 0]), np.outer(HAND_OVER, [0, 1])])
    assert gallery("finger").angle_names == ("pip", "dip")
    return views_of(gallery("finger"), jnp.asarray(np.radians(poses)))


@pytest.mark.parametrize(
    ("poses", "pad", "mirror", "direct_up_to", "mirror_from"),
    [(slice(10), 0, 2, 52, 45), (slice(10, 20), 2, 1, 74, 42)],
    ids=["pip", "dip"],
)
def test_the_finger_hands_over_from_the_direct_view_to_the_mirror(
    poses, pad, mirror, direct_up_to, mirror_from
):
    def complete(path: int) -> list[float]:
        seen = np.asarray(finger_views().seen(path))[poses, pad]
        return np.array(HAND_OVER)[seen > 1 - 1e-12].tolist()

    assert complete(0) == [angle for angle in HAND_OVER if angle <= direct_up_to]
    assert complete(mirror) == [angle for angle in HAND_OVER if angle >= mirror_from]


def reflected(scene: Scene, offsets: np.ndarray) -> np.ndarray:
    """Where rays from the camera to places of the only, curved mirror meet the pad's line.

    Args:
        scene: the scene.
        offsets: of the places, along the chord from the mirror's axis, mm.
    """
    start, end = np.asarray(scene.mirrors)[0]
    half = np.array(np.linalg.norm(end - start) / 2)
    along = (end - start) / (2 * half)
    left = np.array([-along[1], along[0]])
    radius, conic = float(scene.radii[0]), float(scene.conics[0])

    def sag(offset: np.ndarray) -> np.ndarray:
        return offset**2 / (radius * (1 + np.sqrt(1 - (1 + conic) * offset**2 / radius**2)))

    vertex = (start + end) / 2 - sag(half) * left
    places = vertex + np.outer(offsets, along) + np.outer(sag(offsets), left)
    slopes = offsets / (radius * np.sqrt(1 - (1 + conic) * offsets**2 / radius**2))
    normals = (left - np.outer(slopes, along)) / np.sqrt(1 + slopes**2)[:, None]
    rays = places - np.asarray(scene.camera.position)
    rays -= 2 * np.sum(rays * normals, axis=1)[:, None] * normals
    x = float(scene.pads[0, 0, 0])
    assert x == float(scene.pads[0, 1, 0])  # upright
    return places[:, 1] + (x - places[:, 0]) * rays[:, 1] / rays[:, 0]


def test_the_parabola_sends_rays_from_its_focus_along_its_axis():
    offsets = np.array([-100.0, -60, -5, 30, 100])
    np.testing.assert_allclose(reflected(gallery("parabola"), offsets), 340 - offsets, rtol=1e-13)


def test_the_ellipse_gathers_rays_from_one_focus_in_the_other():
    offsets = np.array([-48.0, -20, 1, 30])
    np.testing.assert_allclose(reflected(gallery("ellipse"), offsets), 0, atol=1e-12)


def test_the_circle_has_a_spherical_aberration():
    heights = reflected(gallery("circle"), np.array([-10.0, -20, -30, -40]))
    # The mirror's `from` is above, so these are rays from above; they end below the axis.
    np.testing.assert_allclose(heights, [-0.05, -0.43, -1.66, -4.82], atol=0.005)


@pytest.mark.slow
def test_the_lip_of_the_bezel_hides_the_near_end_of_a_layered_pad():
    scene = gallery("layered-pad")
    found = jax.tree.map(np.asarray, views_of(scene, scene.pose()))
    # From the camera over the lip's upper edge to the acrylic, through it and the silicone.
    edge = -7 + 1 - 3 * np.tan(np.radians(10)) - 1, 5.8
    angle = np.arctan2(-edge[0], 19 - edge[1])
    depths, indices = np.array([19 - 5, 3, 2]), np.array([1, 1.491, 1.41])
    reached = -depths @ np.tan(np.arcsin(np.sin(angle) / indices))
    np.testing.assert_allclose(found.coverage(), [1, (reached + 32) / 25], rtol=1e-9)
    assert found.coverage()[1] == pytest.approx(0.89, abs=0.005)
    names = np.array(name_paths(scene.layout))[found.path[0]]
    by = {*zip(names[found.present[0]], found.face[0][found.present[0]].tolist(), strict=True)}
    assert {path for path, _ in by} == {"direct", "mirror:lid"}
    # By the outermost surface, and by the clear ends of both layers at `from`.
    assert sorted(face for path, face in by if path == "direct") == [0, 1, 3]
