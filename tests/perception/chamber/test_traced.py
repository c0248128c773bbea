"""Path-traced pictures of wet, dusty chambers: `tests.trace_chambers` makes them."""

from __future__ import annotations

import numpy as np
import pytest

from perception.chamber import (
    IN_VIEW,
    ChamberStatus,
    Direction,
    estimate_bending_direction,
    find_points,
    find_regions,
)
from tests.perception.chamber.traced import picture

BENT = {name: Direction[name.upper()] for name in ("right", "down", "left", "up")}

RADIUS = 346.41 * (1 - 0.1 * (10.62 / 40.84) ** 2) * 10.62 / 40.84
"""Of blue's outline in the straight finger, px: focal length, distortion, and the wall at B."""

RESPONSES = {"linear": 1.0, "for screens": 2.2}


@pytest.mark.parametrize("gamma", RESPONSES.values(), ids=RESPONSES)
@pytest.mark.parametrize("level", [1.0, 2.2])
@pytest.mark.parametrize("name", BENT)
def test_the_direction_is_found_unfiltered(name: str, level: float, gamma: float):
    images = [picture(one, gamma, level) for one in ("straight", name)]
    initial, bent = (find_points(image, find_regions(image)) for image in images)
    for use in ("all", "blue"):
        answer = estimate_bending_direction(bent, initial, threshold=2.0, use=use)
        assert answer is BENT[name]


@pytest.mark.parametrize("gamma", RESPONSES.values(), ids=RESPONSES)
def test_gloss_and_dust_leave_blue_its_outline(gamma: float):
    image = picture("straight", gamma)
    regions = find_regions(image)
    assert regions.status in IN_VIEW
    points = find_points(image, regions)
    wanted = np.array([[159.5 - RADIUS, 119.5], [159.5, 119.5 + RADIUS], [159.5 + RADIUS, 119.5]])
    assert points.seen[:3].all()
    across = (points.xy[:3] - wanted)[[0, 1, 2], [0, 1, 0]]
    assert np.abs(across).max() < 1  # a pixel of an outline in whole pixels


def test_yellow_is_not_given_where_mirror_images_hide_it():
    regions = find_regions(picture("straight", 2.2))
    assert regions.status is ChamberStatus.GLOSSY_INSIDE
    assert not len(regions.yellow)
