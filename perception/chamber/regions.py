"""The coloured regions of the chamber in one frame (paper A §III.A.a and §III.B, Fig. 7).

An endoscope looks along the chamber. From outside to inside it sees the red wall, which fills the
rest of the image, the blue ring, the yellow ring and the dark top. The openings of a round chamber
are convex as they are seen, however it bends, with few straight sides, and each lies in the outer
one: a picture whose colours do not lie so shows no chamber.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass, replace

import cv2
import numpy as np
from jaxtyping import UInt8

from perception.chamber.colors import DIM, OPENING, Colors, colors_of, not_above
from perception.chamber.outlines import NOWHERE, Course, Outline, convex_outline, filled
from perception.images import checked_image
from perception.masks import Gray, Image, Mask, cleaned, global_mask

LEAST_SHARE = 2e-4
"""Of the image; a colour with less is not in view."""

DARK = 0.5
"""The top is darker than this share of the yellow ring's brightness."""

BLACK, NIGHT, FULL = 6.0, 20.0, 250.0
"""Mean of an image that is too dark for anything, and of one that is too dark if it shows no
chamber; a pixel above the last level is saturated."""

# What a chamber has and other pictures lack: of 1,080 rendered frames of fingers as made, bent by
# up to 120° and pressed by up to 4 mm, in light from perfect to poor, the worst has, in the order
# of what follows: 0.08; 0; 0.97; 0.86; 0.77; 0.58; 0.36. Pictures of other things miss one or
# several.

LEAST_AREA = 0.03
"""Of the image; blue with all that it encloses has more."""

NESTED, EDGE = 0.06, 7
"""Of what an outline encloses, at most this part has the colour that belongs outside, counted where
a square of so many pixels a side lies inside: edges are rough."""

EXPLAINED, MOST_UNTOLD = 0.9, 0.45
"""Of the image, at least this part has the colour that the outlines give it. Highlights have not;
what is too dark for colours, such as a lens's black corners, does not count, up to the second part
of the image."""

PARTED = 0.75
"""Of blue's outline, at least this part has red outside, and inside blue or yellow."""

BLUE_INSIDE, BLUE_UNWASHED = 0.6, 0.45
"""... and at least these parts blue, with and without what gloss may have taken the colour of: a
nearer wall hides blue before yellow on one side alone."""

YELLOW_PARTED = 0.45
"""Of yellow's outline, at least this part has blue outside, and yellow or the top inside. A nearer
wall hides less than half of the blue round it; there may be a highlight beside."""

MOST_STRAIGHT = 0.45
"""Of blue's outline, at most this part is straight: what presses the wall makes one chord of it."""

FAINTEST = 4.0
"""Mean of what is labelled yellow; of a darker one noise and rounding take the outer pixels."""

WASHED, SOLID, GLARE = 5, 0.97, 110.0
"""Narrower parts without colour, px, are edges or specks; a hole is round from this part of its
convex hull on; a least channel above the last grey level is a highlight."""

UNTOLD = 0.03
"""Of what blue encloses; a larger part that is too dark for colours may be yellow or not."""


class Region(enum.IntEnum):
    """Labels of pixels; OTHER are mixed colours between two regions, highlights, shadows."""

    OTHER = 0
    RED = 1
    BLUE = 2
    YELLOW = 3
    TOP = 4


INWARDS = (Region.RED, Region.BLUE, Region.YELLOW, Region.TOP)


class ChamberStatus(enum.Enum):
    """What is seen of the chamber; the values are what a person reads."""

    CHAMBER = "The red, the blue and the yellow region are seen."
    NO_YELLOW = "The yellow region is out of view; the blue one is seen."
    DARK_INSIDE = (
        "The blue region is seen; what it encloses is too dark to tell yellow: add light, or "
        "expose for longer."
    )
    GLOSSY_INSIDE = (
        "The blue region is seen; mirror images on glossy walls hide where yellow begins in what "
        "it encloses: make the walls matt, or spread the light."
    )
    NO_CHAMBER = "The chamber is out of view: the blue or the red region is missing."
    NO_RINGS = (
        "The colours are seen, but not as rings one within the other: aim the camera along the "
        "chamber, and clear its view."
    )
    TOO_DARK = "The image is too dark to tell colours apart."
    TOO_BRIGHT = "The image is too bright to tell colours apart: more than half is saturated."
    SWAPPED = "The image's red and blue channels are swapped: with them in order it is a chamber."


IN_VIEW = frozenset(
    {
        ChamberStatus.CHAMBER,
        ChamberStatus.NO_YELLOW,
        ChamberStatus.DARK_INSIDE,
        ChamberStatus.GLOSSY_INSIDE,
    }
)
"""A chamber is seen, and blue has an outline."""


@dataclass(frozen=True)
class Regions:
    """The regions of one frame.

    Attributes:
        labels: a Region for every pixel.
        status: what is seen; there are outlines with those of `IN_VIEW` alone.
        blue: the blue region's outer outline, corners of a convex polygon in pixels, column and
            row; what blue encloses belongs to it. Empty where it is not seen.
        yellow: the same of the yellow region, with the top.
        top: the same of the top.
    """

    labels: UInt8[np.ndarray, "rows columns"]
    status: ChamberStatus
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


def find_regions(image: Image) -> Regions:
    """The regions of the chamber in one frame; every image has an answer.

    Source: paper A §III.A.a, steps 1 and 2. The thresholds are ours, on ratios; the outlines' being
    convex is a reading of Fig. 7. Their hulls close what a highlight or the inner region breaks
    open.

    Args:
        image: red, green, blue.

    Raises:
        UserError: it is no image of three channels of 8 bits.

    Example:
        >>> import numpy as np
        >>> find_regions(np.zeros((240, 320, 3), np.uint8)).status.name
        'TOO_DARK'
    """
    image = checked_image(image)
    found = _regions(image)
    if found.status is ChamberStatus.NO_RINGS:
        swapped = np.ascontiguousarray(image[..., ::-1])
        if _regions(swapped).status in IN_VIEW:
            return replace(found, status=ChamberStatus.SWAPPED)
    return found


def _regions(image: Image) -> Regions:
    """The regions of an image whose channels are in order."""
    colors = colors_of(image)
    red, blue, yellow, value = colors.red, colors.blue, colors.yellow, colors.value
    least = LEAST_SHARE * red.size
    enclosed = cv2.max(blue, yellow)
    few = min(cv2.countNonZero(red), cv2.countNonZero(blue)) <= least
    few |= cv2.mean(value)[0] < BLACK
    washed = np.zeros_like(red) if few else _washed_out(colors)
    outline = NOWHERE if few else convex_outline(cv2.max(enclosed, washed))
    top, inner = np.zeros_like(red), NOWHERE
    within = filled(outline, red.shape)
    if len(outline) and cv2.countNonZero(yellow) > least:
        shade = cv2.bitwise_and(not_above(value, DARK * cv2.mean(value, yellow)[0]), within)
        top = cleaned(cv2.subtract(shade, cv2.max(red, enclosed)), OPENING)
        inner = convex_outline(cv2.max(yellow, top))
        others = cv2.bitwise_not(cv2.max(yellow, top))
        if cv2.countNonZero(washed) and _held(others, filled(inner, red.shape)) > NESTED:
            # Glossy blue is as dark where it mirrors the top, and the top mirrors the lamp.
            top = _largest(_inside(cv2.max(top, washed), convex_outline(yellow)))
            inner = convex_outline(cv2.max(yellow, top))
    # Where closing made masks overlap, the inner region has the pixel.
    labels = np.zeros_like(red)
    for mask, region in zip((red, blue, yellow, top), INWARDS, strict=True):
        labels = cv2.max(labels, mask & np.uint8(region))
    status = ChamberStatus.CHAMBER if len(inner) else ChamberStatus.NO_YELLOW
    found = Regions(labels, status, outline, inner, convex_outline(top))
    return _judged(found, within, value, washed)


def _washed_out(colors: Colors) -> Mask:
    """What has no colour among blue and yellow within the red all around them.

    Gloss mixes the colours of walls with those of their mirror images, of red least, for it is
    brightest. Nothing where what is not red is no round hole.
    """
    square = np.ones((WASHED, WASHED), np.uint8)
    hole = cv2.morphologyEx(cv2.bitwise_not(colors.red), cv2.MORPH_OPEN, square)
    enclosed, glare = cv2.max(colors.blue, colors.yellow), global_mask(colors.grey, GLARE)
    blank = cv2.subtract(hole, cv2.max(enclosed, glare))
    blank = cv2.morphologyEx(blank, cv2.MORPH_OPEN, square)
    if not cv2.countNonZero(blank):
        return blank
    # Which hole, and whether it is round, is seen in every other pixel, too.
    hole, known = np.ascontiguousarray(hole[::2, ::2]), enclosed[::2, ::2] > 0
    contours, _ = cv2.findContours(hole, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    hole = cv2.drawContours(hole, contours, -1, 255, cv2.FILLED)
    number, parts = cv2.connectedComponents(hole)
    held = np.bincount(parts[known], minlength=number)
    held[0] = 0
    own = cv2.inRange(parts, int(held.argmax()), int(held.argmax()))
    area, hull = cv2.countNonZero(own), filled(convex_outline(own), own.shape)
    if area < SOLID * cv2.countNonZero(hull) or 2 * held.max() < area:
        return np.zeros_like(blank)
    whole = cv2.resize(own, blank.shape[::-1], interpolation=cv2.INTER_NEAREST)
    return cv2.bitwise_and(blank, whole)


def _judged(found: Regions, within: Mask, value: Gray, washed: Mask) -> Regions:
    """Regions and their status; without outlines where they are no rings."""
    other, red, blue, yellow, top = (
        cv2.inRange(found.labels, int(region), int(region)) for region in Region
    )
    dim = not_above(value, DIM)
    untold = cv2.max(cv2.bitwise_and(dim, other), cv2.subtract(washed, top))
    fault = ChamberStatus.NO_CHAMBER
    if len(found.blue):
        fault = ChamberStatus.NO_RINGS
        if _is_ring(found, within, (red, blue, yellow, washed), untold):
            seen = found.status is ChamberStatus.CHAMBER
            sound = seen and _is_yellow(found.yellow, blue, cv2.max(yellow, top), untold)
            sound = sound and cv2.mean(value, yellow)[0] >= FAINTEST
            if sound and not _much(untold, within):
                return found
            if _much(cv2.subtract(washed, dim), within):
                fault = ChamberStatus.GLOSSY_INSIDE
                return replace(found, status=fault, yellow=NOWHERE, top=NOWHERE)
            if _much(cv2.subtract(dim, cv2.max(red, blue)), within):
                return replace(found, status=ChamberStatus.DARK_INSIDE, yellow=NOWHERE, top=NOWHERE)
            if not seen:
                return found
    if cv2.mean(value)[0] < NIGHT:
        fault = ChamberStatus.TOO_DARK
    elif 2 * cv2.countNonZero(global_mask(value, FULL)) > value.size:
        fault = ChamberStatus.TOO_BRIGHT
    return replace(found, status=fault, blue=NOWHERE, yellow=NOWHERE, top=NOWHERE)


def _is_ring(found: Regions, within: Mask, masks: tuple[Mask, ...], untold: Mask) -> bool:
    """Whether blue's outline, with all it encloses, is that of a round opening in red."""
    red, blue, yellow, washed = masks
    if cv2.countNonZero(within) < LEAST_AREA * within.size or _held(red, within) > NESTED:
        return False
    right = cv2.compare(found.labels, found.nested(), cv2.CMP_EQ)
    counted = right.size - min(cv2.countNonZero(untold), MOST_UNTOLD * right.size)
    if cv2.countNonZero(right) < EXPLAINED * counted:
        return False
    course = Course.of(found.blue, within.shape)
    return (
        course.straightness() <= MOST_STRAIGHT
        and course.support(red, cv2.max(cv2.max(blue, washed), yellow), untold) >= PARTED
        and course.support(red, cv2.max(blue, washed), untold) >= BLUE_INSIDE
        and (not cv2.countNonZero(washed) or course.support(red, blue, untold) >= BLUE_UNWASHED)
    )


def _is_yellow(outline: Outline, blue: Mask, inside: Mask, untold: Mask) -> bool:
    """Whether yellow's outline, with the top, is that of an opening in blue."""
    support = Course.of(outline, blue.shape).support(blue, inside, untold)
    return _held(blue, filled(outline, blue.shape)) <= NESTED and support >= YELLOW_PARTED


def _held(mask: Mask, within: Mask) -> float:
    """The part of an area that a mask holds, the edge of the area apart."""
    inside = cv2.erode(within, np.ones((EDGE, EDGE), np.uint8))
    return cv2.countNonZero(cv2.bitwise_and(mask, inside)) / cv2.countNonZero(within)


def _inside(mask: Mask, outline: Outline) -> Mask:
    """The part of a mask that an outline encloses."""
    return cv2.bitwise_and(mask, filled(outline, mask.shape))


def _largest(mask: Mask) -> Mask:
    """The largest connected part of a mask."""
    _, parts, stats, _ = cv2.connectedComponentsWithStats(mask)
    own = int(stats[1:, cv2.CC_STAT_AREA].argmax()) + 1 if len(stats) > 1 else 1
    return cv2.inRange(parts, own, own)


def _much(mask: Mask, within: Mask) -> bool:
    """Whether a mask holds more than `UNTOLD` of an area, lines between two colours apart."""
    least = UNTOLD * cv2.countNonZero(within)
    inside = cv2.bitwise_and(mask, within)
    if cv2.countNonZero(inside) <= least:
        return False
    square = np.ones((OPENING, OPENING), np.uint8)
    return cv2.countNonZero(cv2.morphologyEx(inside, cv2.MORPH_OPEN, square)) > least
