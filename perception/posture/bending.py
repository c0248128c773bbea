"""The bend of a finger from its markers: the arc of constant curvature that fits them best."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

SMALLEST, LARGEST = -math.pi, math.pi
"""Bends that are looked for, in radians: half a turn to either side."""

STARTS = 61
"""Bends that are tried, evenly between these; the best one is refined."""

STEPS = 7
"""Of Newton's iteration, from a start a few degrees off; each doubles the digits."""

LEAST_CURVED = 0.1
"""Of the squared slopes: where the sum of squares is curved less, as if it were so much."""

NUDGE = 1e-4
"""Change of the bend, in radians, by which slopes are taken: their error, 1e-9 of them, moves the
bend by as little."""

FAR = 10.0
"""Markers farther off than so many lengths of the finger are none of it."""

APART = 1e-6
"""Of the finger's length: markers nearer to each other along it do not rise."""

ROUNDED = 1e-9
"""Of the finger's length: by so much the last marker may lie beyond it."""


@dataclass(frozen=True)
class Bends:
    """Bends of some fingers; everything is finite.

    Attributes:
        bend: angle between both ends of the finger, in radians, positive to the side of x.
        residual: root mean square distance of the markers from the arc's own, mm.
        known: whether there is an answer; else the bend and the residual are 0 and mean nothing.
    """

    bend: Float[np.ndarray, " images"]
    residual: Float[np.ndarray, " images"]
    known: Bool[np.ndarray, " images"]


def fit_bend(
    markers: Float[np.ndarray, "images 3 2"], arcs: tuple[float, float, float, float], length: float
) -> Bends:
    """Least squares of an arc of constant curvature, of known length, through three markers.

    There is one unknown: paper A's markers (§III.A.c) are given in the plane of bending relative to
    one on the finger, and its frame does not turn. Of all bends up to half a turn to either side,
    the best on a grid is refined. That an object bends the finger to an arc is a reading.

    Args:
        markers: places relative to the marker nearest the camera: x to the side the finger bends
            to, y along the finger where it starts, mm.
        arcs: places of all markers along the finger, the one that the others are relative to
            first, mm.
        length: of the finger, mm.

    Returns:
        Bends; not known where a marker is not finite, or farther off than `FAR` lengths.

    Raises:
        ValueError: the length is not positive, or the markers' places do not rise along it.

    Example:
        >>> import numpy as np
        >>> straight = np.array([[[0.0, 30.0], [0.0, 60.0], [0.0, 90.0]]])
        >>> abs(float(fit_bend(straight, (10.0, 40.0, 70.0, 100.0), 110.0).bend[0])) < 1e-3
        True
    """
    if not 0 < length < math.inf:
        raise ValueError(f"a finger's length is positive, not {length:g} mm")
    rise = np.diff(arcs)
    if not (arcs[0] >= 0 and np.all(rise > APART * length) and arcs[-1] <= length * (1 + ROUNDED)):
        raise ValueError(
            f"places of markers rise along the finger, from 0 to {length:g} mm at most, "
            f"not {', '.join(f'{arc:g}' for arc in arcs)}"
        )
    sane = np.isfinite(markers) & (np.abs(markers) <= FAR * length)
    known = np.all(sane, axis=(1, 2), keepdims=True)[:, 0, 0]
    wanted = np.where(known[:, None, None], markers, 0.0)

    grid = np.linspace(SMALLEST, LARGEST, STARTS)
    off = wanted[:, None] - _arc_markers(grid, arcs, length)[None]
    bend = grid[np.argmin(np.sum(off**2, axis=(2, 3)), axis=1)]
    reach = grid[1] - grid[0]
    low = np.maximum(bend - reach, SMALLEST)
    high = np.minimum(bend + reach, LARGEST)
    for _ in range(STEPS):
        ends = [_arc_markers(bend + move, arcs, length) for move in (NUDGE, -NUDGE)]
        here = _arc_markers(bend, arcs, length)
        slope = (ends[0] - ends[1]) / (2 * NUDGE)
        curved = (ends[0] - 2 * here + ends[1]) / NUDGE**2
        off = wanted - here
        steep = np.sum(slope**2, axis=(1, 2))
        second = steep - np.sum(curved * off, axis=(1, 2))
        step = np.sum(slope * off, axis=(1, 2)) / np.maximum(second, LEAST_CURVED * steep)
        bend = np.clip(bend + step, low, high)
    off = wanted - _arc_markers(bend, arcs, length)
    residual = np.sqrt(np.mean(np.sum(off**2, axis=2), axis=1))
    return Bends(np.where(known, bend, 0.0), np.where(known, residual, 0.0), known)


def _arc_markers(
    bends: Float[np.ndarray, " images"], arcs: tuple[float, float, float, float], length: float
) -> Float[np.ndarray, "images 3 2"]:
    """Where three markers of an arc are, relative to the first of four, mm.

    A chord of an arc that turns by t is sin(t/2)/(t/2) of it long and points at t/2.

    Args:
        bends: in radians.
        arcs: places of all markers along the finger, mm.
        length: of the finger, mm.
    """
    along = np.asarray(arcs)[None, :]
    half = bends[:, None] * along / (2 * length)
    chord = along * np.sinc(half / np.pi)
    places = np.stack([chord * np.sin(half), chord * np.cos(half)], axis=-1)
    return places[:, 1:] - places[:, :1]
