"""A problem over one vector in scaled units: the form that solvers work on."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float

from designopt.optimize.problem import (
    EpigraphVariables,
    Evaluation,
    Parameters,
    Problem,
    describe_by_index,
)

Point = Float[Array, " parameters"]

Given = tuple[tuple[Any, ...], tuple[Any, Any]]
"""What may change without compiling again: a problem's data; least and greatest values, scaled."""


@dataclass(frozen=True)
class Flat:
    """A problem whose parameters are one vector, each in units of its scale.

    Attributes:
        problem: the problem.
        units: mm or rad, or whatever a parameter has, per scaled unit; in the bounds' float type.
        lower: least values, scaled.
        upper: greatest values, scaled.
        limited: which parameters have a lower bound, and which an upper one.
    """

    problem: Problem
    units: np.ndarray
    lower: Any
    upper: Any
    limited: tuple[np.ndarray, np.ndarray]

    @classmethod
    def of(cls, problem: Problem) -> Flat:
        """The flat form of a problem."""
        lower, upper, units = (
            np.asarray(ravel_pytree(part)[0])
            for part in (problem.lower, problem.upper, problem.units)
        )
        units = units.astype(lower.dtype)
        limited = np.flatnonzero(np.isfinite(lower)), np.flatnonzero(np.isfinite(upper))
        return cls(problem, units, lower / units, upper / units, limited)

    @property
    def own(self) -> Given:
        """Its data and bounds."""
        return self.problem.data, (self.lower, self.upper)

    def name(self, of: str) -> str:
        """By which a program of it is kept, with all that it does not have from its arguments.

        Args:
            of: what the program does; nothing is kept of a problem without a name.
        """
        if not self.problem.name:
            return ""
        structure = jax.tree.structure(self.problem.lower)
        fixed = self.units.tolist(), [part.tolist() for part in self.limited], structure
        return f"{of}: {self.problem.name} {fixed}"

    def point(self, parameters: Parameters) -> Point:
        """The vector of parameters."""
        # In units of each parameter's scale: quasi-Newton methods start with the identity as their
        # Hessian, which a millimetre beside a radian would make a poor one.
        vector, _ = ravel_pytree(parameters)
        return vector / jnp.asarray(self.units, vector.dtype)

    def parameters(self, point: Point) -> Parameters:
        """The parameters of a vector."""
        _, unravel = ravel_pytree(self.problem.lower)
        return unravel(point * jnp.asarray(self.units, point.dtype))

    def given(self, given: Given) -> Flat:
        """The same for other data of the problem, and other bounds of the same parameters."""
        data, (lower, upper) = given
        return replace(self, problem=replace(self.problem, data=data), lower=lower, upper=upper)

    def terms(self, point: Point) -> Evaluation:
        """The problem's evaluation at a vector."""
        return self.problem.terms(self.parameters(point), *self.problem.data)

    def evaluated(
        self, point: Point
    ) -> tuple[Evaluation, Float[Array, " equalities"], Float[Array, " inequalities"]]:
        """The terms; and their constraints, without the bounds, as vectors in the names' order."""
        terms = self.terms(point)
        equalities = _joined(terms.equalities, point.dtype)
        return terms, equalities, _joined(terms.inequalities, point.dtype)

    def refuse_least(self, caller: str) -> None:
        """Refuse a problem of max–min as it is, for a solver of smooth problems.

        Raises:
            ValueError: the terms have ``least``.
        """
        if jax.eval_shape(self.terms, jnp.asarray(self.units)).least is not None:
            raise ValueError(
                f"{caller}: bring `least` into a form with make_epigraph() or make_soft_minimum()"
            )

    def bounds(self, point: Point) -> Float[Array, " bounds"]:
        """How far the vector is inside its finite bounds: the lower ones, then the upper ones."""
        low, high = self.limited
        above = point[low] - jnp.asarray(self.lower[low], point.dtype)
        below = jnp.asarray(self.upper[high], point.dtype) - point[high]
        return jnp.concatenate([above, below])

    def clipped(self, point: Point) -> Point:
        """The nearest vector inside the bounds."""
        return jnp.clip(
            point, jnp.asarray(self.lower, point.dtype), jnp.asarray(self.upper, point.dtype)
        )

    def bound(self, place: int) -> tuple[str, str, float]:
        """Of an element of `bounds`: words, unit, and the unit's amount for 1 in scaled units."""
        low, high = self.limited
        which = left = int([*low, *high][place])
        for path, leaf in jax.tree_util.tree_leaves_with_path(self.problem.lower):
            if left < leaf.size:
                # The epigraph form's parameters are named as the problem's own.
                path = path[isinstance(self.problem.lower, EpigraphVariables) :]
                name = jax.tree_util.keystr(path, simple=True, separator=".") or "parameter"
                bounded = self.problem.parameters.get(name, describe_by_index(name))
                index = tuple(int(i) for i in np.unravel_index(left, leaf.shape))
                side = "lower" if place < len(low) else "upper"
                amount = float(self.units[which]) * bounded.scale
                return f"{bounded.words(index)} at its {side} bound", bounded.unit, amount
            left -= leaf.size
        raise IndexError(place)


def column_slopes(function: Callable[[Point], Any], point: Point) -> Any:
    """Derivatives of a function's arrays by a vector, which has the last axis, and their values.

    One direction after the other by one linear program: `jax.jacfwd` carries all directions through
    every operation at once, which took three times as long for thousands of requirements.

    Returns:
        The values, and the derivatives.
    """
    values, push = jax.linearize(function, point)
    columns = jax.lax.map(push, jnp.eye(point.size, dtype=point.dtype))
    return values, jax.tree.map(lambda part: jnp.moveaxis(part, 0, -1), columns)


def _joined(arrays: dict[str, Float[Array, "..."]], dtype: jnp.dtype) -> Float[Array, " all"]:
    """Arrays by name as one vector, in the order of their names; empty if there is none."""
    return ravel_pytree(arrays)[0] if arrays else jnp.zeros(0, dtype)
