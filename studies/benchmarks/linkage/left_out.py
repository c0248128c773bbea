"""Operations that a question about a linkage does not need."""

from __future__ import annotations

from collections.abc import Sequence

import jax
import jax.numpy as jnp

from designopt.study.left_out import count_operations
from designopt.study.results import LeftOutRow
from kinematics import Linkage, read_linkage, solve_poses
from studies.benchmarks.linkage.cases import CASES, GALLERY, linkage_of

POSES = 360
"""Poses that the counted programs solve; the count does not depend on it."""


def operations() -> list[LeftOutRow]:
    """Operation counts of programs that leave something out beside the general ones."""
    six_bar = linkage_of(CASES[-1], _dtype())
    # The same finger twice: what is asked of one is what drives the other.
    by_joints, by_crank = (
        read_linkage(GALLERY / f"{name}.toml") for name in ("finger", "finger-crank")
    )
    return [
        LeftOutRow(
            "place of B on the six-bar",
            "the second loop: B does not depend on it",
            _count(six_bar, ["B"]),
            _count(six_bar),
        ),
        LeftOutRow(
            "all poses of the finger, driven at its joints",
            "the iteration: the same finger driven by its crank has no closed form",
            _count(by_joints),
            _count(by_crank),
        ),
    ]


def _count(linkage: Linkage, of: Sequence[str] | None = None) -> int:
    inputs = jnp.zeros((POSES, len(linkage.input_names)), _dtype())
    return count_operations(lambda *args: solve_poses(*args, of=of), linkage, inputs)


def _dtype() -> str:
    return str(jax.dtypes.canonicalize_dtype(float))
