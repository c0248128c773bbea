"""Places that are lifted, and the rays that show them, against a camera in three dimensions."""

import numpy as np
import pytest

from perception.places import find_places_in_air, find_sight
from tests.perception.drawn import Eye, Pad, exact_view

EYE = Eye(540, 720, focal=193.0)
PADS = {"before": Pad((20, -12), (22, 12)), "below": Pad((21, -20), (8, -36), width=20.0)}


def axes_of(pad):
    """Unit vectors along a pad, across it, and towards the camera."""
    first, along, across = pad.points(np.array([[0.0, 0], [1, 0], [0, 1]]))
    along, across = along - first, across - first
    up = np.cross(along, across)
    return along, across, -up * np.sign(up @ first)


@pytest.mark.parametrize("name", PADS)
def test_lifted_places_are_imaged_where_the_camera_images_them(name):
    pad = PADS[name]
    flat = pad.lattice(7).reshape(-1, 2)
    places_of = find_places_in_air(exact_view(EYE, pad), EYE.lens(), pad.length, pad.width)
    for height in (0.0, 0.5, 1.5):
        there = EYE.places(pad.points(flat) + height * axes_of(pad)[2])
        found = places_of(np.column_stack([flat, np.full(len(flat), height)]))
        # Corners are found in single precision.
        np.testing.assert_allclose(found, there, atol=0.02)


@pytest.mark.parametrize("name", PADS)
def test_rays_have_the_slopes_of_lines_to_the_camera(name):
    pad = PADS[name]
    places_of = find_places_in_air(exact_view(EYE, pad), EYE.lens(), pad.length, pad.width)
    sight = find_sight(places_of, pad.length, pad.width)
    nodes = len(sight.slopes)
    along = np.linspace(0, pad.length, nodes)
    across = np.linspace(-pad.width / 2, pad.width / 2, nodes)
    flat = np.stack(np.meshgrid(along, across, indexing="ij"), axis=-1)
    # The camera is at the origin: towards it a line rises by its part along the normal.
    away = -pad.points(flat.reshape(-1, 2)) @ np.stack(axes_of(pad)).T
    wanted = (away[:, :2] / away[:, 2:]).reshape(nodes, nodes, 2)
    np.testing.assert_allclose(sight.slopes, wanted, atol=0.02)
