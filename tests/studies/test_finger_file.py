"""The finger's file: what is written is read back, and what contradicts itself is refused."""

from __future__ import annotations

import json
import math
import shutil
import tomllib
from pathlib import Path

import jax
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from designopt import UserError, format_toml
from designopt.io.toml_writing import degrees_of
from kinematics import read_linkage
from optics import read_scene
from studies.models import format_finger, parse_finger, read_finger, write_finger
from studies.models.finger import camera_of, pins_of, spring_of
from studies.models.finger_file import bare_finger, packaged_finger
from studies.models.spec_files import finger_files
from tests.commands import refused_cases
from tests.helpers import assert_same
from tests.studies.fingers import OLD

TEXT = format_finger(bare_finger()).replace('name = "finger"', 'name = "mine"')


def table() -> dict:
    return tomllib.loads(TEXT)


def test_every_number_is_where_it_belongs():
    finger, written = parse_finger(table(), "mine.toml"), table()
    assert finger.name == "mine"
    assert (float(finger.body.proximal), float(finger.body.flexion)) == (35.0, math.pi / 2)
    assert pins_of(finger).H.tolist() == written["pins"]["G'"]
    assert float(camera_of(finger).tilt) == math.radians(written["camera"]["tilt_deg"])
    for mirror, own in zip(finger.mirrors, written["mirrors"], strict=True):
        assert (mirror.phalanx, mirror.ends.tolist()) == (own["phalanx"], [own["from"], own["to"]])
    # The distal one's ends from PIP, and above the axes.
    [[x, depth], _] = finger.mirrors[0].ends.tolist()
    np.testing.assert_allclose(finger.scene().mirrors[0, 0], [23 + x, 21 - depth], atol=1e-12)


lengths = st.floats(12.0, 60.0)
places = st.tuples(st.floats(-60.0, 60.0), st.floats(-60.0, 60.0)).map(list)
angles = st.one_of(st.floats(2.0, 100.0), st.integers(20, 1000).map(lambda tenths: tenths / 10))


@st.composite
def tables(draw) -> dict:
    drawn = table()
    drawn["body"] |= {name: draw(lengths) for name in ("proximal", "intermediate", "distal")}
    drawn["body"]["range_deg"] = draw(angles)
    drawn["pins"] = {pin: draw(places) for pin in drawn["pins"]}
    drawn["camera"] |= {"tilt_deg": draw(st.floats(-90, 90)), "fov_deg": draw(angles)}
    for mirror in drawn["mirrors"]:
        mirror |= {"from": draw(places), "to": draw(places)}
    for part in ("pins", "spring", "camera", "mirrors"):
        if draw(st.booleans()):
            del drawn[part]
    return drawn


@given(tables())
def test_what_is_written_is_read_back(drawn):
    finger = parse_finger(drawn, "drawn")
    text = format_finger(finger)
    again = parse_finger(tomllib.loads(text), "again")
    assert_same(finger, again, rtol=0, atol=0)
    assert format_finger(again) == text


@given(st.floats(-360, 360))
def test_degrees_give_their_angle_back(degrees):
    angle = math.radians(degrees)
    assert math.radians(degrees_of(angle)) == angle
    assert len(repr(degrees_of(angle))) <= len(repr(degrees))


def test_a_file_is_written_and_read(tmp_path):
    path = tmp_path / "finger.toml"
    path.write_text(TEXT.replace('name = "mine"\n', ""))
    finger = read_finger(path)
    assert finger.name == "finger"
    write_finger(finger, tmp_path / "again.toml")
    assert_same(finger, read_finger(tmp_path / "again.toml"), rtol=0, atol=0)


@pytest.mark.parametrize(("change", "message"), refused_cases("finger_files"))
def test_faults_are_one_line(tmp_path, change, message):
    path = tmp_path / "finger.toml"
    path.write_text(TEXT.replace(*change))
    with pytest.raises(UserError) as caught:
        read_finger(path)
    assert message in str(caught.value)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)


@pytest.fixture
def specs(tmp_path) -> Path:
    """The folder of an earlier result."""
    folder = tmp_path / "specs"
    folder.mkdir()
    for name in ("linkage.toml", "scene.toml"):
        shutil.copy(OLD / name, folder)
    return folder


def test_an_earlier_result_is_a_finger(specs):
    finger = read_finger(specs)
    assert_same(finger.scene(), read_scene(specs / "scene.toml"))
    assert_same(finger.linkage(), read_linkage(specs / "linkage.toml"))
    assert finger.spring is None
    assert degrees_of(float(finger.body.flexion)) == 90.0
    spring = {"stiffness": 1, "preload": 2, "servo": 3, "diameters": [20.0]}
    spec = {"body": {"range_deg": 80.0}, "spring": spring}
    (specs.parent / "results.json").write_text(json.dumps({"study": "finger", "spec": spec}))
    finger = read_finger(specs)
    assert float(spring_of(finger).servo) == 3.0
    assert degrees_of(float(finger.body.flexion)) == 80.0


def test_what_contradicts_itself_is_named(specs):
    path = specs / "scene.toml"
    scene = tomllib.loads(path.read_text(encoding="utf-8"))

    def refused(message: str) -> None:
        path.write_text(format_toml(scene))
        with pytest.raises(UserError, match=message):
            read_finger(specs)

    scene["pads"][1]["to"][0] += 1.0
    refused(r"scene\.toml: pads differs by 1 from what body, pins, ")
    scene["pads"][1]["to"][0] -= 1.0
    scene["frames"]["distal"]["hinge"][0] += 0.5
    refused(r"scene\.toml: hinges differs by 0\.5 from what body, ")
    scene["pads"].pop(0)
    refused("it lacks 'proximal', so that it is no finger; name the ")


def test_the_bare_finger_sees_as_that_of_the_old_result():
    old, new = read_finger(OLD), bare_finger()
    assert_same(jax.tree.leaves(old.scene()), jax.tree.leaves(new.scene()))


def test_a_new_result_is_read_by_its_finger_file(tmp_path):
    for file in finger_files(packaged_finger()):
        (tmp_path / file.name).write_text(str(file.content), encoding="utf-8")
    assert_same(read_finger(tmp_path), packaged_finger(), rtol=0, atol=0)
