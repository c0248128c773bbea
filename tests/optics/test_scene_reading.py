"""From a file to a scene: numbers, names and frames find their places, or one line says why."""

from __future__ import annotations

import math
import tomllib
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from designopt import UserError
from optics import parse_scene, read_scene
from optics.scene.camera import Camera, Equidistant, KannalaBrandt, Pinhole
from optics.scene.scene import WORLD, Frame, Scene, Surface, place

GALLERY = Path(__file__).parents[2] / "studies/gallery/scenes"
CAMERA = {"position": [3, 4], "direction_deg": -90, "fov_deg": 120, "pixels": 640}


def wall(name: str, x: float = 10, **more: Any) -> dict[str, Any]:
    return {"name": name, "from": [x, 0], "to": [x, 8], **more}


def frame(angle: str, parent: str = "world", **more: Any) -> dict[str, Any]:
    return {"hinge": [0, 0], "angle": angle, "parent": parent, **more}


def scene(**tables: Any) -> dict[str, Any]:
    return {"camera": CAMERA, "pads": [wall("pad")], **tables}


def said_of(data: dict[str, Any]) -> str:
    with pytest.raises(UserError) as raised:
        parse_scene(data, "f.toml")
    said = str(raised.value)
    assert said.startswith("f.toml: ")
    assert said.isprintable()
    return said


def turned(place: Any, hinge: Any, angle: float) -> np.ndarray:
    """A place turned about a hinge, by a rotation matrix."""
    matrix = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    return matrix @ (np.asarray(place, float) - hinge) + hinge


def placed_ends(scene: Scene, **degrees: float) -> np.ndarray:
    """Ends of all surfaces in a pose, mm, shape (surfaces, 2, 2)."""
    pose = scene.pose({name: math.radians(angle) for name, angle in degrees.items()})
    placed = place(scene, pose)
    ends = (placed.absolute(placed.starts), placed.absolute(placed.ends))
    return np.stack([np.asarray(end.stacked()) for end in ends], axis=1)


def test_numbers_arrive_in_mm_and_radians():
    found = parse_scene(
        scene(
            mirrors=[
                wall("flat", 1),
                wall("bowl", 2, radius=-50, conic=-1),
                wall("arc", 3, radius=9),
            ],
            pads=[wall("a", 4, min_grazing_deg=30), wall("b", 5)],
            blockers=[wall("c", 6)],
            frames={"f": frame("t") | {"hinge": [7, 8]}},
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


def test_an_empty_kind_has_its_shape():
    found = parse_scene(scene())
    assert found.mirrors.shape == found.blockers.shape == (0, 2, 2)
    assert found.radii.shape == found.conics.shape == (0,)
    assert found.hinges.shape == (0, 2)
    assert found.angle_names == ()


@pytest.mark.parametrize("x64", [True, False])
def test_arrays_have_the_default_float_type(x64):
    before = jax.config.read("jax_enable_x64")
    jax.config.update("jax_enable_x64", x64)
    try:
        found = read_scene(GALLERY / "finger.toml")
        kinds = {leaf.dtype for leaf in jax.tree.leaves(found)}
    finally:
        jax.config.update("jax_enable_x64", before)
    assert kinds == {jnp.dtype("float64" if x64 else "float32")}


@pytest.mark.parametrize(
    ("projection", "kind"),
    [
        ({}, Equidistant),
        ({"projection": "equidistant"}, Equidistant),
        ({"projection": "pinhole"}, Pinhole),
        ({"projection": [0.1, 0, 0, 0]}, KannalaBrandt),
    ],
)
def test_projections(projection, kind):
    found: Camera = parse_scene(scene(camera=CAMERA | projection)).camera
    assert type(found.projection) is kind
    heights = {
        Equidistant: math.radians(30),
        Pinhole: math.tan(math.radians(30)),
        KannalaBrandt: math.radians(30) + 0.1 * math.radians(30) ** 3,
    }
    height = float(found.projection.height(jnp.radians(jnp.array(30.0))))
    assert height == pytest.approx(heights[kind], rel=1e-15)


def test_a_lens_is_in_focus_where_the_file_says():
    lens = {"focal_length": 2.8, "f_number": 2, "focus": 25}
    found = parse_scene(scene(camera=CAMERA | {"lens": lens})).camera.lens
    assert found is not None
    assert float(found.focal_length) == 2.8
    assert float(found.aperture) == 1.4
    assert float(found.focus_vergence().value) == pytest.approx(1 / 25, rel=1e-14)
    assert float(found.image(25.0).value.blur_diameter) == pytest.approx(0, abs=1e-15)


@pytest.mark.parametrize(
    ("mirrors", "wanted"),
    [
        ([], 0),
        ([wall("a")], 1),
        ([wall("a"), wall("b")], 2),
        ([wall("a"), wall("b"), wall("c")], 2),
        ([wall("a", radius=10)], 2),
    ],
)
def test_most_bounces_follow_from_the_mirrors(mirrors, wanted):
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
        "tip": frame("third", "middle"),
        "middle": frame("second", "base"),
        "other": frame("third"),
        "base": frame("first"),
    }
    found = parse_scene(scene(frames=frames))
    assert found.angle_names == ("third", "second", "first")
    assert [part.name for part in found.layout.frames] == ["other", "base", "middle", "tip"]
    assert [part.parent for part in found.layout.frames] == [WORLD, WORLD, 1, 2]
    assert [part.angle for part in found.layout.frames] == [0, 2, 1, 0]


def test_a_flexed_finger_is_where_rotations_put_it():
    finger = read_scene(GALLERY / "finger.toml")
    data = tomllib.loads((GALLERY / "finger.toml").read_text(encoding="utf-8"))
    tables = [*data["mirrors"], *data["pads"], *data["blockers"]]
    # Flexion turns the tip down: clockwise on the right, counter-clockwise on the left.
    turns = {"distal": ([23, 0], -40), "proximal": ([0, 0], 70), None: ([0, 0], 0)}
    wanted = []
    for part in tables:
        hinge, degrees = turns[part.get("body")]
        wanted.append([turned(part[end], hinge, math.radians(degrees)) for end in ("from", "to")])
    np.testing.assert_allclose(placed_ends(finger, pip=70, dip=40), wanted, atol=1e-12)


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

    def moved(point: Any, turns: int) -> np.ndarray:
        """Turned about the hinges of the first frames of the chain, the innermost first."""
        chain = [([10, 0], -a), ([20, 5], a), ([20, 5], b)][:turns]
        for hinge, angle in reversed(chain):
            point = turned(point, hinge, angle)
        return point

    wanted = [[moved([10, 0], i), moved([10, 8], i)] for i in (1, 2, 3)]
    np.testing.assert_allclose(placed_ends(found, a=25, b=-60), wanted, atol=1e-12)
    placed = place(found, found.pose({"a": a, "b": b}))
    np.testing.assert_allclose(
        placed.absolute(placed.camera).stacked(), moved([3, 4], 3), atol=1e-12
    )
    # The first two turns cancel, so the optical axis turns by the third alone.
    assert float(placed.axis.angle()) == pytest.approx(-math.pi / 2 + b)


@pytest.mark.parametrize(
    ("tables", "words"),
    [
        ({"pads": []}, ["pads: there is nothing to see; add a pad, a mirror or a blocker"]),
        ({"pads": [wall("a"), wall("a")]}, ["pads: 2 are named 'a'; give each its own name"]),
        ({"mirrors": [wall("a"), wall("a"), wall("a")]}, ["mirrors: 3 are named 'a'"]),
        ({"blockers": [wall("a"), wall("a")]}, ["blockers: 2 are named 'a'"]),
        (
            {"pads": [wall("a"), wall("b", body="f")]},
            ["pads.1.body: no frame is named 'f'; there are: world; take one", "add [frames.f]"],
        ),
        (
            {"frames": {"distal": frame("t")}, "mirrors": [wall("a", body="distl")]},
            ["mirrors.0.body: no frame is named 'distl'; did you mean 'distal'?"],
        ),
        (
            {"frames": {"distal": frame("t")}, "camera": CAMERA | {"body": "Distal"}},
            ["camera.body: no frame is named 'Distal'; did you mean 'distal'?"],
        ),
        (
            {"frames": {"distal": frame("t", "wrld")}},
            ["frames.distal.parent: no frame is named 'wrld'; did you mean 'world'?"],
        ),
        (
            {"frames": {"world": frame("t")}},
            ["frames.world: 'world' is what does not move; choose another name"],
        ),
        (
            {"frames": {"a": frame("t", "a")}},
            ["frames.a.parent: 'a' in 'a': frames cannot hold each other; hinge one of them"],
        ),
        (
            {
                "frames": {
                    "d": frame("t", "b"),
                    "a": frame("t", "b"),
                    "b": frame("t", "c"),
                    "c": frame("t", "a"),
                }
            },
            ["frames.a.parent: 'a' in 'b' in 'c' in 'a': frames cannot hold each other"],
        ),
    ],
)
def test_what_makes_no_scene_is_told_with_its_key_and_cure(tables, words):
    said = said_of(scene(**tables))
    for word in words:
        assert word in said
    assert said.count(";") <= 2  # one fault


def test_all_faults_are_told_at_once():
    said = said_of(
        scene(
            mirrors=[wall("a"), wall("a", body="f")],
            pads=[wall("p", body="g")],
            frames={"h": frame("t", "k"), "x": frame("t", "y"), "y": frame("t", "x")},
        )
    )
    for word in ("2 are named", "'f'", "'g'", "'k'", "'x' in 'y' in 'x'"):
        assert word in said
    assert said.count("cannot hold each other") == 1


def test_names_are_unique_within_a_kind_only():
    found = parse_scene(scene(mirrors=[wall("a")], pads=[wall("a")], blockers=[wall("a")]))
    assert [part.name for part in found.layout.surfaces] == ["a", "a", "a"]


def test_a_scene_may_be_mirrors_alone():
    found = parse_scene(scene(pads=[], mirrors=[wall("a")]))
    assert found.layout.pads == ()


def test_files_and_tables_give_the_same_scene(tmp_path):
    path = tmp_path / "f.toml"
    path.write_bytes(b"\xef\xbb\xbf" + (GALLERY / "finger.toml").read_bytes())
    from_file = read_scene(path)
    tables = tomllib.loads((GALLERY / "finger.toml").read_text(encoding="utf-8"))
    from_tables = parse_scene(tables)
    assert from_file.layout == from_tables.layout
    for one, other in zip(jax.tree.leaves(from_file), jax.tree.leaves(from_tables), strict=True):
        np.testing.assert_array_equal(one, other)


def test_what_is_no_scene_file_is_told(tmp_path):
    path = tmp_path / "f.toml"
    with pytest.raises(UserError, match="cannot be read"):
        read_scene(path)
    path.write_text("[camera]\nposition = ")
    with pytest.raises(UserError, match="not TOML"):
        read_scene(path)
    path.write_text("")
    with pytest.raises(UserError, match="camera: missing; add it"):
        read_scene(path)
    path.write_text("a = " + "[" * 5000 + "]" * 5000)
    with pytest.raises(UserError, match="nested too deeply for a scene"):
        read_scene(path)
