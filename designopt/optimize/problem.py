"""A design problem: parameters with bounds, what is asked of them, and what they must satisfy."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float

Parameters = Any  # a pytree of float arrays

BOUND = "bounds"
"""Name of the bounds among violations and multipliers."""


class Evaluation(eqx.Module):
    """Objective and constraints at one set of parameters. Exactly one of the first three is set.

    Every name stands for one array, and none is ``"bounds"``, the name of the parameters' bounds.

    Attributes:
        objective: a number to be minimised.
        residuals: an array whose sum of squares, halved, is to be minimised.
        least: arrays by name, in one unit, whose smallest element is to be maximised.
        equalities: arrays by name that must be 0, in units in which 1 is much.
        inequalities: arrays by name that must not be negative, in such units.
    """

    objective: Float[Array, ""] | None = None
    residuals: Float[Array, " residuals"] | None = None
    least: dict[str, Float[Array, "..."]] | None = None
    equalities: dict[str, Float[Array, "..."]] = eqx.field(default_factory=dict)
    inequalities: dict[str, Float[Array, "..."]] = eqx.field(default_factory=dict)

    def __check_init__(self) -> None:
        if sum(part is not None for part in (self.objective, self.residuals, self.least)) != 1:
            raise ValueError("Evaluation: give one of objective, residuals and least, and only one")
        names = [*(self.least or {}), *self.equalities, *self.inequalities, BOUND]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise ValueError(f"Evaluation: names that stand for two things: {', '.join(twice)}")

    @property
    def value(self) -> Float[Array, ""]:
        """What is minimised, as one number; exact, so of ``least`` it has a kink."""
        if self.objective is not None:
            return self.objective
        if self.residuals is not None:
            return jnp.sum(self.residuals**2) / 2
        assert self.least is not None
        return -jnp.min(ravel_pytree(self.least)[0])


@dataclass(frozen=True)
class Requirement:
    """How a requirement or a parameter is written for people.

    Attributes:
        words: from the index of an element of its array to words, such as "pin G at the palmar
            face" for ``()``; the index has one number per axis of the array.
        unit: unit in which an amount is written.
        scale: that unit's amount for one unit of the array.
    """

    words: Callable[[tuple[int, ...]], str]
    unit: str = ""
    scale: float = 1.0


def describe_by_index(name: str) -> Requirement:
    """The description of an array for which none is given: its name and index."""
    return Requirement(lambda index: f"{name}{list(index) or ''}")


@dataclass(frozen=True)
class Problem:
    """Parameters that are to be found.

    Attributes:
        terms: pure function from parameters, and from the arrays of ``data``, to what they give;
            traced by JAX.
        lower: least values, a pytree of arrays like the parameters; −∞ where there is no bound.
        upper: greatest values; ∞ where there is no bound.
        scale: change of a parameter that matters about as much as that of another; the solvers
            compute in these units. By default the distance between finite bounds, else 1.
        requirements: how each named array of the terms is written for people; by default
            with its name and index.
        parameters: the same for the arrays of the parameters, by their paths (``F`` or ``arm.F``),
            which are written where a bound of theirs is.
        data: further arguments of ``terms``, such as the cases in which a design is judged. A
            `Minimizer` solves for others of the same shapes without compiling again.
        name: of ``terms``: problems of equal names have equal ones. Compiled programs are kept by
            it between commands; those of a problem without a name are not.
    """

    terms: Callable[..., Evaluation]
    lower: Parameters
    upper: Parameters
    scale: Parameters | None = None
    requirements: Mapping[str, Requirement] = field(default_factory=dict)
    parameters: Mapping[str, Requirement] = field(default_factory=dict)
    data: tuple[Any, ...] = ()
    name: str = ""

    @property
    def units(self) -> Parameters:
        """The scale of every parameter."""
        if self.scale is not None:
            return self.scale

        def unit(lower: Array, upper: Array) -> Array:
            width = upper - lower
            return jnp.where(jnp.isfinite(width) & (width > 0), width, 1.0)

        return jax.tree.map(unit, self.lower, self.upper)


class EpigraphVariables(eqx.Module):
    """Parameters of an epigraph form: those of the design, and the level they all reach."""

    design: Parameters
    level: Float[Array, "*starts"]


def _with_level(design: Parameters, level: float) -> EpigraphVariables:
    return EpigraphVariables(design, jnp.asarray(level, jax.tree.leaves(design)[0].dtype))


def make_epigraph(problem: Problem, *, scale: float = 1.0) -> Problem:
    """The exact form of max–min: maximise a level t subject to every value being at least t.

    Args:
        problem: one whose terms have ``least``.
        scale: change of the level that matters about as much as 1 in a scaled parameter.

    Returns:
        A problem in `EpigraphVariables`, smooth where the values are; the values' names become
        names of inequalities (S. Boyd, L. Vandenberghe, *Convex Optimization*, §4.1.3).

    Example:
        >>> import jax.numpy as jnp
        >>> problem = Problem(
        ...     lambda x: Evaluation(least={"arms": jnp.stack([x, 1 - x])}),
        ...     jnp.zeros(()),
        ...     jnp.ones(()),
        ... )
        >>> form = make_epigraph(problem)
        >>> found = form.terms(EpigraphVariables(jnp.array(0.3), jnp.array(0.2)))
        >>> [round(v, 4) for v in found.inequalities["arms"].tolist()]
        [0.1, 0.5]
    """

    def terms(parameters: EpigraphVariables, *data: Any) -> Evaluation:
        found = problem.terms(parameters.design, *data)
        above = {
            name: (values - parameters.level) / scale for name, values in _least(found).items()
        }
        return Evaluation(
            objective=-parameters.level / scale,
            equalities=found.equalities,
            inequalities=found.inequalities | above,
        )

    return replace(
        problem,
        terms=terms,
        lower=_with_level(problem.lower, -jnp.inf),
        upper=_with_level(problem.upper, jnp.inf),
        scale=_with_level(problem.units, scale),
        name=_form(problem, f"epigraph, {scale}"),
    )


def make_epigraph_starts(problem: Problem, starts: Parameters) -> EpigraphVariables:
    """Starts of the epigraph form from starts of the problem: each at the level it reaches.

    Args:
        problem: one whose terms have ``least``.
        starts: parameters with the starts along every array's first axis.

    Example:
        >>> import jax.numpy as jnp
        >>> problem = Problem(
        ...     lambda x: Evaluation(least={"arms": jnp.stack([x, 1 - x])}),
        ...     jnp.zeros(()),
        ...     jnp.ones(()),
        ... )
        >>> [
        ...     round(v, 4)
        ...     for v in make_epigraph_starts(problem, jnp.array([0.25, 0.5])).level.tolist()
        ... ]
        [0.25, 0.5]
    """
    return EpigraphVariables(starts, _levels(problem.terms, starts, problem.data))


@partial(jax.jit, static_argnums=0)
def _levels(
    evaluate: Callable[..., Evaluation], starts: Parameters, data: tuple[Any, ...]
) -> Float[Array, " starts"]:
    return jax.vmap(lambda design: -evaluate(design, *data).value)(starts)


def make_elastic(problem: Problem) -> Problem:
    """The problem of what is missing: the least s with which every inequality + s is not negative.

    Where the requirements cannot all be met, those that hold s from falling are the ones that
    conflict (elastic constraints: J. Nocedal, S. J. Wright, *Numerical Optimization*, 2nd ed.,
    §18.3).

    Args:
        problem: its objective does not matter; equalities stay as they are.

    Returns:
        A problem in `EpigraphVariables` whose level is s.

    Example:
        >>> import jax.numpy as jnp
        >>> problem = Problem(
        ...     lambda x: Evaluation(objective=x, inequalities={"high": x - 2, "low": 1 - x}),
        ...     jnp.zeros(()),
        ...     jnp.full((), 4.0),
        ... )
        >>> form = make_elastic(problem)
        >>> found = form.terms(EpigraphVariables(jnp.array(1.5), jnp.array(0.5)))
        >>> {name: float(values) for name, values in found.inequalities.items()}
        {'high': 0.0, 'low': 0.0}
    """

    def terms(parameters: EpigraphVariables, *data: Any) -> Evaluation:
        found = problem.terms(parameters.design, *data)
        met = {name: values + parameters.level for name, values in found.inequalities.items()}
        return Evaluation(parameters.level, equalities=found.equalities, inequalities=met)

    return replace(
        problem,
        terms=terms,
        lower=_with_level(problem.lower, 0.0),
        upper=_with_level(problem.upper, jnp.inf),
        scale=_with_level(problem.units, 1.0),
        name=_form(problem, "elastic"),
    )


def make_soft_minimum(problem: Problem, temperature: float) -> Problem:
    """The smooth form of max–min: the least value replaced by a soft minimum of all.

    −τ log Σ exp(−vᵢ/τ) is below the least of n values by at most τ log n.

    Args:
        problem: one whose terms have ``least``.
        temperature: τ, in the values' unit.

    Example:
        >>> import jax.numpy as jnp
        >>> problem = Problem(
        ...     lambda x: Evaluation(least={"arms": jnp.stack([x, 1 - x])}),
        ...     jnp.zeros(()),
        ...     jnp.ones(()),
        ... )
        >>> -round(
        ...     float(make_soft_minimum(problem, 0.1).terms(jnp.array(0.2)).value), 4
        ... )  # just below 0.2
        0.1998
    """

    def terms(parameters: Parameters, *data: Any) -> Evaluation:
        found = problem.terms(parameters, *data)
        values, _ = ravel_pytree(_least(found))
        soft = temperature * jax.nn.logsumexp(-values / temperature)
        return Evaluation(
            objective=soft, equalities=found.equalities, inequalities=found.inequalities
        )

    return replace(problem, terms=terms, name=_form(problem, f"soft minimum, {temperature}"))


def _form(problem: Problem, form: str) -> str:
    """The name of another form of a problem's terms."""
    return f"{form} of {problem.name}" if problem.name else ""


def _least(terms: Evaluation) -> dict[str, Float[Array, "..."]]:
    if terms.least is None:
        raise ValueError("this form is for problems whose terms have `least`")
    return terms.least
