"""Searches for a linkage that were stopped where a test wants them."""

from __future__ import annotations

import jax.numpy as jnp

from designopt.optimize import EpigraphVariables, Optimum, OptimumResult
from designopt.optimize.augmented_lagrangian import Trace
from designopt.solution import Solution
from studies.models.pins import Pins


def stopped_at(pins: Pins, level: float) -> Optimum:
    """A design that is no optimum, at some level of the epigraph form."""
    zero, none = jnp.asarray(0.0), jnp.zeros(1)
    variables = EpigraphVariables(pins, jnp.asarray(level))
    solution = Solution(variables, zero, zero, OptimumResult.not_stationary)
    return Optimum(solution, 0.0, {}, {}, Trace(none, none, jnp.zeros(1, int)), {})
