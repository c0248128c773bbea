"""The form of a scene file: whatever is wrong with it is said at once, in words of the file."""

from __future__ import annotations

import copy
import math
from typing import Any

import pytest

from designopt import UserError
from designopt.io.spec_files import validated
from optics.scene.file import MirrorTable, SceneFile


def tables() -> dict[str, Any]:
    return {
        "camera": {"position": [0, 0], "direction_deg": 0, "fov_deg": 90, "pixels": 100},
        "mirrors": [{"name": "m", "from": [10, 0], "to": [10, 8]}],
        "pads": [{"name": "p", "from": [1, 2], "to": [3, 4]}],
        "blockers": [{"name": "b", "from": [5, 6], "to": [7, 8]}],
        "frames": {"f": {"hinge": [0, 0], "angle": "a"}},
    }


def changed(*changes: tuple[str, Any]) -> dict[str, Any]:
    """The tables with entries replaced, or removed where the value is ``...``."""
    data = copy.deepcopy(tables())
    for path, value in changes:
        *places, last = [int(part) if part.isdigit() else part for part in path.split("/")]
        table: Any = data
        for place in places:
            table = table[place]
        if value is ...:
            del table[last]
        else:
            table[last] = value
    return data


def read(*changes: tuple[str, Any]) -> SceneFile:
    return validated(SceneFile, changed(*changes), "f.toml")


def said_of(*changes: tuple[str, Any]) -> str:
    with pytest.raises(UserError) as raised:
        read(*changes)
    said = str(raised.value)
    assert said.startswith("f.toml: ")
    assert said.isprintable()
    return said


def test_what_is_left_out_has_a_default():
    file = read()
    assert file.scene.name is None
    assert file.scene.bounces is None
    assert (file.camera.projection, file.camera.body, file.camera.lens) == (
        "equidistant",
        "world",
        None,
    )
    (mirror,), (pad,), (blocker,), frame = file.mirrors, file.pads, file.blockers, file.frames["f"]
    assert (mirror.start, mirror.end) == ((10, 0), (10, 8))
    assert (mirror.side, mirror.body, mirror.radius, mirror.conic) == ("both", "world", None, None)
    assert (pad.side, pad.body, pad.min_grazing_deg) == ("both", "world", 0)
    assert (blocker.side, blocker.body) == ("both", "world")
    assert (frame.parent, frame.positive) == ("world", "counterclockwise")


def test_only_the_camera_must_be_there():
    file = validated(SceneFile, {"camera": tables()["camera"]}, "f.toml")
    assert (file.mirrors, file.pads, file.blockers, file.frames) == ([], [], [], {})


@pytest.mark.parametrize(
    "change",
    [
        ("camera/fov_deg", 360),
        ("camera/projection", [0.1, 0, 0, 0]),
        ("camera/lens", {"focal_length": 2, "f_number": 2.8, "focus": 2.001}),
        ("pads/0/name", "upper pad, inner side"),
        ("mirrors/0/radius", -4.001),
        ("scene", {"bounces": 0}),
        ("scene", {"bounces": 6, "name": "Fräser, 2. Lage"}),
    ],
)
def test_what_is_possible_is_read(change):
    read(change)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("camera", ...), ["camera: missing; add it"]),
        (("camera/position", ...), ["camera.position: missing; add it"]),
        (("camera/position", 3), ["camera.position: write it as two numbers, [x, y] (it is 3)"]),
        (("camera/direction", 3), ["camera.direction: no such key; did you mean 'direction_deg'?"]),
        (("camera/fov_deg", 0), ["camera.fov_deg", "greater than 0 (it is 0); correct it"]),
        (("camera/fov_deg", 361), ["camera.fov_deg", "equal to 360 (it is 361); correct it"]),
        (("camera/pixels", 0), ["camera.pixels", "equal to 1 (it is 0); correct it"]),
        (("camera/pixels", 10.5), ["camera.pixels", "integer (it is 10.5); correct it"]),
        (("camera/pixels", 10**7), ["camera.pixels", "equal to 1000000"]),
        (("camera/projection", "fisheye"), ["camera.projection: write it as", '"equidistant"']),
        (("camera/projection", [1, 2, 3]), ["camera.projection: write it as", "[k1, k2, k3, k4]"]),
        (("camera/lens", 3), ["camera.lens: write it as a table, { … } (it is 3)"]),
        (("camera/lens", {}), ["camera.lens.focal_length: missing", "f_number: missing", "focus"]),
        (
            ("camera/lens", {"focal_length": 0, "f_number": -1, "focus": math.inf}),
            ["focal_length: a length must be positive", "f_number: a length", "focus: write a fin"],
        ),
        (
            ("camera/lens", {"focal_length": 2, "f_number": 2, "focus": 2}),
            ["camera.lens: what lies within the focal length is never in focus; make 'focus'"],
        ),
        (("scene", {"bounces": 7}), ["scene.bounces", "equal to 6 (it is 7); correct it"]),
        (("scene", {"bounces": -1}), ["scene.bounces", "equal to 0 (it is -1); correct it"]),
        (("scene", {"bounces": 1.5}), ["scene.bounces", "integer (it is 1.5)"]),
        (("scene", {"bounces": "2"}), ["scene.bounces", "integer (it is '2')"]),
        (("mirrors", {}), ["mirrors: write each as a table of its own, [[mirrors]]"]),
        (("mirrors/0/name", "a+b"), ["mirrors.0.name: '+' and ':'", "choose another name"]),
        (("mirrors/0/name", "a:b"), ["mirrors.0.name: '+' and ':'", "choose another name"]),
        (("pads/0/name", " "), ["pads.0.name: a name must not be blank", "choose another"]),
        (("pads/0/name", "a\n"), ["pads.0.name", "printed; choose another"]),
        (("pads/0/name", 5), ['pads.0.name: write it as text in quotes, "…" (it is 5)']),
        (("pads/0/from", ...), ["pads.0.from: missing; add it"]),
        (("pads/0/from", [0]), ["pads.0.from.1: missing"]),
        (("pads/0/to", [0, "1"]), ["pads.0.to.1: write a finite number, without quotes"]),
        (("pads/0/to", [1, 2]), ["pads.0: it has no length; move 'from' or 'to'"]),
        (("mirrors/0/to", [10, 0]), ["mirrors.0: it has no length; move 'from' or 'to'"]),
        (("blockers/0/to", [5, 6]), ["blockers.0: it has no length; move 'from' or 'to'"]),
        (("blockers/0/side", "up"), ["blockers.0.side", "'left', 'right' or 'both' (it is 'up')"]),
        (("blockers/0/radius", 3), ["blockers.0.radius: no such key; remove it"]),
        (("pads/0/min_grazing_deg", -1), ["pads.0.min_grazing_deg", "equal to 0 (it is -1)"]),
        (("pads/0/min_grazing_deg", 90), ["pads.0.min_grazing_deg", "less than 90 (it is 90)"]),
        (("pads/0/body", "a b"), ["pads.0.body: a name must not be empty or hold blanks"]),
        (("frames/f/angle", "a=b"), ["frames.f.angle: a name must not be empty or hold blanks"]),
        (("frames/f/hinge", ...), ["frames.f.hinge: missing; add it"]),
        (("frames/f/positive", "cw"), ["frames.f.positive", "'clockwise' (it is 'cw'); correct"]),
        (("frames/a b", {}), ["frames.a b: a name must not be empty or hold blanks"]),
        (("frame", {}), ["frame: no such key; did you mean 'frames'?"]),
    ],
)
def test_wrong_forms_are_told_with_their_key_and_cure(change, words):
    said = said_of(change)
    for word in words:
        assert word in said


def test_all_faults_are_told_at_once():
    said = said_of(("camera/fov_deg", 0), ("pads/0/to", [1, 2]), ("mirrors/0/conic", 1), ("x", 1))
    for word in ("camera.fov_deg", "pads.0: it has no length", "mirrors.0: 'conic'", "x: no such"):
        assert word in said


def test_a_pinhole_camera_sees_less_than_half_of_the_plane():
    pinhole = ("camera/projection", "pinhole")
    read(pinhole, ("camera/fov_deg", 179.9))
    said = said_of(pinhole, ("camera/fov_deg", 180))
    assert "camera: a pinhole camera sees less than 180° (fov_deg is 180); narrow it" in said


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
    projection = ("camera/projection", coefficients)
    read(projection, ("camera/fov_deg", 1.9999 * limit_deg))
    said = said_of(projection, ("camera/fov_deg", 2.0001 * limit_deg))
    assert f"camera: with these coefficients the image grows only up to {limit_deg:.4g}°" in said
    assert f"keep fov_deg below {2 * limit_deg:.4g}, or correct 'projection'" in said


@pytest.mark.parametrize("coefficients", [[0, 0, 0, 0], [1, 1, 1, 1], [1e-300, 0, 0, 1e-300]])
def test_an_image_that_always_grows_has_no_limit(coefficients):
    read(("camera/projection", coefficients), ("camera/fov_deg", 360))


@pytest.mark.parametrize(
    ("radius", "conic", "words"),
    [
        (4, 0, "longer than 4 mm, or move them together"),  # half of the chord
        (-3.9, 0, "longer than 4 mm"),
        (5.6, 1, "longer than 5.65685 mm"),
        (2.8, -0.5, "longer than 2.82843 mm"),
        (0, 0, "a radius of 0 mm does not fit a mirror 8 mm long; correct it, or leave it out"),
        (1e10, 0, "a radius of 1e+10 mm does not fit"),
        (-1e-10, -1, "a radius of -1e-10 mm does not fit"),
        (None, -1, "mirrors.0: 'conic' is the form of a curved mirror; add 'radius'"),
    ],
)
def test_curves_that_do_not_exist_are_told(radius, conic, words):
    entries = {"radius": radius, "conic": conic}
    changes = [(f"mirrors/0/{key}", value) for key, value in entries.items() if value is not None]
    said = said_of(*changes)
    assert "mirrors.0: " in said
    assert words in said


@pytest.mark.parametrize(("radius", "conic"), [(5.7, 1), (2.83, -0.5), (0.1, -1), (-0.1, -3)])
def test_curves_that_exist_are_read(radius, conic):
    mirror = read(("mirrors/0/radius", radius), ("mirrors/0/conic", conic)).mirrors[0]
    assert isinstance(mirror, MirrorTable)
    assert (mirror.radius, mirror.conic) == (radius, conic)
