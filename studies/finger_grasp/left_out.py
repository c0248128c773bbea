"""Operations that a question about the finger does not need."""

from __future__ import annotations

import jax
import jax.numpy as jnp

from designopt.left_out import count_operations
from designopt.results import LeftOutRow
from studies.finger_grasp import cases
from studies.finger_grasp.equilibrium import Problem, Unknowns, equations, straight
from studies.finger_grasp.finger import Finger, Joints, transfer


def operations(finger: Finger) -> list[LeftOutRow]:
    """Operation counts of programs that leave something out beside the general ones."""
    body = finger.body
    nothing = cases.problem_of(finger, None)
    circle = cases.problem_of(finger, cases.lying(body, 40.0, 11.5))
    polygon = cases.problem_of(finger, cases.box(body))
    free, round_one, square = (_slopes_count(problem) for problem in (nothing, circle, polygon))

    def pull(finger: Finger, joints: Joints) -> jax.Array:
        found = transfer(finger, joints)
        return found.winding * found.slope

    joints = jnp.asarray([0.4, 0.3])
    return [
        LeftOutRow(
            "equations of free closing, and their slopes",
            "pads, object and contact forces: there is nothing to touch",
            free,
            round_one,
        ),
        LeftOutRow(
            "equations on a circle, and their slopes",
            "corners, sides and the second contact of a pad: a circle has none",
            round_one,
            square,
        ),
        LeftOutRow(
            "moment of the spring",
            "the outer dyad: the spring's winding depends on DIP alone",
            count_operations(pull, finger, joints),
            count_operations(transfer, finger, joints),
        ),
    ]


def _slopes_count(problem: Problem) -> int:
    def both(problem: Problem, unknowns: Unknowns) -> tuple[Unknowns, Unknowns]:
        return (
            equations(unknowns, problem),
            jax.jacfwd(lambda u: equations(u, problem))(unknowns),
        )

    return count_operations(both, problem, straight(problem))
