"""Contacts in a view of a pad: candidates fitted one after the other, and what of them is claimed."""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float, UInt8

from perception.contacts.change import Change
from perception.contacts.contact import Contact
from perception.contacts.detection import find_candidates
from perception.contacts.fitting import EVEN, Circles, Fit, Toward, fit, start_at
from perception.matching import View
from perception.places import Sight

MOST = 10
"""No more candidates are fitted."""

LARGER = 1.8
"""A candidate is fitted again from a circle so many times as large, where it may be a part of one."""

WELL = 0.9
"""Not where so much of the change is explained."""

CLEAR, FAINT = 0.6, 0.3
"""Part of the change that the model must explain, where noise is not, and where it is all else."""

STRONG = 8.0
"""A contact is so far above noise at least."""

ODD = 0.35
"""λ is off by less under even light."""

BESIDE = 0.4
"""mm: nearer to a contact's edge candidates are its parts."""


def find_contacts(
    picture: UInt8[np.ndarray, "along across 3"],
    reference: UInt8[np.ndarray, "along across 3"],
    view: View,
    sight: Sight,
    toward: Toward,
    response: Float[np.ndarray, "256"] | None = None,
) -> list[Contact]:
    """Contacts on a pad, the strongest first."""
    change = Change.of(picture, reference, sight, response)
    found: list[Fit] = []
    for candidate in find_candidates(change, toward)[:MOST]:
        circle = np.array(candidate[:3])
        if any(_inside(circle, one.circle, BESIDE) for one in found):
            continue
        own = _best(change, circle, circles_of(found), toward)
        if own is None:
            continue
        over = [one for one in found if _inside(own.circle, one.circle) or _inside(one.circle, own.circle)]
        if all(one.strength < own.strength for one in over):
            found = [one for one in found if one not in over] + [own]
    contacts = []
    for number, one in enumerate(found):
        others = circles_of(found[:number] + found[number + 1 :])
        again = fit(change, one.parameters, others, toward) if len(others) else one
        contacts.append(_contact(again if again and is_contact(again, toward) else one, view, change))
    return sorted(contacts, key=lambda one: -one.strength)


def circles_of(fits: list[Fit]) -> Circles:
    return np.array([one.circle for one in fits]).reshape(-1, 3)


def _best(change, circle, others, toward) -> Fit | None:
    best = None
    for factor in (1.0, LARGER):
        own = fit(change, start_at(circle * [1, 1, factor]), others, toward)
        if own is not None and is_contact(own, toward) and (best is None or own.strength > best.strength):
            best = own
        if best is not None and best.explained > WELL:
            break
    return best


def is_contact(own: Fit, toward: Toward) -> bool:
    needed = FAINT + (CLEAR - FAINT) * min(1.0, 2 * (own.scale - 1))
    if own.explained < needed or own.strength < STRONG:
        return False
    first = own.factors[:, 0]
    if not toward.any():
        return abs(float(first.mean()) - EVEN) < ODD
    return bool(first.sum() > 0 and np.sum(first > 0) > 1)


def _inside(inner, outer, margin: float = 0.0) -> bool:
    return math.hypot(*(inner[:2] - outer[:2])) < outer[2] + margin


def _contact(own: Fit, view: View, change: Change) -> Contact:
    scaling = np.array([1, 1, 2 * own.circle[2]])
    covariance = own.covariance[:3, :3] * np.outer(scaling, scaling)
    angles = np.arange(72) * (2 * np.pi / 72)
    outline = own.circle[:2] + own.circle[2] * np.stack([np.cos(angles), np.sin(angles)], -1)
    c = Contact(view.pad, (view.path,), own.circle[:2], 2 * own.circle[2], covariance, outline, math.exp(own.parameters[3]), own.strength)
    object.__setattr__(c, "fit", own)
    return c
