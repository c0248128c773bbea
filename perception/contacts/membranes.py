"""How a membrane bulges over a round or flat body that is pressed into it.

A body of revolution that is flat up to a radius b and rounded beyond touches an elastic half-space
up to a radius a > b. By I. N. Sneddon (Int. J. Eng. Sci. 3 (1965) 47), with s = r / a, β = b / a
and g(t) = t √(t² − β²) − t β arccos(β / t) for t > β, else 0, the surface is lifted by its depth
times

    1 − (s − β)₊² / 2 g(1)                                    for s ≤ 1,
    2/π ∫₀¹ (1 − g(t) / g(1)) / √(s² − t²) dt                 beyond.

β = 0 is a sphere (Hertz), β → 1 a pin with a sharp rim. Where the membrane leaves the body, at
s = 1, it is steepest, whatever β is. A pad is thin, so what is lifted fades over `FADE`.
"""

from __future__ import annotations

import functools

import cv2
import numpy as np
from jaxtyping import Float

FADE = 2.0
"""mm: beyond the contact's edge, heights fall by exp(−(distance / FADE)²) as well."""

BETAS, FLATTEST = 24, 0.92
"""Rows of the table, and the last one's β."""

STEP, FARTHEST = 0.02, 4.0
"""Step of s between columns of the table, and the last one's s; beyond all is 0."""

NODES = 24
"""Of the quadrature: right to 1e-5."""

Table = Float[np.ndarray, "betas steps"]
Batch = Float[np.ndarray, "*batch places"]


def heights(distance: Float[np.ndarray, " steps"], beta: float) -> Float[np.ndarray, " steps"]:
    """Part of the depth by which a half-space is lifted, by distance from the middle over a.

    Example:
        >>> heights(np.array([0.0, 1.0, 2.0]), 0.0).round(3).tolist()  # a sphere
        [1.0, 0.5, 0.218]
    """
    on = 1 - np.maximum(distance - beta, 0) ** 2 / (2 * _sunk(np.ones(1), beta))
    # Over angles t = s sin θ the integral has no pole.
    beyond = np.maximum(distance, 1)
    low, high = np.arcsin(beta / beyond), np.arcsin(1 / beyond)
    nodes, weights = np.polynomial.legendre.leggauss(NODES)
    angles = low + (high - low) * (nodes[:, None] + 1) / 2
    kept = 1 - _sunk(beyond * np.sin(angles), beta) / _sunk(np.ones(1), beta)
    outside = 2 / np.pi * (low + (high - low) / 2 * (weights @ kept))
    return np.where(distance <= 1, on, outside)


def _sunk(edge: np.ndarray, beta: float) -> np.ndarray:
    inner = np.minimum(beta / edge, 1)
    return edge**2 * (np.sqrt(1 - inner**2) - inner * np.arccos(inner))


@functools.cache
def tables(blur: float) -> tuple[Table, Table]:
    """Heights and their slopes by s, for all β, as means over ``blur`` of s."""
    distance = np.arange(0, FARTHEST + STEP / 2, STEP)
    rows = np.stack([heights(distance, beta) for beta in np.linspace(0, FLATTEST, BETAS)])
    # A mean of slopes is a difference of heights.
    mirrored = np.concatenate([rows[:, :0:-1], rows], axis=1)
    half = max(round(blur / STEP / 2), 1)
    padded = np.pad(mirrored, ((0, 0), (half, half)), mode="edge")
    slopes = (padded[:, 2 * half :] - padded[:, : -2 * half]) / (2 * half * STEP)
    means = cv2.blur(mirrored, (2 * half + 1, 1), borderType=cv2.BORDER_REPLICATE)
    first = len(distance) - 1
    both = (np.ascontiguousarray(one[:, first:], np.float32) for one in (means, slopes))
    height, slope = both
    return height, slope


def look_up(table: Table, distance: Batch, beta: Float[np.ndarray, "*batch 1"]) -> Batch:
    """Values of a table of `tables`, interpolated."""
    columns = (distance * (1 / STEP)).astype(np.float32, copy=False)
    rows = np.broadcast_to(beta * ((BETAS - 1) / FLATTEST), distance.shape).astype(np.float32)
    return cv2.remap(table, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
