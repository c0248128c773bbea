"""Corners of outlines: sides that are straight in space or bowed, outlines seen edge-on."""

import numpy as np
import pytest

from perception.straightening import SHARES, find_straight_corners
from tests.perception.drawn import Eye, rays_of

EYE = Eye()

IN_VIEW = [(20.0, -9.0, -8.0), (22.0, 7.0, -8.0), (22.0, 7.0, 8.0), (20.0, -9.0, 8.0)]
"""Corners in space: forward, up, across."""

SQUARE = [(-8.0, -8.0), (8.0, -8.0), (8.0, 8.0), (-8.0, 8.0)]

BESIDE = [(x, y - 100.0, z) for x, y, z in IN_VIEW]
"""Partly beyond the border of the image, which is 79° below the axis."""


def sides_of(corners: np.ndarray) -> np.ndarray:
    """Places along the sides in space, from corner to corner."""
    steps = np.roll(corners, -1, axis=0) - corners
    return corners[:, None] + SHARES[:, None] * steps[:, None]


@pytest.mark.parametrize("corners", [IN_VIEW, BESIDE])
def test_sides_that_are_straight_in_space_meet_at_the_corners(corners):
    corners = np.array(corners)
    found = find_straight_corners(rays_of(sides_of(corners)), EYE.lens())
    np.testing.assert_allclose(found, EYE.places(corners), atol=1e-9)


def test_a_side_that_is_bowed_counts_where_it_is_on_average():
    corners = np.array([(20.0, up, across) for up, across in SQUARE])
    sides, bow = sides_of(corners), 0.3 * 4 * SHARES * (1 - SHARES)
    sides[1, :, 1] += bow
    corners[1:3, 1] += bow.mean()
    found = find_straight_corners(rays_of(sides), EYE.lens())
    np.testing.assert_allclose(found, EYE.places(corners), atol=1e-9)


def test_what_is_seen_edge_on_has_no_corners():
    along_section = [(20.0 + across, up, 0.0) for up, across in SQUARE]
    across_it = [(20.0 + up, 0.4 * (20.0 + up), across) for up, across in SQUARE]
    for corners in map(np.array, (along_section, across_it)):
        assert np.isnan(find_straight_corners(rays_of(sides_of(corners)), EYE.lens())).all()
