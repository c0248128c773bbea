"""The study ``proprioception``: a quick run end to end, and its pieces."""

import math

import numpy as np
import pytest

from designopt import Records
from studies.models.sensor.poses import spread_angles
from studies.proprioception.run import variance_over_predicted
from tests.studies.quick import half_as_high, quick_run


@pytest.mark.as_users
def test_a_quick_run_estimates_angles_by_every_method(tmp_path):
    done = quick_run("proprioception", tmp_path, *half_as_high(tmp_path))
    measured, ladder = done.measured, done.rows("ladder")
    assert measured["labelled_mean_deg"] <= 0.5
    assert measured["unlabelled_mean_deg"] <= 0.75
    assert measured["known_finger_mean_deg"] < min(measured["labelled_mean_deg"], 0.1)
    assert 0.5 < measured["gap_mean_deg"] < 4
    assert 0 < measured["gap_defined"] < 0.8
    paper = [row[1:6] for row in ladder if row[0] == "paper B, Table 4.1"]
    assert paper == [("pip", 30, "", 2.3, 1.6), ("dip", 30, "", 2.5, 2.0)]
    assert sum("labelled frames" in row[0] for row in ladder) == 2


def test_labelled_poses_cover_both_ranges_apart():
    poses = spread_angles([(0.0, 1.0), (2.0, 3.0)], 5)
    for column, low in zip(poses.T, (0.0, 2.0), strict=True):
        np.testing.assert_allclose(np.sort(column), low + np.linspace(0.1, 0.9, 5))
    # Two joints that always move together could not be told apart.
    assert abs(np.corrcoef(poses.T)[0, 1]) < 0.6


def test_the_variance_is_compared_where_there_is_an_angle():
    own = Records({"error_deg": [1.0, -3.0, math.nan], "deviation_deg": [0.5, 1.5, math.inf]})
    assert variance_over_predicted(own) == pytest.approx((1 + 9) / (0.25 + 2.25))
