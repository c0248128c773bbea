"""Pinching with the straight distal pad: when it holds and gives way, and the stability map."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np

from studies.models.finger import Finger, spring_of
from studies.models.grasp.closing import STEPS, Path
from studies.models.grasp.transfer import transfers

APPROACH = 24
"""Steps in which a pinch is approached; the others load it."""

MOST_LOAD = 5.0
"""A pinch that should hold is loaded until the motor leads by this, rad."""

LEAST_LOAD = 1e-3
"""Every pinch is loaded until the motor leads by this, rad, for some hold nothing at all."""

AT_STOP = 1e-7
"""A joint nearer to its stop than this rests on it, rad."""


@dataclass(frozen=True)
class Pinch:
    """A contact at k₂ on the straight distal pad.

    Attributes:
        pip: PIP flexion there, rad.
        place: k₂, mm.
        ratio: φ₂/φ₁.
        threshold: k₂/(k₂ + l): the pinch holds at any motor moment if the ratio is no larger.
        limit: T_a at which it gives way, N mm; infinite where it holds.
        crank: φ there, rad.
    """

    pip: float
    place: float
    ratio: float
    threshold: float
    limit: float
    crank: float

    @property
    def holds(self) -> bool:
        """Whether it holds at any motor moment."""
        return math.isinf(self.limit)


@dataclass(frozen=True)
class Bracket:
    """What loading a pinch showed.

    Attributes:
        low: largest T_a at which the distal pad was still straight, N mm.
        high: T_a of the next step, had it stayed straight; infinite where it never gave way.
        agrees: whether the formula's limit lies between them (or it held as it should); ``None``
            where the motor could not load it that far.
        held: number of states before it gave way. Then the distal pad turns about the contact or,
            where that runs off the pad, snaps to an equilibrium far away, if there is one.
    """

    low: float
    high: float
    agrees: bool | None
    held: int


def predict(finger: Finger, contacts: Sequence[tuple[float, float]]) -> list[Pinch]:
    """The limits of pinches in closed form, by virtual work (an argument of this project).

    With T_a φ₁ = f₂ (k₂ + l) and T_a φ₂ = f₂ k₂ + t_s − λ at DIP = 0, the stop's λ is positive
    up to T_a = t_s / (φ₂ − φ₁ k₂ / (k₂ + l)), t_s = k γ_p γ'(0).

    Args:
        finger: one design.
        contacts: PIP flexion (rad) and k₂ (mm) of each.
    """
    joints = np.array([[pip, 0.0] for pip, _ in contacts])
    found = jax.tree.map(np.asarray, transfers(finger, jnp.asarray(joints)))
    spring, middle = spring_of(finger), float(finger.body.intermediate)
    wound = float(spring.stiffness) * float(spring.preload)
    pinches = []
    for (pip, place), crank, (first, second), slope in zip(
        contacts, found.crank.tolist(), found.ratios.tolist(), found.slope.tolist(), strict=True
    ):
        threshold = place / (place + middle)
        surplus = second - first * threshold
        limit = wound * slope / surplus if surplus > 0 else math.inf
        pinches.append(Pinch(pip, place, second / first, threshold, limit, crank))
    return pinches


def loading(finger: Finger, pinch: Pinch) -> np.ndarray:
    """Motor angles that approach a pinch and load it to 1.3 times its limit, rad."""
    servo = float(spring_of(finger).servo)
    lead = MOST_LOAD if pinch.holds else min(1.3 * pinch.limit / servo, 4 * math.pi)
    lead = max(lead, LEAST_LOAD)
    up = np.linspace(0, pinch.crank, APPROACH, endpoint=False)
    return np.concatenate([up, pinch.crank + np.linspace(0, lead, STEPS - APPROACH)])


def bracket(finger: Finger, pinch: Pinch, path: Path) -> Bracket:
    """Between which motor moments the pinch gave way on its loading."""
    servo, loads = float(spring_of(finger).servo), np.arange(APPROACH, STEPS)
    straight = loads[path.ok[loads] & (path.joints[loads, 1] < AT_STOP)]
    held = int(straight[-1]) + 1 if straight.size else APPROACH
    low = float(path.motor[held - 1]) if straight.size else 0.0
    if held == STEPS:
        agrees = pinch.holds or (None if low < pinch.limit else False)
        return Bracket(low, math.inf, agrees, held)
    high = servo * float(path.commands[held] - pinch.crank)
    return Bracket(low, high, bool(low * (1 - 1e-9) <= pinch.limit <= high), held)


def ratio_map(finger: Finger, angles: np.ndarray) -> np.ndarray:
    """φ₁ and φ₂ over the square of PIP (rows) and DIP (columns) angles, shape (n, n, 2).

    NaN where the linkage does not assemble.
    """
    square = np.stack(np.meshgrid(angles, angles, indexing="ij"), axis=-1).reshape(-1, 2)
    found = jax.tree.map(np.asarray, transfers(finger, jnp.asarray(square)))
    ratios = np.where(found.reach[:, None] > 0, found.ratios, np.nan)
    return ratios.reshape(len(angles), len(angles), 2)


def least_place(ratio: np.ndarray, dip: np.ndarray, length: float) -> np.ndarray:
    """The k₂ beyond which the intermediate phalanx is pushed on the object, f₁ > 0, mm.

    From φ₂/φ₁ < k₂ / (k₂ + l cos q₂) (Birglen & Gosselin 2004 for two phalanges).

    Args:
        ratio: φ₂/φ₁.
        dip: q₂, rad; broadcasts with the ratio.
        length: l, PIP axis to DIP axis, mm.
    """
    return length * np.cos(dip) * ratio / (1 - ratio)
