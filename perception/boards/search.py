"""A board's points found in a picture from its markers on, each from those beside it."""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import Float, Int, UInt8
from scipy.spatial import KDTree

from perception.boards.appearance import BLURS, Look
from perception.boards.board import Board
from perception.boards.local_maps import LocalMaps, scaling
from perception.boards.neighbors import BESIDE, maps_from_neighbors
from perception.boards.pattern import Pattern
from perception.boards.registration import register

LEVELS, SMALLEST = 4, 60
"""Copies of the picture of half the size each, at most, and the least of their sides, px."""

SQUARE = 16
"""Points are looked for in the smallest copy in which a square is at least as large, px."""

BLUR = 0.6
"""Of a lens, to begin with, px."""

HALF, STEPS = 8, 3
"""Of windows, px, and how often points are fitted."""

BESIDE_MARKER = 0.5
"""How near a corner of a marker is to a point that is looked for beside it, squares."""

LIKENESS, MOVED, SHIFT = 0.6, 0.35, 1.0
"""What a point has at least that is found, how far, in squares along either side, it may be from
where it was expected, and how many px in the copy its last step may be."""

RIM = 3
"""Points nearer the picture's border are left out, px."""

Numbers = Int[np.ndarray, " _"]


class Search:
    """Points of a board in a picture, as far as they are found.

    Attributes:
        pattern: of the board.
        images: brightness, and smaller copies.
        found: numbers of the points that are found, in the order of that.
        places: of all points, px; NaN of those that are not found.
        look: of lens and camera, in the picture itself.
    """

    def __init__(self, board: Board, gray: UInt8[np.ndarray, "rows columns"]) -> None:
        """Nothing is found yet."""
        self.pattern, self.images = Pattern.of(board), _copies(gray)
        self.found = np.zeros(0, int)
        self.places = np.full(board.points.shape, np.nan)
        self.look = Look(BLUR, 0.0)
        self._points = board.points
        self._blurs = [max(BLUR / 2**level, BLURS[0]) for level in range(len(self.images))]

    def begin(self, corners: Float[np.ndarray, "_ 2"], places: Float[np.ndarray, "_ 2"]) -> None:
        """Find the points beside corners of markers on the board (mm) that lie at places (px)."""
        self._find(np.arange(len(self._points)), corners, places, BESIDE_MARKER)

    def spread(self) -> None:
        """Find points beside those that are found, until there are no more."""
        new, square = self.found, self.pattern.square
        while len(new):
            tree = KDTree(self._points[new] / square)
            away, _ = tree.query(self._points / square, distance_upper_bound=BESIDE)
            missing = np.flatnonzero(np.isfinite(away) & np.isnan(self.places[:, 0]))
            known = self.found
            self._find(missing, self._points[known], self.places[known], BESIDE)
            new = self.found[len(known) :]

    def keep(self, numbers: Numbers) -> None:
        """Lose all points but these."""
        lost = np.setdiff1d(self.found, numbers)
        self.places[lost] = np.nan
        self.found = np.sort(numbers)

    def _find(
        self,
        numbers: Numbers,
        known: Float[np.ndarray, "known 2"],
        places: Float[np.ndarray, "known 2"],
        within: float,
    ) -> None:
        """Find points beside known ones."""
        square = self.pattern.square
        chosen, maps, start = maps_from_neighbors(
            self._points[numbers], known, places, square, within=within
        )
        numbers = numbers[chosen]
        inside = self._inside(start)
        numbers, maps, start = numbers[inside], maps.part(inside), start[inside]
        areas = np.abs(np.linalg.det(maps.slopes(start)))
        sizes = square / np.sqrt(np.maximum(areas, 1e-12))
        levels = np.clip(np.log2(sizes / SQUARE), 0, len(self.images) - 1).astype(int)
        for level in np.unique(levels)[::-1].tolist():
            on = levels == level
            self._find_at(level, numbers[on], maps.part(np.flatnonzero(on)), start[on])

    def _find_at(
        self, level: int, numbers: Numbers, maps: LocalMaps, start: Float[np.ndarray, "_ 2"]
    ) -> None:
        """Find points in a copy."""
        scale = 2.0**level
        warps = scaling(np.full(len(start), scale), np.full(start.shape, (scale - 1) / 2))
        fit = register(
            self.images[level],
            self.pattern,
            maps.warped(warps),
            self._points[numbers],
            Look(self._blurs[level], self.look.swell / scale),
            start=(start + 0.5) / scale - 0.5,
            half=HALF,
            steps=STEPS,
            learn_tone=True,
        )
        self._blurs[level] = fit.look.blur
        self.look = Look(self._blurs[0], fit.look.swell * scale)
        places = (fit.places + 0.5) * scale - 0.5
        moved = (maps.slopes(start) @ (places - start)[..., None])[..., 0] / self.pattern.square
        good = (fit.likeness > LIKENESS) & (fit.shifts < SHIFT)
        good &= (np.abs(moved) < MOVED).all(axis=1)
        good = np.intersect1d(np.flatnonzero(good), self._inside(places))
        self.places[numbers[good]] = places[good]
        self.found = np.append(self.found, numbers[good])

    def _inside(self, places: Float[np.ndarray, "_ 2"]) -> Numbers:
        """Which places are in the picture."""
        rows, columns = self.images[0].shape
        most = np.array([columns, rows]) - 1 - RIM
        return np.flatnonzero(((places >= RIM) & (places <= most)).all(axis=1))


def _copies(gray: UInt8[np.ndarray, "rows columns"]) -> list[Float[np.ndarray, "_ _"]]:
    """Brightness, and smaller copies, each a mean of two by two pixels of the one before."""
    images = [gray.astype(np.float32)]
    while len(images) < LEVELS and min(images[-1].shape) >= 2 * SMALLEST:
        rows, columns = (side // 2 for side in images[-1].shape)
        even = images[-1][: 2 * rows, : 2 * columns]
        smaller = cv2.resize(even, (columns, rows), interpolation=cv2.INTER_AREA)
        images.append(smaller.astype(np.float32, copy=False))
    return images
