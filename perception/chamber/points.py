"""Seven points of the blue and the yellow region (paper A §III.B, Fig. 7), finer than pixels.

An extreme point is where a parabola through the edge has its extreme; the edge itself is found in
the image's colours, in every line across it. The paper takes an extreme pixel of a binary image;
its run of equally extreme pixels is tens of pixels long, and noise decides how far out it lies.
"""

from __future__ import annotations

import enum
import functools
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float

from perception.chamber.colors import despeckled
from perception.chamber.outlines import Outline, filled
from perception.chamber.regions import Regions
from perception.images import checked_image
from perception.masks import Image, Mask

NAMES = "abcdefg"
"""The paper's names, in the order of Points: leftmost, lowest and rightmost point of blue, the same
of yellow, centre of blue."""

BLUE_EDGE = np.array([-1.0, 1.0, 1.0])
"""Weights of red, green, blue: blue, yellow and the top are all above red. A weighted sum, as it
stays proportional to the share of a pixel that is beyond the edge."""

YELLOW_EDGE = np.array([1.0, 1.0, -2.0])
"""The same for yellow and the top, above blue; yellow also above red."""

AROUND = np.arange(-5, 5)
"""Pixels across an edge, from the outermost one of the outline; the edge is about half a pixel
outside that one."""

OUTER, ACROSS, INNER = slice(0, 2), slice(2, 8), slice(8, 10)
"""Of these: outside the edge and its blur, on the edge, inside it."""

REACH, REACH_SHARE = 20, 0.2
"""Half the lines of a fit, at most and over the outline's size: a circle's deviation from its
parabola then stays below 0.03 px."""

LEAST_CONTRAST = 12.0
"""Grey levels; an edge with less stays at the outline of the labels."""

SMOOTH = 0.5
"""Root mean square from the parabola, px; what is farther from one is a corner."""

BORDER = 1
"""An outline that comes so near to the image's border, px, is cut by it."""


@dataclass(frozen=True)
class Points:
    """The seven points of one frame, in the order a to g of the paper.

    Attributes:
        xy: pixels, to the right and down; pixels have their middles at integers. 0 if not seen.
        seen: whether the region is in view and the point is not where the image's border cuts it.
            The centre of blue counts as seen whenever blue is in view; it is that of what the
            border leaves.
    """

    xy: Float[np.ndarray, "7 2"]
    seen: Bool[np.ndarray, "7"]


class _Side(enum.Enum):
    LEFT = enum.auto()
    LOWEST = enum.auto()
    RIGHT = enum.auto()


def _turned(array: np.ndarray, side: _Side) -> np.ndarray:
    """An image whose rows begin at this side."""
    if side is _Side.LEFT:
        return array
    return (array.swapaxes(0, 1) if side is _Side.LOWEST else array)[:, ::-1]


@functools.lru_cache(maxsize=128)
def _parabola(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Powers 0 to 2 at evenly spaced places from -1 to 1, and their pseudoinverse."""
    powers = np.linspace(-1.0, 1.0, count)[:, None] ** np.arange(3)
    return powers, np.linalg.pinv(powers)


def _crossings(
    image: np.ndarray, rows: np.ndarray, first: np.ndarray, weights: np.ndarray
) -> Float[np.ndarray, " rows"]:
    """Where an edge crosses rows, whose first pixels within the outline are known.

    The share of every pixel that is outside, by its colour between those on both sides, summed:
    the blur of the image leaves this sum alone.
    """
    columns = np.clip(first[:, None] + AROUND, 0, image.shape[1] - 1)
    signal = image[rows[:, None], columns] @ weights
    outer, inner = np.median(signal[:, OUTER]), np.median(signal[:, INNER])
    if inner - outer < LEAST_CONTRAST:
        return first - 0.5
    # Beyond the levels of both sides there are other regions and highlights.
    outside = np.clip((inner - signal[:, ACROSS]) / (inner - outer), 0.0, 1.0)
    return first + AROUND[ACROSS.start] - 0.5 + outside.sum(axis=1)


def _extreme(
    image: Image, outline: Outline, within: Mask, weights: np.ndarray, side: _Side
) -> tuple[float, float] | None:
    """The extreme point of an outline, column and row; None where the border cuts it."""
    image, within = _turned(image, side), _turned(within, side)
    lines, depth = within.shape
    along, across = outline.T if side is _Side.LOWEST else outline.T[::-1]
    if side is not _Side.LEFT:
        across = depth - 1 - across
    run = along[across == across.min()]
    start, end = run.min(), run.max()
    if across.min() <= BORDER or start <= BORDER or end >= lines - 1 - BORDER:
        return None

    reach = int(np.clip(REACH_SHARE * np.ptp(along), 2, REACH))
    middle = (start + end) // 2
    rows = np.arange(max(middle - reach, along.min()), min(middle + reach, along.max()) + 1)
    first = within[rows].argmax(axis=1)
    edge = _crossings(image, rows, first, weights)
    inward, position = _vertex(rows, edge) or (
        float(edge[first == first.min()].mean()),
        float(start + end) / 2,
    )
    if side is _Side.LEFT:
        return inward, position
    outward = depth - 1 - inward
    return (position, outward) if side is _Side.LOWEST else (outward, position)


def _vertex(rows: np.ndarray, edge: np.ndarray) -> tuple[float, float] | None:
    """The least value of a parabola through an edge, and its row; None if the edge is none."""
    if len(edge) < 5:
        return None
    powers, inverse = _parabola(len(edge))
    constant, slope, bend = coefficients = inverse @ edge
    rest = powers @ coefficients - edge
    if bend <= 0 or abs(slope) > 2 * bend or rest @ rest > SMOOTH**2 * len(edge):
        return None
    middle, half = (rows[0] + rows[-1]) / 2, (rows[-1] - rows[0]) / 2
    return float(constant - slope**2 / (4 * bend)), float(middle - half * slope / (2 * bend))


def find_points(image: Image, regions: Regions) -> Points:
    """The points a to g of one frame.

    Source: paper A §III.B, Fig. 7. Readings: a region's points are those of its filled outer
    outline, the centre too, which else would jump when yellow leaves the view; the lowest point is
    that with the largest y; an edge that is the image's border does not count.

    Args:
        image: red, green, blue.
        regions: of this image.

    Raises:
        UserError: it is no image of three channels of 8 bits, or not as large as the regions.

    Example:
        >>> import numpy as np
        >>> from perception.chamber import find_regions
        >>> image = np.zeros((240, 320, 3), np.uint8)
        >>> bool(find_points(image, find_regions(image)).seen.any())  # a dark image has no chamber
        False
    """
    image = despeckled(
        checked_image(image, like=("the picture of the regions", regions.labels.shape))
    )
    xy, seen = np.zeros((7, 2)), np.zeros(7, bool)
    parts = (0, regions.blue, BLUE_EDGE), (3, regions.yellow, YELLOW_EDGE)
    for start, outline, weights in parts:
        if len(outline):
            within = filled(outline, regions.labels.shape)
            for number, side in enumerate(_Side, start):
                point = _extreme(image, outline, within, weights, side)
                if point is not None:
                    xy[number], seen[number] = point, True
    if len(regions.blue):
        moments = cv2.moments(regions.blue)
        xy[6] = moments["m10"] / moments["m00"], moments["m01"] / moments["m00"]
        seen[6] = True
    return Points(xy, seen)
