"""What holds an optimum, and what conflicts, in words."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from designopt.optimize.flat import Flat
from designopt.optimize.optimality import Optimum
from designopt.optimize.problem import BOUND, Problem, describe_by_index


@dataclass(frozen=True)
class Active:
    """A requirement that holds an optimum.

    Attributes:
        name: of its array.
        index: of its element there.
        words: what it is.
        unit: of its amounts.
        price: by how much the objective would fall, to first order, if one ``unit`` less were
            asked: for an inequality or a bound by one, its λ; for an equality, at +1 instead of
            0, its μ, which may be negative. In units of the objective per ``unit``.
        share: of its multiplier in the sum of all.
    """

    name: str
    index: tuple[int, ...]
    words: str
    unit: str
    price: float
    share: float


def find_active_set(problem: Problem, optimum: Optimum, least_share: float = 0.01) -> list[Active]:
    """The requirements whose multipliers are not zero, the dearest first.

    Args:
        problem: the problem that was solved.
        optimum: what was found.
        least_share: requirements with a smaller share of all multipliers are left out.

    Example:
        >>> import jax.numpy as jnp
        >>> from designopt.optimize import Evaluation, minimize
        >>> problem = Problem(
        ...     lambda x: Evaluation(objective=(x - 2) ** 2), jnp.zeros(()), jnp.ones(())
        ... )
        >>> best = minimize(problem, jnp.array([0.5]), "slsqp").best
        >>> [active.words for active in find_active_set(problem, best)]
        ['parameter at its upper bound']
    """
    total = sum(float(np.sum(np.abs(part))) for part in optimum.multipliers.values())
    found = []
    for name, values in optimum.multipliers.items():
        for index in np.argwhere(np.abs(values) > least_share * total):
            place = tuple(int(i) for i in index)
            words, unit, scale = _described(problem, name, place)
            price = float(values[place])
            found.append(Active(name, place, words, unit, price / scale, abs(price) / total))
    return sorted(found, key=lambda one: -one.share)


def explain_conflict(problem: Problem, optimum: Optimum) -> list[str]:
    """The requirements that an infeasible point fails, each with its amount, the worst first.

    Of an array with several such elements the worst one is listed. Where the point's result is
    ``infeasible``, it is at a minimum of the squared violations: their gradients balance, so that
    near it none of these requirements can be met better without another being met worse.

    Args:
        problem: the problem that was solved.
        optimum: what was found.

    Example:
        >>> import jax.numpy as jnp
        >>> from designopt.optimize import Evaluation, minimize
        >>> problem = Problem(
        ...     lambda x: Evaluation(objective=x, inequalities={"high": x - 2}),
        ...     jnp.zeros(()),
        ...     jnp.ones(()),
        ... )
        >>> explain_conflict(problem, minimize(problem, jnp.array([0.5]), "slsqp").best)
        ['high by 1']
    """
    lines = []
    for name in sorted(optimum.worst, key=lambda name: -optimum.violations[name]):
        words, unit, scale = _described(problem, name, optimum.worst[name])
        lines.append(f"{words} by {optimum.violations[name] * scale:.3g} {unit}".rstrip())
    return lines


def _described(problem: Problem, name: str, place: tuple[int, ...]) -> tuple[str, str, float]:
    """Of an element of a requirement: words, unit, and the unit's amount for 1 in the array."""
    if name == BOUND:
        return Flat.of(problem).bound(*place)
    requirement = problem.requirements.get(name, describe_by_index(name))
    return requirement.words(place), requirement.unit, requirement.scale
