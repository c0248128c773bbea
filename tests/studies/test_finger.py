"""The study ``finger``: its files, its lines, and the whole of it."""

import tomllib

import jax.numpy as jnp
import numpy as np
import pytest

from designopt.cli import run as command
from designopt.study.runner import run_study
from kinematics import parse_linkage, solve_poses
from optics import find_coverage, parse_scene
from studies.finger.run import degrees_of_freedom
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


@pytest.mark.slow
def test_a_finger_that_is_too_thin_names_what_gave_way():
    results = run_study(
        "finger",
        {
            "body": {"thickness": 14},
            "linkage": {"search": {"starts": 4, "among": 4096, "exchanges": 1}, "draws": 100},
            "mirrors": {"search": {"starts": 1}},
            "yield_draws": 100,
            "spring": {"diameters": [40]},
        },
    )
    metrics = {metric.name: metric for metric in results.metrics}
    lines = next(table for table in results.tables if table.name == "table_3_1").rows
    missed = [str(row[0]) for row in lines if row[-1] == "no"]
    assert metrics["requirements_missed"].value == len(missed)
    assert metrics["requirements_missed"].met is False
    assert metrics["min_transmission_angle_deg"].value < 40
    assert "transmission angles" in missed
    assert all(name in results.findings[0] for name in missed)
    assert not any("k₂ = -" in line for line in results.findings)


@pytest.mark.parametrize(
    "name",
    [
        *("finger", "finger-linkage", "finger-mirrors", "finger-grasp"),
        *("object-size", "surface-profile"),
    ],
)
def test_fewer_digits_are_refused_at_once(tmp_path, capsys, name):
    assert command(["run", name, "--dtype", "float32", "--out", str(tmp_path / "out")]) == 2
    assert "needs float64; leave --dtype out" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
