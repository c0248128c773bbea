"""Contacts in a view of a pad: candidates are fitted, and what of them is sure is claimed."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
from jaxtyping import Float, UInt8

from perception.contacts.change import Change
from perception.contacts.contact import Contact
from perception.contacts.detection import find_candidates
from perception.contacts.fitting import (
    DEPTH_INDEX,
    HARMONICS,
    Circle,
    Circles,
    Fit,
    Parameters,
    fit,
    start_at,
)
from perception.contacts.lamps import Lamps
from perception.matching import View
from perception.places import Sight

SIZES = 0.75, 1.0, 1.4
"""A candidate is fitted from a circle so many times as large as itself, whichever is best."""

CLEAR, FAINT = 0.6, 0.3
"""Part of the change that a contact explains, where noise is not the rest, and where it is."""

STRONG = 8.0
"""A contact is so far above noise at least."""

ODD = 0.7
"""The light of a contact is off by no more from what is expected."""

BESIDE, GAP = 0.4, 0.3
"""mm: candidates nearer to a contact's edge are its parts; contacts are farther apart."""

CORRELATED = 1.6
"""Deviations of a fit are so much larger than independent noise of samples has them: neighbors
share it."""

DEEP = 0.17
"""Deviation of a depth's logarithm by what the model of the light lacks."""

PLACED, SPREAD = 0.1, 0.7
"""Pixels by which a center and a diameter are off beside that."""

MISFIT = 0.02
"""Part of the radius by which they are off for each time the noise that a fit leaves too much."""


def find_contacts(
    picture: UInt8[np.ndarray, "along across 3"],
    reference: UInt8[np.ndarray, "along across 3"],
    view: View,
    sight: Sight,
    lamps: Lamps,
    response: Float[np.ndarray, "256"] | None = None,
) -> list[Contact]:
    """Contacts on a pad, the strongest first.

    Args:
        picture: the pad unwarped (`perception.unwarp`).
        reference: the same view of it untouched.
        view: the view.
        sight: how it shows the pad (`perception.places.find_sight`).
        lamps: that light the pad; none where the light is even.
        response: of the camera, as `perception.Lens` has it.

    Returns:
        What is surely pressed in. What cannot be seen is not claimed: where a view is flat, noise
        is large or light is even, contacts may be missing.

    Raises:
        UserError: one is no image of three channels of 8 bits, or they differ in size.
    """
    change = Change.of(picture, reference, sight, response)
    found: list[Fit] = []
    for candidate in find_candidates(change, lamps):
        circle = np.array(candidate[:3])
        if any(_distance(circle, one.circle) < one.circle[2] + BESIDE for one in found):
            continue
        starts = [start_at(circle * [1, 1, factor]) for factor in SIZES]
        own = _best(change, starts, circles_of(found), lamps)
        if own is not None:
            found = _without_parts([*found, own])
    again = []
    for number, one in enumerate(found):
        others = circles_of(found[:number] + found[number + 1 :])
        own = fit(change, one.parameters, others, lamps) if len(others) else one
        again.append(own if own is not None and is_contact(own) else one)
    found = _without_parts(again)
    contacts = []
    for number, one in enumerate(found):
        others = circles_of(found[:number] + found[number + 1 :])
        free = np.append(one.parameters, np.zeros(len(HARMONICS)))
        traced = fit(change, free, others, lamps) or one
        contacts.append(_contact(one, traced, view, change))
    return contacts


def circles_of(fits: Iterable[Fit]) -> Circles:
    """Their circles, one a row."""
    return np.array([one.circle for one in fits]).reshape(-1, 3)


def is_contact(own: Fit) -> bool:
    """Whether a fit is surely one of something that is pressed in."""
    needed = FAINT + (CLEAR - FAINT) * min(1.0, 2 * (own.scale - 1))
    return own.explained > needed and own.strength > STRONG and abs(own.light - 1) < ODD


def _best(
    change: Change, starts: Iterable[Parameters], others: Circles, lamps: Lamps
) -> Fit | None:
    """The fit from the best of several starts, if it is a contact."""
    fits = (fit(change, start, others, lamps, rounds=0) for start in starts)
    first = max((one for one in fits if one), key=lambda one: one.explained, default=None)
    own = first and fit(change, first.parameters, others, lamps)
    return own if own and is_contact(own) else None


def _without_parts(fits: list[Fit]) -> list[Fit]:
    """Without those that overlap a stronger one, the strongest first."""
    kept: list[Fit] = []
    for own in sorted(fits, key=lambda one: -one.strength):
        reach = own.circle[2] + GAP
        if all(_distance(own.circle, one.circle) > reach + one.circle[2] for one in kept):
            kept.append(own)
    return kept


def _distance(one: Circle, other: Circle) -> float:
    return math.hypot(*(one[:2] - other[:2]))


def _contact(own: Fit, traced: Fit, view: View, change: Change) -> Contact:
    along, across, radius = own.circle.tolist()
    scaling = np.array([1, 1, 2 * radius])
    by_depth = own.covariance[:3, DEPTH_INDEX] / own.covariance[DEPTH_INDEX, DEPTH_INDEX] * scaling
    pixels = change.pixels_at(along, across)
    off = [*PLACED * pixels, SPREAD * math.sqrt(pixels.prod())]
    covariance = (
        CORRELATED**2 * own.covariance[:3, :3] * np.outer(scaling, scaling)
        + DEEP**2 * np.outer(by_depth, by_depth)
        + np.diag(np.square(off) + (MISFIT * (own.scale - 1) * radius) ** 2)
    )
    depth = math.exp(own.parameters[DEPTH_INDEX])
    return Contact(
        view.pad,
        (view.path,),
        own.circle[:2],
        2 * radius,
        covariance,
        traced.outline,
        depth,
        own.strength,
    )
