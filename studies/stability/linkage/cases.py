"""Families of extreme four-bars and slider-cranks, and the random ones.

Every family is built for one float type: lengths that are to leave a certain margin are computed
from what is left of the others after rounding.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from studies.oracles.linkages import EXTENDED

SIZE = 100.0
"""Ground or crank of most families, mm."""

FAR = 1e8
"""Distance of a far origin, mm."""

TURNS = 1e6
"""Largest number of turns of a crank."""

LEAST_MARGIN = 1e-16
"""How near lock-up is approached, in units of the linkage's size."""


@dataclass(frozen=True)
class Cases:
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


def four_bars(dtype: str, count: int) -> Iterator[Cases]:
    """Families of four-bars.

    Args:
        dtype: float type.
        count: cases in each; even.
    """
    angles = np.linspace(-3.0, 3.0, count)
    tilt = np.linspace(0.1, 6.0, count)
    steps = np.logspace(-1, np.log10(LEAST_MARGIN), count)
    ratios = np.logspace(-6, 6, count)

    def cases(
        case: str,
        *,
        ground: Column = SIZE,
        crank: Column = 40.0,
        coupler: Column = 120.0,
        rocker: Column = 80.0,
        angle: Column = angles,
        tilted: Column = 0.0,
        far: Column = 0.0,
    ) -> Cases:
        o4 = (far + ground * np.cos(tilted), ground * np.sin(tilted) - far)
        columns = (far, -np.asarray(far), *o4, crank, coupler, rocker, angle)
        return Cases(case, _columns(columns, dtype), _both(count))

    def triangle(case: str, third: str, margins: np.ndarray) -> Cases:
        # The last length is chosen for the margin that the rounded others leave.
        start = cases(case, tilted=tilt, rocker=0.55 * SIZE)
        inputs = EXTENDED.number(start.inputs)
        arm = inputs[:, 2:4] - inputs[:, :2]
        arm = arm - inputs[:, 4:5] * np.stack([np.cos(inputs[:, 7]), np.sin(inputs[:, 7])], axis=1)
        apart, rocker = np.hypot(arm[:, 0], arm[:, 1]), inputs[:, 6]
        reached = apart - rocker if third == "stretched" else apart + rocker
        sign = 1 if third == "stretched" else -1
        start.inputs[:, 5] = (abs(reached + sign * margins * SIZE)).astype(dtype)
        return start

    yield cases("four-bar, crank-rocker of the gallery", tilted=tilt)
    for name, third in (("stretching", "stretched"), ("folding", "folded")):
        yield triangle(f"four-bar, {name}: margin 1e-1 to 1e-16", third, steps)
        yield triangle(f"four-bar, {name}: margin −1e-1 to −1e-16", third, -steps)
    turned = np.where(np.arange(count) % 4 < 2, 0.0, np.pi) + steps
    yield cases(
        "four-bar, parallelogram to 1e-16 rad from change", coupler=SIZE, rocker=40.0, angle=turned
    )
    yield cases(
        "four-bar, kite to 1e-16 rad from change",
        crank=SIZE,
        coupler=70.0,
        rocker=70.0,
        angle=steps,
    )
    gaps = SIZE * steps
    shorter = np.asarray(70.0, dtype) * np.ones(count)
    yield cases(
        "four-bar, A to 1e-16 from O4, coupler ≈ rocker",
        crank=SIZE,
        coupler=shorter + gaps / 2,
        rocker=shorter,
        angle=steps,
    )
    yield cases(
        "four-bar, rhombus to 1e-16 rad from change",
        crank=SIZE,
        coupler=SIZE,
        rocker=SIZE,
        angle=turned,
    )
    apart = np.hypot(
        SIZE * np.cos(tilt) - 40 * np.cos(angles), SIZE * np.sin(tilt) - 40 * np.sin(angles)
    )
    yield cases(
        "four-bar, coupler 1e-6 to 1e6 of the gap",
        tilted=tilt,
        coupler=ratios * apart,
        rocker=apart * abs(1 + 0.3 * ratios),
    )
    yield cases(
        "four-bar, rocker 1e-6 to 1e6 of the gap",
        tilted=tilt,
        rocker=ratios * apart,
        coupler=apart * abs(1 - 0.3 * ratios),
    )
    arm = np.hypot(
        SIZE * np.cos(tilt) - ratios * SIZE * np.cos(angles),
        SIZE * np.sin(tilt) - ratios * SIZE * np.sin(angles),
    )
    yield cases(
        "four-bar, crank 1e-6 to 1e6 of the ground",
        tilted=tilt,
        crank=ratios * SIZE,
        coupler=0.8 * arm,
        rocker=0.9 * arm,
    )
    unit = np.logspace(-12, 12, count)
    yield cases(
        "four-bar, all lengths 1e-10 to 1e14 mm",
        tilted=tilt,
        ground=SIZE * unit,
        crank=40 * unit,
        coupler=120 * unit,
        rocker=80 * unit,
    )
    yield cases("four-bar, origin 1e8 mm away", tilted=tilt, far=FAR)
    turns = 2 * np.pi * np.round(np.logspace(0, np.log10(TURNS), count)) * _both(count)
    yield cases("four-bar, crank at 1 to 1e6 turns", tilted=tilt, angle=turns + angles)
    # Whole numbers whose sums are exact: tangent from outside, then from inside.
    parts = np.linspace(5, 55, count).round()
    tangent = np.where(np.arange(count) % 4 < 2, 60 - parts, 60 + parts)
    yield cases(
        "four-bar, joints in one line: circles exactly tangent",
        coupler=parts,
        rocker=tangent,
        angle=0.0,
    )
    kinds = np.arange(count) // 2 % 6
    yield cases(
        "four-bar, coincident joints: links of length 0",
        tilted=np.where(kinds < 4, tilt, 0.0),
        ground=np.choose(kinds, [SIZE, 0.0, SIZE, SIZE, SIZE, 0.0]),
        crank=np.choose(kinds, [0.0, 40.0, 40.0, 40.0, SIZE, 0.0]),
        coupler=np.where(kinds == 3, apart, np.choose(kinds, [80.0, 80.0, 0.0, 0.0, 70.0, 0.0])),
        rocker=np.where(kinds == 2, apart, np.choose(kinds, [70.0, 70.0, 0.0, 0.0, 70.0, 0.0])),
        angle=np.where(kinds < 4, angles, 0.0),
    )


def slider_cranks(dtype: str, count: int) -> Iterator[Cases]:
    """Families of slider-cranks; otherwise as `four_bars`."""
    angles = np.linspace(-3.0, 3.0, count)
    tilt = np.linspace(0.1, 6.0, count)
    steps = np.logspace(-1, np.log10(LEAST_MARGIN), count)
    ratios = np.logspace(-6, 6, count)

    def cases(
        case: str,
        *,
        crank: Column = 40.0,
        rod: Column = 120.0,
        offset: Column = 20.0,
        angle: Column = angles,
        tilted: Column = 0.0,
        far: Column = 0.0,
        along: Column = 30.0,
    ) -> Cases:
        cosine, sine = np.cos(tilted), np.sin(tilted)
        point = (far + along * cosine - offset * sine, along * sine + offset * cosine - far)
        columns = (far, -np.asarray(far), crank, rod, *point, tilted, angle)
        return Cases(case, _columns(columns, dtype), _both(count))

    def reaching(case: str, margins: np.ndarray) -> Cases:
        start = cases(case, tilted=tilt, crank=SIZE)
        o2_x, o2_y, crank, _, point_x, point_y, direction, angle = EXTENDED.number(start.inputs).T
        a_x, a_y = o2_x + crank * np.cos(angle) - point_x, o2_y + crank * np.sin(angle) - point_y
        across = abs(np.cos(direction) * a_y - np.sin(direction) * a_x)
        start.inputs[:, 3] = abs(across + margins * SIZE).astype(dtype)
        return start

    yield cases("slider-crank, that of the gallery", tilted=tilt)
    yield reaching("slider-crank, margin 1e-1 to 1e-16", steps)
    yield reaching("slider-crank, margin −1e-1 to −1e-16", -steps)
    yield cases("slider-crank, zero offset", offset=0.0)
    yield cases(
        "slider-crank, rod = crank to 1e-16 rad from change",
        offset=0.0,
        rod=40.0,
        along=0.0,
        angle=np.pi / 2 + steps,
    )
    yield cases(
        "slider-crank, rod 1e-6 to 1e6 of the crank",
        tilted=tilt,
        crank=SIZE,
        rod=SIZE * ratios,
        offset=SIZE * (np.sin(angles - tilt) + 0.3 * ratios),
    )
    yield cases(
        "slider-crank, crank 1e-6 to 1e6 of the rod",
        tilted=tilt,
        crank=120 * ratios,
        offset=120 * (ratios * np.sin(angles - tilt) + 0.3),
    )
    unit = np.logspace(-12, 12, count)
    yield cases(
        "slider-crank, all lengths 1e-10 to 1e14 mm",
        tilted=tilt,
        crank=40 * unit,
        rod=120 * unit,
        offset=20 * unit,
        along=30 * unit,
    )
    yield cases("slider-crank, origin 1e8 mm away", tilted=tilt, far=FAR)
    yield cases("slider-crank, line's point 1e8 mm along it", along=FAR)
    turns = 2 * np.pi * np.round(np.logspace(0, np.log10(TURNS), count)) * _both(count)
    yield cases("slider-crank, crank at 1 to 1e6 turns", tilted=tilt, angle=turns + angles)
    yield cases(
        "slider-crank, joints in one line: circle exactly tangent",
        crank=40.0,
        offset=np.linspace(10, 35, count).round(),
        angle=0.0,
        rod=np.linspace(10, 35, count).round(),
    )
    kinds = np.arange(count) // 2 % 3
    yield cases(
        "slider-crank, coincident joints: links of length 0",
        crank=np.choose(kinds, [0.0, 40.0, 0.0]),
        rod=np.choose(kinds, [120.0, 0.0, 0.0]),
        offset=np.choose(kinds, [20.0, 0.0, 0.0]),
        angle=np.where(kinds == 1, 0.0, angles),
        along=0.0,
    )


def random_four_bars(dtype: str, count: int, decades: float, seed: int) -> Cases:
    """Four-bars with log-uniform lengths, most of which cannot be assembled as they are driven.

    Args:
        dtype: float type.
        count: how many.
        decades: spread of the lengths.
        seed: of the draw.
    """
    random = np.random.default_rng(seed)
    lengths = _lengths(random, (4, count), decades)
    tilt, angle = random.uniform(-np.pi, np.pi, (2, count))
    o2 = random.normal(0, SIZE, (2, count))
    o4 = o2 + lengths[0] * np.stack([np.cos(tilt), np.sin(tilt)])
    inputs = _columns((*o2, *o4, *lengths[1:], angle), dtype)
    return Cases("four-bar, random", inputs, random.choice([-1.0, 1.0], count))


def random_slider_cranks(dtype: str, count: int, decades: float, seed: int) -> Cases:
    """Slider-cranks with log-uniform lengths and offsets; otherwise `random_four_bars`."""
    random = np.random.default_rng(seed + 1)
    crank, rod, offset, along = _lengths(random, (4, count), decades)
    offset, along = random.choice([-1.0, 1.0], (2, count)) * (offset, along)
    direction, angle = random.uniform(-np.pi, np.pi, (2, count))
    o2 = random.normal(0, SIZE, (2, count))
    cosine, sine = np.cos(direction), np.sin(direction)
    point = o2 + np.stack([along * cosine - offset * sine, along * sine + offset * cosine])
    inputs = _columns((*o2, crank, rod, *point, direction, angle), dtype)
    return Cases("slider-crank, random", inputs, random.choice([-1.0, 1.0], count))


def _lengths(random: np.random.Generator, shape: tuple[int, int], decades: float) -> np.ndarray:
    return SIZE * 10 ** random.uniform(-decades / 2, decades / 2, shape)


def _columns(columns: tuple[Column, ...], dtype: str) -> np.ndarray:
    return np.stack(np.broadcast_arrays(*columns), axis=1).astype(dtype)


def _both(count: int) -> np.ndarray:
    return np.resize([1.0, -1.0], count)
