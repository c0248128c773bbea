"""Contacts in a view of a pad: candidates fitted one after the other, and what of them is claimed."""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float, UInt8

from perception.contacts.change import Change
from perception.contacts.contact import Contact
from perception.contacts.detection import find_candidates
from perception.contacts.fitting import HARMONICS, Circles, Fit, fit, start_at
from perception.contacts.lamps import Lamps
from perception.matching import View
from perception.places import Sight

MOST = 40
"""No more candidates are fitted."""

SIZES = 0.75, 1.0, 1.4
"""A candidate is fitted from a circle so many times as large as itself, whichever is best."""

CLEAR, FAINT = 0.6, 0.3
"""Part of the change that the model must explain, where noise is not, and where it is all else."""

STRONG = 8.0
"""A contact is so far above noise at least."""

ODD = 0.7
"""The light of a contact is off by no more from what is expected."""

BESIDE = 0.4
"""mm: nearer to a contact's edge candidates are its parts."""


def find_contacts(
    picture: UInt8[np.ndarray, "along across 3"],
    reference: UInt8[np.ndarray, "along across 3"],
    view: View,
    sight: Sight,
    lamps: Lamps,
    response: Float[np.ndarray, "256"] | None = None,
) -> list[Contact]:
    """Contacts on a pad, the strongest first."""
    change = Change.of(picture, reference, sight, response)
    found: list[Fit] = []
    for candidate in find_candidates(change, lamps)[:MOST]:
        circle = np.array(candidate[:3])
        if any(_inside(circle, one.circle, BESIDE) for one in found):
            continue
        own = _best(change, circle, circles_of(found), lamps)
        if own is None:
            continue
        over = [one for one in found if _overlap(own.circle, one.circle)]
        if all(one.strength < own.strength for one in over):
            found = [one for one in found if one not in over] + [own]
    contacts = []
    for number, one in enumerate(found):
        others = circles_of(found[:number] + found[number + 1 :])
        again = fit(change, one.parameters, others, lamps) if len(others) else one
        contacts.append(_contact(again if again and is_contact(again) else one, view, change, others, lamps))
    return sorted(contacts, key=lambda one: -one.strength)


def circles_of(fits: list[Fit]) -> Circles:
    return np.array([one.circle for one in fits]).reshape(-1, 3)


def _best(change, circle, others, lamps) -> Fit | None:
    starts = (fit(change, start_at(circle * [1, 1, factor]), others, lamps, 0) for factor in SIZES)
    best = max((one for one in starts if one), key=lambda one: one.explained, default=None)
    own = best and fit(change, best.parameters, others, lamps)
    return own if own and is_contact(own) else None


def is_contact(own: Fit) -> bool:
    needed = FAINT + (CLEAR - FAINT) * min(1.0, 2 * (own.scale - 1))
    if own.explained < needed or own.strength < STRONG:
        return False
    return abs(own.light - 1) < ODD


def _inside(inner, outer, margin: float = 0.0) -> bool:
    return math.hypot(*(inner[:2] - outer[:2])) < outer[2] + margin


def _overlap(one, other) -> bool:
    return math.hypot(*(one[:2] - other[:2])) < one[2] + other[2] + 0.3


def _contact(own: Fit, view: View, change: Change, others, lamps) -> Contact:
    scaling = np.array([1, 1, 2 * own.circle[2]])
    covariance = own.covariance[:3, :3] * np.outer(scaling, scaling)
    free = np.append(own.parameters, np.zeros(len(HARMONICS)))
    traced = fit(change, free, others, lamps) or own
    outline = traced.outline
    c = Contact(view.pad, (view.path,), own.circle[:2], 2 * own.circle[2], covariance, outline, math.exp(own.parameters[3]), own.strength)
    object.__setattr__(c, "fit", own);object.__setattr__(c, "traced", traced)
    return c
