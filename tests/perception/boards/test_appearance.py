"""What windows are predicted to show, against a brute-force rendering and finite differences."""

import cv2
import numpy as np
import pytest

from perception.boards import Board
from perception.boards.appearance import PIXEL, Look, predict
from perception.boards.local_maps import fit_maps, shifting
from perception.boards.pattern import Pattern, dark_rectangles

BOARD = Board(columns=5, rows=4, square=8.0)
HALF = 8
LOOK = Look(0.8, 0.0)


def maps_at(middles: np.ndarray, scale: float):
    """A tilted, slightly bent map about each place, with squares of about 8 scale px."""
    grid = np.stack(np.meshgrid(*2 * [np.linspace(-30, 30, 5)]), axis=-1).reshape(-1, 2)
    turn = np.array([[np.cos(0.4), np.sin(0.4)], [-0.6 * np.sin(0.4), 0.6 * np.cos(0.4)]])

    def to_board(places: np.ndarray, about: np.ndarray) -> np.ndarray:
        offsets = (places - about) @ np.linalg.inv(turn).T / scale
        return offsets + 5e-4 * offsets[..., ::-1] ** 2 + [16.0, 8.0]

    places = middles[:, None] + grid
    points = np.stack(
        [to_board(place, about) for place, about in zip(places, middles, strict=True)]
    )
    return fit_maps(places, points, np.ones(places.shape[:2]))


def rendered(maps, middle: np.ndarray, width: float, finer: int = 10) -> np.ndarray:
    """A window of pixels sampled ten times as finely, blurred by a Gaussian, and picked."""
    reach = HALF + 5
    line = np.arange(-reach * finer, reach * finer + 1) / finer
    grid = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2) + middle
    whole = np.append(grid, np.ones((len(grid), 1)), axis=1)
    points = np.stack([np.einsum("ni,ij,nj->n", whole, one, whole) for one in maps.forms[0]], 1)
    image = np.ones(len(points))
    for left, top, right, bottom in dark_rectangles(BOARD):
        inside = (points > [left, top]) & (points < [right, bottom])
        image[inside.all(axis=1)] = 0
    side = len(line)
    blurred = cv2.GaussianBlur(image.reshape(side, side), (0, 0), width * finer)
    picked = slice(5 * finer, -5 * finer, finer)
    return blurred[picked, picked]


@pytest.mark.parametrize("scale", [2.0, 4.0, 9.0])
def test_shade_is_the_blurred_print(scale):
    middle = np.array([[120.0, 90.0]])
    maps = maps_at(middle, scale)
    seen = predict(Pattern.of(BOARD), maps, middle, LOOK, HALF).shade[0]
    wanted = rendered(maps, middle[0], np.hypot(LOOK.blur, PIXEL))
    wanted = wanted[: 2 * HALF + 1, : 2 * HALF + 1]
    assert 0.2 < wanted.std() < 0.5
    assert np.abs(seen - wanted).max() < 0.05
    assert np.sqrt(np.mean((seen - wanted) ** 2)) < 0.012


@pytest.mark.parametrize("swell", [0.0, 0.4, -0.3])
def test_derivatives_are_finite_differences(swell):
    middle, step = np.array([[120.0, 90.0]]), 0.02
    maps, look = maps_at(middle, 4.0), Look(0.8, swell)

    def shade(shift=(0.0, 0.0), blur=0.8, bend=look.bend) -> np.ndarray:
        moved = maps.warped(shifting(np.array([shift])))
        one = Look(blur, 0.0)
        found = predict(Pattern.of(BOARD), moved, middle, Look(blur, bend * one.width), HALF)
        return found.shade[0]

    seen = predict(Pattern.of(BOARD), maps, middle, look, HALF)
    right = (shade((step, 0)) - shade((-step, 0))) / (2 * step)
    down = (shade((0, step)) - shade((0, -step))) / (2 * step)
    bent = (shade(bend=look.bend + 0.05) - shade(bend=look.bend - 0.05)) / 0.1
    # Half the variance of the blur changes by blur times the change of blur.
    wider = (shade(blur=0.81) - shade(blur=0.79)) / (0.8 * 0.02)
    for found, wanted in (
        (seen.right, right),
        (seen.down, down),
        (seen.bent, bent),
        (seen.wider, wider),
    ):
        assert np.abs(wanted).max() > 0.05
        # Samples are half a pixel apart: where a line lies between two of them is not quite seen.
        assert np.sqrt(np.mean((found[0] - wanted) ** 2)) < 0.07 * np.sqrt(np.mean(wanted**2))


def test_a_bend_is_a_tone_curve_that_rises_from_black_to_white():
    middle = np.array([[120.0, 90.0]])
    maps, width = maps_at(middle, 4.0), LOOK.width
    plain = predict(Pattern.of(BOARD), maps, middle, LOOK, HALF).shade.ravel()
    order = np.argsort(plain)
    for gamma, bend in ((2.2, 0.65), (1.0, 0.0)):
        look = Look(LOOK.blur, bend * width)
        shade = predict(Pattern.of(BOARD), maps, middle, look, HALF).shade.ravel()
        light = 0.06 + 0.94 * plain  # paper is not quite black where it is printed
        wanted = (light ** (1 / gamma) - 0.06 ** (1 / gamma)) / (1 - 0.06 ** (1 / gamma))
        assert np.abs(shade - wanted).max() < 0.03
        assert np.all(np.diff(shade[order]) > -1e-6)


@pytest.mark.parametrize("gamma", [1.0, 1.8, 2.2, 2.4])
def test_power_is_that_of_the_tone_curve(gamma):
    def tone(light: float) -> float:
        ink, paper = (1 / 17) ** (1 / gamma), 1.0
        return (light ** (1 / gamma) - ink) / (paper - ink)

    bend = 4 * (tone((1 + 1 / 17) / 2) - 0.5)
    assert Look(0.8, bend * LOOK.width).power == pytest.approx(1 / gamma, abs=0.01)
