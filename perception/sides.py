"""The sides of a view: where their edges are, and a straight line through them.

An edge is where the brightness falls below half of its step, looked for across the expected side.
All of this is in the tangent plane of the view's rays, where sides are straight.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float

from perception.lens import Lens, TangentPlane
from perception.sampling import sampled

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

UNKNOWN = 1.0
"""Variance of a side that was not found, in the tangent plane: it may be anywhere."""


@dataclass(frozen=True)
class Side:
    """A side, from corner to corner in the tangent plane, clockwise as the plane is seen."""

    start: Float[np.ndarray, "2"]
    end: Float[np.ndarray, "2"]

    @property
    def outward(self) -> Float[np.ndarray, "2"]:
        """Unit normal that points out of the view."""
        along = self.end - self.start
        return np.array([-along[1], along[0]]) / max(float(np.hypot(*along)), 1e-12)

    def places(self, shares: Float[np.ndarray, " points"]) -> Float[np.ndarray, "points 2"]:
        """Places at parts 0 to 1 of the way from start to end."""
        return self.start + shares[:, None] * (self.end - self.start)


@dataclass(frozen=True)
class Edge:
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
class Line:
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
        """How far outward the line is at a part of the side, tangent plane."""
        return self.offset + self.turn * share

    def variance(self, share: float) -> float:
        """Variance of that."""
        weights = np.array([1.0, share])
        return float(weights @ self.covariance @ weights)


def find_edges(
    grey: Float[np.ndarray, "rows columns"], lens: Lens, plane: TangentPlane, sides: list[Side]
) -> list[Edge]:
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
        edges.append(Edge(shares, offsets[own], scale[own], there, step, doubt))
    return edges


def fit_line(edge: Edge) -> Line:
    """A line through the edges of a side by weighted least squares with Tukey's weights.

    Source: P. J. Huber, E. M. Ronchetti, *Robust Statistics*, 2nd ed., §7.8. Neighbouring edges
    err alike, so the covariance counts fewer of them: n (1 − r) / (1 + r) for the correlation r
    of neighbours.
    """
    found = edge.found
    if found.sum() < POINTS // 4:
        return Line(0.0, 0.0, np.diag([UNKNOWN, 0.0]), np.inf)
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
    return Line(float(solution[0]), float(solution[1]), covariance, float(np.sqrt(variance)))


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
