"""OpenCV's own calibration of fisheye lenses, from the same corners."""

from __future__ import annotations

import time
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Float

FAR_OFF_PX = 1.0
"""A median error above this is no calibration."""

FEWEST = 10
"""Corners of a picture that it gets: with fewer it ends in exceptions of other kinds."""


class Baseline(NamedTuple):
    """What ``cv2.fisheye.calibrate`` makes of pictures.

    Attributes:
        failure: why there is no lens, or "".
        median: distance of predicted from seen corners of its own pictures, px; NaN without a lens.
        seconds: it took.
    """

    failure: str
    median: float
    seconds: float


def calibrate_with_opencv(
    points: Float[np.ndarray, "points 2"],
    places: Float[np.ndarray, "pictures points 2"],
    size: tuple[int, int],
) -> Baseline:
    """Calibrate; an exception, or a lens that is far off, is a failure.

    Args:
        points: of the board, mm.
        places: of its corners in each picture, NaN where one is not found.
        size: columns and rows of the images.
    """
    places = places[np.isfinite(places[..., 0]).sum(axis=1) >= FEWEST]
    shown = [np.isfinite(one[:, 0]) for one in places]
    solid = np.column_stack([points, np.zeros(len(points))])
    begin = time.perf_counter()
    try:
        _, matrix, distortion, turns, shifts = cv2.fisheye.calibrate(
            [solid[None, which] for which in shown],
            [one[None, which] for one, which in zip(places, shown, strict=True)],
            size,
            np.eye(3),
            np.zeros((4, 1)),
            flags=cv2.CALIB_RECOMPUTE_EXTRINSIC | cv2.CALIB_FIX_SKEW,
            criteria=(cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 100, 1e-9),
        )
    except cv2.error as error:
        return Baseline(f"exception: {error.err}", np.nan, time.perf_counter() - begin)
    seconds = time.perf_counter() - begin
    off = []
    for one, which, turn, shift in zip(places, shown, turns, shifts, strict=True):
        predicted, _ = cv2.fisheye.projectPoints(
            solid[None, which], turn, shift, matrix, distortion
        )
        off.append(np.linalg.norm(predicted.reshape(-1, 2) - one[which], axis=1))
    median = float(np.median(np.concatenate(off)))
    if not median < FAR_OFF_PX:
        return Baseline("far off", median, seconds)
    return Baseline("", median, seconds)
