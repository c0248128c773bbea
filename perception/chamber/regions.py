"""The coloured regions of the chamber in one frame (paper A §III.A.a and §III.B, Fig. 7).

An endoscope looks along the chamber. From outside to inside it sees the red wall, which fills the
rest of the image, the blue ring, the yellow ring and the dark top. Colours are told apart by ratios
of channels, which the light's strength and its falling off with depth leave alone.
"""

from __future__ import annotations

import enum
from collections.abc import Iterable
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Int32, UInt8

from perception.masks import Grey, Image, Mask, brightness, cleaned, global_mask

Outline = Int32[np.ndarray, "_ 2"]

CLEARLY = 1.4
"""A channel is clearly above others from this ratio on. Blue silicone holds some green: where
blue is overexposed 2.5 times, the ratio is still 1.8."""

RED_CLEARLY = 2.0
"""The same for red, between red's own ratio to green, about 6, and yellow's, about 1.2."""

LEAST = 8
"""... and by so many grey levels more, as noise has ratios too."""

LEAST_SHARE = 2e-4
"""Of the image; a colour with less is not in view."""

LEAST_PART = 0.02
"""Of the largest part of a region; smaller parts of it are specks."""

DARK = 0.5
"""The top is darker than this share of the yellow ring's brightness."""

NIGHT, FULL = 20.0, 250.0
"""Mean of an image that is too dark; a pixel above this level is saturated."""

OPENING = 3
"""Side of the square of paper A's "dilatation corrosion", px; read as open, then close."""


class Region(enum.IntEnum):
    """Labels of pixels; OTHER are mixed colours between two regions, highlights, shadows."""

    OTHER = 0
    RED = 1
    BLUE = 2
    YELLOW = 3
    TOP = 4


class Sight(enum.Enum):
    """What is seen of the chamber; the values are what a person reads."""

    CHAMBER = "The red, the blue and the yellow region are seen."
    NO_YELLOW = "The yellow region is out of view; the blue one is seen."
    NO_CHAMBER = "The chamber is out of view: the blue or the red region is missing."
    TOO_DARK = "The image is too dark to tell colours apart."
    TOO_BRIGHT = "The image is too bright to tell colours apart: more than half is saturated."
    SWAPPED = "Red is seen inside blue: the image's red and blue channels are swapped."


@dataclass(frozen=True)
class Regions:
    """The regions of one frame.

    Attributes:
        labels: a Region for every pixel.
        sight: what is seen; with neither CHAMBER nor NO_YELLOW there are no outlines.
        blue: the blue region's outer outline, corners of a convex polygon in pixels, column and
            row; what blue encloses belongs to it. Empty where it is not seen.
        yellow: the same of the yellow region, with the top.
        top: the same of the top.
    """

    labels: UInt8[np.ndarray, "rows columns"]
    sight: Sight
    blue: Outline
    yellow: Outline
    top: Outline

    def nested(self) -> UInt8[np.ndarray, "rows columns"]:
        """Labels by the outlines alone: highlights, specks and mixed colours are gone.

        All red where there are no outlines.
        """
        labels = np.full_like(self.labels, Region.RED)
        outlines = (self.blue, Region.BLUE), (self.yellow, Region.YELLOW), (self.top, Region.TOP)
        for outline, region in outlines:
            if len(outline):
                cv2.fillConvexPoly(labels, outline, int(region))
        return labels


NOWHERE = np.zeros((0, 2), np.int32)


def _above(channel: Grey, others: Grey, ratio: float) -> Mask:
    """Where a channel is clearly above others."""
    level = cv2.convertScaleAbs(others, alpha=ratio, beta=LEAST)
    return cv2.compare(channel, level, cv2.CMP_GT)


def _labelled(masks: Iterable[tuple[Mask, Region]], shape: tuple[int, ...]) -> Grey:
    """Labels from masks; where closing made them overlap, the inner region has the pixel."""
    labels = np.zeros(shape, np.uint8)
    for mask, region in masks:
        labels = cv2.max(labels, cv2.min(mask, np.full_like(mask, region)))
    return labels


def _outline(mask: Mask) -> Outline:
    """The convex hull of all parts of a mask that are no specks.

    Visible regions are convex, being far ends of a round chamber cut off by nearer openings and by
    the image: so the hull closes what a highlight or the inner region breaks open.
    """
    contours, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    areas = [cv2.contourArea(contour) for contour in contours]
    least = LEAST_PART * max(areas, default=0.0)
    parts = [part for part, area in zip(contours, areas, strict=True) if area >= least]
    return cv2.convexHull(np.concatenate(parts)).reshape(-1, 2) if parts else NOWHERE


def filled(outline: Outline, shape: tuple[int, ...]) -> Mask:
    """The pixels of a convex outline and those within it."""
    return cv2.fillConvexPoly(np.zeros(shape, np.uint8), outline, 255)


def find_regions(image: Image) -> Regions:
    """The regions of the chamber in one frame; every image has an answer.

    Source: paper A §III.A.a, steps 1 and 2. The thresholds are ours, on ratios; the outlines' being
    convex is a reading of Fig. 7.

    Args:
        image: red, green, blue.
    """
    # Averages of 3×3 pixels: dark pixels' ratios are mostly noise.
    even = cv2.blur(image, (3, 3))
    red, green, blue = cv2.split(even)
    shape, least = red.shape, LEAST_SHARE * red.size
    raw_reds = _above(red, cv2.max(green, blue), RED_CLEARLY)
    # Red is a little above blue in green too: what is red is not yellow.
    raw_yellows = cv2.subtract(_above(cv2.min(red, green), blue, CLEARLY), raw_reds)
    reds = cleaned(raw_reds, OPENING)
    yellows = cleaned(raw_yellows, OPENING)
    blues = cleaned(_above(blue, cv2.max(red, green), CLEARLY), OPENING)
    coloured = cv2.max(blues, yellows)
    masks = [(reds, Region.RED), (blues, Region.BLUE), (yellows, Region.YELLOW)]

    amount = {region: cv2.countNonZero(mask) for mask, region in masks}
    outline = (
        _outline(coloured) if min(amount[Region.RED], amount[Region.BLUE]) > least else NOWHERE
    )
    if len(outline) < 3:
        return Regions(
            _labelled(masks, shape), _missing(brightness(even)), NOWHERE, NOWHERE, NOWHERE
        )
    within = filled(outline, shape)
    if 2 * cv2.countNonZero(cv2.bitwise_and(reds, within)) > amount[Region.RED]:
        return Regions(_labelled(masks, shape), Sight.SWAPPED, NOWHERE, NOWHERE, NOWHERE)
    if amount[Region.YELLOW] <= least:
        return Regions(_labelled(masks, shape), Sight.NO_YELLOW, outline, NOWHERE, NOWHERE)

    left, upper, wide, high = cv2.boundingRect(outline)
    box = np.s_[upper : upper + high, left : left + wide]
    value = brightness(even[box])
    dark = DARK * cv2.mean(value, yellows[box])[0]
    shade = cv2.bitwise_and(cv2.bitwise_not(global_mask(value, dark)), within[box])
    shade = cv2.subtract(shade, cv2.max(reds[box], coloured[box]))
    tops = np.zeros_like(reds)
    tops[box] = cleaned(shade, OPENING)
    labels = _labelled([*masks, (tops, Region.TOP)], shape)
    yellow = _outline(cv2.max(yellows, tops))
    return Regions(labels, Sight.CHAMBER, outline, yellow, _outline(tops))


def _missing(value: Grey) -> Sight:
    """Why there is no chamber in an image, by its brightest channel."""
    if cv2.mean(value)[0] < NIGHT:
        return Sight.TOO_DARK
    saturated = cv2.countNonZero(global_mask(value, FULL))
    return Sight.TOO_BRIGHT if 2 * saturated > value.size else Sight.NO_CHAMBER
