"""Heights of what the finger touches, from how far points of the chamber moved (paper A §IV.D).

The finger touches a surface, bends, and is slid along it; what it bends, the endoscope sees as a
displacement of the chamber's points. The paper leaves the profile in whole pixels, a ladder. Here
the displacement is finer than a pixel, and a map that the chamber's design predicts and a few
touched heights calibrate turns it into millimetres.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from perception.chamber.directions import DOWN
from perception.chamber.points import NAMES, Points

TRACKED = DOWN["all"]
"""The points whose heights in the image are followed: b, e and g."""

LEAST_NOISE = 0.01
"""Of a point, px; keeps the weights finite where frames do not differ at all."""

LEAST_APART = 1.0
"""Touched heights that differ by less count as one, mm: shaking by half a pixel, about 0.1 mm,
would become a tenth of the scale and more."""


@dataclass(frozen=True)
class Movements:
    """How far the points b, e and g moved up in the image from where they are at rest.

    Attributes:
        px: pixels upwards; 0 if not seen.
        seen: in the frame, and at rest.
    """

    px: Float[np.ndarray, "frames 3"]
    seen: Bool[np.ndarray, "frames 3"]


@dataclass(frozen=True)
class Heights:
    """Heights found.

    Attributes:
        mm: 0 where it is not known.
        known: whether any point gives one, within the range of the map.
    """

    mm: Float[np.ndarray, " frames"]
    known: Bool[np.ndarray, " frames"]


def compute_movements(
    frames: Sequence[Points], rest: Sequence[Points], *, whole: bool = False
) -> Movements:
    """Movements of b, e and g, upwards in the image.

    Args:
        frames: points of every frame.
        rest: of frames of the finger while it touches nothing; their mean is where rest is.
        whole: whether places count in whole pixels only, as in the paper.

    Example:
        >>> start = Points(np.zeros((7, 2)), np.ones(7, bool))
        >>> moved = Points(np.tile([0.0, -2.0], (7, 1)), np.ones(7, bool))
        >>> compute_movements([moved], [start]).px.tolist()  # upwards
        [[2.0, 2.0, 2.0]]
    """
    picked = [NAMES.index(name) for name in TRACKED]
    places = np.array([frame.xy[picked, 1] for frame in frames]).reshape(-1, 3)
    seen = np.array([frame.seen[picked] for frame in frames], bool).reshape(-1, 3)
    start = np.array([frame.xy[picked, 1] for frame in rest]).reshape(-1, 3)
    there = np.array([frame.seen[picked] for frame in rest], bool).reshape(-1, 3)
    mean = np.where(there, start, 0.0).sum(axis=0) / np.maximum(there.sum(axis=0), 1)
    if whole:
        places, mean = np.rint(places), np.rint(mean)
    seen = seen & there.any(axis=0)
    return Movements(np.where(seen, mean - places, 0.0), seen)


def estimate_scatter(rest: Movements) -> tuple[float, float]:
    """Standard deviations, px, of what moves all points alike and of what moves each alone.

    The former is the camera's shaking; the points' covariance is the same for every pair then.

    Args:
        rest: at least two frames of a finger that does not move; only those that show all points
            count. Without two of them both are 0.

    Example:
        >>> px = np.array([[1.0, 1.0, 1.0], [-1.0, -1.0, -1.0]])  # all points move alike
        >>> [round(value, 6) for value in estimate_scatter(Movements(px, np.ones((2, 3), bool)))]
        [1.414214, 0.0]
    """
    whole = rest.px[rest.seen.all(axis=1)]
    if len(whole) < 2:
        return 0.0, 0.0
    covariance = np.cov(whole.T)
    common = (covariance.sum() - np.trace(covariance)) / (covariance.size - len(covariance))
    alone = np.trace(covariance) / len(covariance) - common
    return float(np.sqrt(max(common, 0.0))), float(np.sqrt(max(alone, 0.0)))


@dataclass(frozen=True)
class ChamberMap:
    """From movements in the image to heights.

    A point's movement is read from the table of its chamber; where several points are seen, their
    heights are averaged with the weights of least variance. Shaking moves all alike, so that e
    counts more than once and b and g are subtracted: yellow is far away and moves more than blue.

    Attributes:
        heights: of the table, mm, rising.
        moved: movements of b, e and g upwards at these heights, px, rising.
        shake: standard deviation of what moves all points alike, px.
        noise: of what moves each point alone, px.
    """

    heights: Float[np.ndarray, " places"]
    moved: Float[np.ndarray, "places 3"]
    shake: float = 0.5
    noise: float = 0.1

    def __post_init__(self) -> None:
        if len(self.heights) < 2 or not (
            (np.diff(self.heights) > 0).all() and (np.diff(self.moved, axis=0) > 0).all()
        ):
            raise ValueError("a chamber's map needs two places, and must rise from one to the next")

    def calibrated(self, touched: Float[np.ndarray, " frames"], seen: Movements) -> ChamberMap:
        """The map of a finger that is not quite as designed, from frames at known heights.

        Of every point, scale and offset of the movement are fitted by least squares. Two frames
        at heights that differ by `LEAST_APART` are needed; from one, or from several at one
        height, only the offset is taken, and a point that no frame shows stays as designed. More
        frames average shaking and errors of setting. A scale that is not positive is no
        calibration: it stays 1.

        Args:
            touched: heights of a flat plate, mm; beyond the table, as at its end.
            seen: movements there.
        """
        moved = self.moved.copy()
        plate = np.clip(touched, self.heights[0], self.heights[-1])
        for point in range(moved.shape[1]):
            used = seen.seen[:, point]
            if not used.any():
                continue
            table = np.interp(plate[used], self.heights, self.moved[:, point])
            found = seen.px[used, point]
            off = table - table.mean()
            apart = np.ptp(plate[used]) >= LEAST_APART
            scale = off @ found / (off @ off) if apart else 1.0
            scale = scale if scale > 0 else 1.0
            moved[:, point] = found.mean() + scale * (self.moved[:, point] - table.mean())
        return replace(self, moved=moved)

    def height(self, seen: Movements, *, use: str = TRACKED) -> Heights:
        """Heights of frames; not known where no point that is used is seen within the table.

        Args:
            seen: movements.
            use: of b, e and g those that count.

        Raises:
            ValueError: other points, or none.
        """
        if not use or not set(use) <= set(TRACKED):
            raise ValueError(f"use is {use!r}; give one or more of the letters {TRACKED}")
        each = np.zeros_like(seen.px)
        usable = seen.seen & np.isin(list(TRACKED), list(use))
        for point in range(each.shape[1]):
            column, moved = self.moved[:, point], seen.px[:, point]
            usable[:, point] &= (moved >= column[0]) & (moved <= column[-1])
            each[:, point] = np.interp(moved, column, self.heights)
        rates = 1 / np.stack(
            [self.resolution(column)[:, point] for point, column in enumerate(each.T)], axis=1
        )
        mm = np.zeros(len(each))
        for shown in np.unique(usable, axis=0):
            if shown.any():
                frames = (usable == shown).all(axis=1)
                weights = self._weights(rates[np.ix_(frames, shown)])
                mm[frames] = (weights * each[np.ix_(frames, shown)]).sum(axis=1)
        return Heights(mm, np.asarray(usable.any(axis=1)))

    def _weights(
        self, rates: Float[np.ndarray, "frames points"]
    ) -> Float[np.ndarray, "frames points"]:
        """Of least variance among those whose sum is 1, for heights of points of these rates."""
        # notation: of heights, the covariance is R⁻¹ (n² 1 + s² 1 1ᵀ) R⁻¹ with R the rates; its
        # inverse by Sherman and Morrison, times the vector of ones.
        noise, shake = max(self.noise, LEAST_NOISE) ** 2, self.shake**2
        common = shake * rates.sum(axis=1) / (noise + shake * rates.shape[1])
        weights = rates * (rates - common[:, None])
        return weights / weights.sum(axis=1)[:, None]

    def resolution(self, heights: Float[np.ndarray, " any"]) -> Float[np.ndarray, "any 3"]:
        """What a pixel of every point's movement is in height, mm per px.

        Args:
            heights: where, mm; beyond the table, as at its end.
        """
        at = np.clip(np.searchsorted(self.heights, heights) - 1, 0, len(self.heights) - 2)
        return (np.diff(self.heights)[:, None] / np.diff(self.moved, axis=0))[at]
