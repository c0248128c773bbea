"""A Stephenson six-bar without a closed form, by small steps from its sketch and Newton's method.

The equations are written out a second time: three lengths and the rod's, in the places of the
pins A and B. From the sketch they are followed in steps of `STEP` in float64, and the pose is then
solved to `PLACES` digits. Where the linkage locks, the equations' determinant vanishes; that input
is found to the same digits.
"""

from __future__ import annotations

import functools
from typing import Any

import mpmath
import numpy as np

from studies.oracles.linkages import Exact, Formula, digits, direction, left

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


class Follower:
    """Poses of one six-bar from its sketch on, with the crank turning one way or the other.

    Attributes:
        home: the crank's angle in the sketch, rad.
        poses: places of A and B at angles `STEP` apart from ``home`` on, by number of steps.
        lock: angle at which it locks when the crank turns forward, mpmath; none if it turns fully.
    """

    def __init__(self, row: np.ndarray, sketch: np.ndarray) -> None:
        self._row, self.home = row, float(row[-1])
        self.poses = [_newton(row, sketch, 8)]
        self.lock, sign = None, np.sign(np.linalg.det(_by_pose(row, self.poses[0])))
        while self.lock is None and len(self.poses) * STEP < 2 * np.pi:
            there = np.append(row[:-1], self.home + len(self.poses) * STEP)
            pose = _newton(there, self.poses[-1], 8)
            near = np.max(abs(pose - self.poses[-1])) < 0.2 * row[7]
            if near and np.sign(np.linalg.det(_by_pose(there, pose))) == sign:
                self.poses.append(pose)
            else:
                with mpmath.workdps(PLACES):
                    self.lock, self._locked, self._opening = self._find_lock()

    def start(self, angle: Number) -> np.ndarray:
        """A pose near that at an angle (mpmath), from which Newton's method finds it."""
        remaining = np.inf if self.lock is None else abs(self.lock - angle)
        if remaining <= FOLLOWED:
            return self._locked + mpmath.sqrt(remaining) * self._opening
        # A crank that turns fully comes back to the same poses.
        steps, poses = int(mpmath.fmod(angle - self.home, 2 * mpmath.pi) / STEP), len(self.poses)
        return digits(self.poses[steps % poses if self.lock is None else min(steps, poses - 1)])

    def _find_lock(self) -> tuple[Number, np.ndarray, np.ndarray]:
        row = digits(self._row)

        def equations(*unknowns: Number) -> list[Number]:
            there, pose = np.append(row[:-1], unknowns[4]), np.array(unknowns[:4])
            determinant = mpmath.det(mpmath.matrix(_by_pose(there, pose).tolist()))
            return [*_gaps(there, pose), determinant / row[7] ** 4]

        last = self.home + (len(self.poses) - 1) * STEP
        with mpmath.workdps(30):
            rough = mpmath.findroot(equations, [*map(mpmath.mpf, self.poses[-1]), last + STEP / 4])
        found = list(mpmath.findroot(equations, list(rough), tol=mpmath.mpf(10) ** (-PLACES + 10)))
        lock, locked = found[4], np.array(found[:4])
        # Before lock-up the pose differs from the locked one as the root of what is left.
        steps = int((lock - mpmath.mpf(2) * FOLLOWED - self.home) / STEP)
        opening = digits(self.poses[steps]) - locked
        return lock, locked, opening / mpmath.sqrt(lock - (self.home + steps * STEP))


def _place_p(row: np.ndarray, pose: np.ndarray) -> np.ndarray:
    way = (pose[2:] - pose[:2]) / row[7]
    return pose[:2] + row[8] * way + row[9] * left(way)


def _rod(row: np.ndarray, pose: np.ndarray) -> np.ndarray:
    return _place_p(row, pose) - row[4:6] - row[12] * direction(row[13])


def _gaps(row: np.ndarray, pose: np.ndarray) -> np.ndarray:
    """What the four lengths miss, as differences of squares (mm²)."""
    a, b = pose[:2], pose[2:]
    ways = np.stack([a - row[:2], b - row[2:4], b - a, _rod(row, pose)])
    return np.sum(ways * ways, axis=1) - row[[6, 10, 7, 11]] ** 2


def _by_pose(row: np.ndarray, pose: np.ndarray) -> np.ndarray:
    """Derivatives of `_gaps` by the places of A and B: exact differences, as it is quadratic."""
    moves = np.eye(4, dtype=int)
    return np.stack([_gaps(row, pose + m) - _gaps(row, pose - m) for m in moves], axis=1) / 2


def _newton(row: np.ndarray, pose: np.ndarray, steps: int, reached: Number = 0) -> np.ndarray:
    """Newton's method, until no gap is larger than what is ``reached``."""
    for _ in range(steps):
        gaps = _gaps(row, pose)
        if np.max(abs(gaps)) <= reached:
            break
        pose = pose - _solve(_by_pose(row, pose), gaps)
    return pose


def _solve(matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    if matrix.dtype != object:
        return np.linalg.solve(matrix, right)
    return np.array(list(mpmath.lu_solve(mpmath.matrix(matrix.tolist()), mpmath.matrix(right))))


class SixBar:
    """Exact poses and gradients of six-bars that are assembled as one sketch, case by case.

    Args:
        home: the crank's angle in the sketch, rad.
        sketch: places of A and B there, shape (4,).
    """

    def __init__(self, home: float, sketch: np.ndarray) -> None:
        self._home, self._sketch = home, sketch
        self._starts: dict[tuple[float, ...], np.ndarray] = {}

    @property
    def formula(self) -> Formula:
        """It, beside those of other linkages."""
        return Formula(INPUTS, self, "o6", "rod", (0, 2, 4), closed_form=False)

    @functools.lru_cache  # noqa: B019 - one six-bar lives as long as its study
    def follower(self, dimensions: tuple[float, ...]) -> Follower:
        """The six-bar of these dimensions (a row without its angle), followed once."""
        return Follower(np.array([*dimensions, self._home]), self._sketch)

    def __call__(self, inputs: np.ndarray, sides: np.ndarray) -> Exact:
        """Exact joint P; the margin is how far the crank is from lock-up, in radians.

        Args:
            inputs: shape (cases, 14), in the order of `INPUTS`, mpmath numbers.
            sides: ignored, as the sketch chooses the assembly.
        """
        with mpmath.workdps(PLACES):
            values, gradients, margins = zip(*map(self._one, inputs), strict=True)
            ones = np.full(len(inputs), mpmath.mpf(1))
        return Exact(np.array(values), np.array(gradients), np.array(margins), ones)

    def locking(self, row: np.ndarray, crank: float) -> np.ndarray:
        """A row with another crank, and a rod for which the sketch still holds."""
        pose, row = self.follower(tuple(row[:-1].tolist())).poses[0], row.copy()
        row[12] = crank
        row[11] = np.hypot(*_rod(row, pose))
        return row

    def _one(self, row: np.ndarray) -> tuple[np.ndarray, np.ndarray, Number]:
        # Rows that differ only in the last digits share what they start from.
        near = tuple(row.astype(float).tolist())
        follower = self.follower(near[:-1])
        margin = mpmath.mpf(1) if follower.lock is None else follower.lock - row[-1]
        if margin <= 0:
            return 0 * row[:2], np.outer(0 * row[:2], row), margin
        pose = self._starts[near] if near in self._starts else follower.start(row[-1])
        pose = _newton(row, pose, 60, mpmath.mpf(10) ** (8 - PLACES) * row[7] ** 2)
        self._starts.setdefault(near, pose)
        return _place_p(row, pose), self._gradient(row, pose), margin

    @staticmethod
    def _gradient(row: np.ndarray, pose: np.ndarray) -> np.ndarray:
        """Derivatives of P with respect to every entry of the row, by implicit differentiation."""
        inverse = mpmath.inverse(mpmath.matrix(_by_pose(row, pose).tolist()))
        step, columns = mpmath.mpf(10) ** (-PLACES // 3), []
        for move in np.eye(len(row), dtype=int) * step:
            ends = row + move, row - move
            gaps, places = ([function(end, pose) for end in ends] for function in (_gaps, _place_p))
            change = inverse * mpmath.matrix((gaps[1] - gaps[0]) / (2 * step))
            # P is linear in the places of A and B, so that their change gives its own.
            moved = _place_p(row, np.array(list(change)))
            columns.append(moved + (places[0] - places[1]) / (2 * step))
        return np.stack(columns, axis=1)
