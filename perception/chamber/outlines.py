"""Convex outlines of regions, and how well an image agrees with one."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int32

from perception.masks import Mask

Outline = Int32[np.ndarray, "_ 2"]

NOWHERE = np.zeros((0, 2), np.int32)

LEAST_PART = 0.02
"""Of the largest part of a region; smaller parts of it are specks."""

PLACES = 128
"""Places along an outline at which it is judged."""

PROBES = (1.0, 3.0, 5.0, 7.0)
"""How far beside an outline its two sides are looked for, px: blur and opening keep colours that
differ a few pixels off an edge."""

BORDER = 8
"""Nearer to the image's border than so many pixels, an outline is the border's."""

CHORD = PLACES // 16
"""Places from end to end of a chord: in a circle, each chord turns by 22.5° from the one before."""

STRAIGHT = np.deg2rad(6.0)
"""Two chords that turn by less are straight; a pixel's staircase turns them by less than that."""

LEAST_JUDGED = 0.2
"""Of an outline; where less of it is off the border, its shape is not known."""


def convex_outline(mask: Mask) -> Outline:
    """The convex hull of all parts of a mask that are no specks."""
    contours, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    areas = [cv2.contourArea(contour) for contour in contours]
    least = LEAST_PART * max(areas, default=0.0)
    parts = [part for part, area in zip(contours, areas, strict=True) if area >= least]
    hull = cv2.convexHull(np.concatenate(parts)).reshape(-1, 2) if parts else NOWHERE
    return hull if len(hull) > 2 else NOWHERE


def filled(outline: Outline, shape: tuple[int, ...]) -> Mask:
    """The pixels of a convex outline and those within it."""
    return cv2.fillConvexPoly(np.zeros(shape, np.uint8), outline, 255)


@dataclass(frozen=True)
class Course:
    """Places evenly along a closed convex outline.

    Attributes:
        places: column and row.
        outward: unit normals there that point out of it.
        judged: whether a place is off the image's border.
    """

    places: Float[np.ndarray, "places 2"]
    outward: Float[np.ndarray, "places 2"]
    judged: Bool[np.ndarray, " places"]

    @classmethod
    def of(cls, outline: Outline, shape: tuple[int, ...]) -> Course:
        """The course of an outline in an image of rows and columns."""
        corners = outline.astype(float)
        sides = np.concatenate([corners[1:], corners[:1]]) - corners
        lengths = np.hypot(*sides.T)
        ends = np.cumsum(lengths)
        way = (np.arange(PLACES) + 0.5) / PLACES * ends[-1]
        side = np.searchsorted(ends, way)
        along = sides[side] / lengths[side, None]
        places = corners[side] + sides[side] - (ends[side] - way)[:, None] * along
        around = np.sign(cv2.contourArea(outline, oriented=True))
        far = np.array(shape[1::-1]) - 1 - BORDER
        judged = np.all((places >= BORDER) & (places <= far), axis=-1)
        return cls(places, around * along[:, ::-1] * [1, -1], judged)

    def support(self, outer: Mask, inner: Mask, unknown: Mask) -> float:
        """The part of the outline that parts two masks; 1 where none of it can be judged.

        It cannot at the image's border, and where what lies outside is not known.

        Args:
            outer: what is looked for within a few pixels outside.
            inner: what is looked for within a few pixels inside.
            unknown: what may be anything.
        """
        far = np.array(outer.shape[1::-1]) - 1
        beside = np.multiply.outer(PROBES, self.outward)
        outwards, inwards = (
            tuple(np.clip(np.rint(probes).astype(int), 0, far).T[::-1])
            for probes in (self.places + beside, self.places - beside)
        )
        outside, inside = outer[outwards].any(axis=1), inner[inwards].any(axis=1)
        judged = self.judged & (outside | ~inside | ~unknown[outwards].any(axis=1))
        parted = outside & inside & judged
        return float(parted.sum() / judged.sum()) if judged.any() else 1.0

    def straightness(self) -> float:
        """The part of the outline that is straight, the image's border apart.

        0 for an ellipse, 0.5 for a square; 1 where too little is seen off the border.
        """
        again = np.concatenate([self.places, self.places[: 2 * CHORD]])
        x, y = (again[CHORD:] - again[:-CHORD]).T
        turn = np.arctan2(
            x[:-CHORD] * y[CHORD:] - y[:-CHORD] * x[CHORD:],
            x[:-CHORD] * x[CHORD:] + y[:-CHORD] * y[CHORD:],
        )
        off = np.concatenate([self.judged, self.judged[: 2 * CHORD]])
        judged = np.convolve(off, np.ones(2 * CHORD + 1, int), "valid") == 2 * CHORD + 1
        if judged.mean() < LEAST_JUDGED:
            return 1.0
        return float((np.abs(turn[judged]) < STRAIGHT).mean())
