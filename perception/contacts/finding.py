"""Contacts in a view of a pad: candidates are fitted, and what of them is sure is claimed."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
from jaxtyping import Float, UInt8

from perception.contacts.change import Change
from perception.contacts.contact import Contact
from perception.contacts.detection import find_candidates
from perception.contacts.fitting import Circle, Circles, Fit, fit, start_at
from perception.contacts.lamps import Lamps
from perception.matching import View
from perception.places import Sight

SIZES = 0.75, 1.0, 1.4
"""A candidate is fitted from a circle so many times as large as itself, whichever is best."""

MOST = 0.6
"""Of the change about a contact, its model explains at least so much."""

APART = 0.5

KNOWN = 0.25
PIXEL = 12**-0.5
STRONG = 8.0
"""A contact is so far above noise at least."""


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
        if any(_distance(circle, one.circle) < one.circle[2] + APART for one in found):
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
    contacts = (_contact(one, view, change) for one in _without_parts(again))
    return [one for one in contacts if one.deviations[2] < KNOWN * one.diameter]


def circles_of(fits: Iterable[Fit]) -> Circles:
    """Their circles, one a row."""
    return np.array([one.circle for one in fits]).reshape(-1, 3)


def is_contact(own: Fit) -> bool:
    """Whether a fit is surely one of something that is pressed in."""
    return own.explained > MOST and own.strength > STRONG and abs(own.light - 1) < .7


def _best(
    change: Change, starts: Iterable[np.ndarray], others: Circles, lamps: Lamps
) -> Fit | None:
    """The fit from the best of several starts, if it is a contact."""
    fits = (fit(change, start, others, lamps, steps=0) for start in starts)
    first = max((one for one in fits if one), key=lambda one: one.explained, default=None)
    own = first and fit(change, first.parameters, others, lamps)
    return own if own and is_contact(own) else None


def _without_parts(fits: list[Fit]) -> list[Fit]:
    """Without those that overlap a stronger one, the strongest first."""
    kept: list[Fit] = []
    for own in sorted(fits, key=lambda one: -one.strength):
        if all(_distance(own.circle, one.circle) > own.circle[2] + one.circle[2] + APART for one in kept):
            kept.append(own)
    return kept


def _distance(one: Circle, other: Circle) -> float:
    return math.hypot(*(one[:2] - other[:2]))


def _contact(own: Fit, view: View, change: Change) -> Contact:
    along, across, radius = own.circle.tolist()
    scaling = np.array([1, 1, 2 * radius])
    covariance = own.covariance[:3, :3] * np.outer(scaling, scaling)
    pixels = change.pixels_at(along, across)
    covariance = covariance + np.diag([*pixels**2, 4 * pixels.prod()]) * PIXEL**2
    shares = np.outer([1 - along / change.length, along / change.length], [0.5 - across / change.width, 0.5 + across / change.width]).ravel()
    covariance[:2, :2] += np.diag(pixels**2) * np.mean(np.trace(view.covariance, axis1=1, axis2=2)) / 2 * np.sum(shares**2)
    c = Contact(
        view.pad,
        (view.path,),
        own.circle[:2],
        2 * radius,
        covariance,
        own.circle,
        math.exp(own.parameters[3]),
        own.strength,
    )
    object.__setattr__(c,"info","ex %.2f sc %.1f light %.2f beta %.2f"%(own.explained,own.scale,own.light,own.parameters[4]))
    return c
