"""Lines drawn within pads, as clear layers show them, and none where there are none."""

import cv2
import numpy as np
import pytest

from perception.detection import detect_quads
from perception.lens import TangentPlane
from tests.perception.drawn import BRIGHT, Eye, Pad, drawn, rays_of, stored

EYE = Eye(rows=540, columns=720, focal=195.0)
LENS = EYE.lens()
PAD, INNER = Pad((20, -14), (22, 12)), 1.5
"""The pad's image, and by how many mm the pad itself is smaller on every side."""


def membrane() -> Pad:
    first, second = (tuple(np.add(end, side * INNER * PAD.step))
                     for end, side in ((PAD.first, 1), (PAD.second, -1)))  # fmt: skip
    return Pad(first, second, width=PAD.width - 2 * INNER)


@pytest.mark.parametrize("beside", [0.6, 1.3])
def test_the_edge_of_a_pad_within_the_image_of_a_wall_is_given_beside_the_outline(beside):
    looks = [lambda places, level=level: np.full(len(places), level)
             for level in (BRIGHT, beside * BRIGHT)]  # fmt: skip
    light = drawn(EYE, [membrane(), PAD], looks)
    (quad,) = detect_quads(stored(cv2.GaussianBlur(light, (0, 0), 0.7), noise=1.0), LENS)
    np.testing.assert_allclose(quad.corners, EYE.places(PAD.corners()), atol=0.5)
    # In the tangent plane, where sides are straight.
    rays = rays_of(membrane().corners())
    plane = TangentPlane(float(rays[:, 0].mean()))
    true = EYE.focal * plane.flat(rays)
    for i, line in enumerate(quad.inner):
        assert line is not None
        assert line.share > 0.9
        assert line.step == pytest.approx((beside - 1) * BRIGHT, rel=0.2)
        begin, end = true[i], true[(i + 1) % 4]
        along = (end - begin) / np.hypot(*(end - begin))
        normal = np.array([-along[1], along[0]])
        # Lines go from beside one corner to beside the next; wherever they meet its own side.
        ends = EYE.focal * plane.flat(LENS.rays(line.ends))
        np.testing.assert_allclose((ends - begin) @ normal, 0, atol=0.7)


@pytest.mark.parametrize("noise", [0.0, 3.0])
def test_a_pad_in_air_has_no_line_within(noise):
    light = cv2.GaussianBlur(drawn(EYE, [PAD]), (0, 0), 0.7)
    (quad,) = detect_quads(stored(light, noise=noise), LENS)
    assert quad.inner == (None, None, None, None)
