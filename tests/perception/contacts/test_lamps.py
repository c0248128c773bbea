"""Light of a lamp against a sum over many points of it."""

from __future__ import annotations

import numpy as np
import pytest

from perception.contacts import Lamp
from perception.contacts.lamps import Pieces


def summed(place, height, normal, low, high):
    """Irradiance by a lamp along the pad from 0 to 24 mm, 12 mm beside its middle."""
    along, up = np.meshgrid(
        (np.arange(600) + 0.5) / 25, low + (np.arange(200) + 0.5) / 200 * (high - low)
    )
    ways = np.stack([along - place[0], 12 - place[1] + 0 * along, up - height], axis=-1)
    met = np.maximum(ways @ normal, 0) * (ways[..., 2] > 0)
    return np.sum(ways[..., 1] * met / np.sum(ways**2, axis=-1) ** 2)


@pytest.mark.parametrize(("low", "high"), [(0.0, 6.0), (1.0, 4.0)])
@pytest.mark.parametrize("across", [-8.0, 0.0, 6.0])
@pytest.mark.parametrize("slopes", [(0.0, 0.0), (0.3, 0.5), (-0.2, -0.2)])
@pytest.mark.parametrize("height", [0.0, 0.8])
def test_light_is_that_of_all_points_of_a_lamp(low, high, across, slopes, height):
    place = np.array([10.0, across])
    normal = np.array([-slopes[0], -slopes[1], 1])
    normal /= np.linalg.norm(normal)
    pieces = Pieces.of(Lamp((0, 12), (24, 12), low, high), place, *place[:, None])
    # Of shape (sets, places).
    given = (np.full((1, 1), one) for one in (*normal, height))
    expected = summed(place, height, normal, low, high)
    expected /= summed(place, 0.0, np.array([0.0, 0, 1]), low, high)
    assert pieces.light(*given).item() == pytest.approx(expected, rel=0.06, abs=0.08)
