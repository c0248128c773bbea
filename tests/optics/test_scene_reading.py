"""From a file to a scene: numbers, names and frames find their places, or one line says why."""

import cmath
import math
import tomllib
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from designopt import UserError
from designopt.io.spec_files import validated
from optics import parse_scene, read_scene
from optics.scene.camera import Camera, Equidistant, KannalaBrandt, Pinhole
from optics.scene.file import SceneFile
from optics.scene.scene import WORLD, Frame, Scene, Surface, place
from tests.helpers import SCENES, assert_same
from tests.refusals import changed, check_refused, refusals

CAMERA = {"position": [3, 4], "direction_deg": -90, "fov_deg": 120, "pixels": 640}


def wall(name: str, x: float = 10, **more: Any) -> dict[str, Any]:
    return {"name": name, "from": [x, 0], "to": [x, 8], **more}


def frame(angle: str, parent: str = "world", **more: Any) -> dict[str, Any]:
    return {"hinge": [0, 0], "angle": angle, "parent": parent, **more}


def scene(**tables: Any) -> dict[str, Any]:
    return {"camera": CAMERA, "pads": [wall("pad")], **tables}


def placed_ends(scene: Scene, **degrees: float) -> np.ndarray:
    """Ends of all surfaces in a pose, mm, shape (surfaces, 2, 2)."""
    pose = scene.pose({name: math.radians(angle) for name, angle in degrees.items()})
    placed = place(scene, pose)
    ends = (placed.absolute(placed.starts), placed.absolute(placed.ends))
    return np.stack([np.asarray(end.stacked()) for end in ends], axis=1)


def test_numbers_arrive_in_mm_and_radians():
    bowl = wall("bowl", 2, radius=-50, conic=-1)
    found = parse_scene(
        scene(
            mirrors=[wall("flat", 1), bowl, wall("arc", 3, radius=9)],
            pads=[wall("a", 4, min_grazing_deg=30), wall("b", 5)],
            blockers=[wall("c", 6)],
            frames={"f": frame("t", hinge=[7, 8])},
        )
    )
    for array, x in ((found.mirrors, [1, 2, 3]), (found.pads, [4, 5]), (found.blockers, [6])):
        np.testing.assert_array_equal(array, [[[x, 0], [x, 8]] for x in x])
    np.testing.assert_array_equal(found.radii, [-50, 9])
    np.testing.assert_array_equal(found.conics, [-1, 0])
    assert found.layout.curved == (1, 2)
    np.testing.assert_allclose(found.grazing, [math.pi / 6, 0], rtol=1e-15)
    np.testing.assert_array_equal(found.hinges, [[7, 8]])
    camera = found.camera
    np.testing.assert_array_equal(camera.position, [3, 4])
    assert float(camera.direction) == -math.pi / 2
    assert float(camera.field_of_view) == pytest.approx(2 * math.pi / 3, rel=1e-15)
    assert float(camera.pixels) == 640
    assert camera.lens is None


@pytest.mark.parametrize("x64", [True, False])
def test_arrays_have_the_default_float_type_and_empty_kinds_their_shape(x64):
    with jax.enable_x64(x64):
        found = parse_scene(scene())
        kinds = {leaf.dtype for leaf in jax.tree.leaves(found)}
    assert kinds == {jnp.dtype("float64" if x64 else "float32")}
    assert found.mirrors.shape == found.blockers.shape == (0, 2, 2)
    assert found.radii.shape == found.conics.shape == (0,)
    assert found.hinges.shape == (0, 2)


@pytest.mark.parametrize(
    ("projection", "kind", "height"),
    [
        ({}, Equidistant, math.radians(30)),
        ({"projection": "equidistant"}, Equidistant, math.radians(30)),
        ({"projection": "pinhole"}, Pinhole, math.tan(math.radians(30))),
        (
            {"projection": [0.1, 0, 0, 0]},
            KannalaBrandt,
            math.radians(30) + 0.1 * math.radians(30) ** 3,
        ),
    ],
)
def test_projections(projection, kind, height):
    found: Camera = parse_scene(scene(camera=CAMERA | projection)).camera
    assert type(found.projection) is kind
    assert float(found.projection.height(jnp.radians(jnp.array(30.0)))) == pytest.approx(height)


def test_a_lens_is_in_focus_where_the_file_says():
    lens = {"focal_length": 2.8, "f_number": 2, "focus": 25}
    found = parse_scene(scene(camera=CAMERA | {"lens": lens})).camera.lens
    assert found is not None
    assert float(found.focal_length) == 2.8
    assert float(found.aperture) == 1.4
    assert float(found.focus_vergence().value) == pytest.approx(1 / 25, rel=1e-14)
    assert float(found.image(25.0).value.blur_diameter) == pytest.approx(0, abs=1e-15)


@pytest.mark.parametrize(
    ("names", "more", "wanted"),
    [("", {}, 0), ("a", {}, 1), ("ab", {}, 2), ("abc", {}, 2), ("a", {"radius": 10}, 2)],
)
def test_most_bounces_follow_from_the_mirrors(names, more, wanted):
    mirrors = [wall(name, **more) for name in names]
    assert parse_scene(scene(mirrors=mirrors)).layout.bounces == wanted
    asked = scene(mirrors=mirrors, scene={"bounces": 3, "name": "three"})
    assert (parse_scene(asked).layout.bounces, parse_scene(asked).layout.name) == (3, "three")


def test_sides_and_frames_of_surfaces():
    found = parse_scene(
        scene(
            camera=CAMERA | {"body": "f"},
            mirrors=[wall("m", side="left"), wall("n", side="right", body="g")],
            pads=[wall("m", body="f")],
            blockers=[wall("m", side="both", body="world")],
            frames={"f": frame("t"), "g": frame("t", "f", positive="clockwise")},
        )
    ).layout
    assert found.mirrors == (Surface("m", 1), Surface("n", -1, 1))
    assert found.pads == (Surface("m", 0, 0),)
    assert found.blockers == (Surface("m", 0, WORLD),)
    assert found.camera_frame == 0
    assert found.frames == (Frame("f", WORLD, 0, 1), Frame("g", 0, 0, -1))


def test_parents_come_before_children_and_angles_as_in_the_file():
    frames = {
        "tip": frame("third", "middle", hinge=[3, 0]),
        "middle": frame("second", "base", hinge=[2, 0]),
        "other": frame("third", hinge=[0, 4]),
        "base": frame("first", hinge=[1, 0]),
    }
    found = parse_scene(scene(frames=frames))
    np.testing.assert_array_equal(found.hinges, [[0, 4], [1, 0], [2, 0], [3, 0]])
    assert found.angle_names == ("third", "second", "first")
    assert [part.name for part in found.layout.frames] == ["other", "base", "middle", "tip"]
    assert [part.parent for part in found.layout.frames] == [WORLD, WORLD, 1, 2]
    assert [part.angle for part in found.layout.frames] == [0, 2, 1, 0]


def test_a_chain_of_frames_and_a_shared_angle():
    frames = {
        "tip": {"hinge": [20, 5], "angle": "a", "parent": "base"},
        "base": {"hinge": [10, 0], "angle": "a", "positive": "clockwise"},
        "third": {"hinge": [20, 5], "angle": "b", "parent": "tip"},
    }
    camera = CAMERA | {"body": "third"}
    pads = [wall("base", body="base"), wall("tip", body="tip"), wall("third", body="third")]
    found = parse_scene(scene(camera=camera, pads=pads, frames=frames))
    a, b = math.radians(25), math.radians(-60)

    def moved(point: complex, turns: int) -> list[float]:
        """Turned about the hinges of the first frames of the chain, the innermost first."""
        chain = [(10 + 0j, -a), (20 + 5j, a), (20 + 5j, b)][:turns]
        for hinge, angle in reversed(chain):
            point = hinge + (point - hinge) * cmath.rect(1, angle)
        return [point.real, point.imag]

    wanted = [[moved(10 + 0j, i), moved(10 + 8j, i)] for i in (1, 2, 3)]
    np.testing.assert_allclose(placed_ends(found, a=25, b=-60), wanted, atol=1e-12)
    placed = place(found, found.pose({"a": a, "b": b}))
    np.testing.assert_allclose(
        placed.absolute(placed.camera).stacked(), moved(3 + 4j, 3), atol=1e-12
    )
    # The first two turns cancel, so the optical axis turns by the third alone.
    assert float(placed.axis.angle()) == pytest.approx(-math.pi / 2 + b)


def test_names_are_unique_within_a_kind_only():
    found = parse_scene(scene(mirrors=[wall("a")], pads=[wall("a")], blockers=[wall("a")]))
    assert [part.name for part in found.layout.surfaces] == ["a", "a", "a"]
    found = parse_scene(scene(pads=[], mirrors=[wall("a")]))  # it may be mirrors alone
    assert found.layout.pads == ()


def test_files_and_tables_give_the_same_scene(tmp_path):
    path = tmp_path / "f.toml"
    path.write_bytes(b"\xef\xbb\xbf" + (SCENES / "finger.toml").read_bytes())
    tables = tomllib.loads((SCENES / "finger.toml").read_text(encoding="utf-8"))
    assert_same(read_scene(path), parse_scene(tables), 0, 0)


@pytest.mark.parametrize(("data", "words"), refusals("refused_scenes.toml"))
def test_what_makes_no_scene_is_refused(data, words):
    message = check_refused(parse_scene, data, words)
    if len(words) <= 2:
        assert message.count(";") <= 2  # one fault


def test_what_is_no_scene_file_is_refused(tmp_path):
    path = tmp_path / "f.toml"
    for content, words in (
        (None, "cannot be read"),
        ("[camera]\nposition = ", "not TOML"),
        ("", "camera: missing; add it"),
    ):
        if content is not None:
            path.write_text(content)
        with pytest.raises(UserError, match=words):
            read_scene(path)


def test_only_the_camera_must_be_in_a_file():
    file = validated(SceneFile, {"camera": CAMERA}, "f.toml")
    assert (file.mirrors, file.pads, file.blockers, file.frames) == ([], [], [], {})
    assert (file.scene.name, file.scene.bounces) == (None, None)


CURVES = (-4.001, 0), (5.7, 1), (2.83, -0.5), (0.1, -1), (-0.1, -3)
"""Radius and conic constant of curves that exist between ends 8 mm apart."""


@pytest.mark.parametrize(
    "change",
    [
        {"camera/fov_deg": 360},
        {"camera/projection": "pinhole", "camera/fov_deg": 179.9},
        {"camera/lens": {"focal_length": 2, "f_number": 2.8, "focus": 2.001}},
        {"camera/projection": [0.1, 0, 0, 0]},
        {"camera/projection": [1e-300, 0, 0, 1e-300], "camera/fov_deg": 360},
        {"pads/0/name": "upper pad, inner side"},
        {"scene": {"bounces": 0}},
        {"scene": {"bounces": 6, "name": "Fräser, 2. Lage"}},
        *({"mirrors": [wall("m", radius=radius, conic=conic)]} for radius, conic in CURVES),
    ],
)
def test_what_is_possible_is_read(change):
    parse_scene(changed(scene(), change), "f.toml")


@pytest.mark.parametrize(
    ("coefficients", "limit_deg"),
    [
        # 1 + 3 k₁ θ² = 0 at θ = √(−1 / (3 k₁)), and 1 + 9 k₄ θ⁸ = 0 likewise.
        ([-1 / 3, 0, 0, 0], math.degrees(1)),
        ([0, 0, 0, -1 / 9], math.degrees(1)),
        # (1 − θ²)²: its slope is 0 at θ = 1, and positive before and beyond.
        ([-2 / 3, 1 / 5, 0, 0], math.degrees(1)),
        ([-1e30, 0, 0, 0], math.degrees(math.sqrt(1 / 3e30))),
    ],
)
def test_an_image_has_to_grow_over_all_of_the_field_of_view(coefficients, limit_deg):
    def with_view(degrees: float) -> dict[str, Any]:
        return scene(camera=CAMERA | {"projection": coefficients, "fov_deg": degrees})

    parse_scene(with_view(1.9999 * limit_deg), "f.toml")
    words = [f"grows only up to {limit_deg:.4g}°", f"keep fov_deg below {2 * limit_deg:.4g}"]
    check_refused(parse_scene, with_view(2.0001 * limit_deg), words)
