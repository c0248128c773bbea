"""Exposure and white balance that move are noticed, and contacts and moving views are not."""

from __future__ import annotations

import numpy as np
import pytest

from designopt.errors import UserError
from perception.sources import LightWatch
from perception.sources.light import BACK, LOOKS
from tests.perception.drawn import Eye, Pad, drawn

EYE = Eye(rows=240, columns=320, focal=110.0, pinhole=True)

TINT = np.array([0.8, 0.6, 1.0])
"""Of the lamps: red, green and blue."""


def light_at(turn: float, contact: float | None = None) -> np.ndarray:
    """A pad that stands still and one that moves; something presses the first one somewhere."""

    def still(places: np.ndarray) -> np.ndarray:
        shade = 150 - 2 * places[:, 0]
        if contact is None:
            return shade
        near = np.hypot(places[:, 0] - contact, places[:, 1]) < 4
        return np.where(near, 0.6 * shade, shade)

    first = Pad((30, -9), (30, 7), width=26)
    end = 40 + 14 * np.sin(turn), 14 + 14 * np.cos(turn)
    second = Pad((40, 14), end, width=22)
    looks = [still, lambda places: 110 + 2 * places[:, 0]]
    return drawn(EYE, [first, second], looks)


def image_of(light: np.ndarray, gains: object = 1.0, seed: int = 0) -> np.ndarray:
    """Three channels of 8 bits, with noise."""
    noise = np.random.default_rng(seed).normal(0, 2, (*light.shape, 3))
    return np.clip(np.rint(light[..., None] * TINT * np.asarray(gains) + noise), 0, 255).astype(
        np.uint8
    )


REFERENCE = light_at(0.8)


@pytest.mark.parametrize("gains", [(1.2,) * 3, (0.5,) * 3, (1.15, 1.0, 0.9), (1.06,) * 3])
def test_ratios_are_those_of_the_camera(gains: tuple[float, ...]) -> None:
    light = LightWatch(image_of(REFERENCE)).look(image_of(REFERENCE, gains, seed=1))
    np.testing.assert_allclose(light.gains, gains, rtol=0.015)
    assert light.gain == pytest.approx(np.prod(gains) ** (1 / 3), rel=0.015)
    assert light.red == pytest.approx(gains[0] / gains[1], rel=0.02)
    assert light.blue == pytest.approx(gains[2] / gains[1], rel=0.02)


def test_of_large_images_not_all_rows_are_needed() -> None:
    before, after = (
        image_of(REFERENCE, gains, seed).repeat(4, axis=0).repeat(4, axis=1)
        for seed, gains in enumerate((1.0, 1.15))
    )
    np.testing.assert_allclose(LightWatch(before).look(after).gains, 1.15, rtol=0.01)


def test_ratios_while_the_finger_moves_and_is_touched() -> None:
    watch = LightWatch(image_of(REFERENCE))
    for number, turn in enumerate(np.linspace(0.2, 1.5, 6)):
        light = watch.look(image_of(light_at(turn, contact=3.0 + number), 1.25, seed=number))
        np.testing.assert_allclose(light.gains, 1.25, rtol=0.02)


def test_moving_and_touching_raise_no_alarm() -> None:
    watch = LightWatch(image_of(REFERENCE))
    turns = np.random.default_rng(3).uniform(0.1, 1.6, 15)
    for number, turn in enumerate(turns):
        light = watch.look(image_of(light_at(turn, contact=float(number)), seed=number))
        np.testing.assert_allclose(light.gains, 1, rtol=0.02)
        assert light.verdict == ""


def test_a_line_when_it_begins_and_one_when_it_ends() -> None:
    """Exposure that goes up and comes back: one line each, after images in succession."""
    watch = LightWatch(image_of(REFERENCE))
    gains = [1.0] * 3 + [1.3] * 10 + [1.04] * 10 + [1.0] * 10 + [1.3] * (LOOKS - 1) + [1.0] * 10
    verdicts = {
        number: verdict
        for number, gain in enumerate(gains)
        if (verdict := watch.look(image_of(REFERENCE, gain, seed=number)).verdict)
    }
    assert list(verdicts) == [3 + LOOKS - 1, 23 + LOOKS - 1]
    began, ended = verdicts.values()
    assert began.startswith("the light is not the reference's: brightness ×1.30, red over green ×1")
    assert ended == BACK


def test_white_balance_alone_is_noticed() -> None:
    watch = LightWatch(image_of(REFERENCE))
    verdicts = [
        watch.look(image_of(REFERENCE, (1.12, 1, 0.9), seed=n)).verdict for n in range(LOOKS)
    ]
    assert "red over green ×1.12, blue ×0.90" in verdicts[-1]


def test_a_dark_image_leaves_it_open() -> None:
    watch = LightWatch(image_of(REFERENCE))
    looks = [watch.look(np.zeros((EYE.rows, EYE.columns, 3), np.uint8)) for _ in range(2 * LOOKS)]
    assert all(np.isnan(light.gain) and not light.verdict for light in looks)


def test_another_size_is_refused() -> None:
    watch = LightWatch(image_of(REFERENCE))
    with pytest.raises(UserError, match="the reference of the light has 320x240 px"):
        watch.look(np.zeros((10, 10, 3), np.uint8))
