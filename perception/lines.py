"""Straight lines through the edges of views' sides."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from perception.medians import Medians
from perception.sides import POINTS, SHARES, Edges

ROUNDS = 5
"""Rounds of weighting places by how near to the line they are."""

LEAST_SCATTER = 0.02
"""No edge is straighter than to so many px."""

TUKEY = 4.685
"""Residuals of so many standard deviations count no more (95 % efficiency for normal ones)."""

ENDS, SCATTERED = 6, 4.0
"""Over this part of a side at each end its edges lie on its line, but for so many standard
deviations of their mean."""

UNKNOWN = 1.0
"""Variance of a side that was not found, in the tangent plane: it may be anywhere."""

RUNS = (SHARES - SHARES[:, None] + np.diag(np.full(POINTS, np.nan))).astype(np.float32)
"""From each place of a side to the others; to itself there is none."""


BySide = Float[np.ndarray, " sides"]
"""A number for every side, of one view after the other."""


@dataclass(frozen=True, eq=False)
class Lines:
    """Sides of several views, moved outward by ``offset + turn · share``.

    Attributes:
        offset: tangent plane.
        turn: tangent plane.
        covariance: of both.
        roughness: the part of it that neighbouring edges share: where a pad's own edge is rough.
        scatter: standard deviation of the edges about it, px; infinite where there are too few.
    """

    offset: Float[np.ndarray, "views sides"]
    turn: Float[np.ndarray, "views sides"]
    covariance: Float[np.ndarray, "views sides 2 2"]
    roughness: Float[np.ndarray, "views sides 2 2"]
    scatter: Float[np.ndarray, "views sides"]

    def at(self, share: float) -> Float[np.ndarray, "views sides"]:
        """How far outward the lines are at a part of each side, tangent plane."""
        return self.offset + self.turn * share

    def variances(self, share: float) -> Float[np.ndarray, "views sides 2"]:
        """Variance of that, and the part of it that is the edge's roughness."""
        place = np.array([1.0, share])
        return np.stack([place @ one @ place for one in (self.covariance, self.roughness)], axis=-1)


def fit_lines(edges: Edges) -> Lines:
    """A line through the edges of every side: Tukey's weights, begun at the repeated median.

    Sources: A. F. Siegel, *Robust regression using repeated medians*, Biometrika 69 (1982) 242;
    P. J. Huber, E. M. Ronchetti, *Robust Statistics*, 2nd ed., §7.8. Neighbouring edges err alike,
    so the covariance counts fewer of them: n (1 − r) / (1 + r) for the correlation r of neighbours.
    Noise has no neighbours: the part 1 − r of their variance is as in n independent edges.
    """
    shape = edges.contrast.shape
    found, scale = (one.reshape(-1, POINTS) for one in (edges.found, edges.scale))
    bare = edges.offsets.reshape(-1, POINTS)
    offsets, leaning = bare * scale, scale * SHARES
    medians = Medians(found)
    factors = scale**2, scale * leaning, leaning**2, scale * offsets, leaning * offsets
    products = np.stack(factors, axis=1)

    def residuals(line: tuple[BySide, BySide]) -> tuple[np.ndarray, BySide]:
        left = offsets - scale * line[0][:, None] - leaning * line[1][:, None]
        # The standard deviation of most of them, which is never quite 0.
        return left, np.maximum(1.4826 * medians.of(np.abs(left)), LEAST_SCATTER)

    def reweighted(line: tuple[BySide, BySide]) -> np.ndarray:
        left, deviation = residuals(line)
        far = left / (TUKEY * deviation)[:, None]
        return np.where(found, np.maximum(1 - far**2, 0) ** 2, 0.0)

    weights = reweighted(_repeated_medians(bare, found, medians))
    for _ in range(ROUNDS - 1):
        weights = reweighted(_weighted(products, weights)[0])
    (offset, turn), (corner, mixed, other) = _weighted(products, weights)
    left, deviation = residuals((offset, turn))
    count = found.sum(axis=1)
    variance = np.sum(weights * left**2, axis=1) / np.maximum(weights.sum(axis=1) - 2, 1)
    furthest = (TUKEY * deviation)[:, None]
    near = np.where(found, np.clip(left, -furthest, furthest), 0.0)
    pairs = np.maximum((found[:, 1:] & found[:, :-1]).sum(axis=1), 1)
    mean_square = np.sum(near**2, axis=1) / np.maximum(count, 1)
    alike = np.sum(near[:, 1:] * near[:, :-1], axis=1) / pairs / np.maximum(mean_square, 1e-12)
    alike = np.clip(alike, 0.0, 0.9)
    inverse = np.stack([other, -mixed, -mixed, corner]) / (corner * other - mixed**2)
    independent = (variance * inverse).T.reshape(-1, 2, 2)
    covariance = ((1 + alike) / (1 - alike))[:, None, None] * independent
    roughness = covariance - (1 - alike)[:, None, None] * independent
    mean_scale = scale.mean(axis=1)
    covariance[:, 0, 0] += (edges.doubt.ravel() / mean_scale) ** 2
    # What moves one end only, and turns the side.
    first, last = (_bends(left, deviation, found) / mean_scale) ** 2
    covariance += first[:, None, None] * np.array([[1, -1], [-1, 1]])
    covariance[:, 1, 1] += last
    scatter = np.sqrt(variance)
    few = count < POINTS // 4
    if few.any():
        offset[few], turn[few], roughness[few], scatter[few] = 0.0, 0.0, 0.0, np.inf
        covariance[few] = np.diag([UNKNOWN, 0.0])
    return Lines(
        offset.reshape(shape),
        turn.reshape(shape),
        covariance.reshape(*shape, 2, 2),
        roughness.reshape(*shape, 2, 2),
        scatter.reshape(shape),
    )


def _bends(
    left: Float[np.ndarray, "sides places"],
    deviation: Float[np.ndarray, " sides"],
    found: Bool[np.ndarray, "sides places"],
) -> Float[np.ndarray, "2 sides"]:
    """By how much the edges near each end of a side lie off its line, all to one side, px.

    A contact that bulges the gel near a corner moves them: the line does not follow, but whether it
    or they are the pad's side the edges do not show. What scatter alone does is taken off.
    """
    part = POINTS // ENDS
    there, ends = (np.stack([one[:, :part], one[:, -part:]]) for one in (found, left))
    scatter = deviation / np.sqrt(np.maximum(there.sum(axis=2), 1))
    return np.maximum(np.abs(Medians(there).of(ends)) - SCATTERED * scatter, 0.0)


def _weighted(
    products: Float[np.ndarray, "sides 5 places"], weights: Float[np.ndarray, "sides places"]
) -> tuple[tuple[BySide, BySide], tuple[BySide, BySide, BySide]]:
    """Weighted least squares of two unknowns; of their normal matrix the corners and the rest.

    Args:
        products: of the unknowns' factors: both of the first, one of each, both of the second, and
            of each with what is wanted.
        weights: of every place's residual.
    """
    first, mixed, second, *wanted = (products @ weights[..., None])[..., 0].T
    # Where all weight lies in one place, the side keeps its direction.
    least = 1e-12 * (first + second) + 1e-30
    first, second = first + least, second + least
    determinant = first * second - mixed**2
    offset = (second * wanted[0] - mixed * wanted[1]) / determinant
    turn = (first * wanted[1] - mixed * wanted[0]) / determinant
    return (offset, turn), (first, mixed, second)


def _repeated_medians(
    offsets: Float[np.ndarray, "sides places"],
    found: Bool[np.ndarray, "sides places"],
    medians: Medians,
) -> tuple[BySide, BySide]:
    """Offset and turn of every side: of each place the median turn to the others, of these again.

    A line added to all of the edges is added to the result, however bad the edges are, but for
    rounding to single precision, as a line only begins here.
    """
    # NaN sorts behind all numbers.
    there = np.where(found, offsets, np.nan).astype(np.float32)
    ordered = np.sort((there[:, None, :] - there[..., None]) / RUNS, axis=-1)
    sides, others = np.arange(len(found)), np.maximum(found.sum(axis=1) - 1, 0)
    middle = ordered[sides, :, np.maximum(others - 1, 0) // 2] + ordered[sides, :, others // 2]
    turn = medians.of(np.where(others[:, None] > 0, middle.astype(float) / 2, 0.0))
    return medians.of(offsets - turn[:, None] * SHARES), turn
