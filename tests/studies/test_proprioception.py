"""The study ``proprioception``: a quick run end to end, and its pieces."""

import json
import math

import numpy as np
import pytest

from designopt import Records
from designopt.cli import run as command
from studies.proprioception.frames import spread_angles
from studies.proprioception.run import variance_over_predicted

QUICK = [
    "fingers=2",
    "frames=5",
    "gap_fingers=8",
    "cost_fingers=1",
    "sizes=[]",
]


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    out = tmp_path_factory.mktemp("quick") / "out"
    sets = [part for setting in QUICK for part in ("--set", setting)]
    code = command(["run", "proprioception", *sets, "--out", str(out)])
    return code, json.loads((out / "results.json").read_text(encoding="utf-8")), out


@pytest.mark.as_users
def test_a_quick_run_estimates_angles_by_every_method(done):
    code, document, _ = done
    measured = {name: metric["value"] for name, metric in document["metrics"].items()}
    assert code == 0  # targets do not apply to a run this small
    assert measured["labelled_mean_deg"] <= 0.5
    assert measured["unlabelled_mean_deg"] <= 0.75
    assert measured["known_finger_mean_deg"] < measured["labelled_mean_deg"]
    assert measured["known_finger_mean_deg"] < 0.1
    assert 0.5 < measured["gap_mean_deg"] < 4
    assert 0 < measured["gap_defined"] < 0.8


@pytest.mark.as_users
def test_the_table_stands_beside_the_papers(done):
    _, _, out = done
    lines = (out / "tables" / "ladder.csv").read_text(encoding="utf-8").splitlines()
    assert any(line.startswith('"paper B, Table 4.1",pip,30,,2.3,1.6') for line in lines)
    assert any(line.startswith('"paper B, Table 4.1",dip,30,,2.5,2.0') for line in lines)
    assert sum("labelled frames" in line for line in lines) == 2


def test_labelled_poses_cover_both_ranges_apart():
    poses = spread_angles([(0.0, 1.0), (2.0, 3.0)], 5)
    for column, low in zip(poses.T, (0.0, 2.0), strict=True):
        np.testing.assert_allclose(np.sort(column), low + np.linspace(0.1, 0.9, 5))
    # Two joints that always move together could not be told apart.
    assert abs(np.corrcoef(poses.T)[0, 1]) < 0.6


def test_the_variance_is_compared_where_there_is_an_angle():
    own = Records({"error_deg": [1.0, -3.0, math.nan], "deviation_deg": [0.5, 1.5, math.inf]})
    assert variance_over_predicted(own) == pytest.approx((1 + 9) / (0.25 + 2.25))
