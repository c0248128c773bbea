"""Which pixels of a look into the chamber are red, blue and yellow (paper A §III.A.a).

Colours are separated by ratios of channels, which the light's strength and its falling off with
depth leave alone. Noise has ratios too: where it is dim, means of ever more pixels decide.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from perception.masks import Gray, Image, Mask, cleaned, global_mask

SPECKLE = 3
"""Side of the squares whose median replaces a pixel, px, once for the places of edges and twice for
colours: speckles go, edges stay."""

CLEARLY, CLEARLY_DIM = 1.2, 1.4
"""A channel is clearly above others from these ratios on, the second one in means over dim pixels,
whose noise is cut off at black. Mirror images on a glossy wall leave blue a ratio of 1.8, and in
images for screens (gamma 2.2) of 1.3."""

RED_CLEARLY = 1.6
"""The same for red at least: the root of the ratio that red has in the picture, where that is more.
It is about 6 in even light, in images for screens about 2.3, and 20 where red walls light each
other; then they light yellow, too, whose own is up to 2.5 and not 1.2."""

SAMPLED = 8
"""Every so many pixels, red's own ratio is measured."""

EVEN, LEAST = 3, 5.0
"""... and by so many grey levels more, in means of squares of `EVEN` pixels a side: five standard
deviations of the noise of a poor finger. That of a mean falls with the root of the number."""

ROUNDING = 1.5
"""... but by no less, for in the dark all pixels of a colour are rounded alike."""

SATURATED = 250
"""Grey level from which on a channel may be cut off."""

DIM = 20
"""Grey level; in what is darker, the chamber's colours may differ by less than `LEAST`."""

WIDER = (9, 27)
"""Sides of the squares, px, over which dim pixels without a colour are averaged."""

GAP = 14.0
"""Where blue and yellow are no farther apart, px, with dim pixels between, they meet halfway."""

LEAST_DIM = 2e-4
"""Of the image; fewer dim pixels do not matter."""

OPENING = 3
"""Side of the square of paper A's "dilatation corrosion", px; read as open, then close."""


@dataclass(frozen=True)
class Colors:
    """Pixels by their colour, and the brightest and the least channel of their surroundings."""

    red: Mask
    blue: Mask
    yellow: Mask
    value: Gray
    grey: Gray


def despeckled(image: Image) -> Image:
    """An image without speckles, such as hot pixels and sparks of light."""
    return cv2.medianBlur(image, SPECKLE)


def colors_of(image: Image) -> Colors:
    """The colours of an image, cleaned of specks and small holes."""
    clear = despeckled(despeckled(image))
    channels = _channels(cv2.blur(clear, (EVEN, EVEN)))
    value = cv2.max(cv2.max(*channels[:2]), channels[2])
    grey = cv2.min(cv2.min(*channels[:2]), channels[2])
    red_clearly, red_level = _own_red(channels)
    found = _told_apart(channels, np.full_like(value, LEAST), CLEARLY, red_clearly)
    # Highlights on red have a lower ratio, and are brighter.
    others = cv2.addWeighted(cv2.max(*channels[1:]), RED_CLEARLY, value, 0, LEAST)
    bright = cv2.bitwise_and(
        cv2.compare(channels[0], others, cv2.CMP_GT),
        global_mask(channels[0], red_level),
    )
    found[0] = cv2.max(found[0], bright)
    dim = cv2.subtract(not_above(value, DIM), cv2.max(cv2.max(*found[:2]), found[2]))
    # Between two bright colours, a line of dim pixels is a mixture of both.
    broad = cv2.morphologyEx(dim, cv2.MORPH_OPEN, np.ones((OPENING, OPENING), np.uint8))
    if cv2.countNonZero(broad) <= LEAST_DIM * broad.size:
        red, blue, yellow = (cleaned(mask, OPENING) for mask in found)
        return Colors(red, blue, yellow, value, grey)
    left, upper, wide, high = cv2.boundingRect(broad)
    box = np.s_[upper : upper + high, left : left + wide]
    _add_dim(clear[box], dim[box], [mask[box] for mask in found], red_clearly)
    red, blue, yellow = (cleaned(mask, OPENING) for mask in found)
    _close_gap(dim[box], blue[box], yellow[box])
    return Colors(red, blue, yellow, value, grey)


def not_above(value: Gray, level: float) -> Mask:
    """Pixels that are no brighter than a level."""
    return cv2.bitwise_not(global_mask(value, level))


def _channels(image: np.ndarray) -> list[np.ndarray]:
    """Red, green and blue; OpenCV's `split` takes three times as long."""
    return [cv2.extractChannel(image, number) for number in range(3)]


def _own_red(channels: list[np.ndarray]) -> tuple[float, float]:
    """The ratio from which on red is clearly above others in this picture, and its level there."""
    red, green, blue = (one[::SAMPLED, ::SAMPLED].astype(float) for one in channels)
    ratio = red / (np.maximum(green, blue) + 1)
    own = (ratio > RED_CLEARLY) & (red > DIM) & (red < SATURATED)
    if not own.any():
        return RED_CLEARLY, SATURATED
    return max(float(np.sqrt(np.median(ratio[own]))), RED_CLEARLY), float(np.median(red[own]))


def _told_apart(
    channels: list[np.ndarray], least: np.ndarray, clearly: float, red_clearly: float
) -> list[Mask]:
    """Red, blue and yellow pixels, by the least ratios of channels and difference beside them."""
    red, green, blue = channels

    def above(channel: np.ndarray, others: np.ndarray, ratio: float) -> Mask:
        return cv2.compare(channel, cv2.addWeighted(others, ratio, least, 1.0, 0.0), cv2.CMP_GT)

    reds = above(red, cv2.max(green, blue), red_clearly)
    yellows = above(cv2.min(red, green), blue, clearly)
    both = cv2.bitwise_and(reds, yellows)
    if cv2.countNonZero(both):
        both = np.nonzero(both)
        # Yellow is orange where red walls light it. Green is nearer to red in it, by ratio, and to
        # blue in red, whatever the response curve.
        r, g, b, spare = (one[both].astype(np.float32) for one in (*channels, least))
        orange = g * g > r * (b + spare / 2)
        reds[both], yellows[both] = np.where(orange, 0, 255), np.where(orange, 255, 0)
    return [reds, above(blue, cv2.max(red, green), clearly), yellows]


def _add_dim(image: Image, dim: Mask, masks: list[Mask], red_clearly: float) -> None:
    """Give dim pixels to the masks of colours that means over other dim pixels show.

    Args:
        image: without speckles.
        dim: pixels without a colour; those that get one are taken out.
        masks: of red, blue and yellow, which are added to.
        red_clearly: the least ratio of red.
    """
    exact = image.astype(np.float32)
    for side in WIDER:
        counted = dim.astype(np.float32) / 255
        number, total = (
            cv2.boxFilter(one, -1, (side, side), normalize=False, borderType=cv2.BORDER_CONSTANT)
            for one in (counted, exact * counted[..., None])
        )
        number = np.maximum(number, EVEN**2)
        least = np.maximum(LEAST * EVEN / np.sqrt(number), ROUNDING)
        means = _channels(total / number[..., None])
        for mask, found in zip(
            masks, _told_apart(means, least, CLEARLY_DIM, red_clearly), strict=True
        ):
            mask |= found & dim
            dim &= ~found


def _close_gap(dim: Mask, blue: Mask, yellow: Mask) -> None:
    """Share out dim pixels between blue and yellow, where means hold both: to the nearer one."""
    if cv2.countNonZero(blue) and cv2.countNonZero(yellow):
        from_blue, from_yellow = (
            cv2.distanceTransform(cv2.bitwise_not(mask), cv2.DIST_L2, 3) for mask in (blue, yellow)
        )
        between = (dim > 0) & (from_blue + from_yellow <= GAP)
        blue[between & (from_blue < from_yellow)] = 255
        yellow[between & (from_blue >= from_yellow)] = 255
