"""A pad's length, and how flat it is seen, by its view alone: without a model of where the pad is.

The lateral slopes of an end's two corners and the pad's width give the end's distance; distances
and section angles of both ends give the rest. The length separates a complete view from a cut one
and from two that run into one.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from perception.lens import Lens
from perception.quads import Quad

ENDS = ((0, 3), (1, 2))
"""Corners of a `Quad`'s lower and its upper end, lesser slope first."""

LEAST_DEVIATION = 0.5
"""Of a corner, px, when a length is judged: lens and pads are not quite as they are thought."""

STEP = 0.5
"""By which corners are moved to see how the length depends on them, px."""

MOVES = STEP * np.array([[[0, 0]], [[1, 0]], [[0, 1]]])
MOVED, CORNERS = np.arange(1, 9), np.tile(np.arange(4), 2)
"""Of nine copies of four corners, in which one of them is moved, and which."""


def measured_length(quad: Quad, width: float, lens: Lens) -> tuple[float, float]:
    """Length of a pad along the section as its view shows it, and its standard deviation, mm.

    Behind layers that is not its own length, but what a bare pad of that width would need.

    Args:
        quad: the view.
        width: of the pad across the section, mm.
        lens: of the camera.
    """
    places = quad.corners + MOVES
    moved = lens.rays(places.reshape(-1, 2)).reshape(places.shape)
    # Every corner by itself is moved along the columns, and along the rows; first, none is.
    rays = np.tile(quad.rays, (9, 1, 1))
    rays[MOVED, CORNERS] += (moved[1:] - moved[0]).reshape(-1, 2)
    lengths = apparent_length(rays, width)
    slopes = (lengths[1:] - lengths[0]) / STEP
    variances = quad.covariance[:, [0, 1], [0, 1]].T.ravel() + LEAST_DEVIATION**2
    return float(lengths[0]), math.sqrt(slopes**2 @ variances)


def measured_grazing(quad: Quad, width: float) -> float:
    """The flattest angle at which a view shows its pad, at one of its ends, rad.

    Args:
        quad: the view.
        width: of the pad across the section, mm.
    """
    ends = _ends(quad.rays, width)
    along = (ends[1] - ends[0]) / max(float(np.hypot(*(ends[1] - ends[0]))), 1e-9)
    rays = ends / np.hypot(*ends.T)[:, None]
    return float(np.arcsin(np.abs(rays[:, 0] * along[1] - rays[:, 1] * along[0])).min())


def measured_skew(quad: Quad, width: float) -> tuple[float, float]:
    """How far a view is from that of a rectangle across the section: in angle (rad) and place (mm).

    Both corners of an end of a pad have one section angle, and both ends are as far beside the
    section.

    Args:
        quad: the view.
        width: of the pad across the section, mm.
    """
    rays, middles, turns = quad.rays, [], []
    for left, right in ENDS:
        distance = width / max(rays[right, 1] - rays[left, 1], 1e-9)
        middles.append(distance * (rays[left, 1] + rays[right, 1]) / 2)
        turns.append(abs(rays[left, 0] - rays[right, 0]))
    return float(max(turns)), float(abs(middles[1] - middles[0]))


def shortened(
    quad: Quad, width: float, extent: Float[np.ndarray, "2"], lens: Lens, kept: int
) -> Quad:
    """A view that another one has made too long, ended where the pad's known length ends.

    Args:
        quad: the view.
        width: of the pad across the section, mm.
        extent: length of the pad as this view shows it, and its standard deviation, mm.
        lens: of the camera.
        kept: which end is the pad's own: 0 the lower, 1 the upper.
    """
    length, of_finger = extent.tolist()
    long, of_corners = measured_length(quad, width, lens)
    ends = _ends(quad.rays, width)
    distances = np.hypot(*ends.T)

    def ended(length: float) -> Float[np.ndarray, "4 2"]:
        end = ends[kept] + length / long * (ends[1 - kept] - ends[kept])
        rays = quad.rays.copy()
        for own, other in zip(ENDS[kept], ENDS[1 - kept], strict=True):
            # A side is as far from the section's plane at both ends.
            beside = rays[own, 1] * distances[kept] + rays[other, 1] * distances[1 - kept]
            rays[other] = np.arctan2(end[1], end[0]), beside / 2 / np.hypot(*end)
        return rays

    rays = ended(length)
    corners = lens.project(rays)
    covariance, roughness = quad.covariance.copy(), quad.roughness.copy()
    deviation = float(np.hypot(of_corners, of_finger))
    moved = lens.project(ended(length + deviation)) - corners
    for other in ENDS[1 - kept]:
        covariance[other] += np.outer(moved[other], moved[other])
        # The edge that was found there is not the pad's.
        roughness[other] = 0
    return replace(quad, rays=rays, corners=corners, covariance=covariance, roughness=roughness)


def _ends(rays: Float[np.ndarray, "*batch 4 2"], width: float) -> Float[np.ndarray, "*batch 2 2"]:
    """Both ends in the camera's own axes (forward, up), mm."""
    left, right = rays[..., :2, :], rays[..., :1:-1, :]
    angles = (left[..., 0] + right[..., 0]) / 2
    distances = width / np.maximum(right[..., 1] - left[..., 1], 1e-9)
    return np.stack([distances * np.cos(angles), distances * np.sin(angles)], axis=-1)


def apparent_length(
    rays: Float[np.ndarray, "*batch 4 2"], width: float
) -> Float[np.ndarray, "*batch"]:
    """Length of a bare pad whose corners, in the order of a `Quad` or of a pad, have these rays."""
    ends = _ends(rays, width)
    along = ends[..., 1, :] - ends[..., 0, :]
    return np.asarray(np.hypot(along[..., 0], along[..., 1]))
