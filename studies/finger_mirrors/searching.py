"""A bounded quasi-Newton search with multipliers for the inequalities."""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import scipy.optimize
from jaxtyping import Array

from studies.finger_mirrors.arrangement import Arrangement
from studies.finger_mirrors.problem import Task, terms_of

PENALTY = 100.0


class Found(NamedTuple):
    arrangement: Arrangement
    objective: float
    violation: float
    evaluations: int
    multipliers: Any


@jax.jit
def lagrangian(parts, scale, task, multipliers, PENALTY):
    def value(parts):
        arrangement = jax.tree.map(jnp.multiply, parts, scale)
        objective, inequalities = terms_of(arrangement, task)
        held = jax.tree.map(
            lambda g, m: jnp.sum(jnp.maximum(m - PENALTY * g, 0.0) ** 2 - m**2) / (2 * PENALTY+1e-9),
            inequalities,
            multipliers,
        )
        return objective + sum(jax.tree.leaves(held)), (objective, inequalities)

    return jax.value_and_grad(value, has_aux=True)(parts)


def search(start, bounds, scale, task, evaluations, multipliers=None, penalty=100.0):
    PENALTY=jnp.asarray(penalty)
    """One stage."""
    flat, build = jax.flatten_util.ravel_pytree(jax.tree.map(jnp.divide, start, scale))
    low, high = (
        np.asarray(jax.flatten_util.ravel_pytree(jax.tree.map(jnp.divide, b, scale))[0])
        for b in bounds
    )
    if multipliers is None:
        multipliers = {"resolution": jnp.zeros((len(task.nominal), 3)), "clearance": jnp.zeros(2)}
    count = 0

    def asked(x):
        nonlocal count
        count += 1
        (value, _), slope = lagrangian(build(jnp.asarray(x)), scale, task, multipliers, PENALTY)
        return float(value), np.asarray(jax.flatten_util.ravel_pytree(slope)[0])

    done = scipy.optimize.minimize(
        asked, np.clip(np.asarray(flat), low, high), jac=True, method="L-BFGS-B",
        bounds=list(zip(low, high, strict=True)),
        options={"maxfun": evaluations, "maxls": 12, "maxcor": 20, "maxiter": evaluations},
    )
    parts = build(jnp.asarray(done.x))
    (_, (objective, inequalities)), _ = lagrangian(parts, scale, task, multipliers, PENALTY)
    multipliers = jax.tree.map(lambda g, m: jnp.maximum(m - PENALTY * g, 0.0), inequalities, multipliers)
    violation = max(float(jnp.max(-g)) for g in jax.tree.leaves(inequalities))
    return Found(jax.tree.map(jnp.multiply, parts, scale), float(objective), max(violation, 0.0), count, multipliers)
