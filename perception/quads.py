"""The outline of a pad's view: one line per side, straight in the tangent plane of its rays.

A plane pad through a wide lens has curved sides in the image, but straight ones in the plane that
touches the sphere of rays. Paper B approximates the image's contour by a polygon (§4.1.1), whose
corners are those of the pad's rounded ones; here every side is a line fitted robustly to the places
where the brightness crosses half of its step, and corners are where these lines meet.
"""

from __future__ import annotations

from collections.abc import Generator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int

from perception.images import checked_brightness
from perception.lens import Lens, TangentPlane
from perception.masks import Mask
from perception.quality import Quality
from perception.sides import (
    FEET,
    LEAST_CONTRAST,
    REACH,
    SMALL,
    Edges,
    Line,
    Outline,
    Side,
    find_all_edges,
    fit_all_lines,
)

INNER, HEIGHTS = (0.15, 0.85), 12
"""Heights at which a contour's outermost points give its sides at first, and how many."""

LEAST_RISE = 0.01
"""A side that rises less over its length is none."""

STEPS, SETTLED = 5, 0.05
"""Rounds of finding edges and fitting lines, at most, and by how many px a further one would move
no corner any more."""

FLAT = 1e-9
"""Corners that turn by less, product of two sides in the tangent plane, are none."""

RIGHT, UP = np.eye(2)
"""Directions in the tangent plane."""

WIDEST = 0.8 * 2 * REACH / FEET
"""Of a side's edge, px: of a wider one not both feet lie within reach, with a fifth to spare. Two
sides are blurred where a view is; the edge of one may be a gradient of light."""

CLEAR = 0.5
"""Other sides' edges are clear of at least this part of every side: a line through less of it would
be extended to a corner by more than its own length."""

ENDS_OF_SIDES = (None, 1, None, 0)
"""Which end of a view each side from corner to corner is, in the order of `Quad`, if any."""

NEAR_BORDER = 3
"""A blob within so many pixels of the image's border is cut off by it."""


@dataclass(frozen=True)
class Quad:
    """The view of a pad, or of what looks like one.

    Corners are in the order: lower section angle and lesser slope, higher and lesser, higher and
    greater, lower and greater (in the image: bottom left, top left, top right, bottom right).

    Attributes:
        rays: of the corners.
        corners: where they are in the image.
        covariance: of each corner's place, px².
        roughness: the part of it that is in every image of this pad: its edges are rough, px².
        area: of the blob, px².
        contrast: step of brightness across the side that has the least, of 255.
        scatter: standard deviation of edges about the side that fits worst, px.
        quality: complete, clipped, of low contrast or blurred.
        apart: whether some color ends elsewhere than at its lower and at its upper end: what lies
            behind a pad has other colors.
    """

    rays: Float[np.ndarray, "4 2"]
    corners: Float[np.ndarray, "4 2"]
    covariance: Float[np.ndarray, "4 2 2"]
    roughness: Float[np.ndarray, "4 2 2"]
    area: float
    contrast: float
    scatter: float
    quality: Quality
    apart: Bool[np.ndarray, "2"] = field(default_factory=lambda: np.zeros(2, bool))


def fit_quad(
    gray: Float[np.ndarray, "rows columns"],
    lens: Lens,
    contour: Int[np.ndarray, "_ 2"],
    lamps: Mask | None = None,
) -> Quad | None:
    """The view whose blob has a given contour.

    Args:
        gray: light, float32.
        lens: of the camera.
        contour: outermost pixels of a blob, column and row.
        lamps: where lamps are in view, if any are.

    Returns:
        The view; ``None`` where the contour has no four sides.

    Raises:
        UserError: the brightness is not float32, finite about the contour, and of the lens's size.

    Example:
        >>> import cv2
        >>> rows, columns = np.mgrid[:90, :120]
        >>> rays = np.stack([(44.5 - rows) / 200, (columns - 59.5) / 200], axis=-1)
        >>> lens = Lens(
        ...     rays, lambda r: np.stack([59.5 + 200 * r[:, 1], 44.5 - 200 * r[:, 0]], axis=-1)
        ... )
        >>> image = cv2.rectangle(np.zeros((90, 120), np.uint8), (30, 20), (89, 69), 200, -1)
        >>> (contour,), _ = cv2.findContours(image, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        >>> fit_quad(image.astype(np.float32), lens, contour[:, 0]).corners.round().tolist()
        [[30.0, 70.0], [30.0, 19.0], [89.0, 19.0], [89.0, 70.0]]
    """
    checked_brightness(gray, lens.shape, contour)
    return fit_quads(gray, lens, [contour], lamps)[0]


def fit_quads(
    gray: Float[np.ndarray, "rows columns"],
    lens: Lens,
    contours: Sequence[Int[np.ndarray, "_ 2"]],
    lamps: Mask | None = None,
) -> list[Quad | None]:
    """As `fit_quad`, of several contours at once, which takes half of the time."""
    found: list[Quad | None] = [None] * len(contours)
    searches = {}
    for number, contour in enumerate(contours):
        checked_brightness(gray, lens.shape, contour)
        rays = lens.pixel_rays(contour)
        plane = TangentPlane(float(rays[:, 0].min() + rays[:, 0].max()) / 2)
        corners = first_corners(plane.flat(rays))
        if corners is not None:
            searches[number] = _settling(lens, plane, corners, contour, gray.shape)
    for number, quad in _settled(gray, lens, searches, lamps).items():
        found[number] = quad
    return found


def follow_quads(
    gray: Float[np.ndarray, "rows columns"],
    lens: Lens,
    expected: Sequence[Float[np.ndarray, "4 2"]],
    lamps: Mask | None = None,
    beside: int | None = None,
) -> list[Quad | None]:
    """The views whose corners are expected at given places; as `fit_quads` otherwise.

    Args:
        gray: light, float32.
        lens: of the camera.
        expected: corners of each, in the order of `Quad`.
        lamps: where lamps are in view, if any are.
        beside: the end (0 the lower, 1 the upper) that adjoins another view: where light does not
            rise to that, none is returned.

    Example:
        >>> import cv2
        >>> rows, columns = np.mgrid[:90, :120]
        >>> rays = np.stack([(44.5 - rows) / 200, (columns - 59.5) / 200], axis=-1)
        >>> lens = Lens(
        ...     rays, lambda r: np.stack([59.5 + 200 * r[:, 1], 44.5 - 200 * r[:, 0]], axis=-1)
        ... )
        >>> image = cv2.rectangle(np.zeros((90, 120), np.uint8), (30, 20), (89, 69), 200, -1)
        >>> expected = np.array([[32.0, 68.0], [28.0, 22.0], [91.0, 21.0], [88.0, 72.0]])
        >>> (quad,) = follow_quads(image.astype(np.float32), lens, [expected])
        >>> quad.corners.round(1).tolist()
        [[29.7, 69.5], [29.7, 19.5], [89.3, 19.5], [89.3, 69.5]]
    """
    found: list[Quad | None] = [None] * len(expected)
    side = None if beside is None else ENDS_OF_SIDES.index(beside)
    searches = {}
    for number, corners in enumerate(expected):
        rays = lens.rays(corners)
        plane = TangentPlane(float(rays[:, 0].min() + rays[:, 0].max()) / 2)
        flat = plane.flat(rays)
        if _is_convex(flat):
            outline = np.clip(np.round(corners).astype(int), 0, np.array(gray.shape[::-1]) - 1)
            checked_brightness(gray, lens.shape, outline)
            searches[number] = _settling(lens, plane, flat, outline, gray.shape, side)
    for number, quad in _settled(gray, lens, searches, lamps).items():
        found[number] = quad
    return found


def _settled(
    gray: Float[np.ndarray, "rows columns"],
    lens: Lens,
    searches: Mapping[int, _Search],
    lamps: Mask | None,
) -> dict[int, Quad | None]:
    """The views that searches end with; what they ask for is found for all of them together."""
    lamps = lamps if lamps is not None and lamps.any() else None
    asked = {number: next(search) for number, search in searches.items()}
    found: dict[int, Quad | None] = {}
    while asked:
        outlines = list(asked.values())
        edges = find_all_edges(gray, lens, outlines, lamps)
        lines = fit_all_lines(edges)
        for number, outline, own, through in zip(list(asked), outlines, edges, lines, strict=True):
            try:
                asked[number] = searches[number].send(_moved(outline, own, through))
            except StopIteration as end:
                del asked[number]
                found[number] = end.value
    return found


def _settling(
    lens: Lens,
    plane: TangentPlane,
    corners: Float[np.ndarray, "4 2"],
    contour: Int[np.ndarray, "_ 2"],
    shape: tuple[int, ...],
    beside: int | None = None,
) -> _Search:
    """The search for a view from its first corners in the tangent plane.

    It asks for the edges of sides, is sent the outline that lies on them (or ``None``), and returns
    the view.
    """

    def sides_of(corners: Float[np.ndarray, "4 2"]) -> Outline:
        sides = [Side(corners[i], corners[(i + 1) % 4]) for i in range(4)]
        return Outline(plane, sides, beside)

    places, moved = lens.project(plane.rays(corners)), 0.0
    found = yield sides_of(corners)
    for _ in range(STEPS - 1):
        # A blotch, hardly there on any side, is not looked at more closely.
        if found is None or found.edges.contrast.max() < LEAST_CONTRAST:
            break
        before, earlier, places = places, moved, lens.project(plane.rays(found.corners))
        moved = float(np.abs(places - before).max())
        # Every round moves corners by about the same part of what the one before it has.
        if moved * (min(moved / earlier, 1.0) if earlier else 1.0) < SETTLED:
            break
        found = yield sides_of(found.corners)
    if found is None or (beside is not None and not found.edges.seam):
        return None
    rays = plane.rays(found.corners)
    rows, columns = shape
    border = (contour <= NEAR_BORDER) | (contour >= np.array([columns, rows]) - 1 - NEAR_BORDER)
    contrast = float(found.edges.contrast.min())
    scatter = max(line.scatter for line in found.lines)
    quality = Quality.COMPLETE
    # A lamp across an end may be before it, and hide a part of the pad.
    if border.any() or found.edges.lit[1::2].any():
        quality = Quality.CLIPPED
    elif contrast < LEAST_CONTRAST:
        quality = Quality.LOW_CONTRAST
    elif np.sort(found.edges.width)[-2] > WIDEST or found.edges.clear.min() < CLEAR:
        quality = Quality.BLURRED
    elif not np.isfinite(scatter):
        quality = Quality.LOW_CONTRAST
    area = float(cv2.contourArea(contour))
    covariances = _covariances(lens, plane, found)
    return Quad(rays, lens.project(rays), *covariances, area, contrast, scatter, quality)


def first_corners(flat: Float[np.ndarray, "_ 2"]) -> Float[np.ndarray, "4 2"] | None:
    """A trapezium whose ends lie across the section, around a contour in the tangent plane.

    So is every pad in an extruded scene. Its sides are lines through the outermost points of the
    contour at several heights, which also finds views of few pixels' height and acute corners.
    """
    low, high = flat[:, 1].min(), flat[:, 1].max()
    if not high > low:
        return None
    heights = low + (high - low) * np.linspace(*INNER, HEIGHTS)
    crossings = _outermost(flat, heights)
    if crossings is None:
        return None
    sides = []
    for outermost in crossings.T:
        # In units that suit single precision.
        points = np.stack([outermost, heights], axis=-1) / (high - low)
        middle = points.mean(axis=0)
        line = cv2.fitLine((points - middle).astype(np.float32), cv2.DIST_HUBER, 0, 1e-3, 1e-3)
        right, up, x, y = line.ravel().astype(float)
        if abs(up) < LEAST_RISE:
            return None
        ends = np.array([low, high]) / (high - low) - middle[1]
        sides.append((middle[0] + x + right / up * (ends - y)) * (high - low))
    (left_low, left_high), (right_low, right_high) = sides
    if not (left_low < right_low and left_high < right_high):
        return None
    return np.array([[left_low, low], [left_high, high], [right_high, high], [right_low, low]])


def ordered(corners: Float[np.ndarray, "4 2"]) -> Float[np.ndarray, "4 2"]:
    """Four corners in the order of `Quad`, from (across, up) in any order."""
    by_height = corners[np.argsort(corners[:, 1])]
    low, high = (part[np.argsort(part[:, 0])] for part in (by_height[:2], by_height[2:]))
    return np.stack([low[0], high[0], high[1], low[1]]).astype(float)


def _outermost(
    contour: Float[np.ndarray, "_ 2"], heights: Float[np.ndarray, " heights"]
) -> Float[np.ndarray, "heights 2"] | None:
    """Where a closed contour crosses each of some heights first and last, if it crosses all."""
    following = np.roll(contour, -1, axis=0)
    below = contour[:, 1] <= heights[:, None]
    at, starts = np.nonzero(below != np.roll(below, -1, axis=1))
    start, end = contour[starts], following[starts]
    part = (heights[at] - start[:, 1]) / (end[:, 1] - start[:, 1])
    across = start[:, 0] + part * (end[:, 0] - start[:, 0])
    found = np.tile([np.inf, -np.inf], (len(heights), 1))
    np.minimum.at(found[:, 0], at, across)
    np.maximum.at(found[:, 1], at, across)
    return found if np.isfinite(found).all() else None


class _Fitted(NamedTuple):
    """A quadrilateral whose sides have been moved onto their edges.

    Attributes:
        sides: as they were.
        edges: that were found across them.
        lines: through these.
        corners: where the lines meet.
    """

    sides: list[Side]
    edges: Edges
    lines: list[Line]
    corners: Float[np.ndarray, "4 2"]


_Search = Generator[Outline, _Fitted | None, Quad | None]


def _moved(outline: Outline, edges: Edges, lines: list[Line]) -> _Fitted | None:
    """An outline whose sides are moved onto their lines; ``None`` where these do not meet."""
    corners = _meeting(outline.sides, lines)
    return None if corners is None else _Fitted(outline.sides, edges, lines, corners)


def _meeting(sides: list[Side], lines: list[Line]) -> Float[np.ndarray, "4 2"] | None:
    """Where neighbouring sides meet when they have moved onto their lines."""
    ends = [
        (side.start + line.at(0.0) * side.outward, side.end + line.at(1.0) * side.outward)
        for side, line in zip(sides, lines, strict=True)
    ]
    corners = []
    for i in range(4):
        (a, b), (c, d) = ends[i - 1], ends[i]
        first, second = b - a, d - c
        across = first[0] * second[1] - first[1] * second[0]
        if abs(across) < 1e-12:
            return None
        part = ((c - a)[0] * second[1] - (c - a)[1] * second[0]) / across
        corners.append(a + part * first)
    found = np.stack(corners)
    return found if _is_convex(found) else None


def _is_convex(corners: Float[np.ndarray, "4 2"]) -> bool:
    """Whether four corners, in the order of a `Quad`, go clockwise around something."""
    sides = np.roll(corners, -1, axis=0) - corners
    following = np.roll(sides, -1, axis=0)
    turns = sides[:, 0] * following[:, 1] - sides[:, 1] * following[:, 0]
    return bool(np.isfinite(corners).all() and (turns < -FLAT).all())


def _covariances(
    lens: Lens, plane: TangentPlane, outline: _Fitted
) -> tuple[Float[np.ndarray, "4 2 2"], Float[np.ndarray, "4 2 2"]]:
    """Covariance of every corner's place in the image, and the part that is roughness, px²."""
    corners, sides, lines = outline.corners, outline.sides, outline.lines
    moved = np.concatenate([corners, corners + SMALL * RIGHT, corners + SMALL * UP])
    at, right, up = np.split(lens.project(plane.rays(moved)), 3)
    to_image = np.stack([right - at, up - at], axis=-1) / SMALL
    outward = np.stack([side.outward for side in sides])
    normals = np.stack([np.roll(outward, 1, axis=0), outward], axis=1)
    # Of the side that ends in each corner, and of the one that begins there.
    variances = np.array([(lines[i - 1].variances(1.0), lines[i].variances(0.0)) for i in range(4)])
    to_plane = to_image @ np.linalg.inv(normals)
    covariance, roughness = (
        (to_plane * variances[:, None, :, part]) @ np.swapaxes(to_plane, 1, 2) for part in range(2)
    )
    return covariance, roughness
