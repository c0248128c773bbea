"""The study ``finger``: its files, its lines, and the whole of it."""

import json
import tomllib

import jax.numpy as jnp
import numpy as np
import pydantic
import pytest

from designopt.cli import run as command
from kinematics import parse_linkage, solve_poses
from optics import find_coverage, parse_scene
from studies.finger import FingerSpec
from studies.finger.run import degrees_of_freedom
from studies.models.body import BodySpec
from studies.models.mirror_design.judging import percent_at_least
from studies.models.spec_files import finger_files
from tests.studies.fingers import finger_of, seeing_finger


@pytest.fixture(scope="module")
def files():
    made = finger_files(seeing_finger())
    return {file.name: tomllib.loads(str(file.content)) for file in made}


def test_the_files_are_the_finger(files):
    joints = parse_linkage(files["linkage.toml"])
    crank = parse_linkage(files["linkage-crank.toml"])
    assert joints.input_names == ("pip", "dip")
    assert crank.input_names == ("theta", "gamma")
    assert float(crank.springs[0].stiffness) == 30.0
    there = solve_poses(joints, -jnp.deg2rad(jnp.array([50.0, 30.0]))).value
    theta = there.angle("crank")
    gamma = there.bodies["plate"].turned(there.bodies["distal"].conjugate()).angle()
    back = solve_poses(crank, jnp.stack([theta, gamma]))
    assert bool(back.ok)
    np.testing.assert_allclose(back.value.position("T"), there.position("T"), atol=1e-9)


def test_the_scene_file_shows_every_pad(files):
    scene = parse_scene(files["scene.toml"])
    poses = jnp.deg2rad(jnp.array([[0.0, 0.0], [45.0, 45.0], [90.0, 90.0]]))
    np.testing.assert_allclose(find_coverage(scene, poses).value, 1.0, atol=1e-9)


def test_degrees_of_freedom_by_kutzbach():
    """Paper B: seven links and eight revolute joints leave two."""
    assert degrees_of_freedom(finger_of()) == 2


def test_a_finger_without_room_for_its_camera_is_refused():
    with pytest.raises(pydantic.ValidationError, match="no room for the camera"):
        FingerSpec(body=BodySpec(thickness=9.0))


@pytest.mark.parametrize(
    ("body", "words"),
    [
        ({"thickness": 3.0}, "smaller than thickness"),
        ({"distal": 5.0}, "distal .* no room for a pad"),
        ({"axis_height": 12.0}, "intermediate .* no room for a pad"),
    ],
)
def test_impossible_bodies_are_refused(body, words):
    with pytest.raises(pydantic.ValidationError, match=words):
        BodySpec(**body)


def test_parts_are_rounded_down_to_percent():
    assert percent_at_least(1.0) == "100 %"
    assert percent_at_least(0.99999) == "99.99 %"


QUICK = [
    "linkage.search.starts=4",
    "linkage.search.among=4096",
    "linkage.search.exchanges=1",
    "linkage.draws=100",
    "mirrors.search.starts=1",
    "yield_draws=100",
    "spring.diameters=[40]",
]


@pytest.mark.slow
def test_a_finger_that_is_too_thin_says_what_gave_way(tmp_path):
    sets = [part for setting in (*QUICK, "body.thickness=14") for part in ("--set", setting)]
    assert command(["run", "finger", *sets, "--out", str(tmp_path / "thin")]) == 1
    document = json.loads((tmp_path / "thin" / "results.json").read_text(encoding="utf-8"))
    first = document["findings"][0]
    assert not any("k₂ = -" in line for line in document["findings"])
    assert "does not meet every requirement" in first
    assert "transmission angles (> 40° required" in first


@pytest.mark.parametrize("name", ["finger", "finger-linkage", "finger-mirrors", "finger-grasp"])
def test_fewer_digits_are_refused_at_once(tmp_path, capsys, name):
    assert command(["run", name, "--dtype", "float32", "--out", str(tmp_path / "out")]) == 2
    assert "needs float64; leave --dtype out" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
