"""The study ``bending-posture``: a quick run end to end, and its pieces."""

import dataclasses
import json
import math
from pathlib import Path

import numpy as np
import pytest

from designopt.cli import run as command
from perception.chamber import Sight
from perception.posture import PostureEstimator, find_posture
from studies.bending_posture.spec import BendingPostureSpec
from studies.bending_posture.trainings import data_of, fewer, label_scale, regularisations, size_of
from studies.chamber_images.making import DOWN, SoftFinger
from studies.chamber_images.odd import KINDS, odd_pictures
from studies.chamber_images.samples import MARKERS, marker_places

QUICK = [
    "samples=300",
    "unseen=60",
    "epochs=12",
    "seeds=1",
    "width=32",
    "widths=[32]",
    "counts=[100,300]",
    "etas=[]",
    "sweep=false",
]


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    out = tmp_path_factory.mktemp("quick") / "out"
    sets = [part for setting in QUICK for part in ("--set", setting)]
    code = command(["run", "bending-posture", *sets, "--out", str(out)])
    return code, json.loads((out / "results.json").read_text(encoding="utf-8")), out


@pytest.fixture(scope="module")
def finger():
    return SoftFinger.of(BendingPostureSpec())


def test_a_quick_run_reads_postures(done):
    code, document, out = done
    assert code == 0
    measured = {name: metric["value"] for name, metric in document["metrics"].items()}
    assert measured["tip_seed_0_mm"] < measured["mean_predictor_mm"] / 8
    assert measured["odd_failures"] == 0
    assert measured["unanswered"] == 0
    assert measured["raw_images_ratio"] > 1
    assert measured["paper_regularisation_ratio"] > 1
    for name in ("pictures", "dots", "markers", "learning", "ways", "bends", "precision"):
        assert (out / "figures" / f"{name}.png").stat().st_size > 5000


def test_the_network_of_a_run_is_loaded_and_reads_a_new_frame(done, finger):
    _, document, out = done
    assert document["specs"] == ["specs/posture.network"]
    estimator = PostureEstimator.load(Path(out / "specs" / "posture.network"))
    assert estimator.record.samples == 300
    bend = np.deg2rad([50.0])
    image = finger.renderer(7).render(finger.postures(bend, np.array([DOWN])))[0]
    seen = find_posture(image.pixels, estimator)
    assert seen.sight is Sight.CHAMBER
    assert seen.markers is not None
    off = np.linalg.norm(seen.markers[-1] - marker_places(bend, finger.length)[0, -1])
    assert off < 8  # mm: of a network that saw 300 images twelve times


def test_frames_without_a_chamber_have_no_posture(done, finger):
    estimator = PostureEstimator.load(Path(done[2] / "specs" / "posture.network"))
    postures = finger.postures(np.deg2rad([20.0]), np.array([DOWN]))
    for kind, _, picture in odd_pictures(finger, postures, seed=1):
        seen = find_posture(picture, estimator)
        assert seen.sight is kind.sight, kind.name
        assert (seen.markers is not None) is kind.usable, kind.name
    assert {kind.sight for kind in KINDS} == set(Sight)


@pytest.mark.parametrize("degrees", [0.0, 0.01, 60.0, 120.0])
def test_markers_lie_on_a_circle_of_the_bend(degrees):
    bend, length = math.radians(degrees), 100.0
    found = marker_places(np.array([bend]), length)[0]
    # The tangent summed over a thousand pieces, by the rule of midpoints.
    pieces = np.arange(1000) / 1000 * length + length / 2000
    tangents = np.stack([np.sin(bend * pieces / length), np.cos(bend * pieces / length)], axis=1)
    places = np.concatenate([[[0, 0]], np.cumsum(tangents * length / 1000, axis=0)])
    at = places[[round(1000 * share) for share in MARKERS]]
    np.testing.assert_allclose(found, at[1:] - at[0], atol=1e-4)


def test_samples_are_the_same_for_every_finger_but_for_the_picture(finger):
    spec = BendingPostureSpec(unseen=50)
    other = SoftFinger.of(BendingPostureSpec(eta=0.9))
    one, two = (data_of(spec, which, 50, [32], seed=3) for which in (finger, other))
    np.testing.assert_array_equal(one.labels, two.labels)
    np.testing.assert_array_equal(one.unseen.markers, two.unseen.markers)
    size = size_of(32)
    assert not np.array_equal(one.train.images[size], two.train.images[size])
    off = one.labels - one.train.markers
    assert np.std(off) == pytest.approx(spec.label_noise, rel=0.15)  # of 300 numbers
    half = fewer(one, 25)
    np.testing.assert_array_equal(half.train.images[size], one.train.images[size][:25])
    np.testing.assert_array_equal(half.labels, one.labels[:25])
    assert half.mean_error == pytest.approx(
        np.mean(np.linalg.norm(one.unseen.markers[:, 2] - one.labels[:25, 2].mean(axis=0), axis=1))
    )


def test_the_papers_regularisation_goes_with_the_square_of_its_unit(finger):
    spec = BendingPostureSpec(unseen=50)
    data = data_of(spec, finger, 50, [32], seed=3)
    scale, at = label_scale(data), regularisations(data, 100.0)
    assert at["standardised"] == 0.01
    assert at["mm"] * scale**2 == pytest.approx(0.01)
    longer = dataclasses.replace(data, labels=2 * data.labels)
    again = regularisations(longer, 200.0)
    assert again["finger lengths"] == pytest.approx(at["finger lengths"])
    assert again["mm"] == pytest.approx(at["mm"] / 4)


@pytest.mark.parametrize("setting", ["widths=[32,32]", "samples=3", "largest_bend_deg=200"])
def test_settings_out_of_range_are_one_line(setting, tmp_path, capsys):
    out = tmp_path / "out"
    assert command(["run", "bending-posture", "--set", setting, "--out", str(out)]) == 2
    assert setting.split("=")[0] in capsys.readouterr().err
    assert not out.exists()
