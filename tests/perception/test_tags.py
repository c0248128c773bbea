"""Tags in pictures that OpenCV's projection of their corners has made, from in front and aslant."""

import cv2
import numpy as np
import pytest

from designopt.errors import UserError
from perception import find_tag_turns
from perception.tags import DICTIONARY

SIZE, MARGIN = 200, 40
"""Of a tag's bitmap, and of the white about it, px."""

SIDE = 10.0
"""Of a tag, mm."""

CAMERA = np.array([[1400.0, 0, 719.5], [0, 1400, 539.5], [0, 0, 1]])
SHAPE = 1080, 1440
LARGER = 3


def picture(turns, tilt, heights, numbers):
    """Tags in planes at heights (mm) that a camera 250 mm away sees aslant."""
    image = np.full([LARGER * one for one in SHAPE], 200, np.uint8)
    wide = SIZE + 2 * MARGIN
    half = SIDE * wide / SIZE / 2
    bitmap = np.array([[0, 0], [wide, 0], [wide, wide], [0, wide]], np.float32) - 0.5
    for place, (turn, height, number) in enumerate(zip(turns, heights, numbers, strict=True)):
        tag = cv2.aruco.generateImageMarker(
            cv2.aruco.getPredefinedDictionary(DICTIONARY), number, SIZE
        )
        tag = np.pad(tag, MARGIN, constant_values=255)
        # Rows go down: counter-clockwise in the image is about -z of OpenCV's camera.
        cosine, sine = np.cos(turn), np.sin(turn)
        square = np.array([[-half, -half], [half, -half], [half, half], [-half, half]])
        square = square @ [[cosine, -sine], [sine, cosine]] + [45.0 * (place - 1), 8.0 * place]
        points = np.column_stack([square, np.full(4, height)])
        corners = cv2.projectPoints(points, np.array(tilt), np.array([0, 0, 250.0]), CAMERA, None)
        corners = (corners[0].reshape(4, 2) + 0.5) * LARGER - 0.5
        to_image = cv2.getPerspectiveTransform(bitmap, corners.astype(np.float32))
        drawn = cv2.warpPerspective(tag, to_image, image.shape[::-1])
        there = cv2.warpPerspective(np.full_like(tag, 255), to_image, image.shape[::-1])
        image = np.where(there > 127, drawn, image)
    small = cv2.resize(image, SHAPE[::-1], interpolation=cv2.INTER_AREA)
    return np.stack(3 * [cv2.GaussianBlur(small, (0, 0), 0.8)], axis=-1)


@pytest.mark.parametrize(
    ("tilt", "heights"),
    [
        ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
        ((0.2, 0.0, 0.0), (0.0, 5.0, -5.0)),
        ((0.0, -0.2, 0.0), (4.0, 0.0, -6.0)),
        ((0.15, 0.15, 0.3), (0.0, -5.0, 5.0)),
    ],
)
def test_turns_are_those_of_the_tags_however_the_camera_looks(tilt, heights):
    turns = np.array([0.2, -0.9, 1.3])
    found = find_tag_turns(picture(turns, tilt, heights, (0, 1, 2)), 3)
    np.testing.assert_allclose(np.degrees(found - (turns - turns[0])), 0, atol=0.4)


def test_a_tag_that_is_missing_has_no_turn():
    image = picture((0.0, 0.5), (0.0, 0.0, 0.0), (0.0, 0.0), (0, 2))
    found = find_tag_turns(image, 3)
    assert np.isnan(found[1])
    assert np.degrees(found[2] - 0.5) == pytest.approx(0, abs=0.4)


def test_without_the_first_tag_there_is_no_turn():
    image = picture((0.0, 0.5), (0.0, 0.0, 0.0), (0.0, 0.0), (1, 2))
    assert np.isnan(find_tag_turns(image, 3)).all()
    assert np.isnan(find_tag_turns(np.zeros((60, 80, 3), np.uint8), 3)).all()


def test_what_is_no_image_is_refused():
    with pytest.raises(UserError):
        find_tag_turns(np.zeros((4, 4)), 2)
