"""Scenes written and read again."""

import tomllib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from optics import format_scene, parse_scene, read_scene, write_scene
from optics.scene.camera import CLASSICAL
from tests.helpers import SCENES, assert_same


@pytest.mark.parametrize("path", sorted(SCENES.glob("*.toml")), ids=lambda path: path.stem)
def test_the_gallery_is_read_back(path, tmp_path):
    scene = read_scene(path)
    write_scene(scene, tmp_path / "again.toml")
    assert_same(read_scene(tmp_path / "again.toml"), scene, 0, 0)


numbers = st.floats(-1e3, 1e3)
places = st.tuples(numbers, numbers).map(list)
sides = st.sampled_from(["left", "right", "both"])
NAMES = ("palm", "finger", "tip", "thumb")


@st.composite
def tables(draw) -> dict:
    """Scene files with frames in any order, hinged in each other in any way."""
    names = draw(st.permutations(NAMES))[: draw(st.integers(0, 4))]
    parents = {name: draw(st.sampled_from(["world", *names[:i]])) for i, name in enumerate(names)}
    frames = {
        name: {
            "hinge": draw(places),
            "parent": parents[name],
            "angle": draw(st.sampled_from("abc")),
            "positive": draw(st.sampled_from(["counterclockwise", "clockwise"])),
        }
        for name in draw(st.permutations(names))
    }
    bodies = st.sampled_from(["world", *names])

    def surface(name: str, **more) -> dict:
        start = draw(places)
        end = [start[0] + draw(st.floats(1.0, 50.0)), draw(numbers)]
        common = {"name": name, "from": start, "to": end, "side": draw(sides)}
        return {**common, "body": draw(bodies), **more}

    projection = draw(st.one_of(st.sampled_from([*CLASSICAL]), st.just([0.01, -0.002, 0.0, 0.0])))
    return {
        "scene": {"name": "drawn", "bounces": draw(st.integers(0, 3))},
        "camera": {
            "position": draw(places),
            "direction_deg": draw(st.floats(-360, 360)),
            "fov_deg": draw(st.floats(1, 170)),
            "pixels": draw(st.integers(1, 5000)),
            "projection": projection,
            "body": draw(bodies),
        },
        "mirrors": [
            surface(str(i), **({"radius": 1e4, "conic": draw(st.floats(-2, 1))} if curved else {}))
            for i, curved in enumerate(draw(st.lists(st.booleans(), max_size=2)))
        ],
        "pads": [surface("pad", min_grazing_deg=draw(st.floats(0, 89)))],
        "blockers": [surface("wall")] if draw(st.booleans()) else [],
        "frames": frames,
    }


@given(tables())
def test_what_is_written_is_read_back(drawn):
    scene = parse_scene(drawn, "drawn")
    text = format_scene(scene)
    again = parse_scene(tomllib.loads(text), "again")
    assert_same(again, scene, 0, 0)
    assert format_scene(again) == text


@pytest.mark.parametrize("focus", [21.0, 1e30])  # of the latter, the sensor is in the focal plane
def test_a_lens_comes_back_to_rounding(focus):
    lens = {"focal_length": 1.7, "f_number": 2.8, "focus": focus}
    camera = {"position": [0.0, 0.0], "direction_deg": 0.0, "fov_deg": 90.0, "pixels": 100}
    pads = [{"name": "pad", "from": [10.0, -1.0], "to": [10.0, 1.0]}]
    scene = parse_scene({"camera": camera | {"lens": lens}, "pads": pads}, "lens")
    again = parse_scene(tomllib.loads(format_scene(scene)), "again")
    assert_same(again, scene, atol=0)
