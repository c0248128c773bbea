"""Points fitted to pixels: from a shifted, turned map back to the truth, with honest errors."""

import cv2
import numpy as np
import pytest

from perception.boards import Board
from perception.boards.appearance import Look, predict
from perception.boards.local_maps import fit_maps, scaling, shifting
from perception.boards.pattern import Pattern
from perception.boards.registration import register

BOARD = Board(columns=8, rows=6, square=5.0)
TAGS = Board(kind="apriltag", columns=5, rows=4, square=8.0)
SCALE = 6.0
"""Pixels per mm."""


def drawn(
    board: Board, turn: float = 0.3, *, blur: float = 0.7, grows: float = 0.0
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A turned board, as OpenCV warps the pattern: light of 40 to 200, forward matrix, places.

    Of light that grows from column to column, by the given share, paper sends 1 and ink 1/17.
    """
    pattern = Pattern.of(board)
    cosine, sine = SCALE * np.cos(turn), SCALE * np.sin(turn)
    forward = np.array([[cosine, -sine, 90.0], [sine, cosine, 30.0], [0, 0, 1]])
    to_pattern = np.diag([pattern.density, pattern.density, 1.0])
    to_pattern[:2, 2] = pattern.margin * pattern.density - 0.5
    finer = 6
    fine = np.diag([1 / finer, 1 / finer, 1.0])
    fine[:2, 2] = (1 / finer - 1) / 2
    image = cv2.warpPerspective(
        pattern.level(0, 0),
        to_pattern @ np.linalg.inv(forward) @ fine,
        (340 * finer, 320 * finer),
        flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
        borderValue=(1.0,),
    )
    if grows:
        columns = (np.arange(image.shape[1]) + 0.5) / finer
        image = (1 + 16 * image) / 17 * np.exp(grows * (columns - 340))
    image = cv2.GaussianBlur(image, (0, 0), blur * finer)
    image = cv2.resize(image, (340, 320), interpolation=cv2.INTER_AREA)
    places = board.points @ forward[:2, :2].T + forward[:2, 2]
    return 200 * image if grows else 40 + 160 * image, forward, places


def about(board: Board, forward: np.ndarray, places: np.ndarray):
    """The true maps about all points."""
    grid = np.stack(np.meshgrid(*2 * [np.linspace(-40, 40, 4)]), axis=-1).reshape(-1, 2)
    around = places[:, None] + grid
    back = np.linalg.inv(forward)
    points = around @ back[:2, :2].T + back[:2, 2]
    return fit_maps(around, points, np.ones(around.shape[:2]))


def fitted(board: Board, image: np.ndarray, maps, start: np.ndarray, **more):
    how = {"half": 10, "steps": 6, "learn_tone": True} | more
    return register(
        image.astype(np.float32),
        Pattern.of(board),
        maps,
        board.points,
        Look(0.6, 0.0),
        start=start,
        **how,
    )


@pytest.mark.parametrize("board", [BOARD, TAGS])
def test_points_are_found_from_maps_that_are_off(board):
    image, forward, places = drawn(board)
    maps = about(board, forward, places)
    shifts = np.random.default_rng(0).uniform(-1.5, 1.5, places.shape)
    turns = scaling(np.full(len(places), 1.04), -0.04 * places)
    off = maps.warped(shifting(shifts)).warped(turns)
    start = off.places_of(board.points, places)
    assert np.linalg.norm(start - places, axis=1).mean() > 0.8
    fit = fitted(board, image, off, start)
    assert np.linalg.norm(fit.places - places, axis=1).max() < 0.02
    assert fit.likeness.min() > 0.99
    assert fit.shifts.max() < 0.02
    assert fit.look.blur == pytest.approx(0.7, abs=0.1)
    assert fit.look.swell == pytest.approx(0.0, abs=0.02)
    np.testing.assert_allclose(fit.maps.places_of(board.points, fit.places), fit.places, atol=1e-9)


@pytest.mark.parametrize("board", [BOARD, TAGS])
def test_a_bent_tone_curve_moves_no_point(board):
    image, forward, places = drawn(board)
    light = ((image - 30) / 170) ** (1 / 2.2) * 200
    maps = about(board, forward, places)
    errors = np.linalg.norm(fitted(board, light, maps, places).places - places, axis=1)
    assert np.median(errors) < 0.05
    assert errors.max() < 0.15
    bent = fitted(board, light, maps, places, learn_tone=False)
    if board.kind == "apriltag":  # which is why the tone curve is learnt
        assert np.median(np.linalg.norm(bent.places - places, axis=1)) > 0.1


@pytest.mark.parametrize("gamma", [1.0, 2.2])
@pytest.mark.parametrize("board", [BOARD, TAGS])
def test_light_that_grows_moves_no_point(board, gamma):
    def off(grows: float) -> np.ndarray:
        image, forward, places = drawn(board, blur=1.4, grows=grows)
        image = 200 * (image / 200) ** (1 / gamma)
        return fitted(board, image, about(board, forward, places), places).places - places

    # Light that falls on the print is blurred with it, by 1.4 px and a pixel's own 0.29, and edges
    # move towards the dark by its logarithm's slope times the variance: 0.01 px here.
    moved = np.mean(off(0.005) - off(-0.005), axis=0) / 2
    assert np.abs(moved).max() < 0.0015


def test_errors_are_those_of_noise():
    image, forward, places = drawn(BOARD)
    maps, generator = about(BOARD, forward, places), np.random.default_rng(1)
    clean = fitted(BOARD, image, maps, places)
    fits = [
        fitted(BOARD, image + generator.normal(0, 6, image.shape), maps, places) for _ in range(20)
    ]
    scatter = np.array([fit.places - clean.places for fit in fits])
    found = np.sqrt(np.mean(scatter**2, axis=(0, 2)))
    stated = np.sqrt(np.mean([fit.errors**2 for fit in fits], axis=0))
    assert 0.01 < np.median(found) < 0.1
    assert np.median(found / stated) == pytest.approx(1, abs=0.15)


def test_what_is_no_print_is_not_like_it():
    image, forward, places = drawn(BOARD)
    maps = about(BOARD, forward, places)
    noise = np.random.default_rng(2).normal(128, 40, image.shape)
    assert np.percentile(fitted(BOARD, noise, maps, places).likeness, 95) < 0.5
    for even in (np.zeros(image.shape), np.full(image.shape, 255.0)):
        fit = fitted(BOARD, even, maps, places)
        assert fit.likeness.max() < 0.5
        assert np.isfinite(fit.places).all()
    ramp = np.add.outer(np.arange(320.0), np.arange(340.0)) / 4
    assert fitted(BOARD, ramp, maps, places).likeness.max() < 0.5
    # Of another place of the board.
    moved = maps.warped(shifting(np.full(places.shape, 15.0)))
    fit = fitted(BOARD, image, moved, places - 15)
    assert np.median(fit.likeness) < 0.6


def test_points_outside_of_the_image_are_finite():
    image, forward, places = drawn(BOARD)
    far = about(BOARD, forward, places).warped(shifting(np.full(places.shape, 5000.0)))
    fit = fitted(BOARD, image, far, places - 5000)
    assert np.isfinite(fit.places).all()
    assert fit.likeness.max() < 0.5
    seen = predict(Pattern.of(BOARD), far, np.round(places - 5000), Look(0.6, 0.0), 10)
    assert np.isfinite(seen.shade).all()
