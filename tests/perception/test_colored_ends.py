"""Ends of views in several colors: drawn pads, and strips of other colors behind their ends."""

import numpy as np
import pytest

from perception.colored_ends import APART, find_colors_apart
from perception.detection import detect_quads
from tests.perception.drawn import Eye, Pad, drawn, rays_of, stored

EYE = Eye()
LENS = EYE.lens()
PAD = Pad((20, -14), (22, 12))
LIT, BEHIND = (150, 70, 60), (45, 70, 150)
"""Red, green and blue light on a pad and on a wall: in green the two are one."""


def pictured(strip: float, end: int, fading: float = 0.0) -> np.ndarray:
    """A pad with a strip so long (mm) behind an end; red fades along the pad."""
    pads = [PAD]
    if strip:
        start = np.asarray((PAD.first, PAD.second)[end])
        stop = start + (-1, 1)[end] * strip * PAD.step
        pads.append(Pad(*map(tuple, (start, stop) if end else (stop, start))))
    channels = []
    for number, (lit, behind) in enumerate(zip(LIT, BEHIND, strict=True)):
        dims = fading if number == 0 else 0.0
        looks = [lambda at, lit=lit, dims=dims: lit * (1 - dims * at[:, 0] / PAD.length)]
        looks += [lambda at, behind=behind: np.full(len(at), float(behind))] * (len(pads) - 1)
        channels.append(stored(drawn(EYE, pads, looks, dark=5.0), noise=2.0, seed=number))
    return np.stack(channels, axis=-1)


@pytest.mark.parametrize("end", [0, 1])
@pytest.mark.parametrize("strip", [0.7, 1.2])
def test_a_strip_of_another_color_is_in_the_covariance_of_its_end(strip, end):
    picture, true = pictured(strip, end), EYE.places(PAD.corners())
    (quad,) = detect_quads(picture, LENS)
    off = quad.corners - true
    beyond, other = ([0, 3], [1, 2])[:: 1 if end == 0 else -1]
    # In green the strip is a part of the pad.
    assert np.hypot(*off[beyond].T).min() > APART
    spread = np.linalg.inv(quad.covariance + 0.1**2 * np.eye(2))
    assert np.einsum("ci,cij,cj->c", off, spread, off).max() < 3**2
    np.testing.assert_allclose(off[other], 0, atol=0.3)
    assert quad.covariance[other].max() < 0.3**2
    away = find_colors_apart(picture, LENS, quad.rays)
    # Half of the step in red is as far away as the strip is long.
    np.testing.assert_allclose(off[beyond] + away[beyond], 0, atol=1.0)


@pytest.mark.parametrize("fading", [0.0, 0.6])
def test_where_all_colors_end_at_a_pads_ends_nothing_is_added(fading):
    rays = rays_of(PAD.corners())
    assert not find_colors_apart(pictured(0.0, 0, fading), LENS, rays).any()
