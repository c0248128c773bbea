"""Dyads that a crank drives one after the other: their loop equations, and their exact poses.

The loop equations are those that a person would write down, for whatever computes cosines: `math`
for one pose in Python, `jax.numpy` for a batch. Exact poses share no line with them: in many
digits, by trigonometry, the angles of a triangle come from the law of cosines, that at a line from
its sine.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import mpmath
import numpy as np

Point = tuple[Any, Any]

SUMMED = 400
"""Poses of a sweep up to which its mean is summed; a longer one's is integrated."""


class Dyad(NamedTuple):
    """A link from a joint that is known, and what holds its other end.

    Its two unknowns are the link's angle and the arm's angle, or the link's angle and the slide.

    Attributes:
        joint: what it places.
        start: the known joint that the link starts from.
        link: body from ``start`` to ``joint``.
        side: +1 if ``joint`` lies to the left of the way from ``start`` to ``end``, −1 to the
            right; on a line, +1 if it lies on the far side along the line.
        end: fixed joint that the arm turns about; empty where ``joint`` slides on the line.
        arm: body from ``end`` to ``joint``; empty where ``joint`` slides on the line.
        carries: further joint of the arm, or empty.
    """

    joint: str
    start: str
    link: str
    side: int
    end: str = ""
    arm: str = ""
    carries: str = ""


class Case(NamedTuple):
    """A linkage of the gallery that a crank drives from ``O2`` to ``A``.

    Attributes:
        name: in figures and tables.
        file: in ``studies/gallery/linkages``.
        joints: its moving joints, which every method has to place; the last is the one whose path
            the gradient is of.
        dyads: in the order in which they are solved.
        sweep_deg: crank angles from which and to which it is driven; the last pose of a sweep is
            one step short of the end.
        base: fixed joint from whose direction, seen from ``O2``, the crank's angle is counted;
            empty where it is counted from +x.
    """

    name: str
    file: str
    joints: tuple[str, ...]
    dyads: tuple[Dyad, ...]
    sweep_deg: tuple[float, float] = (0.0, 360.0)
    base: str = ""

    def angles(self, poses: int) -> np.ndarray:
        """Crank angles of a sweep in equal steps, rad."""
        start, end = np.deg2rad(self.sweep_deg)
        return start + (end - start) * np.arange(poses) / poses


class Sizes(NamedTuple):
    """Every dimension of a linkage as plain numbers or scalars.

    Attributes:
        pins: positions of the fixed joints, mm.
        lengths: distance of each moving body's first two joints, mm.
        carried: the third joint of a body, in the frame of its first two, mm.
        line: a point of the line that a joint slides on, mm, and its angle, rad; or nothing.
    """

    pins: dict[str, Point]
    lengths: dict[str, Any]
    carried: dict[str, Point]
    line: tuple[Any, ...]


def crank_base(ops: Any, case: Case, sizes: Sizes) -> Any:
    """The angle from +x that the crank's angle is counted from."""
    if not case.base:
        return 0.0
    (x, y), (end_x, end_y) = sizes.pins["O2"], sizes.pins[case.base]
    return ops.atan2(end_y - y, end_x - x)


def crank_tip(ops: Any, case: Case, sizes: Sizes, angle: Any) -> dict[str, Point]:
    """Places of all fixed joints and of the crank's tip, ``A``."""
    x, y = sizes.pins["O2"]
    angle = angle + crank_base(ops, case, sizes)
    crank = sizes.lengths["crank"]
    return {**sizes.pins, "A": (x + crank * ops.cos(angle), y + crank * ops.sin(angle))}


def place(
    ops: Any, dyad: Dyad, sizes: Sizes, joints: dict[str, Point], first: Any, second: Any
) -> Point:
    """Adds what a dyad places to ``joints``, from its unknowns, and returns the loop's gap, mm.

    The gap is the way from where arm or line has the joint to where the link has it.
    """
    x, y = joints[dyad.start]
    length = sizes.lengths[dyad.link]
    here = x + length * ops.cos(first), y + length * ops.sin(first)
    joints[dyad.joint] = here
    if dyad.arm:
        x, y = joints[dyad.end]
        cosine, sine, length = ops.cos(second), ops.sin(second), sizes.lengths[dyad.arm]
    else:
        x, y, angle = sizes.line
        cosine, sine, length = ops.cos(angle), ops.sin(angle), second
    if dyad.carries:
        along, across = sizes.carried[dyad.arm]
        at = x + cosine * along - sine * across, y + sine * along + cosine * across
        joints[dyad.carries] = at
    return here[0] - x - length * cosine, here[1] - y - length * sine


def gaps(
    ops: Any, case: Case, sizes: Sizes, angle: Any, unknowns: Any
) -> tuple[dict[str, Point], list[Any]]:
    """All joints and the gaps of all loops, mm, two equations for each pair of unknowns."""
    joints, left = crank_tip(ops, case, sizes, angle), []
    for number, dyad in enumerate(case.dyads):
        left += place(ops, dyad, sizes, joints, *unknowns[2 * number : 2 * number + 2])
    return joints, left


def pose(case: Case, sizes: Sizes, angle: Any) -> list[Point]:
    """Places of a case's moving joints at one crank angle, mm."""
    joints = dict(sizes.pins)
    if case.base:
        angle = angle + _bearing(joints["O2"], joints[case.base])
    joints["A"] = _from(joints["O2"], sizes.lengths["crank"], angle)
    for dyad in case.dyads:
        start = joints[dyad.start]
        if not dyad.arm:
            joints[dyad.joint] = _on_the_line(dyad, sizes, start)
            continue
        base = joints[dyad.end]
        joints[dyad.joint] = _corner(dyad, sizes, start, base)
        if dyad.carries:
            along, across = sizes.carried[dyad.arm]
            turned = _bearing(base, joints[dyad.joint]) + mpmath.atan2(across, along)
            joints[dyad.carries] = _from(base, mpmath.hypot(along, across), turned)
    return [joints[name] for name in case.joints]


def mean_square(case: Case, poses: int, sizes: Sizes) -> Any:
    """Mean over a sweep of the squared distance of the last joint from the origin, mm².

    That of a long sweep is the integral over the crank's angle, with the end corrections of Euler
    and Maclaurin, which make it that of equal steps that count the start and not the end.
    """

    def square(angle: Any) -> Any:
        x, y = pose(case, sizes, mpmath.mpf(angle))[-1]
        return x * x + y * y

    if poses <= SUMMED:
        return mpmath.fsum(map(square, case.angles(poses).tolist())) / poses
    start, end = map(mpmath.mpf, np.deg2rad(case.sweep_deg).tolist())
    width = (end - start) / poses
    total = mpmath.quad(square, [start, end], method="gauss-legendre", maxdegree=5)
    for order, weight in ((0, -width / 2), (1, width**2 / 12), (3, -(width**4) / 720)):
        total += weight * (mpmath.diff(square, end, order) - mpmath.diff(square, start, order))
    return total / (end - start)


def _corner(dyad: Dyad, sizes: Sizes, start: Point, end: Point) -> Point:
    """Where link and arm meet: the law of cosines gives the angle at ``start``."""
    link, arm = sizes.lengths[dyad.link], sizes.lengths[dyad.arm]
    base = mpmath.hypot(end[0] - start[0], end[1] - start[1])
    corner = mpmath.acos((link**2 + base**2 - arm**2) / (2 * link * base))
    return _from(start, link, _bearing(start, end) + dyad.side * corner)


def _on_the_line(dyad: Dyad, sizes: Sizes, start: Point) -> Point:
    """Where the link ends on the line: its angle to the line from the distance it bridges."""
    x, y, angle = sizes.line
    away = mpmath.hypot(x - start[0], y - start[1])
    distance = away * mpmath.sin(_bearing(start, (x, y)) - angle)
    lean = mpmath.asin(distance / sizes.lengths[dyad.link])
    turned = angle + (lean if dyad.side > 0 else mpmath.pi - lean)
    return _from(start, sizes.lengths[dyad.link], turned)


def _from(start: Point, length: Any, angle: Any) -> Point:
    return start[0] + length * mpmath.cos(angle), start[1] + length * mpmath.sin(angle)


def _bearing(start: Point, end: Point) -> Any:
    return mpmath.atan2(end[1] - start[1], end[0] - start[0])
