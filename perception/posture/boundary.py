"""Boundaries between the coloured regions of a chamber, and these as a network takes them.

Source: paper A, *Vision-Based Tactile Perception for Soft Robotic Hand*, §III.A, which gives the
network boundary images. How they are made smaller is a reading: not stated there.
"""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import Float32, UInt8

from designopt.errors import UserError
from perception.images import checked_image

THICKEN = np.ones((3, 3), np.uint8)


def make_boundary_image(
    labels: UInt8[np.ndarray, "rows columns"],
) -> UInt8[np.ndarray, "rows columns"]:
    """Where regions meet: 255 where a pixel's label is not that of the pixel right of or below it.

    The image's own border is no boundary: its last column has nothing right of it, its last row
    nothing below it.

    Args:
        labels: of every pixel, the region it belongs to.

    Raises:
        UserError: it is no image of one channel of 8 bits.

    Example:
        >>> labels = np.array([[0, 0, 1, 1]] * 2, np.uint8)
        >>> make_boundary_image(labels).tolist()
        [[0, 255, 0, 0], [0, 255, 0, 0]]
    """
    labels = checked_image(labels, channels=(1,), what="an image of labels")
    edges = np.zeros(labels.shape, np.bool_)
    edges[:, :-1] = labels[:, :-1] != labels[:, 1:]
    edges[:-1] |= labels[:-1] != labels[1:]
    return edges.view(np.uint8) * np.uint8(255)


def shrink(
    boundary: UInt8[np.ndarray, "rows columns"], size: tuple[int, int]
) -> Float32[np.ndarray, "_rows _columns"]:
    """A boundary image made smaller: lines thickened by a pixel all round, then area averages.

    Averages keep in grey levels where in a pixel a line runs, which picking pixels would lose.

    Args:
        boundary: 255 on a boundary, else 0.
        size: columns and rows of the result, at most those of the image.

    Returns:
        0 to 255.

    Raises:
        UserError: it is no image of one channel of 8 bits, or the size is not positive or larger.

    Example:
        >>> shrink(np.zeros((48, 64), np.uint8), (16, 12)).shape
        (12, 16)
    """
    boundary = checked_image(boundary, channels=(1,), what="a boundary image")
    rows, columns = boundary.shape
    if not (1 <= size[0] <= columns and 1 <= size[1] <= rows):
        raise UserError(
            f"an image of {columns}x{rows} px cannot be shrunk to {size[0]}x{size[1]} px; give a "
            "larger image, or train the network for a smaller size"
        )
    thick = cv2.dilate(boundary, THICKEN).astype(np.float32)
    return cv2.resize(thick, size, interpolation=cv2.INTER_AREA)
