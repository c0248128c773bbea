"""The outline of a pad's view: one line per side, straight in the tangent plane of its rays.

A plane pad through a wide lens has curved sides in the image, but straight ones in the plane that
touches the sphere of rays. Paper B approximates the image's contour by a polygon (§4.1.1), whose
corners are those of the pad's rounded ones; here every side is a line fitted robustly to the places
where the brightness crosses half of its step, and corners are where these lines meet.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int

from perception.images import checked_brightness
from perception.lens import Lens, TangentPlane
from perception.lines import Lines, fit_lines
from perception.masks import Mask
from perception.quality import Quality
from perception.sides import (
    FEET,
    FOLLOWING,
    LEAST_CONTRAST,
    REACH,
    SMALL,
    Brightness,
    Sides,
    find_edges,
)

HEIGHTS = np.linspace(0.15, 0.85, 12)
"""Parts of a contour's height at which its outermost points give its sides at first."""

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

PRECEDING = [3, 0, 1, 2]
"""Of each side, or corner, the one before it."""

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
        before_lamp: whether all four sides were found, but a lamp lies across an end, which may
            hide a part of the pad: that is why it is clipped.
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
    before_lamp: bool = False


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
    """As `fit_quad`, but for its check, of several contours at once: in half of the time."""
    starts: list[_Start | None] = []
    for contour in contours:
        rays = lens.pixel_rays(contour)
        plane = TangentPlane(float(rays[:, 0].min() + rays[:, 0].max()) / 2)
        corners = first_corners(plane.flat(rays))
        starts.append(None if corners is None else _Start(plane.angle, corners, contour))
    return _settled(gray, lens, starts, lamps)


def follow_quads(
    gray: Brightness | Sequence[Brightness],
    lens: Lens,
    expected: Sequence[Float[np.ndarray, "4 2"]],
    lamps: Mask | None = None,
    beside: int | None = None,
) -> list[Quad | None]:
    """The views whose corners are expected at given places; as `fit_quads` otherwise.

    Args:
        gray: light, float32; that in which each is looked for where it is not the same for all.
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
    starts: list[_Start | None] = []
    limits = np.array(lens.shape[::-1]) - 1
    every = [gray] * len(expected) if isinstance(gray, np.ndarray) else gray
    for corners, _ in zip(expected, every, strict=True):
        rays = lens.rays(corners)
        plane = TangentPlane(float(rays[:, 0].min() + rays[:, 0].max()) / 2)
        flat = plane.flat(rays)
        if not _are_convex(flat):
            starts.append(None)
            continue
        outline = np.clip(np.round(corners).astype(int), 0, limits)
        starts.append(_Start(plane.angle, flat, outline))
    return _settled(gray, lens, starts, lamps, beside)


class _Start(NamedTuple):
    """Where a view is looked for first.

    Attributes:
        angle: of the tangent plane.
        corners: in that plane, in the order of a `Quad`.
        contour: pixels around it.
    """

    angle: float
    corners: Float[np.ndarray, "4 2"]
    contour: Int[np.ndarray, "_ 2"]


class _Fits(NamedTuple):
    """What was found of several views, last.

    Attributes:
        corners: where the lines through the sides' edges meet.
        is_outline: whether they go around something.
        outward: of the sides, as they were before.
        first: variances of the lines where sides begin (`Lines.variances`).
        last: where they end.
        scatter: of the edges.
        contrast: of the edges, as the rest.
        width: px.
        clear: part of a side.
        lit: by lamps.
        seam: to another view.
    """

    corners: Float[np.ndarray, "views 4 2"]
    is_outline: Bool[np.ndarray, " views"]
    outward: Float[np.ndarray, "views 4 2"]
    first: Float[np.ndarray, "views 4 2"]
    last: Float[np.ndarray, "views 4 2"]
    scatter: Float[np.ndarray, "views 4"]
    contrast: Float[np.ndarray, "views 4"]
    width: Float[np.ndarray, "views 4"]
    clear: Float[np.ndarray, "views 4"]
    lit: Bool[np.ndarray, "views 4"]
    seam: Bool[np.ndarray, "views 4"]

    @classmethod
    def of(
        cls, gray: Brightness | Sequence[Brightness], lens: Lens, sides: Sides, lamps: Mask | None
    ) -> _Fits:
        """What is found at sides."""
        edges = find_edges(gray, lens, sides, lamps)
        lines = fit_lines(edges)
        corners = _meeting(sides, lines)
        return cls(
            corners,
            _are_convex(corners),
            sides.outward,
            lines.variances(0.0),
            lines.variances(1.0),
            lines.scatter,
            edges.contrast,
            edges.width,
            edges.clear,
            edges.lit,
            edges.seam,
        )


def _settled(
    gray: Brightness | Sequence[Brightness],
    lens: Lens,
    starts: Sequence[_Start | None],
    lamps: Mask | None,
    beside: int | None = None,
) -> list[Quad | None]:
    """The views that are found from where they are looked for first, all of them in each round."""
    found: list[Quad | None] = [None] * len(starts)
    begun = [number for number, start in enumerate(starts) if start is not None]
    if not begun:
        return found
    lamps = lamps if lamps is not None and lamps.any() else None
    angle, corners, contours = zip(*(one for one in starts if one is not None), strict=True)
    angle, corners = np.array(angle), np.stack(corners)
    adjoining = np.array([end is not None and end == beside for end in ENDS_OF_SIDES])
    places, moved = lens.project(_rays(angle, corners)).reshape(-1, 4, 2), np.zeros(len(begun))
    asked, latest = np.arange(len(begun)), None
    for left in range(STEPS)[::-1]:
        sides = Sides.between(angle[asked], corners, np.tile(adjoining, (len(asked), 1)))
        light = gray if isinstance(gray, np.ndarray) else [gray[begun[i]] for i in asked]
        fits = _Fits.of(light, lens, sides, lamps)
        if latest is None:
            latest = fits
        for every, part in zip(latest, fits, strict=True):
            every[asked] = part
        # No further round for a blotch, which is hardly there on any side.
        going = fits.is_outline & (fits.contrast.max(axis=1) >= LEAST_CONTRAST)
        asked, corners = asked[going], fits.corners[going]
        if not left or not asked.size:
            break
        now = lens.project(_rays(angle[asked], corners)).reshape(-1, 4, 2)
        step, earlier = np.abs(now - places[asked]).max(axis=(1, 2)), moved[asked]
        places[asked], moved[asked] = now, step
        # Every round moves corners by about the same part of what the one before it has.
        part = np.divide(step, earlier, out=np.ones(len(step)), where=earlier > 0)
        far = step * np.minimum(part, 1.0) >= SETTLED
        asked, corners = asked[far], corners[far]
        if not asked.size:
            break
    assert latest is not None
    whole = latest.is_outline & (latest.seam.any(axis=1) | (beside is None))
    kept = _Fits(*(one[whole] for one in latest))
    quads = _quads(lens, angle[whole], kept, list(itertools.compress(contours, whole)))
    for number, quad in zip(itertools.compress(begun, whole), quads, strict=True):
        found[number] = quad
    return found


def _quads(
    lens: Lens,
    angle: Float[np.ndarray, " views"],
    fits: _Fits,
    contours: Sequence[Int[np.ndarray, "_ 2"]],
) -> list[Quad]:
    """The views that were found.

    Args:
        lens: of the camera.
        angle: of their tangent planes.
        fits: of their sides.
        contours: pixels around each.
    """
    # How a corner's place in the image moves with it in the plane, by differences.
    steps = SMALL * np.stack([[0.0, 0.0], RIGHT, UP])[:, None, None]
    rays = _rays(np.tile(angle, 3), (fits.corners + steps).reshape(-1, 4, 2))
    at, right, up = lens.project(rays).reshape(3, -1, 4, 2)
    to_image = np.stack([right - at, up - at], axis=-1) / SMALL
    # Of the side that ends in each corner, and of the one that begins there.
    normals = np.stack([fits.outward[:, PRECEDING], fits.outward], axis=2)
    variances = np.stack([fits.last[:, PRECEDING], fits.first], axis=2)
    to_plane = to_image @ np.linalg.inv(normals)
    covariance, roughness = (
        (to_plane * variances[..., None, :, part]) @ np.swapaxes(to_plane, -1, -2)
        for part in range(2)
    )
    rays = rays.reshape(3, -1, 4, 2)[0]
    rows, columns = (size - 1 - NEAR_BORDER for size in lens.shape)
    quads = []
    for i, contour in enumerate(contours):
        contrast, scatter = float(fits.contrast[i].min()), float(fits.scatter[i].max())
        left, top, width, height = cv2.boundingRect(contour.astype(np.int32))
        cut = min(left, top) <= NEAR_BORDER or left + width > columns or top + height > rows
        quality = Quality.COMPLETE
        if cut:
            quality = Quality.CLIPPED
        elif contrast < LEAST_CONTRAST:
            quality = Quality.LOW_CONTRAST
        elif np.sort(fits.width[i])[-2] > WIDEST or fits.clear[i].min() < CLEAR:
            quality = Quality.BLURRED
        elif not np.isfinite(scatter):
            quality = Quality.LOW_CONTRAST
        # A lamp across an end may be before it, and hide a part of the pad.
        lit = bool(fits.lit[i, 1::2].any())
        found = Quad(
            rays=rays[i],
            corners=at[i],
            covariance=covariance[i],
            roughness=roughness[i],
            area=float(cv2.contourArea(contour)),
            contrast=contrast,
            scatter=scatter,
            quality=Quality.CLIPPED if lit else quality,
            before_lamp=lit and quality is Quality.COMPLETE,
        )
        quads.append(found)
    return quads


def _rays(
    angle: Float[np.ndarray, " views"], corners: Float[np.ndarray, "views 4 2"]
) -> Float[np.ndarray, "corners 2"]:
    """Of corners in the tangent planes at some angles, one view after the other."""
    rays = TangentPlane(0.0).rays(corners.reshape(-1, 2))
    rays[:, 0] += np.repeat(angle, 4)
    return rays


def first_corners(flat: Float[np.ndarray, "_ 2"]) -> Float[np.ndarray, "4 2"] | None:
    """A trapezium whose ends lie across the section, around a contour in the tangent plane.

    So is every pad in an extruded scene. Its sides are lines through the outermost points of the
    contour at several heights, which also finds views of few pixels' height and acute corners.
    """
    low, high = float(flat[:, 1].min()), float(flat[:, 1].max())
    if not high > low:
        return None
    heights = low + (high - low) * HEIGHTS
    crossings = _outermost(flat, heights)
    if crossings is None:
        return None
    sides = []
    for outermost in crossings:
        # In units that suit single precision.
        middle = float(outermost.sum()) / len(heights)
        points = np.stack([(outermost - middle) / (high - low), HEIGHTS], axis=-1)
        line = cv2.fitLine(points.astype(np.float32), cv2.DIST_HUBER, 0, 1e-3, 1e-3)
        right, up, x, y = line.ravel().tolist()
        if abs(up) < LEAST_RISE:
            return None
        sides += [middle + (high - low) * (x + right / up * (end - y)) for end in (0.0, 1.0)]
    left_low, left_high, right_low, right_high = sides
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
) -> Float[np.ndarray, "2 heights"] | None:
    """Where a closed contour crosses each of some heights first and last, if it crosses all."""
    closed = np.concatenate([contour, contour[:1]])
    below = closed[:, 1] <= heights[:, None]
    at, starts = np.nonzero(below[:, 1:] != below[:, :-1])
    start, end = closed[starts], closed[starts + 1]
    part = (heights[at] - start[:, 1]) / (end[:, 1] - start[:, 1])
    across = start[:, 0] + part * (end[:, 0] - start[:, 0])
    found = np.array([[np.inf], [-np.inf]]).repeat(len(heights), axis=1)
    np.minimum.at(found[0], at, across)
    np.maximum.at(found[1], at, across)
    return found if np.isfinite(found).all() else None


def _meeting(sides: Sides, lines: Lines) -> Float[np.ndarray, "views 4 2"]:
    """Where neighbouring sides meet when they have moved onto their lines; NaN where they do not.

    Corner i is that of sides i - 1 and i.
    """
    start = sides.start + lines.at(0.0)[..., None] * sides.outward
    way = sides.end + lines.at(1.0)[..., None] * sides.outward - start
    before, first = start[:, PRECEDING], way[:, PRECEDING]
    apart = start - before
    across = first[..., 0] * way[..., 1] - first[..., 1] * way[..., 0]
    across = np.where(np.abs(across) < 1e-12, np.nan, across)
    part = (apart[..., 0] * way[..., 1] - apart[..., 1] * way[..., 0]) / across
    return before + part[..., None] * first


def _are_convex(corners: Float[np.ndarray, "*views 4 2"]) -> Bool[np.ndarray, "*views"]:
    """Whether four corners, in the order of a `Quad`, go clockwise around something."""
    sides = corners[..., FOLLOWING, :] - corners
    following = sides[..., FOLLOWING, :]
    turns = sides[..., 0] * following[..., 1] - sides[..., 1] * following[..., 0]
    return np.asarray(np.isfinite(corners).all(axis=(-1, -2)) & (turns < -FLAT).all(axis=-1))
