"""Angles between square tags that lie in parallel planes, as those on the sides of phalanges do.

Such planes have one vanishing line: what makes the image of one of them as seen from straight above
does so to all, but for place and size. So of all tags together four numbers are fitted, of this
rectification (R. Hartley, A. Zisserman, *Multiple View Geometry*, 2nd ed., §2.7), and four of
each: its place, size and turn.
"""

from __future__ import annotations

import cv2
import numpy as np
import scipy.optimize
from jaxtyping import Float

from perception.images import checked_image

DICTIONARY = cv2.aruco.DICT_APRILTAG_36h11
"""As `designopt new board` draws tags by default."""

SQUARE = np.array([-1 + 1j, 1 + 1j, 1 - 1j, -1 - 1j])
"""Corners of a tag in the order in which OpenCV has them: from its own top left on, clockwise."""


def find_tag_turns(image: object, count: int) -> Float[np.ndarray, " count"]:
    """By how much each tag is turned from tag number 0, counter-clockwise in the image.

    Args:
        image: with AprilTags 36h11 of the numbers 0 to count - 1; red, green and blue, 8 bits.
        count: number of tags, at least two.

    Returns:
        Angles, rad, from -π to π; NaN of tags that are not found, and of all without number 0.

    Raises:
        UserError: it is no image.

    Example:
        >>> dictionary = cv2.aruco.getPredefinedDictionary(DICTIONARY)
        >>> tags = [cv2.aruco.generateImageMarker(dictionary, number, 80) for number in range(2)]
        >>> image = np.full((160, 320), 255, np.uint8)
        >>> image[40:120, 40:120], image[40:120, 200:280] = tags[0], np.rot90(tags[1])
        >>> np.degrees(find_tag_turns(np.stack(3 * [image], axis=-1), 2)).round(1).tolist()
        [0.0, 90.0]
    """
    gray = cv2.cvtColor(checked_image(image), cv2.COLOR_RGB2GRAY)
    settings = cv2.aruco.DetectorParameters()
    settings.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_CONTOUR
    dictionary = cv2.aruco.getPredefinedDictionary(DICTIONARY)
    corners, numbers, _ = cv2.aruco.ArucoDetector(dictionary, settings).detectMarkers(gray)
    turns = np.full(count, np.nan)
    found = {} if numbers is None else dict(zip(numbers.ravel().tolist(), corners, strict=True))
    seen = [number for number in range(count) if number in found]
    if 0 not in seen:
        return turns
    places = np.array([found[number].reshape(4, 2) for number in seen], float)
    # Rows go down. Near 1, terms of the vanishing line are as large as the others.
    middle, scale = places.reshape(-1, 2).mean(axis=0), float(np.ptp(places))
    turns[seen] = _turns((places - middle) / scale * [1, -1])
    return turns


def _turns(places: Float[np.ndarray, "tags 4 2"]) -> Float[np.ndarray, " tags"]:
    """Of squares in parallel planes, from the first."""
    x, y = np.moveaxis(places, -1, 0)

    def rectified(view: Float[np.ndarray, "4"]) -> np.ndarray:
        skew, stretch, line_x, line_y = view
        return (x + skew * y + 1j * np.exp(stretch) * y) / (1 + line_x * x + line_y * y)

    def similar(view: Float[np.ndarray, "4"]) -> tuple[np.ndarray, np.ndarray]:
        """Rectified corners about their middles, and the turn and size that fit these best."""
        corners = rectified(view)
        about = corners - corners.mean(axis=1, keepdims=True)
        return about, (about @ SQUARE.conj()) / np.sum(np.abs(SQUARE) ** 2)

    def residuals(view: Float[np.ndarray, "4"]) -> Float[np.ndarray, " residuals"]:
        about, factor = similar(view)
        # In units of a tag's size: else all of them would shrink to nothing.
        left = (about - factor[:, None] * SQUARE) / np.abs(factor).mean()
        return np.concatenate([left.real.ravel(), left.imag.ravel()])

    fit = scipy.optimize.least_squares(residuals, np.zeros(4))
    factor = similar(fit.x)[1]
    return np.angle(factor / factor[0])
