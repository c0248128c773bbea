"""Paper B's way (§4.2): the gap between a pad's direct view and its mirror view, looked up.

The gap is the section angle between the two ends that face each other in the image. Its table
comes from the optics; errors of the finger change the gap by an offset and a scale, which are
fitted to labelled frames. Where one of the two ends is not seen there is no gap, and no angle.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from perception.matching import Sighting, View
from perception.proprioception.estimate import Estimate, make_undefined


@dataclass(frozen=True)
class GapTable:
    """The gap of one joint, from the optics.

    Attributes:
        pad: name of the pad.
        mirror: name of the path of its mirror view.
        ends: which end of the pad faces the other view: in the direct view, and in the mirror's.
        angles: of the joint, rad, in rising order.
        gaps: section angle between these ends, rad, falling or rising all along.
    """

    pad: str
    mirror: str
    ends: tuple[int, int]
    angles: Float[np.ndarray, " values"]
    gaps: Float[np.ndarray, " values"]

    @classmethod
    def of(
        cls,
        pad: str,
        mirror: str,
        angles: Float[np.ndarray, " values"],
        direct: Float[np.ndarray, "values 2"],
        mirrored: Float[np.ndarray, "values 2"],
        seen: Bool[np.ndarray, "values 2 2"],
    ) -> GapTable:
        """The table from what the optics predict.

        Args:
            pad: name of the pad.
            mirror: name of the path of its mirror view.
            angles: of the joint, rad.
            direct: section angle of both ends of the pad in its direct view, rad.
            mirrored: the same in its mirror view.
            seen: whether the direct and the mirror view show each end of the pad.

        Raises:
            ValueError: there is no joint angle at which both views show ends that face each other.
        """
        pairs = [(a, b) for a in range(2) for b in range(2)]
        both = np.flatnonzero(seen[:, 0].any(axis=-1) & seen[:, 1].any(axis=-1))
        if not both.size:
            raise ValueError(f"pad '{pad}' is never seen directly and in {mirror} at once")
        middle = both[len(both) // 2]
        near = min(pairs, key=lambda p: abs(direct[middle, p[0]] - mirrored[middle, p[1]]))
        gap = np.abs(direct[:, near[0]] - mirrored[:, near[1]])
        valid = seen[:, 0, near[0]] & seen[:, 1, near[1]]
        first, last = _monotone(gap, valid)
        if last - first < 2:
            raise ValueError(f"pad '{pad}' never shows facing ends directly and in {mirror}")
        return cls(pad, mirror, near, angles[first:last], gap[first:last])

    @property
    def rate(self) -> Float[np.ndarray, " values"]:
        """How the gap changes with the joint angle, rad per rad."""
        return np.gradient(self.gaps, self.angles)

    def gap(self, angle: Float[np.ndarray, "*batch"] | float) -> Float[np.ndarray, "*batch"]:
        """The gap at joint angles, rad; NaN outside of the table."""
        return np.asarray(np.interp(angle, self.angles, self.gaps, np.nan, np.nan))

    def angle(self, gap: float) -> float:
        """The joint angle at a gap, rad; NaN outside of the table."""
        rising = self.gaps[-1] > self.gaps[0]
        order = slice(None) if rising else slice(None, None, -1)
        return float(np.interp(gap, self.gaps[order], self.angles[order], np.nan, np.nan))

    def measured(self, sighting: Sighting) -> float:
        """The gap in an image, rad; NaN where there is none."""
        views = [sighting.view(self.pad, path) for path in ("direct", self.mirror)]
        direct, mirrored = map(end_angle, views, self.ends)
        return np.nan if direct is None or mirrored is None else abs(direct - mirrored)


@dataclass(frozen=True)
class GapEstimator:
    """A table that labelled frames have been used on: gap = offset + scale · table.

    Attributes:
        table: from the optics.
        offset: rad.
        scale: a number.
        covariance: of both.
        noise: standard deviation of a measured gap, rad.
    """

    table: GapTable
    offset: float
    scale: float
    covariance: Float[np.ndarray, "2 2"]
    noise: float

    def estimate(self, gap: float) -> Estimate:
        """The joint angle at a measured gap."""
        if not np.isfinite(gap):
            return make_undefined("there is no gap: the two views do not show facing ends")
        angle = self.table.angle((gap - self.offset) / self.scale)
        if not np.isfinite(angle):
            return make_undefined("the gap lies outside of its table")
        there = float(self.table.gap(angle))
        rate = self.scale * float(np.interp(angle, self.table.angles, self.table.rate))
        known = np.array([1.0, there])
        variance = self.noise**2 + known @ self.covariance @ known
        return Estimate(angle, float(np.sqrt(variance) / abs(rate)), "gap")


def calibrate_gap(
    table: GapTable,
    gaps: Float[np.ndarray, " frames"],
    angles: Float[np.ndarray, " frames"],
    *,
    noise: float,
    label_deviation: float,
) -> GapEstimator | None:
    """Offset and scale of the gap from labelled frames (paper B: at least five).

    Weighted least squares; a label's error is one of the gap times how fast the gap changes there.

    Args:
        table: from the optics.
        gaps: measured, rad; NaN where there is none.
        angles: labels, rad.
        noise: standard deviation of a measured gap, rad.
        label_deviation: that of the labels, rad.

    Returns:
        The calibrated table; ``None`` where fewer than two frames have a gap, or all the same one,
        or where the gap grows as its table falls.

    Example:
        >>> angles = np.linspace(0.0, 1.0, 11)
        >>> table = GapTable("tip", "mirror", (1, 0), angles, 0.1 + 0.2 * angles)
        >>> labels = np.array([0.1, 0.3, 0.5, 0.7, 0.9])
        >>> estimator = calibrate_gap(
        ...     table, 0.1 + 0.2 * labels, labels, noise=1e-3, label_deviation=1e-3
        ... )
        >>> round(float(estimator.offset), 6), round(float(estimator.scale), 4)
        (0.0, 1.0)
    """
    expected = table.gap(angles)
    there = np.isfinite(gaps) & np.isfinite(expected)
    if there.sum() < 2:
        return None
    rates = np.interp(angles[there], table.angles, table.rate)
    weights = 1 / np.sqrt(noise**2 + (rates * label_deviation) ** 2)
    design = weights[:, None] * np.stack([np.ones(there.sum()), expected[there]], axis=-1)
    solution, _, rank, _ = np.linalg.lstsq(design, weights * gaps[there], rcond=None)
    if rank < 2 or not solution[1] > 0:
        return None
    covariance = np.linalg.inv(design.T @ design)
    return GapEstimator(table, float(solution[0]), float(solution[1]), covariance, noise)


def end_angle(view: View | None, end: int) -> float | None:
    """Section angle of one end of a pad, rad: the mean of its two corners; ``None`` if not seen."""
    if view is None or not view.ends[end]:
        return None
    return float(view.rays[[end, 3 - end], 0].mean())


def _monotone(
    gaps: Float[np.ndarray, " values"], valid: Bool[np.ndarray, " values"]
) -> tuple[int, int]:
    """The longest run of valid values along which the gap only rises, or only falls."""
    best = (0, 0)
    for sign in (1, -1):
        first = 0
        for at in range(len(gaps)):
            goes_on = at > first and valid[at - 1] and sign * (gaps[at] - gaps[at - 1]) > 0
            if not (valid[at] and goes_on):
                first = at
            if valid[at] and at + 1 - first > best[1] - best[0]:
                best = (first, at + 1)
    return best
