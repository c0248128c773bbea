"""Published problems, each with its start and its answer."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from designopt.optimize import Evaluation, Problem
from tests.helpers import load_toml

PUBLISHED = load_toml("optimisation_cases.toml")


@dataclass(frozen=True)
class Case:
    """A problem, its published start and answer, and the units its constraints are over."""

    problem: Problem
    start: Any
    value: float
    point: Any
    units: dict[str, float]
    multipliers: dict[str, Any]

    @property
    def starts(self) -> Any:
        return self.start[None]


def _hs1(x, unit):
    return Evaluation(objective=100 * (x[1] - x[0] ** 2) ** 2 + (1 - x[0]) ** 2)


def _hs21(x, unit):
    wall = (10 * x[0] - x[1] - 10) / unit["wall"]
    return Evaluation(objective=0.01 * x[0] ** 2 + x[1] ** 2 - 100, inequalities={"wall": wall})


def _hs28(x, unit):
    # As residuals, whose squares are halved.
    return Evaluation(
        residuals=jnp.sqrt(2.0) * jnp.stack([x[0] + x[1], x[1] + x[2]]),
        equalities={"plane": (x[0] + 2 * x[1] + 3 * x[2] - 1) / unit["plane"]},
    )


def _hs35(x, unit):
    a, b, c = x
    value = 9 - 8 * a - 6 * b - 4 * c + 2 * a**2 + 2 * b**2 + c**2 + 2 * a * b + 2 * a * c
    return Evaluation(objective=value, inequalities={"plane": (3 - a - b - 2 * c) / unit["plane"]})


def _hs43(x, unit):
    a, b, c, d = x
    value = a**2 + b**2 + 2 * c**2 + d**2 - 5 * a - 5 * b - 21 * c + 7 * d
    quadrics = jnp.stack(
        [
            8 - a**2 - b**2 - c**2 - d**2 - a + b - c + d,
            10 - a**2 - 2 * b**2 - c**2 - 2 * d**2 + a + d,
            5 - 2 * a**2 - b**2 - c**2 - 2 * a + b + d,
        ]
    )
    return Evaluation(objective=value, inequalities={"quadrics": quadrics / unit["quadrics"]})


def _hs61(x, unit):
    a, b, c = x
    return Evaluation(
        objective=4 * a**2 + 2 * b**2 + 2 * c**2 - 33 * a + 16 * b - 24 * c,
        equalities={
            "first": (3 * a - 2 * b**2 - 7) / unit["first"],
            "second": (4 * a - c**2 - 11) / unit["second"],
        },
    )


def _hs65(x, unit):
    a, b, c = x
    return Evaluation(
        objective=(a - b) ** 2 + (a + b - 10) ** 2 / 9 + (c - 5) ** 2,
        inequalities={"sphere": (48 - jnp.sum(x**2)) / unit["sphere"]},
    )


def _hs71(x, unit):
    return Evaluation(
        objective=x[0] * x[3] * (x[0] + x[1] + x[2]) + x[2],
        equalities={"sphere": (jnp.sum(x**2) - 40) / unit["sphere"]},
        inequalities={"product": (jnp.prod(x) - 25) / unit["product"]},
    )


def _cb2(x, unit):
    return Evaluation(least={"first": -(x[0] ** 2) - x[1] ** 4, **_of_both(x)})


def _cb3(x, unit):
    return Evaluation(least={"first": -(x[0] ** 4) - x[1] ** 2, **_of_both(x)})


def _of_both(x):
    return {"second": -jnp.sum((2 - x) ** 2), "third": -2 * jnp.exp(x[1] - x[0])}


FREE = (-np.inf, np.inf)

PROBLEMS: dict[str, tuple[Callable[..., Evaluation], list[tuple[float, float]]]] = {
    "hs1": (_hs1, [FREE, (-1.5, np.inf)]),
    "hs21": (_hs21, [(2, 50), (-50, 50)]),
    "hs28": (_hs28, [FREE] * 3),
    "hs35": (_hs35, [(0, np.inf)] * 3),
    "hs43": (_hs43, [FREE] * 4),
    "hs61": (_hs61, [FREE] * 3),
    "hs65": (_hs65, [(-4.5, 4.5), (-4.5, 4.5), (-5, 5)]),
    "hs71": (_hs71, [(1, 5)] * 4),
    "cb2": (_cb2, [(-5, 5)] * 2),
    "cb3": (_cb3, [(-5, 5)] * 2),
}


def case(name: str, dtype: str = "float64") -> Case:
    """A published problem by name."""
    terms, bounds = PROBLEMS[name]
    entry = PUBLISHED[name]
    unit = entry.get("unit", {})
    lower, upper = (jnp.asarray(side, dtype) for side in zip(*bounds, strict=True))
    return Case(
        Problem(lambda x: terms(x, unit), lower, upper),
        jnp.asarray(entry["start"], dtype),
        entry["value"],
        np.asarray(entry["point"]) if "point" in entry else None,
        unit,
        entry.get("multipliers", {}),
    )


def inside(problem: Problem, parameters: Any) -> bool:
    """Whether parameters are within a problem's bounds."""
    between = jax.tree.map(
        lambda low, at, high: bool(np.all((low <= at) & (at <= high))),
        *(jax.device_get(part) for part in (problem.lower, parameters, problem.upper)),
    )
    return all(jax.tree.leaves(between))


def rosenbrock(*limits: float) -> Problem:
    """Rosenbrock's function of two parameters, each no more than its limit where one is given."""
    upper = jnp.asarray([*limits, np.inf, np.inf][:2])
    return Problem(lambda x: _hs1(x, {}), jnp.full(2, -jnp.inf), upper)


def apart() -> Problem:
    """x ≥ 1 and x ≤ −1: least squares of both violations are at 0, where each is 1."""
    return Problem(
        lambda x: Evaluation(
            objective=0.1 * x[0], inequalities={"high": x[0] - 1, "low": -1 - x[0]}
        ),
        jnp.asarray([-5.0]),
        jnp.asarray([5.0]),
    )
