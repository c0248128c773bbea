"""Ends of views in several colors: drawn pads, and strips of other colors behind their ends."""

import cv2
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


def pictured(strip: float, end: int) -> np.ndarray:
    """A pad with a strip so long (mm) behind an end."""
    pads = [PAD]
    if strip:
        start = (PAD.first, PAD.second)[end]
        way = (-1, 1)[end] * strip * PAD.step
        stop = (start[0] + float(way[0]), start[1] + float(way[1]))
        pads.append(Pad(start, stop) if end else Pad(stop, start))
    channels = []
    for number, (lit, behind) in enumerate(zip(LIT, BEHIND, strict=True)):
        looks = [lambda at, lit=lit: np.full(len(at), float(lit))]
        looks += [lambda at, behind=behind: np.full(len(at), float(behind))] * (len(pads) - 1)
        channels.append(stored(drawn(EYE, pads, looks, dark=5.0), noise=2.0, seed=number))
    return np.stack(channels, axis=-1)


@pytest.mark.parametrize("end", [0, 1])
@pytest.mark.parametrize("strip", [0.7, 1.2])
def test_an_end_behind_which_light_has_other_colors_is_found(strip, end):
    (quad,) = detect_quads(pictured(strip, end), LENS)
    off = np.hypot(*(quad.corners - EYE.places(PAD.corners())).T)
    beyond, other = ([0, 3], [1, 2])[:: 1 if end == 0 else -1]
    # In green the strip is a part of the pad.
    assert off[beyond].min() > APART
    assert off[other].max() < 0.3
    assert quad.apart.tolist() == [end == 0, end == 1]


def test_colors_count_at_the_other_end_of_what_a_lamp_lies_across():
    picture = pictured(0.9, 0)
    (left, top), (right, _) = EYE.places(PAD.corners())[1:3].astype(int)
    picture[top - 12 : top, left - 40 : right + 40] = 100, 100, 255
    picture = cv2.GaussianBlur(picture, (0, 0), 0.6)
    lit = [quad for quad in detect_quads(picture, LENS) if quad.before_lamp]
    assert [quad.apart.tolist() for quad in lit] == [[True, False]]


@pytest.mark.parametrize("fading", [0.0, 0.6])
@pytest.mark.parametrize("height", [8, 11, 12, 13, 16, 60])
def test_where_all_colors_end_at_a_pad_no_end_is_apart(height, fading):
    """However thin it is; and beside a brighter view 3 px above."""
    picture = np.full((EYE.rows, EYE.columns, 3), 5.0)
    rows = np.arange(height)[:, None]
    light = (1 - fading * rows / height) * np.array(LIT)
    picture[200 : 200 + height, 150:300] = light[:, None]
    picture[160:197, 150:300] = 2 * np.array(LIT)
    # Layers image red and blue a little elsewhere.
    for channel, shift in ((0, -1), (2, 1)):
        picture[..., channel] = np.roll(picture[..., channel], shift, axis=0)
    picture = stored(cv2.GaussianBlur(picture, (0, 0), 0.8), noise=2.0)
    low, high = 200 + height - 0.5, 199.5
    corners = np.array([[149.5, low], [149.5, high], [299.5, high], [299.5, low]])
    lens = Eye(pinhole=True).lens()
    assert not find_colors_apart(picture, lens, lens.rays(corners)[None]).any()


def test_what_is_across_a_part_of_an_end_is_no_color_of_it():
    picture, rays = pictured(0.0, 0), rays_of(PAD.corners())[None]
    left, top = EYE.places(PAD.corners())[1].astype(int)
    picture[top : top + 8, left : left + 35, 0] = 20
    assert not find_colors_apart(picture, LENS, rays).any()
    picture[top : top + 8, left : left + 70, 0] = 20
    assert find_colors_apart(picture, LENS, rays).tolist() == [[False, True]]
    picture[top : top + 8, left : left + 100, 0] = 20
    assert find_colors_apart(picture, LENS, rays).tolist() == [[False, True]]


@pytest.mark.parametrize(("step", "seen"), [(8, False), (25, True)])
def test_a_color_without_a_step_ends_nowhere(step, seen):
    picture = pictured(1.2, 1)
    (quad,) = detect_quads(picture, LENS)
    red = picture[..., 0].astype(float)
    picture[..., 0] = 20 + (red - red.min()) * step / np.ptp(red)
    picture[..., 2] = picture[..., 1]
    assert find_colors_apart(picture, LENS, quad.rays[None])[0, 1] == seen


@pytest.mark.parametrize(("strip", "apart"), [(45.0, True), (5.0, False)])
def test_between_two_lamps_either_side_shows_where_the_end_is(strip, apart):
    """In the middle the strip is as bright as the pad, and so is its median."""
    picture = np.full((EYE.rows, EYE.columns, 3), 5.0)
    ramp = np.linspace(10, 120, 150)
    picture[200:260, 150:300] = np.stack([ramp, np.full(150, 12.0), ramp[::-1]], axis=-1)
    picture[260:268, 150:300, ::2] = strip
    low = 267.5 if apart else 259.5
    corners = np.array([[149.5, low], [149.5, 199.5], [299.5, 199.5], [299.5, low]])
    lens = Eye(pinhole=True).lens()
    picture = stored(cv2.GaussianBlur(picture, (0, 0), 0.8), noise=2.0)
    assert find_colors_apart(picture, lens, lens.rays(corners)[None]).tolist() == [[apart, False]]


def test_of_several_views_each_is_looked_at_by_itself():
    """Two long ones, one of them without blue at an end, one of 16 px, and one too thin for any."""
    picture = np.full((EYE.rows, EYE.columns, 3), 5.0)
    corners = []
    for column, height in ((40, 60), (150, 60), (260, 16), (370, 10)):
        picture[200 : 200 + height, column : column + 90] = LIT
        low, right = 200 + height - 0.5, column + 89.5
        left, high = column - 0.5, 199.5
        corners.append([[left, low], [left, high], [right, high], [right, low]])
    picture[252:260, 40:130, 2] = picture[200:205, 260:350, 2] = picture[204:210, 370:460, 2] = 5
    picture = stored(cv2.GaussianBlur(picture, (0, 0), 0.8), noise=1.0)
    lens = Eye(pinhole=True).lens()
    rays = np.array([lens.rays(np.array(one)) for one in corners])
    together = find_colors_apart(picture, lens, rays)
    assert together.tolist() == [[True, False], [False, False], [False, True], [False, False]]
    for one, apart in zip(rays, together, strict=True):
        np.testing.assert_array_equal(find_colors_apart(picture, lens, one[None]), apart[None])
