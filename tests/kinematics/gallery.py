"""The gallery's linkages and further ones, and programs compiled once for all tests."""

from __future__ import annotations

import copy
import itertools
import tomllib
from collections import Counter
from collections.abc import Sequence
from functools import cache, partial
from pathlib import Path
from typing import Any

import jax
import numpy as np
import pytest

from kinematics import (
    Limit,
    Limits,
    Linkage,
    read_linkage,
    solve_poses,
    solve_rates,
    solve_transmission,
)
from tests.helpers import nightly
from tests.refusals import changed

FOLDER = Path(__file__).parents[2] / "studies" / "gallery" / "linkages"
NAMES = sorted(path.stem for path in FOLDER.glob("*.toml"))


def each_linkage(quick: Sequence[str]) -> pytest.MarkDecorator:
    """A test of each linkage of the gallery, of which the quick ones run by default."""
    others = [name for name in NAMES if name not in quick]
    return pytest.mark.parametrize("name", [*quick, *nightly(*others)])


poses_of = partial(jax.jit, static_argnames=("of",))(solve_poses)
rates_of = partial(jax.jit, static_argnames=("of",))(solve_rates)
transmission_of = jax.jit(solve_transmission)


@cache
def gallery(name: str) -> Linkage:
    return read_linkage(FOLDER / f"{name}.toml")


@cache
def _read(name: str) -> dict[str, Any]:
    return tomllib.loads((FOLDER / f"{name}.toml").read_text(encoding="utf-8"))


def gallery_tables(name: str, changes: dict[str, Any] | None = None) -> dict[str, Any]:
    """A gallery file's tables, with entries changed as in ``tests.refusals``."""
    return changed(_read(name), changes or {})


def bodies_at(tables: dict[str, Any]) -> Counter[str]:
    """How many bodies meet in each joint of a file's tables; all fixed ones are one."""
    bodies = tables["bodies"].values()
    moving = [body["joints"] for body in bodies if not body.get("fixed")]
    fixed = {joint for body in bodies if body.get("fixed") for joint in body["joints"]}
    return Counter(itertools.chain(fixed, *moving))


def ends(limits: Limits) -> tuple[Limit, Limit]:
    """Both limits of an input that has two."""
    assert limits.lower is not None
    assert limits.upper is not None
    return limits.lower, limits.upper


def tables_of(
    joints: dict[str, Any],
    fixed: str,
    bodies: dict[str, str],
    lengths: dict[str, float] | None = None,
    **more: Any,
) -> dict[str, Any]:
    """A file's tables: bodies as in ``{"crank": "O A"}``, lengths of their first two joints."""
    every: dict[str, Any] = {"ground": {"joints": fixed.split(), "fixed": True}}
    every |= {name: {"joints": names.split()} for name, names in bodies.items()}
    for body, length in (lengths or {}).items():
        every[body]["lengths"] = {"-".join(every[body]["joints"][:2]): length}
    inputs = [{"name": "crank", "body": "crank"}]
    return copy.deepcopy({"joints": joints, "bodies": every, "inputs": inputs} | more)


def circle_meet(a: Any, b: Any, to_a: float, to_b: float, side: float) -> np.ndarray:
    """Where two circles meet: ``side`` +1 is left of a → b."""
    a, b = np.array(a, float), np.array(b, float)
    d = np.hypot(*(b - a))
    along = (to_a**2 - to_b**2 + d**2) / (2 * d)
    across = np.sqrt(max(to_a**2 - along**2, 0.0))
    u = (b - a) / d
    return a + along * u + side * across * np.array([-u[1], u[0]])


FOUR_BAR = {"crank": "O2 A", "coupler": "A B", "rocker": "O4 B"}


def four_bar(
    crank: float,
    coupler: float,
    rocker: float,
    ground: float,
    *,
    side: int = 1,
    ground_deg: float = 0.0,
    sketch_deg: float | None = None,
) -> dict[str, Any]:
    """A four-bar's tables; the sketch is drawn at a crank angle where it can be assembled."""
    turn = np.deg2rad(ground_deg)
    far = [ground * np.cos(turn), ground * np.sin(turn)]

    def pin(degrees: float) -> list[float]:
        return [crank * np.cos(np.deg2rad(degrees)), crank * np.sin(np.deg2rad(degrees))]

    def reached(degrees: float) -> bool:
        d = np.hypot(far[0] - pin(degrees)[0], far[1] - pin(degrees)[1])
        return abs(coupler - rocker) + 0.05 < d < coupler + rocker - 0.05

    a = pin(next(filter(reached, range(15, 360, 15))) if sketch_deg is None else sketch_deg)
    joints = {"O2": [0, 0], "A": a, "O4": far}
    joints["B"] = circle_meet(a, far, coupler, rocker, side).tolist()
    lengths = {"ground": ground, "crank": crank, "coupler": coupler, "rocker": rocker}
    inputs = [{"name": "crank", "body": "crank", "relative_to": "world"}]
    return tables_of(joints, "O2 O4", FOUR_BAR, lengths, inputs=inputs)


def slider_crank(
    crank: float, rod: float, offset: float, *, sign: int = 1, at: float = 1.0
) -> dict[str, Any]:
    """A slider-crank's tables, its slide towards +x for ``sign`` +1."""
    a = [crank * np.cos(at), crank * np.sin(at)]
    c = [a[0] + sign * np.sqrt(rod**2 - (a[1] - offset) ** 2), offset]
    sliders = [{"joint": "C", "on": "ground", "line": [[0, offset], [1, offset]]}]
    lengths = {"crank": crank, "rod": rod}
    bodies = {"crank": "O2 A", "rod": "A C"}
    return tables_of({"O2": [0, 0], "A": a, "C": c}, "O2", bodies, lengths, sliders=sliders)


# The finger's proportions without exact lengths: the sketch has them.
SKETCHED_FOUR_BAR = tables_of(
    {"O2": [0, 0], "A": [30, 26], "B": [143, 67], "O4": [100, 0]}, "O2 O4", FOUR_BAR
)
PUSHED = tables_of(
    {"O": [0, 0], "A": [20, 35], "C": [127, -20]},
    "O",
    {"crank": "O A", "rod": "A C"},
    sliders=[{"joint": "C", "on": "ground", "line": [[0, -20], [1, -20]]}],
    inputs=[{"name": "push", "slider": "C"}],
)


def pin_in_two_slots(height: float) -> dict[str, Any]:
    """A pin on no body (PRP): in a slot of a turning arm through O, and in a level one."""
    sliders = [
        {"joint": "P", "on": "arm", "line": [[0, 0], [2 * height, height]]},
        {"joint": "P", "on": "ground", "line": [[0, height], [1, height]]},
    ]
    joints = {"O": [0, 0], "T": [4 * height, 2 * height], "P": [2 * height, height]}
    inputs = [{"name": "arm", "body": "arm"}]
    return tables_of(joints, "O", {"arm": "O T"}, sliders=sliders, inputs=inputs)
