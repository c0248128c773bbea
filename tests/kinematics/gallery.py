"""The gallery's linkages, and programs compiled once for all tests that use them."""

from __future__ import annotations

from functools import cache, partial
from pathlib import Path

import jax

from kinematics import (
    Limit,
    Limits,
    Linkage,
    read_linkage,
    solve_poses,
    solve_rates,
    solve_transmission,
)

FOLDER = Path(__file__).parents[2] / "studies" / "gallery" / "linkages"
NAMES = sorted(path.stem for path in FOLDER.glob("*.toml"))

poses_of = partial(jax.jit, static_argnames=("of",))(solve_poses)
rates_of = partial(jax.jit, static_argnames=("of",))(solve_rates)
transmission_of = jax.jit(solve_transmission)


@cache
def gallery(name: str) -> Linkage:
    return read_linkage(FOLDER / f"{name}.toml")


def ends(limits: Limits) -> tuple[Limit, Limit]:
    """Both limits of an input that has two."""
    assert limits.lower is not None
    assert limits.upper is not None
    return limits.lower, limits.upper
