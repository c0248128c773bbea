"""The study ``tactile-images``: a quick run end to end, and its pieces."""

import re
from importlib.resources import files

import cv2
import numpy as np
import pytest

from designopt import Records, Report, UserError
from designopt.cli import run as command
from optics import read_scene
from optics.rendering import Effects
from optics.rendering.effects import SOFT
from studies.models.one_thread import one_thread
from studies.models.sensor.finger_sensor import FingerSensor
from studies.models.sensor.imaged import designed
from studies.models.sensor.spec import FingerImagesSpec
from studies.tactile_images import TactileImagesSpec
from studies.tactile_images.corrupted import ANSWERS, CORRUPTIONS, is_wrong
from studies.tactile_images.figures import draw_imprints
from studies.tactile_images.run import Measured, add_tables, independent_effects, nearest_errors
from tests.helpers import DATA
from tests.studies.quick import half_as_high, quick_run

OLD = DATA / "old_specs" / "scene.toml"
"""The packaged finger's scene, as a result of an earlier version has it."""


@pytest.fixture(scope="module")
def finger(tmp_path_factory):
    """A finger whose distal pad has an odd name and is in no mirror."""
    text, path = OLD.read_text(encoding="utf-8"), tmp_path_factory.mktemp("scene") / "odd.toml"
    start, end = (match.start() for match in re.finditer(r"\[\[mirrors\]\]", text))
    text = text[:start] + text[end:].replace('name = "distal"', r"name = '$\frac{$'")
    path.write_text(text, encoding="utf-8")
    return FingerSensor.of(FingerImagesSpec(scene=str(path)), 360)


@pytest.mark.slow
def test_a_quick_run_finds_what_can_be_found(tmp_path):
    """All images are of one size, so that it is compiled once."""
    sets = (*half_as_high(tmp_path), "corrupted_rows=540", "sizes=[540]")
    done = quick_run("tactile-images", tmp_path, *sets)
    measured, corrupted = done.measured, done.table("corrupted")
    assert measured["found_at_gain_1"] >= 0.95
    assert measured["found_independent"] >= 0.9
    assert measured["corner_median_px"] <= 1
    assert measured["corner_p90_px"] <= 2.5
    assert measured["unwarp_p90_mm"] <= 0.3 < measured["affine_unwarp_p90_mm"]
    assert measured["corner_median_px"] < measured["paper_corner_median_px"]
    assert measured["corrupted_failures"] == 0
    assert corrupted["kind"] == list(CORRUPTIONS)
    assert not any(corrupted["exceptions"])


@pytest.mark.parametrize(
    ("expected", "answer", "wrong"),
    [
        ("undefined", {}, False),
        ("undefined", {"refused": True}, True),
        ("undefined", {"with_complete_views": True}, True),
        ("undefined", {"with_angles": True}, True),
        ("any", {"with_complete_views": True, "with_angles": True}, False),
        ("any", {"exceptions": True}, True),
        ("refused", {"refused": True}, False),
        ("refused", {}, True),
    ],
)
def test_what_is_no_image_is_to_be_refused_and_an_image_is_not(expected, answer, wrong):
    row = dict.fromkeys(ANSWERS, False) | answer
    assert is_wrong(Records({"expected": expected, **row})).tolist() == [wrong]


def test_the_packaged_scene_is_the_default():
    scene = designed("")
    np.testing.assert_allclose(scene.mirrors, read_scene(OLD).mirrors, atol=1e-12)
    assert scene.angle_names == ("pip", "dip")


def test_a_scene_with_an_odd_name_and_without_an_outer_mirror_still_has_views(finger, tmp_path):
    assert (r"$\frac{$", "direct") in finger.model.views
    assert not any(path == "mirror:distal" for _, path in finger.model.views)
    assert ("proximal", "mirror:proximal") in finger.model.views
    draw_imprints(finger, {"untouched": {}}).savefig(tmp_path / "imprints.svg")
    assert r"<!-- $\frac{$ -->" in (tmp_path / "imprints.svg").read_text(encoding="utf-8")


def test_sampled_fingers_are_the_same_in_every_run(finger):
    first, again, other = (finger.made(3, number) for number in (0, 0, 1))
    np.testing.assert_array_equal(first[1], again[1])
    assert not np.allclose(first[1], other[1])
    assert float(first[0].tilt) == pytest.approx(first[1][3] * np.deg2rad(2.0))
    many = np.stack([finger.made(3, number)[1] for number in range(300)])
    np.testing.assert_allclose(many.std(axis=0), 1.0, atol=0.15)


def test_a_lens_to_which_no_distortion_is_added_is_refused(tmp_path):
    text, path = OLD.read_text(encoding="utf-8"), tmp_path / "scene.toml"
    path.write_text(text.replace('"equidistant"', '"orthographic"'), encoding="utf-8")
    with pytest.raises(UserError, match="its lens is orthographic; errors of the lens need"):
        FingerSensor.of(FingerImagesSpec(scene=str(path)), 360)


def test_a_scene_that_is_no_finger_is_refused(tmp_path, capsys):
    curved, out = files("studies") / "gallery" / "scenes" / "circle.toml", tmp_path / "out"
    assert command(["run", "proprioception", "--set", f"scene={curved}", "--out", str(out)]) == 2
    error = capsys.readouterr().err
    assert "scene" in error
    assert "Traceback" not in error


def test_severities_are_independent_of_each_other_and_off_in_one_case_of_five():
    generator = np.random.default_rng(0)
    drawn = [independent_effects(generator) for _ in range(2000)]
    names = ["gain", *SOFT]
    sizes = np.array([[getattr(effects, name) for name in names] for effects in drawn])
    assert np.abs(np.corrcoef(sizes.T) - np.eye(len(names))).max() < 0.1
    greatest = Effects.graded(2.0)
    for name, column in zip(names, sizes.T, strict=True):
        if name == "gain":
            assert 0.6 <= column.min() <= column.max() <= 1.5
            continue
        # Of 2000 draws a share of 0.2 is known to 0.01 (1 σ).
        assert np.mean(column == getattr(Effects(), name)) == pytest.approx(0.2, abs=0.04), name
        assert column.max() == pytest.approx(getattr(greatest, name), rel=0.02), name


def test_nearest_errors_bear_any_order_of_corners():
    square = np.array([[0.0, 0.0], [0.0, 10.0], [10.0, 10.0], [10.0, 0.0]])
    turned = np.roll(square[::-1], 1, axis=0) + np.array([1.0, 0.0])
    np.testing.assert_allclose(nearest_errors([square + 50, turned], square, 5.0), 1.0)
    assert np.isnan(nearest_errors([square + 50], square, 5.0)).all()


def test_tables_count_views_and_frames():
    measured = Measured()
    times = Records({"effect": ["none"], "milliseconds": 1.0, "more_than_none_ms": 0.0})
    name = {"severity": 1.0, "pad": "distal", "path": "direct", "paper_error_px": np.nan}
    measured.corners.add(gain=1.0, error_px=np.repeat([1.0, np.nan], 4), **name)
    measured.corners.add(gain=0.6, error_px=np.repeat(3.0, 4), **name)
    measured.frames.add(gain=[1.0, 0.6], severity=1.0, wrong=[1, 0], shown=1, seconds=0.05)
    out = Report(TactileImagesSpec(), package="studies.tactile_images")
    add_tables(out, measured, Records(), times)
    [first, second] = out.results().tables[0].rows
    assert (*first[:6], first[-1]) == (0.6, 1.0, 1, 1, 1.0, 3.0, 0)
    assert (*second[:6], second[-1]) == (1.0, 1.0, 1, 2, 0.5, 1.0, 1)


def test_one_thread_is_given_back():
    before = cv2.getNumThreads()
    with one_thread():
        assert cv2.getNumThreads() == 1
    assert cv2.getNumThreads() == before
