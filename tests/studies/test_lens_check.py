"""What the lens study keeps: corners as they were found, for what they were asked of."""

import inspect
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

import perception.boards.detection
from perception.boards import BoardCorners
from studies.models import board_sightings
from studies.physical_check.lenses import LensCheckSpec
from studies.physical_check.lenses import run as lens_check

SPEC = LensCheckSpec(fewest=4, most=4, further=1)


@pytest.fixture
def taken(monkeypatch):
    """Pictures that hold no more than what they were taken of; their number."""
    photographed = []

    def photograph(lens, board, pose, conditions, seed):
        photographed.append(seed)
        return SimpleNamespace(pixels=pose, places=pose.places(lens, board.points))

    def detect(pose, board):
        numbers = np.arange(0, len(board.points), 2)
        places = np.repeat(pose.translation[None, :2], len(numbers), axis=0)
        return BoardCorners(numbers, places, np.full(len(numbers), 0.1))

    monkeypatch.setattr(lens_check.judge, "photograph_board", photograph)
    monkeypatch.setattr(lens_check, "detect_board", detect)
    monkeypatch.setattr(lens_check, "_sources", lambda: b"one")  # the true ones need Mitsuba
    return photographed


def test_corners_that_are_kept_are_those_that_were_found(taken, tmp_path):
    first, again = (lens_check.pictured(SPEC, 3, 1, tmp_path) for _ in range(2))
    assert taken == list(range(5))
    assert first.given == again.given == 4
    for one, other in zip(first.seen.__dict__.values(), again.seen.__dict__.values(), strict=True):
        np.testing.assert_array_equal(one, other)
    np.testing.assert_array_equal(first.truth, again.truth)
    np.testing.assert_array_equal(first.seconds, again.seconds)
    angles = np.linspace(0.1, 1.0, 5)
    np.testing.assert_array_equal(first.lens.heights(angles), again.lens.heights(angles))
    seen = np.isfinite(np.asarray(first.seen.deviations))
    assert seen[:, ::2].all()
    assert not seen[:, 1::2].any()


@pytest.mark.parametrize(
    ("changed", "seed", "number"),
    [({}, 4, 1), ({}, 3, 2), ({"most": 5}, 3, 1), ({"further": 2}, 3, 1)],
)
def test_corners_of_others_are_found_anew(taken, tmp_path, changed, seed, number):
    lens_check.pictured(SPEC, 3, 1, tmp_path)
    before = len(taken)
    lens_check.pictured(SPEC.model_copy(update=changed), seed, number, tmp_path)
    assert len(taken) > before


def test_corners_are_found_anew_when_the_detector_is_another(taken, tmp_path, monkeypatch):
    lens_check.pictured(SPEC, 3, 1, tmp_path)
    monkeypatch.setattr(lens_check, "_sources", lambda: b"another")
    lens_check.pictured(SPEC, 3, 1, tmp_path)
    assert len(taken) == 10


def test_what_is_kept_follows_from_judge_detector_and_versions():
    mitsuba = pytest.importorskip("mitsuba")
    made = lens_check._sources()
    for module in (lens_check.judge, perception.boards.detection, board_sightings):
        assert Path(inspect.getfile(module)).read_bytes() in made
    assert mitsuba.__version__.encode() in made
    assert cv2.__version__.encode() in made
