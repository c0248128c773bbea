"""Markers of a board in a picture, by OpenCV: where the search for its points begins."""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import Float, Int, UInt8

from perception.boards.board import Board
from perception.boards.pattern import opencv_dictionary

FEW = 6
"""Where fewer markers are found, they are looked for once more in the picture made larger."""

LARGER = 2
WINDOWS = {1: 9, LARGER: 13}
"""Sides of the windows of OpenCV's adaptive threshold, px, by how much larger the picture is."""

SHARPENED = {1: 1.5, LARGER: 2.0}
"""Standard deviations of the blur that is taken away again, px: modules seen small are smeared."""


def find_markers(
    gray: UInt8[np.ndarray, "rows columns"], board: Board
) -> tuple[Int[np.ndarray, " markers"], Float[np.ndarray, "markers 4 2"]]:
    """Numbers of markers, from 0 on the board, and their corners to about 1 px.

    Some may be none of the board: what looks like a marker of few bits may be anything.
    """
    numbers, corners = _detected(gray, board, 1)
    if len(numbers) >= FEW:
        return numbers, corners
    more = _detected(gray, board, LARGER)
    return more if len(more[0]) > len(numbers) else (numbers, corners)


def _detected(
    gray: UInt8[np.ndarray, "rows columns"], board: Board, larger: int
) -> tuple[Int[np.ndarray, " markers"], Float[np.ndarray, "markers 4 2"]]:
    if larger > 1:
        gray = cv2.resize(gray, None, fx=larger, fy=larger, interpolation=cv2.INTER_CUBIC)
    gray = cv2.addWeighted(gray, 2, cv2.GaussianBlur(gray, (0, 0), SHARPENED[larger]), -1, 0)
    settings = cv2.aruco.DetectorParameters()
    settings.adaptiveThreshWinSizeMin = settings.adaptiveThreshWinSizeMax = WINDOWS[larger]
    # What was misread is found out by the markers beside it.
    settings.errorCorrectionRate, settings.maxErroneousBitsInBorderRate = 1.0, 0.5
    detector = cv2.aruco.ArucoDetector(opencv_dictionary(board), settings)
    corners, numbers, _ = detector.detectMarkers(gray)
    if numbers is None:
        return np.zeros(0, int), np.zeros((0, 4, 2))
    places = (np.array(corners, float).reshape(-1, 4, 2) + 0.5) / larger - 0.5
    return numbers.ravel().astype(int), places
