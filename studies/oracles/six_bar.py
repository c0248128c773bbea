"""A Stephenson six-bar without a closed form, by small steps from its sketch and Newton's method.

The equations are written out a second time: three lengths and the rod's, in the places of the
pins A and B. From the sketch they are followed in steps of `STEP` in float64, and the pose is then
solved to `PLACES` digits. Where the linkage locks, the equations' determinant vanishes; that input
is found to the same digits.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import mpmath
import numpy as np

from studies.oracles.linkages import Arithmetic, Exact, Formula

INPUTS = (
    *("o2_x", "o2_y", "o4_x", "o4_y", "o6_x", "o6_y"),
    *("left", "coupler", "p_x", "p_y", "right", "rod", "crank", "angle"),
)
STEP = 0.02
"""Of the crank, rad, between poses that are followed in float64."""

PLACES = 100
"""Digits of a solution; as many again as the study's, as it is differenced twice."""

FOLLOWED = 1e-2
"""Distance from lock-up down to which small steps are trusted, rad."""

Number = Any
Functions = tuple[Callable[[Number], Number], Callable[[Number], Number]]


class Follower:
    """Poses of one six-bar from its sketch on, with the crank turning one way or the other.

    Attributes:
        home: the crank's angle in the sketch, rad.
        poses: places of A and B at angles `STEP` apart from ``home`` on, by number of steps.
        lock: angle at which it locks when the crank turns forward, mpmath; none if it turns fully.
    """

    def __init__(self, row: np.ndarray, home: float, sketch: np.ndarray) -> None:
        self.home = home
        self._row = row
        self.poses = [_newton_floats(row, home, sketch)]
        sign = np.sign(_determinant(row, home, self.poses[0]))
        turns = True
        while turns and len(self.poses) * STEP < 2 * np.pi:
            angle = home + len(self.poses) * STEP
            pose = _newton_floats(row, angle, self.poses[-1])
            near = np.max(abs(pose - self.poses[-1])) < 0.2 * row[7]
            turns = bool(near and np.sign(_determinant(row, angle, pose)) == sign)
            if turns:
                self.poses.append(pose)
        self.lock = None
        if not turns:
            with mpmath.workdps(PLACES):
                self.lock, self._locked, self._opening = self._find_lock()

    def start(self, angle: Number) -> list[Number]:
        """A pose near that at an angle (mpmath), from which Newton's method finds it."""
        # A crank that turns fully comes back to the same poses.
        passed = mpmath.fmod(angle - self.home, 2 * mpmath.pi)
        if self.lock is None:
            return list(map(mpmath.mpf, self.poses[int(passed / STEP) % len(self.poses)]))
        left = abs(self.lock - angle)
        if left > FOLLOWED:
            return list(map(mpmath.mpf, self.poses[min(int(passed / STEP), len(self.poses) - 1)]))
        root = mpmath.sqrt(left)
        return [at + root * slope for at, slope in zip(self._locked, self._opening, strict=True)]

    def _find_lock(self) -> tuple[Number, list[Number], list[Number]]:
        row = [mpmath.mpf(float(value)) for value in self._row]

        def equations(*unknowns: Number) -> list[Number]:
            pose, angle = list(unknowns[:4]), unknowns[4]
            matrix = _columns(row, angle, pose)
            return [*_gaps([*row[:-1], angle], pose, _MP), mpmath.det(matrix) / row[7] ** 4]

        last = self.home + (len(self.poses) - 1) * STEP
        with mpmath.workdps(30):
            rough = mpmath.findroot(equations, [*map(mpmath.mpf, self.poses[-1]), last + STEP / 4])
        found = list(mpmath.findroot(equations, list(rough), tol=mpmath.mpf(10) ** (-PLACES + 10)))
        lock, locked = found[4], found[:4]
        # Before lock-up the pose differs from the locked one as the root of what is left.
        steps = int((lock - mpmath.mpf(2) * FOLLOWED - self.home) / STEP)
        left = lock - (self.home + steps * STEP)
        opening = [
            (mpmath.mpf(value) - at) / mpmath.sqrt(left)
            for value, at in zip(self.poses[steps], locked, strict=True)
        ]
        return lock, locked, opening


_FLOATS: Functions = (np.cos, np.sin)
_MP: Functions = (mpmath.cos, mpmath.sin)


def _place_p(row: Any, pose: Any) -> tuple[Number, Number]:
    b_x, b_y = pose[2] - pose[0], pose[3] - pose[1]
    across, up = row[8] / row[7], row[9] / row[7]
    return pose[0] + across * b_x - up * b_y, pose[1] + across * b_y + up * b_x


def _gaps(row: Any, pose: Any, functions: Functions) -> list[Number]:
    """What the four lengths miss, as differences of squares (mm²)."""
    p_x, p_y = _place_p(row, pose)
    d_x, d_y = row[4] + row[12] * functions[0](row[13]), row[5] + row[12] * functions[1](row[13])
    return [
        (pose[0] - row[0]) ** 2 + (pose[1] - row[1]) ** 2 - row[6] ** 2,
        (pose[2] - row[2]) ** 2 + (pose[3] - row[3]) ** 2 - row[10] ** 2,
        (pose[2] - pose[0]) ** 2 + (pose[3] - pose[1]) ** 2 - row[7] ** 2,
        (p_x - d_x) ** 2 + (p_y - d_y) ** 2 - row[11] ** 2,
    ]


def _rod(row: Any, angle: Number, pose: Any, functions: Functions) -> tuple[Number, Number]:
    p_x, p_y = _place_p(row, pose)
    return (
        p_x - row[4] - row[12] * functions[0](angle),
        p_y - row[5] - row[12] * functions[1](angle),
    )


def _rows_of_slopes(row: Any, angle: Number, pose: Any, functions: Functions) -> list[list[Number]]:
    """Derivatives of `_gaps` with respect to the places of A and B."""
    x, y = _rod(row, angle, pose, functions)
    across, up = row[8] / row[7], row[9] / row[7]
    a_x, a_y, b_x, b_y = pose
    return [
        [2 * (a_x - row[0]), 2 * (a_y - row[1]), 0 * a_x, 0 * a_x],
        [0 * a_x, 0 * a_x, 2 * (b_x - row[2]), 2 * (b_y - row[3])],
        [2 * (a_x - b_x), 2 * (a_y - b_y), 2 * (b_x - a_x), 2 * (b_y - a_y)],
        [
            2 * (x * (1 - across) - y * up),
            2 * (x * up + y * (1 - across)),
            2 * (x * across + y * up),
            2 * (y * across - x * up),
        ],
    ]


def _columns(row: Any, angle: Number, pose: Any) -> Any:
    return mpmath.matrix(_rows_of_slopes(row, angle, pose, _MP))


def _determinant(row: np.ndarray, angle: float, pose: np.ndarray) -> float:
    return float(np.linalg.det(np.array(_rows_of_slopes(row, angle, pose, _FLOATS))))


def _newton_floats(row: np.ndarray, angle: float, pose: np.ndarray) -> np.ndarray:
    given = [*row[:-1], angle]
    for _ in range(8):
        slopes = np.array(_rows_of_slopes(row, angle, pose, _FLOATS))
        pose = pose - np.linalg.solve(slopes, np.array(_gaps(given, pose, _FLOATS)))
    return pose


class SixBar:
    """Exact poses and gradients of six-bars that are assembled as one sketch, case by case.

    Args:
        home: the crank's angle in the sketch, rad.
        sketch: places of A and B there, shape (4,).
    """

    def __init__(self, home: float, sketch: np.ndarray) -> None:
        self._home, self._sketch = home, sketch
        self._starts: dict[tuple[float, ...], list[Number]] = {}

    @property
    def formula(self) -> Formula:
        """It, beside those of other linkages."""
        return Formula(INPUTS, self, six_bar_gaps, (0, 2, 4), closed_form=False)

    @functools.lru_cache  # noqa: B019 - one six-bar lives as long as its study
    def follower(self, dimensions: tuple[float, ...]) -> Follower:
        """The six-bar of these dimensions (a row without its angle), followed once."""
        row = np.array([*dimensions, self._home])
        return Follower(row, self._home, self._sketch)

    def __call__(self, arithmetic: Arithmetic, inputs: np.ndarray, sides: np.ndarray) -> Exact:
        """Exact joint P; the margin is how far the crank is from lock-up, in radians.

        Args:
            arithmetic: ignored, as poses are solved in mpmath numbers.
            inputs: shape (cases, 14), in the order of `INPUTS`.
            sides: ignored, as the sketch chooses the assembly.
        """
        with mpmath.workdps(PLACES):
            found = [self._one([mpmath.mpf(value) for value in row]) for row in inputs]
        values, gradients, margins = zip(*found, strict=True)
        ones = np.array([mpmath.mpf(1)] * len(found), object)
        return Exact(np.array(values), np.array(gradients), np.array(margins), ones)

    def locking(self, row: np.ndarray, crank: float) -> np.ndarray:
        """A row with another crank, and a rod for which the sketch still holds."""
        pose = self.follower(tuple(row[:-1].tolist())).poses[0]
        row = row.copy()
        row[12] = crank
        row[11] = np.hypot(*_rod(row, row[13], pose, _FLOATS))
        return row

    def _one(self, row: list[Number]) -> tuple[list[Number], list[list[Number]], Number]:
        # Rows that differ only in the last digits share what they start from.
        near = tuple(float(value) for value in row)
        follower = self.follower(near[:-1])
        margin = 1 * mpmath.mpf(1) if follower.lock is None else follower.lock - row[-1]
        if margin <= 0:
            return [row[0] * 0] * 2, [[row[0] * 0] * len(row)] * 2, margin
        pose = self._starts[near] if near in self._starts else follower.start(row[-1])
        size, reached = row[7] ** 2, mpmath.mpf(10) ** (8 - PLACES)
        for _ in range(60):
            gaps = _gaps(row, pose, _MP)
            if max(map(abs, gaps)) < reached * size:
                break
            step = mpmath.lu_solve(_columns(row, row[-1], pose), mpmath.matrix(gaps))
            pose = [value - change for value, change in zip(pose, step, strict=True)]
        self._starts.setdefault(near, pose)
        slopes = zip(*self._slopes(row, pose), strict=True)
        return list(_place_p(row, pose)), list(map(list, slopes)), margin

    @staticmethod
    def _slopes(row: list[Number], pose: list[Number]) -> list[list[Number]]:
        """Derivatives of P with respect to every entry of the row, by implicit differentiation."""
        inverse = mpmath.inverse(_columns(row, row[-1], pose))
        step = mpmath.mpf(10) ** (-PLACES // 3)
        slopes = []
        for entry in range(len(row)):
            ends = []
            for sign in (1, -1):
                moved = list(row)
                moved[entry] += sign * step
                ends.append(mpmath.matrix([*_gaps(moved, pose, _MP), *_place_p(moved, pose)]))
            change = (ends[0] - ends[1]) / (2 * step)
            moved_pose = -inverse * change[:4, 0]
            # P is linear in the places of A and B, so that their change gives its own.
            by_pose = _place_p(row, list(moved_pose))
            slopes.append([by_pose[0] + change[4], by_pose[1] + change[5]])
        return slopes


def six_bar_gaps(inputs: np.ndarray, crank_pin: np.ndarray, last: np.ndarray) -> np.ndarray:
    """How far D misses the crank's length and P the rod's, in units of the rod."""
    crank = np.hypot(*(crank_pin - inputs[:, 4:6]).T) - inputs[:, 12]
    rod = np.hypot(*(last - crank_pin).T) - inputs[:, 11]
    return np.maximum(abs(crank), abs(rod)) / inputs[:, 11]
