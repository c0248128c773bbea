"""What is photographed, and a short run; the judge's own tests are in `test_judge_light`."""

import dataclasses
import importlib.util
from collections import Counter
from contextlib import nullcontext

import jax.numpy as jnp
import numpy as np
import pytest

from designopt import Context, UserError
from optics import parse_scene
from optics.scene.scene import place
from studies.image_check import ImageCheckSpec
from studies.image_check import run as study
from studies.image_check.cases import (
    COUPLED,
    EVEN,
    GAP,
    fingers,
    in_deviations,
    nominal,
    plain,
    with_lamps,
    without_layers,
)
from studies.models import path_tracer
from studies.models.sensor.made import deviations_of
from studies.models.sensor.spec import MadeSpec
from studies.oracles.judge.lens import Lens
from studies.oracles.judge.solids import faces_of
from tests.studies.quick import quick_run


def stated(layers="3 mm, pupil"):
    return deviations_of(MadeSpec(), parse_scene(nominal(layers), "finger"))


def test_default_frames_are_lit_by_both_couplings_and_pressed():
    made = list(fingers(ImageCheckSpec(), plain(stated()), 0))
    frames = [(one.light, capture) for one in made for capture in one.captures]
    lights = Counter(light for light, _ in frames)
    assert len(made) >= 30
    assert len(frames) >= 300
    assert min(lights[GAP], lights[COUPLED]) >= 30
    assert lights[GAP] + lights[COUPLED] >= 100
    assert sum(bool(capture.contacts) for _, capture in frames) >= 0.3 * len(frames)
    assert all(0.02 <= capture.walls <= 0.08 for light, capture in frames if light != EVEN)
    # Frames with labels are those of an untouched finger.
    assert not any(capture.contacts for one in made for capture in one.captures[:5])


def test_a_lens_of_its_own_is_the_same_before_boards_and_in_the_finger():
    spec = ImageCheckSpec(fingers=1, calibrated=3, frames=1)
    plain_one, *own = fingers(spec, plain(stated()), 0)
    assert plain_one.lens is None
    assert {one.light for one in own} == {EVEN, GAP, COUPLED}
    for one in own:
        assert one.lens is not None
        assert not {"distortion", "pupil"} & set(one.errors)
        judged = Lens.of(one.tables["camera"], (1 + 0j, 0j), 4 / 3)
        places = np.array([[700.0, 500.0], [300.0, 800.0], [1200.0, 200.0]])
        ways, _ = one.lens.sight(places)
        rays = judged.rays(places)
        across = [rays @ judged.right, -(rays @ judged.up), rays @ judged.axis]
        np.testing.assert_allclose(ways, np.stack(across, axis=-1), atol=1e-7)
        assert one.tables["camera"]["axis_offset_px"] != [0.0, 0.0]


def test_errors_are_counted_in_their_standard_deviations():
    for one in fingers(ImageCheckSpec(fingers=10, calibrated=0, frames=1), plain(stated()), 3):
        deviations = stated(one.layers)
        numbers = in_deviations(one.errors, deviations)
        names = [field.name for field in dataclasses.fields(deviations)]
        assert set(one.errors) == {n for n in names if getattr(deviations, n) is not None}
        assert numbers.size == sum(np.size(value) for value in plain(deviations).values())
        assert numbers[2] == one.errors["lateral"] / 0.3
        assert np.abs(numbers).max() < 5


def test_lamps_across_the_section_stand_where_the_judge_has_them():
    tables = nominal("none")
    pose = {"pip": 20.0, "dip": 40.0}
    faces = faces_of(tables, pose, lamps=True)
    theirs = [face.corners for face in faces if face.kind == "lamp" and face.lamp == 1]
    scene = parse_scene(with_lamps(tables), "finger")
    own = [i for i, part in enumerate(scene.layout.surfaces) if part.name.startswith("lamp of")]
    placed = place(scene, jnp.deg2rad(jnp.array([20.0, 40.0])))
    there = placed.absolute(placed.corners)
    corners = np.stack([there.x, there.y], axis=-1)[own]
    assert len(theirs) == len(own) == 3
    for one, other in zip(theirs, corners, strict=True):
        ends = np.unique(one[:, :2].round(9), axis=0)
        np.testing.assert_allclose(ends, np.unique(other, axis=0), atol=1e-6)


def test_in_air_the_finger_has_neither_layers_nor_a_pupil_that_moves():
    scene = without_layers(nominal("3 mm, pupil"))
    assert scene.layers is None
    assert scene.camera.pupil_shift is None
    np.testing.assert_array_equal(scene.pads, parse_scene(nominal("none"), "finger").pads)


def test_without_mitsuba_one_line_says_what_to_install(monkeypatch):
    def missing():
        raise ModuleNotFoundError("No module named 'mitsuba'")

    monkeypatch.setattr(path_tracer, "load_mitsuba", missing)
    context = Context(0, "float64", lambda _: nullcontext())
    with pytest.raises(UserError, match=r"pip install 'designopt\[judge\]'"):
        study.run(ImageCheckSpec(), context)


@pytest.mark.slow
@pytest.mark.skipif(
    importlib.util.find_spec("mitsuba") is None,
    reason="Mitsuba is not installed; the extra 'judge' brings it",
)
def test_a_quick_run_finds_views_and_angles(tmp_path):
    done = quick_run("image-check", tmp_path, f"cache={tmp_path / 'pictures'}")
    assert done.measured["frames"] == 4
    assert done.measured["views_found"] == 1
    assert done.measured["corner_median_even_px"] < 0.6
    assert done.measured["model_worst_px"] < 0.1
    assert done.measured["angles_wrong"] == 0
    assert (done.folder / "figures" / "pictures.png").exists()
