"""The corners of a frame as arrays of one shape, whatever was found."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Array, Bool, Float

from perception.matching import Sighting
from perception.quality import Quality

FLOOR, CONSTANT = 0.15, 0.13
"""Standard deviations of a corner that its covariance does not contain, px: in this frame, as
saturation and compression move edges, and in every frame alike, as its pad's edges are round, or a
lens is not quite as it is thought. For twelve rendered fingers with rough edges 0.04 and 0.13 are
most likely; with so small a floor some right frames are refused, as a few corners are off by more.
"""

WORST = 1e12
"""A view with a corner that is known so unevenly is not used: a side of it was not found."""


class Observation(NamedTuple):
    """Corners of complete views, at ends that are surely those of their pads.

    Attributes:
        corners: column and row.
        whitening: what makes their deviations in this frame independent and of size one: the
            inverse square root of the covariance of these, 1/px; 0 for corners that were not found,
            or of ends that may be others.
        common: the square root of the covariance of what corners are off by in every frame alike,
            px. It is symmetric: with the finger's own offsets, of deviation one, it gives those in
            this frame.
    """

    corners: Float[Array | np.ndarray, "*frames views 4 2"]
    whitening: Float[Array | np.ndarray, "*frames views 4 2 2"]
    common: Float[Array | np.ndarray, "*frames views 4 2 2"]

    @property
    def seen(self) -> Bool[Array | np.ndarray, "*frames views"]:
        """Which views were found complete."""
        return (self.whitening != 0).any(axis=(-1, -2, -3))

    @property
    def used(self) -> Bool[Array | np.ndarray, "*frames views 4 2"]:
        """Which columns and rows of corners were found."""
        return (self.whitening != 0).any(axis=-1)


def observe(
    sighting: Sighting, views: Sequence[tuple[str, str]], floor: float = FLOOR
) -> Observation:
    """The corners of a sighting's complete views, at the ends that each view's `View.ends` grants.

    Args:
        sighting: of one frame.
        views: pad and path of every view, in the order of the model.
        floor: standard deviation in this frame that is added to every corner's own, px.

    Example:
        >>> seen = observe(Sighting((), (), np.zeros(1)), [("tip", "direct")])
        >>> seen.seen.tolist()  # the view was not found
        [False]
    """
    # What is not found has no weight, wherever its corners are.
    corners = np.zeros((len(views), 4, 2))
    whitening, common = np.zeros((2, len(views), 4, 2, 2))
    for index, (pad, path) in enumerate(views):
        view = sighting.view(pad, path)
        if view is None or view.quality is not Quality.COMPLETE:
            continue
        alike = view.roughness + CONSTANT**2 * np.eye(2)
        own = view.covariance - view.roughness + floor**2 * np.eye(2)
        if np.isfinite(own).all() and np.linalg.cond(own).max() < WORST:
            of_ends = np.array(view.ends)[[0, 1, 1, 0]]
            corners[index] = view.corners
            whitening[index] = np.where(of_ends[:, None, None], inverse_root(own), 0.0)
            common[index] = root(alike)
    return Observation(corners, whitening, common)


def stack_observations(observations: Sequence[Observation]) -> Observation:
    """Frames along a first axis.

    Example:
        >>> one = Observation(np.zeros((2, 4, 2)), *np.zeros((2, 2, 4, 2, 2)))
        >>> stack_observations([one, one, one]).corners.shape
        (3, 2, 4, 2)
    """
    return Observation(*(np.stack(parts) for parts in zip(*observations, strict=True)))


def inverse_root(covariance: Float[np.ndarray, "*batch 2 2"]) -> Float[np.ndarray, "*batch 2 2"]:
    """W with Wᵀ W the inverse of a covariance."""
    return np.linalg.inv(np.linalg.cholesky(covariance))


def root(covariance: Float[np.ndarray, "*batch 2 2"]) -> Float[np.ndarray, "*batch 2 2"]:
    """S, symmetric, with S S the covariance; continuous where that changes from frame to frame."""
    squares, axes = np.linalg.eigh(covariance)
    return (axes * np.sqrt(np.maximum(squares, 0.0))[..., None, :]) @ np.swapaxes(axes, -1, -2)
