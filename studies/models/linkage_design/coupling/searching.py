"""The search: many starts over all angles of PIP at once, and the best of them anew."""

from __future__ import annotations

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from designopt.optimize import make_epigraph_starts, select_starts
from studies.models.finger import coupling_pins_of
from studies.models.finger_parts import Body
from studies.models.linkage_design.coupling.postures import with_motor_arm
from studies.models.linkage_design.coupling.problem import coupling_problem
from studies.models.linkage_design.judging import STEP_DEG
from studies.models.linkage_design.problem import ANGLE, grids
from studies.models.linkage_design.searching import (
    NEARLY,
    Round,
    Search,
    blank_finger,
    exact,
    minimizer,
    rounded,
)
from studies.models.linkage_design.spec import FingerLinkageSpec


def pip_angles(body: Body) -> Float[np.ndarray, " pip"]:
    """Flexion of PIP from straight to the end of its range in steps of 1°, rad."""
    return grids(body, STEP_DEG)[0]


def search_coupling(spec: FingerLinkageSpec, seed: int) -> Search:
    """The best coupling bar for a spec's body.

    Four numbers and one angle are little: every angle of PIP is in the problem from the start.
    From what cannot be met the solver ends anywhere; so where the motor is too weak for the force
    at the tip, the design is the best one of which no force is asked.

    Args:
        spec: the study's settings, of kind ``coupled``.
        seed: of the Sobol points.
    """
    how, finger = spec.search, blank_finger(spec)
    # Both ends of the bar may be rounded, by half a step along x and y.
    allowance = max(how.allowance, 2 * how.rounding)
    pip = pip_angles(finger.body)
    problem = coupling_problem(finger, spec.limits, pip, allowance, motor=spec.motor)
    starts = select_starts(problem, how.starts, seed, among=how.among, scale=ANGLE)
    begin = make_epigraph_starts(problem, starts.parameters)
    solver = minimizer(problem, how.starts, "slsqp")
    solved = solver.solve(begin, exact(problem))
    best = solved.best
    if best.violation > NEARLY:
        limits = spec.limits.model_copy(update={"tip_force": 0.0})
        other = coupling_problem(finger, limits, pip, allowance, motor=spec.motor)
        weak = solver.solve(begin, exact(other)).best
        best = weak if weak.violation <= NEARLY else best
    found = rounded(best.parameters.design, how.rounding)
    placed = replace(finger, pins=jax.tree.map(jnp.asarray, found))
    pins = rounded(coupling_pins_of(with_motor_arm(placed, spec.motor.arm)), how.rounding)
    return Search(finger.with_pins(pins), starts, (Round(problem, solved),), ())
