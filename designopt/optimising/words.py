"""What holds an optimum, and what conflicts, in words."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from designopt.optimising.flat import Flat
from designopt.optimising.problem import Problem, Requirement
from designopt.optimising.verdict import BOUND, FEASIBLE, Optimum


@dataclass(frozen=True)
class Active:
    """A requirement that holds an optimum.

    Attributes:
        name: of its array.
        index: of its element there.
        words: what it is.
        unit: of its amounts.
        price: by how much the objective would fall for one unit less of it; its multiplier, in
            units of the objective per ``unit``.
        share: of its multiplier in the sum of all.
    """

    name: str
    index: tuple[int, ...]
    words: str
    unit: str
    price: float
    share: float


def active_set(problem: Problem, optimum: Optimum, least_share: float = 0.01) -> list[Active]:
    """The requirements whose multipliers are not zero, the dearest first.

    Args:
        problem: the problem that was solved.
        optimum: what was found.
        least_share: requirements with a smaller share of all multipliers are left out.
    """
    total = sum(float(np.sum(np.abs(part))) for part in optimum.multipliers.values())
    found = []
    for name, values in optimum.multipliers.items():
        for index in np.argwhere(np.abs(values) > least_share * total):
            place = tuple(int(i) for i in index)
            requirement = _requirement(problem, name)
            price = float(values[place])
            found.append(
                Active(
                    name,
                    place,
                    requirement.words(place),
                    requirement.unit,
                    price / requirement.scale,
                    abs(price) / total,
                )
            )
    return sorted(found, key=lambda one: -one.share)


def conflict(problem: Problem, optimum: Optimum) -> list[str]:
    """The requirements that an infeasible point fails, each with its amount, the worst first.

    Where an augmented Lagrangian ends without a feasible point, it is at a minimum of the squared
    violations: the gradients of exactly these requirements balance, so none of them can be met
    better without another being met worse (E. G. Birgin, J. M. Martínez, *Practical Augmented
    Lagrangian Methods*, 2014, ch. 6).
    """
    unmet = sorted(optimum.violations.items(), key=lambda item: -item[1])
    lines = []
    for name, amount in unmet:
        if amount > FEASIBLE:
            requirement = _requirement(problem, name)
            size = f"{amount * requirement.scale:.3g}"
            lines.append(f"{name} by {size} {requirement.unit}".rstrip())
    return lines


def _requirement(problem: Problem, name: str) -> Requirement:
    if name == BOUND:
        flat = Flat.of(problem)
        low, _ = flat.limited

        def bound(index: tuple[int, ...]) -> str:
            path, place = flat.elements(index[0])
            which = "lower" if index[0] < len(low) else "upper"
            return f"{path.lstrip('.')}{list(place) if place else ''} at its {which} bound"

        return Requirement(bound)
    given = problem.requirements.get(name)
    if given is not None:
        return given
    return Requirement(lambda index: f"{name}{list(index) if index else ''}")
