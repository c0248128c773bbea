"""Operations that a question about the finger does not need."""

from __future__ import annotations

import jax
import jax.numpy as jnp

from designopt.study.left_out import count_operations
from designopt.study.results import LeftOutRow
from studies.models.finger import Finger
from studies.models.grasp import cases
from studies.models.grasp.conditions import Problem, equations, straight
from studies.models.grasp.transfer import Joints, transfer


def operations(finger: Finger) -> list[LeftOutRow]:
    """Operation counts of programs that leave something out beside the general ones."""
    body = finger.body
    nothing = cases.problem_of(finger, None)
    circle = cases.problem_of(finger, cases.circle_on_pad(body, 40.0, 11.5))
    polygon = cases.problem_of(finger, cases.box(body))
    free, round_one, square = (_count(problem) for problem in (nothing, circle, polygon))

    def pull(finger: Finger, joints: Joints) -> jax.Array:
        found = transfer(finger, joints)
        return found.winding * found.slope

    joints = jnp.asarray([0.4, 0.3])
    return [
        LeftOutRow(
            "equations of free closing",
            "pads, object and contact forces: there is nothing to touch",
            free,
            round_one,
        ),
        LeftOutRow(
            "equations on a circle",
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


def _count(problem: Problem) -> int:
    return count_operations(equations, straight(problem), problem)
