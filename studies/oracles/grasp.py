"""Equilibria on circles in many digits, with kinematics written out for mpmath alone.

Which stops and contacts hold is taken from the state to be judged; their equations are solved in
`DIGITS` digits, and then it is checked that this choice was right: no force pulls, and nothing that
was left out overlaps.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import mpmath
import numpy as np

DIGITS = 36

Place = tuple[Any, Any]


@dataclass(frozen=True)
class Setting:
    """A problem in plain numbers; lengths in mm, angles in rad, stiffnesses in N mm/rad.

    Attributes:
        pins: C, D, E, F, G, H in the straight finger.
        lengths: intermediate and distal phalanx.
        axis_height: h.
        rim: how far before the tip the distal pad ends.
        limit: upper stop of both joints.
        values: ``log_spring``, ``log_servo``, ``preload`` and ``command``.
        circle: centre and radius.
    """

    pins: Mapping[str, tuple[float, float]]
    lengths: tuple[float, float]
    axis_height: float
    rim: float
    limit: float
    values: Mapping[str, Any]
    circle: tuple[float, float, float]

    def with_value(self, name: str, value: Any) -> Setting:
        """The same with one of its values replaced."""
        return replace(self, values={**self.values, name: value})


@dataclass(frozen=True)
class Exact:
    """An equilibrium in many digits.

    Attributes:
        joints: PIP and DIP.
        motor: T_a.
        forces: on the intermediate and on the distal pad, N; 0 where open.
        right: whether the choice of what holds was right.
    """

    joints: tuple[Any, Any]
    motor: Any
    forces: tuple[Any, Any]
    right: bool


def crank(setting: Setting, pip: Any, dip: Any) -> Any:
    """φ in rad."""
    at = setting.pins
    turn = _angle(at["F"], at["E"]) - _crank_angle(setting, pip, dip)
    return turn - 2 * mpmath.pi * mpmath.nint(turn / (2 * mpmath.pi))


def winding(setting: Setting, dip: Any) -> Any:
    """Δγ in rad."""
    turn = _plate(setting, dip)[1] + dip
    return turn - 2 * mpmath.pi * mpmath.nint(turn / (2 * mpmath.pi))


def gaps(setting: Setting, pip: Any, dip: Any) -> tuple[Any, Any]:
    """Gaps of the circle to both pads, mm."""
    middle, tip = setting.lengths
    h = setting.axis_height
    x, y, radius = setting.circle
    found = []
    for (bx, by), angle, length in (
        ((mpmath.mpf(0), mpmath.mpf(0)), -pip, middle - 2 * h),
        (_turned((middle, 0), -pip), -pip - dip, tip - setting.rim - h),
    ):
        u, v = _turned((x - bx, y - by), -angle)
        nearest = min(max(u - h, mpmath.mpf(0)), mpmath.mpf(length))
        beyond, below = u - h - nearest, -h - v
        found.append((below if beyond == 0 else mpmath.hypot(beyond, below)) - radius)
    return found[0], found[1]


def solve(
    setting: Setting,
    near: np.ndarray,
    held: tuple[float | None, float | None],
    closed: tuple[bool, bool],
) -> Exact | None:
    """The equilibrium with a given choice of what holds, from a place near it.

    Args:
        setting: the problem.
        near: joints to start from, rad.
        held: the stop each joint rests on, rad, or ``None``.
        closed: which pads touch.

    Returns:
        The equilibrium, or ``None`` where the choice leaves it undetermined (more than two holds)
        or its equations were not solved.
    """
    free = [i for i in range(2) if held[i] is None]
    shut = [i for i in range(2) if closed[i]]
    if len(shut) > len(free):
        return None
    stiffness, servo = (mpmath.exp(setting.values[name]) for name in ("log_spring", "log_servo"))
    step = mpmath.mpf(10) ** (-mpmath.mp.dps // 3)

    def joints_of(unknown: Any) -> list[Any]:
        rest = iter(unknown[: len(free)])
        return [next(rest) if held[i] is None else mpmath.mpf(held[i]) for i in range(2)]

    def slopes(function: Any, joints: list[Any]) -> list[Any]:
        moves = ([joints[0] + s * step, joints[1]] for s in (1, -1))
        others = ([joints[0], joints[1] + s * step] for s in (1, -1))
        return [(function(*a) - function(*b)) / (2 * step) for a, b in (moves, others)]

    def motor_of(joints: list[Any]) -> Any:
        return servo * (setting.values["command"] - crank(setting, *joints))

    def pulls(joints: list[Any], forces: list[Any]) -> list[Any]:
        motor = motor_of(joints)
        ratio = slopes(lambda p, d: crank(setting, p, d), joints)
        wound = (winding(setting, joints[1] + step) - winding(setting, joints[1] - step)) / (
            2 * step
        )
        spring = stiffness * (winding(setting, joints[1]) + setting.values["preload"]) * wound
        out = [-motor * ratio[0], -motor * ratio[1] + spring]
        for force, i in zip(forces, shut, strict=True):
            slope = slopes(lambda p, d, i=i: gaps(setting, p, d)[i], joints)
            out = [a - force * b for a, b in zip(out, slope, strict=True)]
        return out

    # Forces in the servo's unit and moments in both stiffnesses' sum: all near one.
    unit = stiffness + servo

    def equations(unknown: list[Any]) -> list[Any]:
        joints, forces = joints_of(unknown), [servo * f for f in unknown[len(free) :]]
        moment = pulls(joints, forces)
        return [moment[i] / unit for i in free] + [gaps(setting, *joints)[i] for i in shut]

    unknown = _converged(equations, [mpmath.mpf(float(near[i])) for i in free], len(shut))
    if unknown is None:
        return None
    joints, forces = joints_of(unknown), [servo * f for f in unknown[len(free) :]]
    moment, gap = pulls(joints, forces), gaps(setting, *joints)
    tiny = mpmath.mpf(10) ** (-mpmath.mp.dps // 4)
    right = all(force >= -tiny * servo for force in forces)
    right &= all(closed[i] or gap[i] >= -tiny for i in range(2))
    for i in range(2):
        if held[i] is not None:
            right &= (moment[i] >= -tiny * unit) if held[i] == 0 else (moment[i] <= tiny * unit)
        right &= -tiny <= joints[i] <= setting.limit + tiny
    whole = [mpmath.mpf(0)] * 2
    for i, force in zip(shut, forces, strict=True):
        whole[i] = force
    return Exact((joints[0], joints[1]), motor_of(joints), (whole[0], whole[1]), bool(right))


def _converged(equations: Any, joints: list[Any], forces: int) -> list[Any] | None:
    """Newton's iteration that keeps its slopes once the start is good.

    From a start good to 1e-15 it gains as many digits in every step, when the forces, in which
    the equations are linear, are there.
    """
    unknown = joints + [mpmath.mpf(0)] * forces
    if not unknown:
        return []
    size, step = len(unknown), mpmath.mpf(10) ** (-mpmath.mp.dps // 2)
    enough = mpmath.mpf(10) ** (-mpmath.mp.dps // 2 - 5)
    slopes = mpmath.matrix(size)
    for fresh in (True, True, False, False, False):
        value = equations(unknown)
        if fresh:
            for j in range(size):
                moved = equations([x + step * (i == j) for i, x in enumerate(unknown)])
                for i in range(size):
                    slopes[i, j] = (moved[i] - value[i]) / step
        try:
            change = mpmath.lu_solve(slopes, mpmath.matrix(value))
        except ZeroDivisionError:
            return None
        unknown = [x - d for x, d in zip(unknown, change, strict=True)]
        if max(abs(d) for d in change) < enough:
            return unknown
    return None


def _plate(setting: Setting, dip: Any) -> tuple[Place, Any]:
    """Pin D in the intermediate phalanx's frame and the plate's turn from straight."""
    at, (middle, _) = setting.pins, setting.lengths
    cx, cy = _turned((at["C"][0] - middle, at["C"][1]), -dip)
    c = (middle + cx, cy)
    h = _meet(at["G"], c, at["G"], at["C"], at["H"])
    turn = _angle(c, h) - _angle(at["C"], at["H"])
    dx, dy = _turned(_minus(at["D"], at["C"]), turn)
    return (c[0] + dx, c[1] + dy), turn


def _crank_angle(setting: Setting, pip: Any, dip: Any) -> Any:
    at = setting.pins
    d = _turned(_plate(setting, dip)[0], -pip)
    return _angle(at["F"], _meet(at["F"], d, at["F"], at["D"], at["E"]))


def _meet(first: Place, second: Place, a: Place, b: Place, c: Place) -> Place:
    """The third corner over two others, with the sides and on the side that a, b, c have."""
    one, two = mpmath.hypot(*_minus(c, a)), mpmath.hypot(*_minus(c, b))
    bx, by = _minus(second, first)
    distance = mpmath.hypot(bx, by)
    along = (one**2 - two**2 + distance**2) / (2 * distance)
    (ux, uy), (vx, vy) = _minus(b, a), _minus(c, a)
    across = mpmath.sqrt(one**2 - along**2) * mpmath.sign(ux * vy - uy * vx)
    x, y = bx / distance, by / distance
    return first[0] + along * x - across * y, first[1] + along * y + across * x


def _minus(a: Place, b: Place) -> Place:
    return mpmath.mpf(a[0]) - b[0], mpmath.mpf(a[1]) - b[1]


def _turned(place: Place, angle: Any) -> Place:
    c, s = mpmath.cos(angle), mpmath.sin(angle)
    return c * place[0] - s * place[1], s * place[0] + c * place[1]


def _angle(start: Place, end: Place) -> Any:
    x, y = _minus(end, start)
    return mpmath.atan2(y, x)
