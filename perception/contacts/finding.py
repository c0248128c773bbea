"""Contacts in a view of a pad: candidates are fitted, and what of them is sure is claimed."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, UInt8

from perception.contacts.change import FLATTEST, PIXEL, Change
from perception.contacts.contact import Contact
from perception.contacts.detection import find_candidates
from perception.contacts.fitting import (
    APART,
    COMPRESSED_SPREADS,
    FINE_SPREADS,
    LEAST,
    MOST,
    SPREAD,
    Circle,
    Circles,
    Fit,
    fit,
    mean_of,
    start_at,
)
from perception.contacts.lamps import Lamps
from perception.matching import View
from perception.places import Sight

SIZES = 0.75, 1.0, 1.4
"""A candidate is fitted from a circle so many times as large as itself, whichever is best: scales
of candidates are this far from each other."""

EXPLAINED = 0.6
"""A contact explains more than this part of the change about it that is no noise."""

STRONG = 12.0
"""A contact is so many deviations of noise strong: five, if in the blocks of a compressed picture
one sample in six has noise of its own."""

ODD = 5.0
"""Its light is less than so many times what is expected, and more than that part of it."""

KNOWN = 0.15
"""Part of its diameter by which that may be uncertain: else it is no contact that is known."""


def find_contacts(
    picture: UInt8[np.ndarray, "_ _ 3"],
    reference: UInt8[np.ndarray, "_ _ 3"],
    view: View,
    sight: Sight,
    lamps: Lamps,
    response: Float[np.ndarray, "256"] | None = None,
    *,
    fine: bool = False,
) -> list[Contact]:
    """Contacts on a pad, the strongest first.

    Args:
        picture: the pad unwarped (`perception.unwarp`).
        reference: the same view of it untouched.
        view: the view.
        sight: how it shows the pad (`perception.places.find_sight`).
        lamps: that light the pad; none where the light is even.
        response: of the camera, as `perception.Lens` has it.
        fine: whether the frame from which the pad was unwarped has colors that no compression has
            made coarser (`has_fine_colors`).

    Returns:
        What is surely pressed in, and wholly on the pad. What cannot be seen is not claimed: where
        a view is flat, noise is large or light is even, contacts may be missing; and in a view
        whose corners are off, so that the dark beside the pad is seen as a part of it.

    Raises:
        UserError: one is no image of three channels of 8 bits, or they differ in size.

    Example:
        >>> from perception.quality import Quality
        >>> view = View(
        ...     "tip",
        ...     "direct",
        ...     0,
        ...     Quality.COMPLETE,
        ...     (True, True),
        ...     *np.zeros((2, 4, 2)),
        ...     *np.zeros((2, 4, 2, 2)),
        ...     2500.0,
        ... )
        >>> above = Sight(np.zeros((13, 13, 2)), np.full((13, 13, 2), 0.1))
        >>> untouched = np.full((240, 240, 3), 150, np.uint8)
        >>> find_contacts(untouched, untouched, view, above, [])
        []
    """
    lamps = lamps if any(lamps) else []
    change = Change.of(picture, reference, sight, response, colored=bool(lamps))
    spreads = (FINE_SPREADS if fine else COMPRESSED_SPREADS) if lamps else (SPREAD,)
    if change.is_misplaced():
        return []
    found: list[Fit] = []
    for candidate in find_candidates(change, lamps):
        circle = np.array(candidate[:3])
        if not _is_within(circle * [1, 1, 0.5], change):
            continue
        if any(_distance(circle, one.circle) < one.circle[2] + APART for one in found):
            continue
        own = _fit_best(change, circle, _circles(found), lamps, spreads[0])
        if own is not None and is_contact(own):
            found = _without_parts([*found, own])
    # The first fit was about what the candidate was like, without what was found later.
    found = [_fit_again(change, one, found, lamps, spreads) for one in found]
    whole = [one for one in _without_parts(found) if _is_within(one.circle, change)]
    contacts = [_contact(one, view, change) for one in whole]
    return [one for one in contacts if one.deviations[2] < KNOWN * one.diameter]


def is_contact(own: Fit) -> bool:
    """Whether a fit is surely one of something that is pressed in."""
    clear = own.explained > EXPLAINED and own.strength > STRONG and 1 / ODD < own.light < ODD
    # What is as small, large, flat or deep as can be was not found within.
    size = own.parameters[2:4]
    return clear and bool(np.all((size > LEAST[2:4]) & (size < MOST[2:4])))


def _fit_best(
    change: Change, circle: Circle, others: Circles, lamps: Lamps, spread: float
) -> Fit | None:
    """The fit from the best of several sizes."""
    starts = (start_at(circle * [1, 1, factor]) for factor in SIZES)
    fits = (fit(change, start, others, lamps, spread, steps=0) for start in starts)
    best = max((one for one in fits if one), key=lambda one: one.explained, default=None)
    # In the light of lamps the shading is nearly right from the start.
    if best is None or (any(lamps) and best.strength < STRONG / 2):
        return None
    return fit(change, best.parameters, others, lamps, spread)


def _fit_again(
    change: Change, one: Fit, found: list[Fit], lamps: Lamps, spreads: Sequence[float]
) -> Fit:
    """The mean of the fits of all spreads that are contacts; the first fit if none is."""
    others = _circles([other for other in found if other is not one])
    fits = (fit(change, one.parameters, others, lamps, each) for each in spreads)
    sure = [own for own in fits if own is not None and is_contact(own)]
    return mean_of(sure) if sure else one


def _without_parts(fits: list[Fit]) -> list[Fit]:
    """Without those that overlap a stronger one, the strongest first."""
    kept: list[Fit] = []
    for own in sorted(fits, key=lambda one: -one.strength):
        reach = own.circle[2] + APART
        if all(_distance(own.circle, one.circle) > reach + one.circle[2] for one in kept):
            kept.append(own)
    return kept


def _circles(fits: list[Fit]) -> Circles:
    return np.array([one.circle for one in fits]).reshape(-1, 3)


def _is_within(circle: Circle, change: Change) -> bool:
    """Whether it is wholly on the pad, and nowhere seen too flat."""
    along, across, radius = circle.tolist()
    on = radius < along < change.length - radius and abs(across) < change.width / 2 - radius
    ways = (radius, 0), (-radius, 0), (0, radius), (0, -radius)
    sizes = np.array([change.pixels_at(along + u, across + v) for u, v in ways])
    return on and bool(np.all(sizes.max(axis=1) < FLATTEST * sizes.min(axis=1)))


def _distance(one: Circle, other: Circle) -> float:
    return math.hypot(*(one[:2] - other[:2]))


def _contact(own: Fit, view: View, change: Change) -> Contact:
    """With what a pixel and the view's corners leave open beside the fit."""
    along, across, radius = own.circle.tolist()
    scaling = np.array([1, 1, 2 * radius])
    pixels = change.pixels_at(along, across)
    sizes = np.array([*pixels, 2 * math.sqrt(pixels.prod())])
    ends, sides = along / change.length, across / change.width + 0.5
    shares = np.outer([1 - ends, ends], [1 - sides, sides])
    corners = np.trace(view.covariance, axis1=1, axis2=2).mean() / 2 * np.sum(shares**2)
    beside = PIXEL**2 + np.array([corners, corners, 0])
    covariance = own.covariance[:3, :3] * np.outer(scaling, scaling) + np.diag(beside * sizes**2)
    depth = math.exp(own.parameters[3])
    path = (view.path,)
    return Contact(view.pad, path, own.circle[:2], 2 * radius, covariance, depth, own.strength)
