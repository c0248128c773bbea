"""Families of extreme linkages, and the random ones.

Every family is built for one float type: lengths that are to leave a certain margin are computed
from what is left of the others after rounding.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from studies.oracles.linkages import extended
from studies.stability.linkage.mechanisms import six_bar

SIZE = 100.0
"""Ground or crank of most families, mm."""

FAR = 1e8
"""Distance of a far origin, mm."""

TURNS = 1e6
"""Largest number of turns of a crank."""

LEAST_MARGIN = 1e-16
"""How near lock-up is approached, in units of the linkage's size."""

TRIADS = 10
"""Six-bars in a family; exact poses and their second derivatives take a tenth of a second each."""

LONG_CRANK = 60.0
"""Length of a six-bar's crank that cannot turn fully, mm."""


class Cases(NamedTuple):
    """Cases that are extreme in one respect.

    Attributes:
        case: what is extreme in them.
        inputs: shape (cases, inputs), in the float type that is tested.
        sides: assembly of each case, ±1, shape (cases,).
    """

    case: str
    inputs: np.ndarray
    sides: np.ndarray


Column = float | np.ndarray


def _grids(count: int) -> tuple[np.ndarray, ...]:
    """What varies in the families, each of shape (cases,); the number of cases is even.

    Returns:
        Angles of a crank and of what is fixed, rad; steps towards a limit, of the linkage's size or
        in rad; ratios of one length to another; scales of all lengths; angles of whole turns of the
        crank, rad; assemblies, ±1.
    """
    side = np.resize([1.0, -1.0], count)
    return (
        np.linspace(-3.0, 3.0, count),
        np.linspace(0.1, 6.0, count),
        np.logspace(-1, np.log10(LEAST_MARGIN), count),
        np.logspace(-6, 6, count),
        np.logspace(-12, 12, count),
        2 * np.pi * np.round(np.logspace(0, np.log10(TURNS), count)) * side,
        side,
    )


def four_bars(dtype: str, count: int) -> Iterator[Cases]:
    """Families of four-bars.

    Args:
        dtype: float type.
        count: cases in each; even.
    """
    angle, tilt, steps, ratios, unit, turned, side = _grids(count)
    usual = {"ground": SIZE, "crank": 40.0, "coupler": 120.0, "rocker": 80.0}
    usual |= {"angle": angle, "tilted": 0.0, "far": 0.0}

    def cases(case: str, **given: Column) -> Cases:
        ground, crank, coupler, rocker, angle, tilted, far = (usual | given).values()
        o4 = (far + ground * np.cos(tilted), ground * np.sin(tilted) - far)
        columns = (far, -np.asarray(far), *o4, crank, coupler, rocker, angle)
        return Cases(f"four-bar, {case}", _columns(columns, dtype), side)

    def triangle(case: str, stretched: bool, margins: np.ndarray) -> Cases:
        # The last length is chosen for the margin that the rounded others leave.
        start = cases(case, tilted=tilt, rocker=0.55 * SIZE)
        inputs = extended(start.inputs)
        arm = inputs[:, 2:4] - inputs[:, :2]
        arm = arm - inputs[:, 4:5] * np.stack([np.cos(inputs[:, 7]), np.sin(inputs[:, 7])], axis=1)
        apart, rocker = np.hypot(arm[:, 0], arm[:, 1]), inputs[:, 6]
        reached = apart - rocker + margins * SIZE if stretched else apart + rocker - margins * SIZE
        start.inputs[:, 5] = abs(reached).astype(dtype)
        return start

    def gap(crank: Column) -> np.ndarray:
        x, y = SIZE * np.cos(tilt) - crank * np.cos(angle), SIZE * np.sin(tilt)
        return np.hypot(x, y - crank * np.sin(angle))

    yield cases("crank-rocker of the gallery", tilted=tilt)
    for name in ("stretching", "folding"):
        yield triangle(f"{name}: margin 1e-1 to 1e-16", name == "stretching", steps)
        yield triangle(f"{name}: margin −1e-1 to −1e-16", name == "stretching", -steps)
    change, same = "to 1e-16 rad from change", {"crank": SIZE, "rocker": 70.0}
    flat = np.where(np.arange(count) % 4 < 2, 0.0, np.pi) + steps
    yield cases(f"parallelogram {change}", coupler=SIZE, rocker=40.0, angle=flat)
    yield cases(f"kite {change}", **same, coupler=70.0, angle=steps)
    near = 70.0 + SIZE * steps / 2
    yield cases("A to 1e-16 from O4, coupler ≈ rocker", **same, coupler=near, angle=steps)
    yield cases(f"rhombus {change}", crank=SIZE, coupler=SIZE, rocker=SIZE, angle=flat)
    apart, arm = gap(40.0), gap(ratios * SIZE)
    for long, short, sign in (("coupler", "rocker", 1), ("rocker", "coupler", -1)):
        lengths = {long: ratios * apart, short: apart * abs(1 + sign * 0.3 * ratios)}
        yield cases(f"{long} 1e-6 to 1e6 of the gap", tilted=tilt, **lengths)
    lengths = {"crank": ratios * SIZE, "coupler": 0.8 * arm, "rocker": 0.9 * arm}
    yield cases("crank 1e-6 to 1e6 of the ground", tilted=tilt, **lengths)
    scaled = {name: unit * length for name, length in list(usual.items())[:4]}
    yield cases("all lengths 1e-10 to 1e14 mm", tilted=tilt, **scaled)
    yield cases("origin 1e8 mm away", tilted=tilt, far=FAR)
    yield cases("crank at 1 to 1e6 turns", tilted=tilt, angle=turned + angle)
    # Whole numbers whose sums are exact: tangent from outside, then from inside.
    parts = np.linspace(5, 55, count).round()
    tangent = np.where(np.arange(count) % 4 < 2, 60 - parts, 60 + parts)
    line = {"coupler": parts, "rocker": tangent, "angle": 0.0}
    yield cases("joints in one line: circles exactly tangent", **line)
    kinds = np.arange(count) // 2 % 6
    yield cases(
        "coincident joints: links of length 0",
        tilted=np.where(kinds < 4, tilt, 0.0),
        ground=np.choose(kinds, [SIZE, 0.0, SIZE, SIZE, SIZE, 0.0]),
        crank=np.choose(kinds, [0.0, 40.0, 40.0, 40.0, SIZE, 0.0]),
        coupler=np.where(kinds == 3, apart, np.choose(kinds, [80.0, 80.0, 0.0, 0.0, 70.0, 0.0])),
        rocker=np.where(kinds == 2, apart, np.choose(kinds, [70.0, 70.0, 0.0, 0.0, 70.0, 0.0])),
        angle=np.where(kinds < 4, angle, 0.0),
    )


def slider_cranks(dtype: str, count: int) -> Iterator[Cases]:
    """Families of slider-cranks; otherwise as `four_bars`."""
    angle, tilt, steps, ratios, unit, turned, side = _grids(count)
    usual = {"crank": 40.0, "rod": 120.0, "offset": 20.0, "along": 30.0}
    usual |= {"angle": angle, "tilted": 0.0, "far": 0.0}

    def cases(case: str, **given: Column) -> Cases:
        crank, rod, offset, along, angle, tilted, far = (usual | given).values()
        cosine, sine = np.cos(tilted), np.sin(tilted)
        point = (far + along * cosine - offset * sine, along * sine + offset * cosine - far)
        columns = (far, -np.asarray(far), crank, rod, *point, tilted, angle)
        return Cases(f"slider-crank, {case}", _columns(columns, dtype), side)

    def reaching(case: str, margins: np.ndarray) -> Cases:
        start = cases(case, tilted=tilt, crank=SIZE)
        o2_x, o2_y, crank, _, point_x, point_y, direction, angle = extended(start.inputs).T
        a_x, a_y = o2_x + crank * np.cos(angle) - point_x, o2_y + crank * np.sin(angle) - point_y
        across = abs(np.cos(direction) * a_y - np.sin(direction) * a_x)
        start.inputs[:, 3] = abs(across + margins * SIZE).astype(dtype)
        return start

    yield cases("that of the gallery", tilted=tilt)
    yield reaching("margin 1e-1 to 1e-16", steps)
    yield reaching("margin −1e-1 to −1e-16", -steps)
    yield cases("zero offset", offset=0.0)
    change = {"offset": 0.0, "rod": 40.0, "along": 0.0, "angle": np.pi / 2 + steps}
    yield cases("rod = crank to 1e-16 rad from change", **change)
    lean = np.sin(angle - tilt)
    rod = {"crank": SIZE, "rod": SIZE * ratios, "offset": SIZE * (lean + 0.3 * ratios)}
    yield cases("rod 1e-6 to 1e6 of the crank", tilted=tilt, **rod)
    crank = {"crank": 120 * ratios, "offset": 120 * (ratios * lean + 0.3)}
    yield cases("crank 1e-6 to 1e6 of the rod", tilted=tilt, **crank)
    scaled = {name: unit * length for name, length in list(usual.items())[:4]}
    yield cases("all lengths 1e-10 to 1e14 mm", tilted=tilt, **scaled)
    yield cases("origin 1e8 mm away", tilted=tilt, far=FAR)
    yield cases("line's point 1e8 mm along it", along=FAR)
    yield cases("crank at 1 to 1e6 turns", tilted=tilt, angle=turned + angle)
    parts = np.linspace(10, 35, count).round()
    line = {"crank": 40.0, "offset": parts, "angle": 0.0, "rod": parts}
    yield cases("joints in one line: circle exactly tangent", **line)
    kinds = np.arange(count) // 2 % 3
    yield cases(
        "coincident joints: links of length 0",
        crank=np.choose(kinds, [0.0, 40.0, 0.0]),
        rod=np.choose(kinds, [120.0, 0.0, 0.0]),
        offset=np.choose(kinds, [20.0, 0.0, 0.0]),
        angle=np.where(kinds == 1, 0.0, angle),
        along=0.0,
    )


def six_bars(dtype: str) -> Iterator[Cases]:
    """The gallery's six-bar through large steps of its input, and up to where one locks."""
    mechanism, oracle = six_bar()
    row = mechanism.sketched_row()
    home = float(row[-1])

    def cases(case: str, row: np.ndarray, angles: np.ndarray) -> Cases:
        rows = np.repeat(row[None].astype(dtype), TRIADS, axis=0)
        rows[:, -1] = angles
        return Cases(f"six-bar{case}", rows, np.ones(TRIADS))

    within = np.linspace(-6.2, 6.2, TRIADS)
    yield cases(", crank within a turn of the sketch", row, home + within)
    _, _, steps, _, _, turned, _ = _grids(TRIADS)
    yield cases(", crank 1 to 1e6 turns from the sketch", row, home + 1 + abs(turned))
    row = oracle.locking(row, LONG_CRANK)
    lock = oracle.follower(tuple(row[:-1].astype(dtype).astype(float).tolist())).lock
    for sign, ends in ((1, "1e-1 to 1e-16"), (-1, "−1e-1 to −1e-16")):
        angles = np.array([float(lock - sign * step) for step in steps])
        yield cases(f" that locks: margin {ends} rad", row, angles)


def random_four_bars(dtype: str, count: int, decades: float, seed: int) -> Cases:
    """Four-bars with log-uniform lengths, most of which cannot be assembled as they are driven.

    Args:
        dtype: float type.
        count: how many.
        decades: spread of the lengths.
        seed: of the draw.
    """
    random = np.random.default_rng(seed)
    lengths = _lengths(random, count, decades)
    tilt, angle = random.uniform(-np.pi, np.pi, (2, count))
    o2 = random.normal(0, SIZE, (2, count))
    o4 = o2 + lengths[0] * np.stack([np.cos(tilt), np.sin(tilt)])
    inputs = _columns((*o2, *o4, *lengths[1:], angle), dtype)
    return Cases("four-bar, random", inputs, random.choice([-1.0, 1.0], count))


def random_slider_cranks(dtype: str, count: int, decades: float, seed: int) -> Cases:
    """Slider-cranks with log-uniform lengths and offsets; otherwise `random_four_bars`."""
    random = np.random.default_rng(seed + 1)
    crank, rod, offset, along = _lengths(random, count, decades)
    offset, along = random.choice([-1.0, 1.0], (2, count)) * (offset, along)
    direction, angle = random.uniform(-np.pi, np.pi, (2, count))
    o2 = random.normal(0, SIZE, (2, count))
    cosine, sine = np.cos(direction), np.sin(direction)
    point = o2 + np.stack([along * cosine - offset * sine, along * sine + offset * cosine])
    inputs = _columns((*o2, crank, rod, *point, direction, angle), dtype)
    return Cases("slider-crank, random", inputs, random.choice([-1.0, 1.0], count))


def _lengths(random: np.random.Generator, count: int, decades: float) -> np.ndarray:
    return SIZE * 10 ** random.uniform(-decades / 2, decades / 2, (4, count))


def _columns(columns: tuple[Column, ...], dtype: str) -> np.ndarray:
    return np.stack(np.broadcast_arrays(*columns), axis=1).astype(dtype)
