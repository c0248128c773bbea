"""Rendered fingers: found in every grade of their effects, in the dark, and under speckles."""

from __future__ import annotations

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest

from optics.chamber import press_wall
from optics.rendering import ChamberEffects, ChamberImage, ChamberRenderer
from perception.chamber import (
    ChamberStatus,
    Direction,
    estimate_bending_direction,
    find_points,
    find_regions,
)
from perception.posture import USABLE
from studies.bending_direction.frames import TOWARDS
from studies.models.soft_finger.finger import SoftFinger
from studies.models.soft_finger.spec import ChamberImagesSpec
from tests.perception.chamber.drawn import points_of

BENDS_DEG = (0.0, 15.0, 35.0, 60.0, 90.0, 120.0)

STEEP = 4.0
"""A power of the light's falling off at which yellow is a twentieth as bright as red."""


@pytest.fixture(scope="module")
def finger() -> SoftFinger:
    return SoftFinger.of(ChamberImagesSpec())


def bent(
    finger: SoftFinger, effects: ChamberEffects, towards: float, pressed: float = 0.0
) -> list[ChamberImage]:
    """Frames at all bends in one direction, pressed by so many mm."""
    renderer = ChamberRenderer(finger.chamber, finger.endoscope, effects, seed=5)
    place, radius = jnp.asarray(60.0), jnp.asarray(30.0)
    press = np.asarray(press_wall(jnp.asarray(finger.arc), place, radius, jnp.asarray(pressed)))
    count = len(BENDS_DEG)
    postures = finger.postures(
        np.deg2rad(BENDS_DEG), np.full(count, towards), np.tile(press, (count, 1))
    )
    return renderer.render(postures)


@pytest.mark.parametrize(("severity", "gain"), [(0.0, 0.4), (2.0, 2.0)])
def test_every_frame_shows_the_chamber(finger, severity, gain):
    effects = ChamberEffects.graded(severity, gain)
    for towards, pressed in ((0.0, 0.0), (2.0, 3.0), (4.0, -3.0)):
        for image in bent(finger, effects, towards, pressed):
            assert find_regions(image.pixels).status in USABLE


def test_yellow_is_found_far_in_the_dark(finger):
    effects = replace(ChamberEffects.graded(1.0), falloff=STEEP)
    for image in bent(finger, effects, 2.0)[:3]:
        regions = find_regions(image.pixels)
        assert regions.status is ChamberStatus.CHAMBER
        points, (x, y) = find_points(image.pixels, regions), image.outlines[1].T
        across = points.xy[[3, 4, 5], [0, 1, 0]] - [x.min(), y.max(), x.max()]
        assert points.seen[3:6].sum() >= 2  # the image's border may cut one
        assert np.abs(across[points.seen[3:6]]).max() < 1


def speckled(pixels: np.ndarray, share: float, random: np.random.Generator) -> np.ndarray:
    """So many pixels are white, black or of any colour."""
    changed = pixels.copy()
    where = random.random(pixels.shape[:2]) < share
    count = int(where.sum())
    any_of = random.integers(0, 256, (count, 3))
    colors = np.stack([np.zeros_like(any_of), np.full_like(any_of, 255), any_of])
    changed[where] = colors[random.integers(0, 3, count), np.arange(count)]
    return changed


def test_speckles_turn_no_direction_and_move_no_point(finger):
    effects = replace(ChamberEffects.graded(1.0), falloff=STEEP)
    random = np.random.default_rng(1)
    for truth, towards in TOWARDS.items():
        images = [image.pixels for image in bent(finger, effects, towards)[:-1]]
        clean = [points_of(pixels) for pixels in images]
        found = [points_of(speckled(pixels, 0.1, random)) for pixels in images]
        for points, usual in zip(found[1:], clean[1:], strict=True):
            assert estimate_bending_direction(points, found[0], use="all") is truth
            across = (points.xy - usual.xy)[np.arange(7), [0, 1, 0, 0, 1, 0, 0]]
            assert np.abs(across[points.seen & usual.seen]).max() < 2
        assert all(
            estimate_bending_direction(points, found[0], use="blue") is not Direction.UNDEFINED
            for points in found
        )
