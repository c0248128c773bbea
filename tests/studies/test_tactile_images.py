"""The study ``tactile-images``: a quick run end to end, and its pieces."""

import dataclasses
import json
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest

from designopt.cli import run as command
from optics import read_scene
from optics.rendering import Effects
from studies.models.one_thread import one_thread
from studies.models.sensor.finger_sensor import FingerSensor, designed
from studies.models.sensor.spec import FingerImagesSpec
from studies.tactile_images import tables
from studies.tactile_images.corrupted import DAMAGED, NO_FINGER, NO_IMAGE, Trial
from studies.tactile_images.drawings import imprints_figure
from studies.tactile_images.frames import (
    FoundView,
    Frame,
    independent_effects,
    nearest_errors,
    poses,
)
from studies.tactile_images.pictures import Shown

OLD = Path(__file__).parents[1] / "data" / "old_specs" / "scene.toml"
"""The packaged finger's scene, as a result of an earlier version has it."""

QUICK = [
    "fingers=1",
    "grid=2",
    "gains=[1.0]",
    "severities=[]",
    "independent=3",
    "corrupted=13",
    "corrupted_rows=360",
    "sizes=[360]",
    "size_frames=2",
]


def run(out, *settings):
    """A quick run's exit code and its results."""
    sets = [part for setting in (*QUICK, *settings) for part in ("--set", setting)]
    code = command(["run", "tactile-images", *sets, "--out", str(out)])
    return code, json.loads((out / "results.json").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    out = tmp_path_factory.mktemp("quick") / "out"
    return *run(out), out


@pytest.mark.slow
def test_a_quick_run_finds_what_can_be_found(done):
    code, document, out = done
    measured = {name: metric["value"] for name, metric in document["metrics"].items()}
    assert measured["found_at_gain_1"] >= 0.95
    assert measured["found_independent"] >= 0.9
    assert measured["corner_median_px"] <= 2
    assert measured["corner_p90_px"] <= 5
    assert measured["unwarp_p90_mm"] <= 0.3 < measured["affine_unwarp_p90_mm"]
    assert measured["corner_median_px"] < measured["paper_corner_median_px"]
    assert measured["corrupted_failures"] == 0
    assert code == (0 if measured["detection_ms"] <= 100 else 1)
    for name in ("views", "masks", "imprints", "errors", "success", "precision"):
        assert (out / "figures" / f"{name}.png").stat().st_size > 5000


@pytest.mark.slow
def test_no_frame_of_the_quick_run_raised(done):
    _, _, out = done
    rows = (out / "tables" / "corrupted.csv").read_text(encoding="utf-8").splitlines()[1:]
    assert len(rows) == len(NO_FINGER | NO_IMAGE | DAMAGED)
    assert all(row.split(",")[2] == "0" for row in rows)


def test_what_is_no_image_is_to_be_refused_and_an_image_is_not():
    assert not Trial("black").failed
    assert not Trial("patches", complete=2, angles=2).failed
    assert not Trial("wrong size", refused=True).failed
    assert Trial("wrong size").failed
    assert Trial("black", refused=True).failed
    assert Trial("black", complete=1).failed
    assert Trial("noise", angles=1).failed
    assert Trial("patches", crash="ValueError()").failed


def test_the_packaged_scene_is_the_default():
    scene = designed("")
    np.testing.assert_allclose(scene.mirrors, read_scene(OLD).mirrors, atol=1e-12)
    assert scene.angle_names == ("pip", "dip")


def test_a_scene_without_an_outer_mirror_still_has_views(tmp_path):
    text = OLD.read_text(encoding="utf-8")
    start = text.index("[[mirrors]]")
    end = text.index("[[mirrors]]", start + 1)
    path = tmp_path / "one-mirror.toml"
    path.write_text(text[:start] + text[end:], encoding="utf-8")
    finger = FingerSensor.of(FingerImagesSpec(scene=str(path)), 360)
    assert ("distal", "mirror:distal") not in finger.model.views
    assert ("proximal", "mirror:proximal") in finger.model.views


def test_names_of_pads_are_drawn_as_text(tmp_path):
    text = OLD.read_text(encoding="utf-8")
    path = tmp_path / "odd.toml"
    path.write_text(text.replace('name = "distal"', r"name = '$\frac{$'"), encoding="utf-8")
    finger = FingerSensor.of(FingerImagesSpec(scene=str(path)), 360)
    drawing = imprints_figure(finger, Shown([], [], {})).drawing
    drawing.savefig(tmp_path / "imprints.svg")
    assert r"<!-- $\frac{$ -->" in (tmp_path / "imprints.svg").read_text(encoding="utf-8")


def test_made_fingers_are_drawn_once_for_all():
    finger = FingerSensor.of(FingerImagesSpec(), 360)
    first, again, other = (finger.made(3, number) for number in (0, 0, 1))
    np.testing.assert_array_equal(first[1], again[1])
    assert not np.allclose(first[1], other[1])
    assert float(first[0].tilt) == pytest.approx(first[1][3] * np.deg2rad(2.0))
    many = np.stack([finger.made(3, number)[1] for number in range(300)])
    np.testing.assert_allclose(many.std(axis=0), 1.0, atol=0.15)


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        ("severity=3", "less than or equal to 2"),
        ("grid=1", "greater than or equal to 2"),
        ("scene=nowhere.toml", "nowhere.toml"),
        ("width=-1", "greater than 0"),
    ],
)
def test_nonsense_is_refused_in_one_line(tmp_path, capsys, setting, words):
    out = tmp_path / "out"
    assert command(["run", "tactile-images", "--set", setting, "--out", str(out)]) == 2
    assert words in capsys.readouterr().err
    assert not out.exists()


def test_a_scene_that_is_no_finger_is_refused(tmp_path, capsys):
    gallery = files("studies") / "gallery" / "scenes"
    curved = next(
        str(path)
        for path in gallery.iterdir()
        if path.name.endswith(".toml") and "radius" in path.read_text(encoding="utf-8")
    )
    out = tmp_path / "out"
    assert command(["run", "proprioception", "--set", f"scene={curved}", "--out", str(out)]) == 2
    error = capsys.readouterr().err
    assert "scene" in error
    assert "Traceback" not in error


def test_severities_are_independent_of_each_other_and_off_in_one_case_of_five():
    generator = np.random.default_rng(0)
    drawn = [independent_effects(generator) for _ in range(2000)]
    names = [one.name for one in dataclasses.fields(Effects)]
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


def test_poses_are_the_grid():
    grid = np.rad2deg(poses(3, 90.0, 2))
    assert {tuple(pose) for pose in grid.round(6).tolist()} == {
        (a, b) for a in (0.0, 45.0, 90.0) for b in (0.0, 45.0, 90.0)
    }


def test_nearest_errors_bear_any_order_of_corners():
    square = np.array([[0.0, 0.0], [0.0, 10.0], [10.0, 10.0], [10.0, 0.0]])
    turned = np.roll(square[::-1], 1, axis=0) + np.array([1.0, 0.0])
    np.testing.assert_allclose(nearest_errors([square + 50, turned], square, 5.0), 1.0)
    assert np.isnan(nearest_errors([square + 50], square, 5.0)).all()


def test_tables_count_what_frames_say():
    def view(found: bool, off: float) -> FoundView:
        errors = np.full(4, off if found else np.nan)
        return FoundView("distal", "direct", found, errors, np.full(4, np.nan))

    frames = [
        Frame(1.0, 1.0, (0.0, 0.0), (view(True, 1.0), view(False, 0.0)), 1, (), 1, 0.05),
        Frame(0.6, 1.0, (0.0, 0.0), (view(True, 3.0),), 0, (), 1, 0.05),
    ]
    rows = tables.conditions(frames).rows
    assert [row[:5] for row in rows] == [(0.6, 1.0, 1, 1, 1.0), (1.0, 1.0, 1, 2, 0.5)]
    assert [row[5] for row in rows] == [3.0, 1.0]
    assert [row[-1] for row in rows] == [0, 1]


def test_one_thread_is_given_back():
    import cv2

    before = cv2.getNumThreads()
    with one_thread():
        assert cv2.getNumThreads() == 1
    assert cv2.getNumThreads() == before
