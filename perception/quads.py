"""The outline of a pad's view: one line per side, straight in the tangent plane of its rays.

A plane pad through a wide lens has curved sides in the image, but straight ones in the plane that
touches the sphere of rays. Paper B approximates the image's contour by a polygon (§4.1.1), whose
corners are those of the pad's rounded ones; here every side is a line fitted robustly to the places
where the brightness crosses half of its step, and corners are where these lines meet.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int

from perception.lens import Lens, TangentPlane
from perception.quality import Quality
from perception.sampling import sampled

INNER, HEIGHTS = (0.15, 0.85), 12
"""Heights at which a contour's outermost points tell its sides at first, and how many."""

LEAST_RISE = 0.01
"""A side that rises less over its length is none."""

POINTS = 48
"""Places on every side at which its edge is looked for."""

TRIMMED = 0.1
"""Part of a side at each of its ends that round corners may have changed."""

REACH = 8.0
"""How far from the expected edge it is looked for, px."""

THICK = 4.0
"""A view must be so many pixels thick where an edge is looked for."""

SAMPLES = 33
"""Brightness samples across each of these places."""

BRIGHTER = 0.75
"""Of the samples inside, this part is darker than what counts as the view's brightness."""

STEPS = 3
"""Rounds of finding edges and fitting lines."""

FAR_ROUNDS = 6
"""Rounds of weighting places by how near to the line they are."""

LEAST_SCATTER = 0.02
"""No edge is straighter than to so many px."""

TUKEY = 4.685
"""Residuals of so many standard deviations count no more (95 % efficiency for normal ones)."""

DEEP, SEAM = 0.9, 10.0
"""Where brightness falls by a smaller part than `DEEP` to the dark, an edge is doubted by so many
pixels per missing part: what falls halfway only may be as far off as a seam is wide."""

SMALL = 1e-4
"""Step of differences in the tangent plane."""

RIGHT, UP = np.eye(2)
"""Directions in the tangent plane."""

UNKNOWN = 1.0
"""Variance of a side that was not found, in the tangent plane: it may be anywhere."""

LEAST_CONTRAST = 5.0
"""Of 255: a lower step is no edge that can be relied on."""

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
        area: of the blob, px².
        contrast: step of brightness across the side that has the least, of 255.
        scatter: standard deviation of edges about the side that fits worst, px.
        quality: complete, clipped or of low contrast.
    """

    rays: Float[np.ndarray, "4 2"]
    corners: Float[np.ndarray, "4 2"]
    covariance: Float[np.ndarray, "4 2 2"]
    area: float
    contrast: float
    scatter: float
    quality: Quality


def fit_quad(
    grey: Float[np.ndarray, "rows columns"], lens: Lens, contour: Int[np.ndarray, "_ 2"]
) -> Quad | None:
    """The view whose blob has a given contour.

    Args:
        grey: brightness, float32.
        lens: of the camera.
        contour: outermost pixels of a blob, column and row.

    Returns:
        The view; ``None`` where the contour has no four sides.
    """
    rays = lens.rays(contour.astype(float))
    plane = TangentPlane(float(rays[:, 0].min() + rays[:, 0].max()) / 2)
    corners = first_corners(plane.flat(rays))
    if corners is None:
        return None
    found = _refined(grey, lens, plane, corners)
    for _ in range(STEPS - 1):
        found = None if found is None else _refined(grey, lens, plane, found.corners)
    if found is None:
        return None
    rays = plane.rays(found.corners)
    rows, columns = grey.shape
    border = (contour <= NEAR_BORDER) | (contour >= np.array([columns, rows]) - 1 - NEAR_BORDER)
    contrast = min(edge.contrast for edge in found.edges)
    quality = Quality.COMPLETE
    if border.any():
        quality = Quality.CLIPPED
    elif contrast < LEAST_CONTRAST:
        quality = Quality.LOW_CONTRAST
    return Quad(
        rays,
        lens.project(rays),
        _covariances(lens, plane, found),
        float(cv2.contourArea(contour)),
        contrast,
        max(line.scatter for line in found.lines),
        quality,
    )


def first_corners(flat: Float[np.ndarray, "_ 2"]) -> Float[np.ndarray, "4 2"] | None:
    """A trapezium whose ends lie across the section, around a contour in the tangent plane.

    So is every pad in an extruded scene. Its sides are lines through the outermost points of the
    contour at several heights; this bears views that are few pixels high and have acute corners.
    """
    low, high = flat[:, 1].min(), flat[:, 1].max()
    if not high > low:
        return None
    following = np.roll(flat, -1, axis=0)
    heights = low + (high - low) * np.linspace(*INNER, HEIGHTS)
    crossings = np.array([_crossings(flat, following, height) for height in heights])
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


def _crossings(
    points: Float[np.ndarray, "_ 2"], following: Float[np.ndarray, "_ 2"], height: float
) -> tuple[float, float]:
    """Where a closed contour crosses a height first and last."""
    crosses = (points[:, 1] <= height) != (following[:, 1] <= height)
    start, end = points[crosses], following[crosses]
    part = (height - start[:, 1]) / (end[:, 1] - start[:, 1])
    across = start[:, 0] + part * (end[:, 0] - start[:, 0])
    return float(across.min()), float(across.max())


@dataclass(frozen=True)
class _Side:
    """A side, from corner to corner in the tangent plane, clockwise as the plane is seen."""

    start: Float[np.ndarray, "2"]
    end: Float[np.ndarray, "2"]

    @property
    def outward(self) -> Float[np.ndarray, "2"]:
        along = self.end - self.start
        return np.array([-along[1], along[0]]) / np.hypot(*along)

    def places(self, shares: Float[np.ndarray, " points"]) -> Float[np.ndarray, "points 2"]:
        return self.start + shares[:, None] * (self.end - self.start)


@dataclass(frozen=True)
class _Edge:
    """Where the edge of a side was found.

    Attributes:
        shares: places along the side, 0 to 1.
        offsets: outward from the side, tangent plane.
        scale: px per unit of the tangent plane across the side.
        found: where an edge was found at all.
        contrast: step of brightness, the median over the places.
        doubt: standard deviation of all of the edge together, px: next to another view the
            brightness does not fall to the dark, and its half is no edge.
    """

    shares: Float[np.ndarray, " points"]
    offsets: Float[np.ndarray, " points"]
    scale: Float[np.ndarray, " points"]
    found: Bool[np.ndarray, " points"]
    contrast: float
    doubt: float


@dataclass(frozen=True)
class _Line:
    """A side moved outward by ``offset + turn · share``.

    Attributes:
        offset: tangent plane.
        turn: tangent plane.
        covariance: of both.
        scatter: standard deviation of the edges about it, px.
    """

    offset: float
    turn: float
    covariance: Float[np.ndarray, "2 2"]
    scatter: float

    def at(self, share: float) -> float:
        return self.offset + self.turn * share

    def variance(self, share: float) -> float:
        weights = np.array([1.0, share])
        return float(weights @ self.covariance @ weights)


class _Outline(NamedTuple):
    """A quadrilateral whose sides have been moved onto their edges.

    Attributes:
        sides: as they were.
        edges: that were found across them.
        lines: through these.
        corners: where the lines meet.
    """

    sides: list[_Side]
    edges: list[_Edge]
    lines: list[_Line]
    corners: Float[np.ndarray, "4 2"]


def _refined(
    grey: Float[np.ndarray, "rows columns"],
    lens: Lens,
    plane: TangentPlane,
    corners: Float[np.ndarray, "4 2"],
) -> _Outline | None:
    """One round of finding edges and fitting lines; ``None`` where these do not meet."""
    sides = [_Side(corners[i], corners[(i + 1) % 4]) for i in range(4)]
    edges = _edges(grey, lens, plane, sides)
    lines = [_line(edge) for edge in edges]
    moved = _meeting(sides, lines)
    return None if moved is None else _Outline(sides, edges, lines, moved)


def _edges(
    grey: Float[np.ndarray, "rows columns"], lens: Lens, plane: TangentPlane, sides: list[_Side]
) -> list[_Edge]:
    """The edges of all sides: where brightness first falls below half of its step outward."""
    shares = np.linspace(TRIMMED, 1 - TRIMMED, POINTS)
    flat = np.concatenate([side.places(shares) for side in sides])
    outward = np.repeat([side.outward for side in sides], POINTS, axis=0)
    both = lens.project(plane.rays(np.concatenate([flat, flat + SMALL * outward])))
    at, beside = both[: len(flat)], both[len(flat) :]
    scale = np.maximum(np.hypot(*(beside - at).T) / SMALL, 1e-9)
    normal = (beside - at) / (SMALL * scale[:, None])
    reach = np.linspace(-REACH, REACH, SAMPLES)
    profile = sampled(grey, at[:, None] + reach[:, None] * normal[:, None])
    profile = cv2.blur(profile, (3, 1), borderType=cv2.BORDER_REPLICATE)
    # A narrow view may end again within reach: the brightest quarter is surely inside.
    inside = np.quantile(profile[:, : SAMPLES // 2 + 1], BRIGHTER, axis=1)
    outside = profile[:, SAMPLES // 2 :].min(axis=1)
    half = (inside + outside) / 2
    rows, counts = np.arange(len(profile)), np.arange(SAMPLES)
    start = SAMPLES // 2 - np.argmax(profile[:, SAMPLES // 2 :: -1] >= inside[:, None], axis=1)
    below = (profile < half[:, None]) & (counts > start[:, None])
    last = np.maximum(np.argmax(below, axis=1), 1)
    high, low = profile[rows, last - 1], profile[rows, last]
    drop = high - low
    found = below.any(axis=1) & (drop > 0) & (high >= half)
    part = np.where(found, (high - half) / np.where(drop > 0, drop, 1.0), 0.0)
    offsets = (reach[last - 1] + (reach[1] - reach[0]) * part) / scale
    contrast = inside - outside
    # Where a view is too thin, as at its acute corners, the other edge is in the way.
    inward = flat - THICK / scale[:, None] * outward
    beyond = np.stack([(inward - side.start) @ side.outward for side in sides])
    found &= (beyond < 0).all(axis=0)
    owns = [slice(i * POINTS, (i + 1) * POINTS) for i in range(len(sides))]
    dark = min(float(np.median(outside[own])) for own in owns)
    depth = contrast / np.maximum(inside - dark, 1.0)
    edges = []
    for own in owns:
        there = found[own]
        step, deep = (
            float(np.median(values[own][there])) if there.any() else 0.0
            for values in (contrast, depth)
        )
        doubt = SEAM * max(DEEP - deep, 0.0)
        edges.append(_Edge(shares, offsets[own], scale[own], there, step, doubt))
    return edges


def _line(edge: _Edge) -> _Line:
    """A line through the edges of a side by weighted least squares with Tukey's weights.

    Source: P. J. Huber, E. M. Ronchetti, *Robust Statistics*, 2nd ed., §7.8. Neighbouring edges
    err alike, so the covariance counts fewer of them: n (1 − r) / (1 + r) for the correlation r
    of neighbours.
    """
    found = edge.found
    if found.sum() < POINTS // 4:
        return _Line(0.0, 0.0, np.diag([UNKNOWN, 0.0]), np.inf)
    design = np.stack([np.ones(found.sum()), edge.shares[found]], axis=-1) * edge.scale[found, None]
    wanted = edge.offsets[found] * edge.scale[found]
    left = wanted - np.median(wanted)
    solution, normal, weights = _weighted(design, wanted, left)
    for _ in range(FAR_ROUNDS - 1):
        left = wanted - design @ solution
        solution, normal, weights = _weighted(design, wanted, left)
    left = wanted - design @ solution
    variance = float(np.sum(weights * left**2) / max(np.sum(weights) - 2, 1))
    furthest = TUKEY * _deviation(left)
    near = np.clip(left, -furthest, furthest)
    correlation = np.clip(np.mean(near[1:] * near[:-1]) / max(np.mean(near**2), 1e-12), 0.0, 0.9)
    fewer = (1 + correlation) / (1 - correlation)
    covariance = variance * fewer * np.linalg.inv(normal)
    covariance[0, 0] += (edge.doubt / float(np.mean(edge.scale))) ** 2
    return _Line(float(solution[0]), float(solution[1]), covariance, float(np.sqrt(variance)))


def _deviation(left: Float[np.ndarray, " places"]) -> float:
    """Standard deviation of most of the residuals, from their median; never quite 0."""
    return max(1.4826 * float(np.median(np.abs(left))), LEAST_SCATTER)


def _weighted(
    design: Float[np.ndarray, "places 2"],
    wanted: Float[np.ndarray, " places"],
    left: Float[np.ndarray, " places"],
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Least squares weighted by how small residuals were; with its normal matrix and weights."""
    weights = np.maximum(1 - (left / (TUKEY * _deviation(left))) ** 2, 0) ** 2
    weighted = design * weights[:, None]
    normal = weighted.T @ design
    # Where all weight lies in one place, the side keeps its direction.
    normal += 1e-12 * np.trace(normal) * np.eye(2)
    return np.linalg.solve(normal, weighted.T @ wanted), normal, weights


def _meeting(sides: list[_Side], lines: list[_Line]) -> Float[np.ndarray, "4 2"] | None:
    """Where neighbouring sides meet when they have moved onto their lines."""
    ends = [
        (
            side.start + line.at(0.0) * side.outward,
            side.end + line.at(1.0) * side.outward,
        )
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
    size = (
        np.abs(sides[0].start - sides[2].start).max()
        + np.abs(sides[1].start - sides[3].start).max()
    )
    moved = np.abs(found - np.stack([side.start for side in sides])).max()
    return found if np.isfinite(found).all() and moved < size else None


def _covariances(lens: Lens, plane: TangentPlane, outline: _Outline) -> Float[np.ndarray, "4 2 2"]:
    """Covariance of every corner's place in the image, px²."""
    corners, sides, lines = outline.corners, outline.sides, outline.lines
    moved = np.concatenate([corners, corners + SMALL * RIGHT, corners + SMALL * UP])
    at, right, up = np.split(lens.project(plane.rays(moved)), 3)
    to_image = np.stack([right - at, up - at], axis=-1) / SMALL
    found = []
    for i in range(4):
        normals = np.stack([sides[i - 1].outward, sides[i].outward])
        offsets = np.diag([lines[i - 1].variance(1.0), lines[i].variance(0.0)])
        to_plane = to_image[i] @ np.linalg.inv(normals)
        found.append(to_plane @ offsets @ to_plane.T)
    return np.stack(found)
