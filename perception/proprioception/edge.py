"""One edge and no model: a joint angle from the section angle of one end of one view.

Labelled frames give a straight line, or with many frames a parabola, from the end's section angle
to the joint angle. No optics are needed, but little is known beyond the labelled range.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from perception.matching import Sighting
from perception.proprioception.estimate import Estimate, make_undefined
from perception.proprioception.gap import end_angle

PARABOLA = 5
"""Frames from which on a parabola is fitted; fewer carry a straight line only."""

BEYOND = 0.25
"""How far beyond the labelled frames a curve is trusted, in parts of their range."""


@dataclass(frozen=True)
class EdgeCurve:
    """From the section angle of one end of one view to a joint angle.

    Attributes:
        pad: name of the pad.
        path: name of the path.
        end: of the pad.
        coefficients: of the polynomial in (angle − middle), constant first.
        covariance: of these.
        edge_deviation: standard deviation of a section angle, rad.
        middle: of the labelled section angles, rad.
        limits: least and greatest section angle for which the curve is trusted, rad.
    """

    pad: str
    path: str
    end: int
    coefficients: Float[np.ndarray, " terms"]
    covariance: Float[np.ndarray, "terms terms"]
    edge_deviation: float
    middle: float
    limits: tuple[float, float]

    def estimate(self, angle: float) -> Estimate:
        """The joint angle at a section angle of the end."""
        if not self.limits[0] <= angle <= self.limits[1]:
            return make_undefined("the end lies outside of the labelled range")
        powers = (angle - self.middle) ** np.arange(len(self.coefficients))
        orders = np.arange(1, len(self.coefficients))
        rate = (orders * self.coefficients[1:]) @ powers[:-1]
        variance = (rate * self.edge_deviation) ** 2 + powers @ self.covariance @ powers
        name = f"end {self.end} of {self.pad}, {self.path}"
        return Estimate(float(powers @ self.coefficients), float(np.sqrt(variance)), name)


@dataclass(frozen=True)
class EdgeEstimator:
    """All curves of one joint.

    Attributes:
        curves: of every end that at least two labelled frames show.
    """

    curves: tuple[EdgeCurve, ...]

    def estimate(self, sighting: Sighting) -> Estimate:
        """The joint angle by the end with the least deviation."""
        nothing = make_undefined("no labelled end is seen")
        ends = [(c, end_angle(sighting.view(c.pad, c.path), c.end)) for c in self.curves]
        answers = [curve.estimate(angle) for curve, angle in ends if angle is not None]
        return min(answers, key=lambda answer: answer.deviation, default=nothing)


def fit_edges(
    sightings: Sequence[Sighting],
    labels: Float[np.ndarray, " frames"],
    views: Sequence[tuple[str, str]],
    *,
    label_deviation: float,
    edge_deviation: float,
) -> EdgeEstimator:
    """Curves from labelled frames by least squares.

    Args:
        sightings: of the frames.
        labels: the joint's angle in each, rad; NaN where it is not known.
        views: pad and path of the views that the joint moves.
        label_deviation: standard deviation of the labels, rad.
        edge_deviation: that of an end's section angle, rad.

    Example:
        >>> fit_edges(
        ...     [], np.zeros(0), [], label_deviation=0.01, edge_deviation=0.01
        ... ).curves  # no frames
        ()
    """
    curves = []
    for pad, path in views:
        for end in range(2):
            found = [end_angle(sighting.view(pad, path), end) for sighting in sightings]
            angles = np.array(found, float)  # NaN where the end is not seen
            there = np.isfinite(angles) & np.isfinite(labels)
            curve = _fitted(angles[there], labels[there], label_deviation, edge_deviation)
            if curve is not None:
                curves.append(EdgeCurve(pad, path, end, *curve))
    return EdgeEstimator(tuple(curves))


def _fitted(
    angles: Float[np.ndarray, " frames"],
    labels: Float[np.ndarray, " frames"],
    label_deviation: float,
    edge_deviation: float,
) -> tuple[np.ndarray, np.ndarray, float, float, tuple[float, float]] | None:
    if len(angles) < 2 or np.ptp(angles) < 4 * edge_deviation:
        return None
    low, high = float(angles.min()), float(angles.max())
    middle = (low + high) / 2
    terms = 3 if len(angles) >= PARABOLA else 2
    design = (angles - middle)[:, None] ** np.arange(terms)
    if np.linalg.matrix_rank(design / np.abs(design).max(axis=0)) < terms:
        design, terms = design[:, :2], 2
    coefficients = np.linalg.lstsq(design, labels, rcond=None)[0]
    noise = abs(float(coefficients[1])) * edge_deviation
    left = labels - design @ coefficients
    stated = label_deviation**2 + noise**2
    free = len(angles) - terms
    variance = max(stated, float(left @ left) / free) if free > 0 else stated
    covariance = variance * np.linalg.inv(design.T @ design)
    beyond = BEYOND * (high - low)
    return coefficients, covariance, edge_deviation, middle, (low - beyond, high + beyond)
