"""Poses and gradients in many digits by trigonometry: the reference for errors.

Nothing here shares a line with `kinematics` or with the loop equations of the iterations: the
angles of a triangle come from the law of cosines, that at a line from its sine.
"""

from __future__ import annotations

import functools
from typing import Any, NamedTuple

import jax
import mpmath
import numpy as np
from mpmath.calculus.quadrature import GaussLegendre

from designopt.study.stability import DIGITS
from studies.benchmarks.linkage.cases import (
    Case,
    Dyad,
    Point,
    Sizes,
    dimensions,
    drawn,
    size_of,
    sizes_of,
    with_dimensions,
)

CHECKED = 200
"""Poses of a sweep that are compared with the reference, evenly spaced."""

SUMMED = 400
"""Poses of a sweep up to which its mean is summed; a longer one's is integrated."""

NODES_DEGREE = 5
"""Degree of mpmath's rule for the integral: 48 nodes."""


class Positions(NamedTuple):
    """Exact positions at some of a sweep's poses.

    Attributes:
        checked: indices of the poses.
        places: mm, of shape (checked, joints, 2), as mpmath numbers.
        size: the linkage's largest length, mm.
    """

    checked: np.ndarray
    places: np.ndarray
    size: float

    def error(self, found: np.ndarray) -> float:
        """Largest distance of a joint in ``found``, (poses, joints, 2), over the largest length."""
        found = found[self.checked]
        if not np.all(np.isfinite(found)):
            return float("inf")
        with mpmath.workdps(DIGITS):
            off = np.asarray(found, dtype=float).astype(object) - self.places
            squared = np.sum(off * off, axis=-1)
            return float(mpmath.sqrt(np.max(squared)) / self.size)


@functools.cache
def positions(case: Case, poses: int, part: int) -> Positions:
    """Moving joints at up to `CHECKED` of the first ``part`` poses of a sweep."""
    angles = case.angles(poses)[:part]
    checked = np.unique(np.linspace(0, part - 1, CHECKED).astype(int))
    with mpmath.workdps(DIGITS):
        sizes = exact_sizes(case)
        places = [pose(case, sizes, mpmath.mpf(float(angle))) for angle in angles[checked]]
    return Positions(checked, np.array(places, dtype=object), float(size_of(drawn(case))))


@functools.cache
def gradient(case: Case, poses: int) -> np.ndarray:
    """Derivative of `mean_square` with respect to all dimensions, raveled."""
    with mpmath.workdps(DIGITS):
        if poses <= SUMMED:
            return np.array([float(slope) for (slope,) in _slopes(case, poses)])
        weights = _weights(case, poses)
        summed: list[Any] = [mpmath.fdot(weights, slopes) for slopes in _slopes(case, None)]
        return np.array([float(slope) for slope in summed])


@functools.cache
def value(case: Case, poses: int) -> Any:
    """`mean_square` of the case's own linkage."""
    with mpmath.workdps(DIGITS):
        return mean_square(case, exact_sizes(case), poses)


def mean_square(case: Case, sizes: Sizes, poses: int) -> Any:
    """Mean over a sweep of the squared distance of the last joint from the origin, mm².

    That of a long sweep is the integral over the crank's angle, by Gauss and Legendre's rule,
    with the end corrections of Euler and Maclaurin, which make it that of equal steps.
    """
    if poses <= SUMMED:
        return _parts(case, sizes, poses)[0]
    return mpmath.fdot(_weights(case, poses), _parts(case, sizes, None))


def _parts(case: Case, sizes: Sizes, poses: int | None) -> list[Any]:
    """The mean over so many poses; or for any long sweep the mean in the limit and at the ends.

    Returns:
        One number; or the integral over the range, and by how much the squared distance, its
        first and its third derivative rise from start to end, all over the range.
    """

    def square(angle: Any) -> Any:
        x, y = pose(case, sizes, angle)[-1]
        return x * x + y * y

    if poses is not None:
        return [mpmath.fsum(square(mpmath.mpf(float(a))) for a in case.angles(poses)) / poses]
    start, end = (mpmath.mpf(float(limit)) for limit in np.deg2rad(case.sweep_deg))
    half, middle = (end - start) / 2, (end + start) / 2
    nodes = GaussLegendre(mpmath.mp).get_nodes(-1, 1, NODES_DEGREE, mpmath.mp.prec)
    mean = mpmath.fsum(weight * square(middle + half * node) for node, weight in nodes) / 2
    rises = [mpmath.diff(square, end, n) - mpmath.diff(square, start, n) for n in (0, 1, 3)]
    return [mean, *(rise / (end - start) for rise in rises)]


def _weights(case: Case, poses: int) -> list[Any]:
    """What the `_parts` of a long sweep count: Bernoulli's numbers over factorials.

    Equal steps count the start and not the end.
    """
    start, end = (mpmath.mpf(float(limit)) for limit in np.deg2rad(case.sweep_deg))
    width = (end - start) / poses
    return [mpmath.mpf(1), -width / 2, width**2 / 12, -(width**4) / 720]


@functools.cache
def _slopes(case: Case, poses: int | None) -> list[list[Any]]:
    """Derivatives of the `_parts` with respect to each of the raveled dimensions."""
    linkage = drawn(case)
    leaves, structure = jax.tree.flatten(dimensions(linkage))
    step = mpmath.mpf(10) ** (-DIGITS // 3)
    numbers = [mpmath.mpf(float(number)) for leaf in leaves for number in np.ravel(leaf)]

    def at(values: list[Any]) -> list[Any]:
        rebuilt, used = [], 0
        for leaf in leaves:
            part = np.array(values[used : used + leaf.size], dtype=object)
            rebuilt.append(part.reshape(leaf.shape))
            used += leaf.size
        moved = with_dimensions(linkage, jax.tree.unflatten(structure, rebuilt))
        return _parts(case, jax.tree.map(_number, sizes_of(moved)), poses)

    slopes = []
    for i, number in enumerate(numbers):
        ends = [at([*numbers[:i], number + move, *numbers[i + 1 :]]) for move in (step, -step)]
        slopes.append([(up - down) / (2 * step) for up, down in zip(*ends, strict=True)])
    return slopes


def exact_sizes(case: Case) -> Sizes:
    """The dimensions of the case's own linkage as mpmath numbers."""
    return jax.tree.map(lambda size: mpmath.mpf(float(size)), sizes_of(drawn(case)))


def pose(case: Case, sizes: Sizes, angle: Any) -> list[Point]:
    """Places of a case's moving joints at one crank angle, mm."""
    joints = dict(sizes.pins)
    if case.base is not None:
        angle = angle + _bearing(joints["O2"], joints[case.base])
    joints["A"] = _from(joints["O2"], sizes.lengths["crank"], angle)
    for dyad in case.dyads:
        if dyad.end is None or dyad.arm is None:
            joints[dyad.joint] = _on_the_line(dyad, sizes, joints[dyad.start])
            continue
        joints[dyad.joint] = _corner(dyad, sizes, joints[dyad.start], joints[dyad.end])
        if dyad.carries is not None:
            base = joints[dyad.end]
            along, across = sizes.carried[dyad.arm]
            turned = _bearing(base, joints[dyad.joint]) + mpmath.atan2(across, along)
            joints[dyad.carries] = _from(base, mpmath.hypot(along, across), turned)
    return [joints[name] for name in case.joints]


def _corner(dyad: Dyad, sizes: Sizes, start: Point, end: Point) -> Point:
    """Where link and arm meet: the law of cosines gives the angle at ``start``."""
    link, arm = sizes.lengths[dyad.link], sizes.lengths[str(dyad.arm)]
    base = mpmath.hypot(end[0] - start[0], end[1] - start[1])
    corner = mpmath.acos((link**2 + base**2 - arm**2) / (2 * link * base))
    return _from(start, link, _bearing(start, end) + dyad.side * corner)


def _on_the_line(dyad: Dyad, sizes: Sizes, start: Point) -> Point:
    """Where the link ends on the line: its angle to the line from the distance it bridges."""
    x, y, angle = sizes.lines[0]
    link = sizes.lengths[dyad.link]
    away = mpmath.hypot(x - start[0], y - start[1])
    distance = away * mpmath.sin(_bearing(start, (x, y)) - angle) if away else mpmath.mpf(0)
    lean = mpmath.asin(distance / link)
    return _from(start, link, angle + (lean if dyad.side > 0 else mpmath.pi - lean))


def _from(start: Point, length: Any, angle: Any) -> Point:
    return start[0] + length * mpmath.cos(angle), start[1] + length * mpmath.sin(angle)


def _bearing(start: Point, end: Point) -> Any:
    return mpmath.atan2(end[1] - start[1], end[0] - start[0])


def _number(size: Any) -> Any:
    return size.item() if isinstance(size, np.ndarray) else size
