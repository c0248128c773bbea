"""How many assembled fingers see everything: Monte Carlo, and each error by itself."""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from designopt.batching import map_blocks
from designopt.programs import QuickJit
from optics.visibility.coverage import find_coverage
from studies.models.finger import Finger
from studies.models.mirror_design.errors import deviations, perturb, sample_errors
from studies.models.mirror_design.postures import ROUNDING, crossed, whole_degrees
from studies.models.mirror_design.spec import ToleranceSpec

BLOCK = 50
"""Draws of one call: one compiled program serves any number of draws."""

STEPS = np.linspace(-5.0, 5.0, 101)
"""Sizes of a single error, in its standard deviations."""


class Yield(NamedTuple):
    """Part of all draws in which every pad is seen in every posture.

    Attributes:
        value: the part.
        low: lower limit of its 95 % confidence interval.
        high: upper limit.
        draws: how many.
        by_pose: part of the draws in which each pad is wholly seen, shape (poses, pads): degree by
            degree, both joints bent alike.
    """

    value: float
    low: float
    high: float
    draws: int
    by_pose: Float[np.ndarray, "poses pads"]


def groups(mirrors: int) -> dict[str, slice]:
    """Entries of the errors that share a tolerance, by its name."""
    found = {"camera position": slice(0, 2), "camera tilt": slice(2, 3)}
    if mirrors:
        found["mirror tilt"] = slice(3, 3 + mirrors)
        found["mirror offset"] = slice(3 + mirrors, 3 + 2 * mirrors)
    return found


def share_of(coverage: Float[np.ndarray, "draws poses pads"]) -> Yield:
    """The yield of draws; a pad is seen if 1 − `ROUNDING` of it is.

    The interval is Wilson's (E. B. Wilson, J. Am. Stat. Assoc. 22 (1927) 209).
    """
    whole = coverage >= 1 - ROUNDING
    good, draws = int(np.sum(np.all(whole, axis=(1, 2)))), len(whole)
    import scipy.stats  # takes a second, and most commands find no yield

    low, high = scipy.stats.binomtest(good, draws).proportion_ci(method="wilson")
    # Rounding may leave a share of 0 or 1 outside.
    value = good / draws
    row = np.mean(whole, axis=0)[: whole.shape[1] // 2]
    return Yield(value, min(low, value), max(high, value), draws, row)


def coverages(
    finger: Finger, errors: Float[np.ndarray, "draws errors"]
) -> Float[np.ndarray, "draws poses pads"]:
    """Coverage of fingers assembled with errors (in the order of `errors.error_names`).

    Degree by degree with both joints bent alike, then each degree of PIP with another one of DIP:
    all pairs for all draws would take a hundred times as long.
    """
    poses = jnp.deg2rad(jnp.asarray(postures(finger)))
    return map_blocks(lambda block: _coverages(finger, block, poses), BLOCK, errors)


def postures(finger: Finger) -> Float[np.ndarray, "poses 2"]:
    """PIP and DIP of the postures in which fingers with errors are looked at, degrees."""
    whole = whole_degrees(finger.body.range_deg)
    alike = np.stack([whole, whole], axis=-1)
    pairs = np.stack([whole, crossed(whole)], axis=-1)
    return np.minimum(np.concatenate([alike, pairs]), finger.body.ranges_deg)


@QuickJit
def _coverages(
    finger: Finger, errors: Float[Array, "draws errors"], poses: Float[Array, "poses joints"]
) -> Float[Array, "draws poses pads"]:
    def of_draw(entries: Float[Array, " errors"]) -> Float[Array, "poses pads"]:
        return find_coverage(perturb(finger, entries).scene(), poses).value

    return jax.lax.map(of_draw, errors)


def monte_carlo(finger: Finger, tolerances: ToleranceSpec, *, draws: int, seed: int) -> Yield:
    """The yield by independent normal errors."""
    errors = sample_errors(tolerances, len(finger.mirrors), draws, seed)
    return share_of(coverages(finger, errors))


class Sensitivity(NamedTuple):
    """What each error does by itself, and what a doubled tolerance does to the yield.

    Attributes:
        worst: least coverage of any pad in any posture, shape (errors, `STEPS`).
        limits: largest error to either side that still shows everything, in standard deviations,
            shape (errors, 2); the end of `STEPS` if none of these hides anything.
        base: the yield of as many draws.
        doubled: the yield with one tolerance doubled, by name.
    """

    worst: Float[np.ndarray, "errors steps"]
    limits: Float[np.ndarray, "errors 2"]
    base: Yield
    doubled: dict[str, Yield]


def sensitivity(finger: Finger, tolerances: ToleranceSpec, *, draws: int, seed: int) -> Sensitivity:
    """What each error does by itself, over `STEPS`; yields with the same draws each."""
    mirrors = len(finger.mirrors)
    sizes, doubling = deviations(tolerances, mirrors), groups(mirrors)
    single = (np.eye(len(sizes))[:, None] * STEPS[:, None]) * sizes
    alone = single.reshape(-1, len(sizes))
    errors = sample_errors(tolerances, mirrors, draws, seed)
    variants = [errors]
    for entries in doubling.values():
        factor = np.ones(len(sizes))
        factor[entries] = 2.0
        variants.append(errors * factor)
    found = coverages(finger, np.concatenate([alone, *variants]))
    worst = np.min(found[: len(alone)], axis=(1, 2)).reshape(len(sizes), len(STEPS))
    base, *doubled = map(share_of, np.split(found[len(alone) :], len(variants)))
    limits = np.array([_limits(curve >= 1 - ROUNDING) for curve in worst])
    return Sensitivity(worst, limits, base, dict(zip(doubling, doubled, strict=True)))


def _limits(whole: np.ndarray) -> tuple[float, float]:
    """How far to either side of 0 nothing is hidden."""
    middle, hidden = len(STEPS) // 2, np.flatnonzero(~whole)
    if not whole[middle]:
        return 0.0, 0.0
    low = np.max(hidden[hidden < middle], initial=-1) + 1
    high = np.min(hidden[hidden > middle], initial=len(STEPS)) - 1
    return float(STEPS[low]), float(STEPS[high])
