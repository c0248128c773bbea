"""Pose after pose in Python, each from the one before: SciPy's fsolve on the loop equations.

What a designer writes without a toolkit. It and the other tools of `peers` are `Walker`s.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import jax
import numpy as np
import scipy.optimize

from kinematics import Linkage
from studies.benchmarks.linkage.cases import (
    Case,
    Sizes,
    dimensions,
    gaps,
    sizes_of,
    start_of,
    with_dimensions,
)


@dataclass(frozen=True)
class Walker:
    """A solver that has been handed a linkage and a sweep.

    Attributes:
        call: solves the sweep; its answer is in the solver's own form.
        read: that answer as an array of shape (poses, joints, 2), mm.
    """

    call: Callable[[], Any]
    read: Callable[[Any], np.ndarray]


Walk = Callable[[Case, Linkage, np.ndarray], Walker]
"""From a case, its dimensions and crank angles in equal steps to a solver that is ready."""


def fsolve_walk(tolerance: float) -> Walk:
    """SciPy's fsolve for each pose, from the solution of the pose before."""

    def walk(case: Case, linkage: Linkage, angles: np.ndarray) -> Walker:
        sizes = numbers_of(linkage)
        home = start_of(case, sizes)

        def residual(unknowns: np.ndarray, angle: float) -> list[float]:
            return gaps(math, case, sizes, angle, unknowns.tolist())[1]

        def call() -> list[list[tuple[float, float]]]:
            unknowns: Any = np.array(home)
            found = []
            with warnings.catch_warnings():
                # Asked for no more than rounding leaves, it warns and is as close as it gets.
                warnings.simplefilter("ignore", RuntimeWarning)
                for angle in angles.tolist():
                    unknowns = scipy.optimize.fsolve(residual, unknowns, args=angle, xtol=tolerance)
                    joints, _ = gaps(math, case, sizes, angle, unknowns.tolist())
                    found.append([joints[name] for name in case.joints])
            return found

        return Walker(call, np.array)

    return walk


def numbers_of(linkage: Linkage) -> Sizes:
    """The dimensions of a linkage as Python numbers."""
    return jax.tree.map(float, sizes_of(linkage))


def gradient_by_differences(
    walk: Walk, case: Case, linkage: Linkage, angles: np.ndarray
) -> np.ndarray:
    """Derivative of the last joint's mean square by central differences, all dimensions raveled.

    The step, the cube root of rounding times the leaf's size, balances truncation and rounding.
    """
    leaves, structure = jax.tree.flatten(jax.tree.map(np.asarray, dimensions(linkage)))
    numbers = np.concatenate([np.ravel(leaf) for leaf in leaves])
    cuts = np.cumsum([leaf.size for leaf in leaves])[:-1]

    def mean_square(values: np.ndarray) -> float:
        parts = [
            part.reshape(leaf.shape)
            for part, leaf in zip(np.split(values, cuts), leaves, strict=True)
        ]
        moved = with_dimensions(linkage, jax.tree.unflatten(structure, parts))
        walker = walk(case, moved, angles)
        last = walker.read(walker.call())[:, -1]
        return float(np.mean(np.sum(last * last, axis=-1)))

    slopes = np.zeros_like(numbers)
    for i, number in enumerate(numbers):
        step = np.finfo(float).eps ** (1 / 3) * max(1.0, abs(number))
        moves = np.zeros_like(numbers)
        moves[i] = step
        slopes[i] = (mean_square(numbers + moves) - mean_square(numbers - moves)) / (2 * step)
    return slopes
