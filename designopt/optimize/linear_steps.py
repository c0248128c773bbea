"""Steps of linear programs: what is best in a box around a design, and what balances there."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.optimize import linprog, nnls

PENALTIES = (3.0, 3000.0)
"""Least and greatest cost of missing a requirement by its scale, in scales of the objective: as
little as leads back to it, for along curved limits a high one leaves small steps only."""

MET = 5e-8
"""Requirements are met where no more than this part of their scale is missed."""

ACTIVE = 1e-5
"""What is no farther from its limit, in scales or in parts of a range, may hold a design."""

LEAST_SLOPE = 1e-7
"""Slopes that are all smaller count as this, where the condition on a sum is weighed by them."""


class Point(NamedTuple):
    """A design, and what is asked of it to first order.

    Attributes:
        place: of the free parameters, in parts of their ranges.
        pieces: of the objective, in its scale; the least one is made as large as possible.
        margins: of all requirements, in their measures' scales; not negative where they are met.
        piece_slopes: of the pieces by the place.
        margin_slopes: of the margins by the place.
    """

    place: Float[np.ndarray, " free"]
    pieces: Float[np.ndarray, " pieces"]
    margins: Float[np.ndarray, " margins"]
    piece_slopes: Float[np.ndarray, "pieces free"]
    margin_slopes: Float[np.ndarray, "margins free"]

    @property
    def level(self) -> float:
        """The objective."""
        return float(np.min(self.pieces))

    @property
    def missing(self) -> float:
        """By how much the requirement that is farthest from being met is missed."""
        return max(-float(np.min(self.margins, initial=0.0)), 0.0)

    @property
    def rank(self) -> tuple[bool, float]:
        """Greater is better: what meets all requirements, then the objective."""
        return (True, self.level) if self.missing <= MET else (False, -self.missing)

    def without_objective(self) -> Point:
        """The same, asked for its requirements alone."""
        return self._replace(pieces=np.zeros(1), piece_slopes=np.zeros((1, self.place.size)))

    def merit(self, penalty: float) -> float:
        """What every step makes smaller: an exact penalty."""
        return penalty * self.missing - self.level

    def with_rows_of(self, others: Sequence[Point]) -> Point:
        """The same, asked also for what was found missing at other places, to first order there.

        What a step meets unawares, such as the edge beyond which a pad is hidden, has no slope on
        this side of it. Rows that this place contradicts are left out.
        """
        found = self
        for other in others:
            way = self.place - other.place
            low, under = other.pieces < self.level, other.margins < 0
            pieces = other.pieces[low] + other.piece_slopes[low] @ way
            margins = other.margins[under] + other.margin_slopes[under] @ way
            fits, holds = pieces >= self.level, margins >= min(-self.missing, 0.0)
            found = found._replace(
                pieces=np.append(found.pieces, pieces[fits]),
                piece_slopes=np.vstack([found.piece_slopes, other.piece_slopes[low][fits]]),
                margins=np.append(found.margins, margins[holds]),
                margin_slopes=np.vstack([found.margin_slopes, other.margin_slopes[under][holds]]),
            )
        return found


def linear_step(point: Point, radius: float, penalty: float) -> tuple[np.ndarray, float, float]:
    """The step that is best to first order, in a box.

    A linear program in the step, the level t of the objective and the missing part s: the largest
    t − P s with every piece at least t and every margin at least −s (R. Fletcher, *Practical
    Methods of Optimization*, 2nd ed., §12.4 and §14.4, of exact penalties and their correction;
    J. Hald, K. Madsen, Math. Programming 20 (1981) 49, of the least of several functions). As long
    as it leaves something missing, P grows.

    Args:
        point: where it begins.
        radius: half the side of the box.
        penalty: P.

    Returns:
        The step, by how much it makes the merit smaller to first order, and P.
    """
    size = point.place.size
    # What no step in the box can bring to its limit is left out.
    reach = radius * np.sum(np.abs(point.margin_slopes), axis=1)
    near = point.margins - reach < 0
    margins, slopes = point.margin_slopes[near], point.piece_slopes
    above = np.hstack([-slopes, np.ones((len(slopes), 1)), np.zeros((len(slopes), 1))])
    kept = np.hstack([-margins, np.zeros((len(margins), 1)), -np.ones((len(margins), 1))])
    limits = np.stack(
        [np.maximum(-radius, -point.place), np.minimum(radius, 1.0 - point.place)], axis=1
    ).tolist()
    rows, values = np.vstack([above, kept]), np.concatenate([point.pieces, point.margins[near]])
    bounds = [*limits, (None, None), (0.0, None)]
    while True:
        cost = np.concatenate([np.zeros(size), [-1.0, penalty]])
        found = linprog(cost, A_ub=rows, b_ub=values, bounds=bounds, method="highs")
        if found.status != 0:
            return np.zeros(size), 0.0, penalty
        if found.x[-1] <= MET or penalty >= PENALTIES[1]:
            return found.x[:size], point.merit(penalty) - float(found.fun), penalty
        penalty *= 10


def bounds_at(place: np.ndarray) -> list[tuple[int, int]]:
    """The parameters that are at a bound, each with +1 if that is the lower one, −1 otherwise."""
    return [
        (number, side)
        for side in (1, -1)
        for number, part in enumerate(place.tolist())
        if (part if side > 0 else 1.0 - part) <= ACTIVE
    ]


def inward(ends: Sequence[tuple[int, int]], size: int) -> Float[np.ndarray, "ends free"]:
    """Slopes of the distances to bounds."""
    found = np.zeros((len(ends), size))
    for row, (number, side) in enumerate(ends):
        found[row, number] = side
    return found


def balance(
    pieces: Float[np.ndarray, "pieces free"],
    others: Float[np.ndarray, "others free"],
    *,
    of_level: bool = False,
) -> tuple[Float[np.ndarray, " multipliers"], float]:
    """Multipliers of the conditions of Karush, Kuhn and Tucker, and what they leave, in parts.

    Of a least piece they are Σ μ = 1 over the pieces that are the least, and Σ μ ∇piece +
    Σ λ ∇other = 0 with what is active (J. Nocedal, S. J. Wright, *Numerical Optimization*, 2nd
    ed., §12.3), found by non-negative least squares.

    Args:
        pieces: slopes of the pieces that are the least.
        others: slopes of what is active.
        of_level: whether to return μ, not λ.
    """
    slopes = np.vstack([pieces, others])
    # The condition on the sum weighs as much as the slopes themselves.
    weight = max(float(np.max(np.abs(pieces), initial=0.0)), LEAST_SLOPE)
    sums = np.zeros(len(slopes))
    sums[: len(pieces)] = weight
    wanted = np.append(np.zeros(slopes.shape[1]), weight)
    multipliers, left = nnls(np.vstack([slopes.T, sums]), wanted)
    own = multipliers[: len(pieces)] if of_level else multipliers[len(pieces) :]
    return own, float(left) / weight
