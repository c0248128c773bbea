"""All real solutions of two loops with four unknowns, up to six for a triad, and none missed.

One unknown of each loop is eliminated by taking lengths, which leaves two equations in the two
unknowns they share. An angle θ enters through z = exp(iθ), so both are polynomials of degree at
most two in either unknown. Their Sylvester resultant is the determinant of a matrix quadratic in
the first unknown; its zeros are eigenvalues, of which there are eight, zero and infinity included
and always found. Of a triad's eight two are at zero and infinity, and six are left.

Source: the elimination is that of J. Nielsen and B. Roth, Solving the input/output problem for
planar mechanisms, ASME J. Mech. Des. 121, 1999, reduced to two loops; the polynomial eigenvalue
problem: D. Manocha, Solving systems of polynomial equations, IEEE CG&A 14, 1994.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import scipy.linalg
import scipy.optimize

Residual = Callable[[np.ndarray], np.ndarray]
"""From four unknowns to the two loops' gaps as complex numbers, x + iy."""

REAL = 1e-4
"""How far an eigenvalue may be from a real unknown to be tried; what survives Newton counts."""

CLOSED = 1e-11
"""Gap below which a polished solution counts, in units of the linkage's size."""

SAME = 1e-7
"""Solutions nearer to each other are one."""


class AllSolutions(NamedTuple):
    """Solutions of two loops.

    Attributes:
        unknowns: shape (solutions, 4).
        complete: whether these are certainly all.
    """

    unknowns: np.ndarray
    complete: bool


def solve_two_loops(residual: Residual, is_angle: tuple[bool, ...], reach: float) -> AllSolutions:
    """Every real solution of two loops in four unknowns.

    Args:
        residual: the loops, each of degree one in a slide and in exp(iθ) of an angle, and in
            products of a slide with the rotation of its line.
        is_angle: which unknowns are angles (rad); the others are slides, in units of the size.
        reach: a length that no slide exceeds, in the same units.

    Returns:
        The solutions, angles from −π to π. Not complete if the two loops have no unknown of
        their own each, or if the solutions are not isolated.
    """
    elimination = _elimination(residual, is_angle)
    if elimination is None:
        return AllSolutions(np.zeros((0, 4)), False)
    equations, shared = elimination.equations, elimination.shared
    kinds = [is_angle[i] for i in shared]
    polynomials = [_coefficients(equation, kinds, reach) for equation in equations]
    values, vectors, regular = _resultant_zeros(*polynomials)
    found: list[np.ndarray] = []
    for x, vector in zip(values, vectors.T, strict=True):
        for first, second in _candidates(x, vector, polynomials, kinds, reach):
            guess = elimination.complete(first, second)
            solution = _polished(residual, guess, is_angle)
            if solution is not None and all(distance(solution, o, is_angle) > SAME for o in found):
                found.append(solution)
    found.sort(key=lambda solution: tuple(solution))
    return AllSolutions(np.array(found).reshape(-1, 4), regular)


class _Elimination(NamedTuple):
    """Two equations in two shared unknowns, and the way back to all four."""

    equations: tuple[Callable[[float, float], float], Callable[[float, float], float]]
    shared: tuple[int, int]
    complete: Callable[[float, float], np.ndarray]


def _elimination(residual: Residual, is_angle: tuple[bool, ...]) -> _Elimination | None:
    def loops(weights: np.ndarray) -> Callable[[np.ndarray], complex]:
        return lambda unknowns: complex(weights @ residual(unknowns))

    # Each of the two equations needs an unknown of its own. Where the loops as they are have none,
    # their sum or difference, which goes round another circuit of the same chain, may.
    combinations = [loops(np.array(w)) for w in ((1, 0), (0, 1), (1, 1), (1, -1))]
    used = [_used(loop) for loop in combinations]
    for i, j in itertools.combinations(range(4), 2):
        own, other = used[i] - used[j], used[j] - used[i]
        shared = tuple(sorted(used[i] & used[j]))
        if len(own) == len(other) == 1 and len(shared) == 2:
            ends = [(combinations[i], own.pop()), (combinations[j], other.pop())]
            break
    else:
        return None

    def at(first: float, second: float) -> np.ndarray:
        unknowns = np.zeros(4)
        unknowns[list(shared)] = first, second
        return unknowns

    def parts(
        loop: Callable[[np.ndarray], complex], index: int, base: np.ndarray
    ) -> tuple[complex, complex]:
        # The loop is c + v exp(ip) in an angle p, and c + v p in a slide.
        here, there = base.copy(), base.copy()
        here[index], there[index] = 0.0, np.pi if is_angle[index] else 1.0
        if is_angle[index]:
            return (loop(here) + loop(there)) / 2, (loop(here) - loop(there)) / 2
        return loop(here), loop(there) - loop(here)

    def equation(end: int) -> Callable[[float, float], float]:
        loop, index = ends[end]

        def value(first: float, second: float) -> float:
            # |v| = |c| is what is left of c + v exp(ip) = 0 when its direction is free, and c
            # parallel to v of c + v s = 0: neither has a branch to be chosen.
            c, v = parts(loop, index, at(first, second))
            return abs(c) ** 2 - abs(v) ** 2 if is_angle[index] else (c * v.conjugate()).imag

        return value

    def complete(first: float, second: float) -> np.ndarray:
        unknowns = at(first, second)
        for loop, index in ends:
            c, v = parts(loop, index, at(first, second))
            unknowns[index] = (
                np.angle(-c * v.conjugate())
                if is_angle[index]
                else -(c * v.conjugate()).real / max(abs(v) ** 2, 1e-300)
            )
        return unknowns

    return _Elimination((equation(0), equation(1)), (shared[0], shared[1]), complete)


def _used(loop: Callable[[np.ndarray], complex]) -> set[int]:
    """The unknowns that a loop contains, found at points where nothing vanishes by chance."""
    random = np.random.default_rng(0)
    used = set()
    for index in range(4):
        for _ in range(3):
            here = random.uniform(0.5, 2.5, 4)
            there = here.copy()
            there[index] += 1.0
            if abs(loop(here) - loop(there)) > 1e-12:
                used.add(index)
    return used


def _coefficients(
    equation: Callable[[float, float], float], is_angle: list[bool], reach: float
) -> np.ndarray:
    """Coefficients of degree (2, 2) in the two unknowns, by interpolation.

    An angle's Laurent polynomial in z, of degrees −1 to 1, is sampled at three points of the unit
    circle (and multiplied by z); a slide's quadratic, in units of ``reach``, at −1, 0 and 1.
    """
    third = 2 * np.pi / 3
    points = [[0.0, third, 2 * third] if angle else [-reach, 0.0, reach] for angle in is_angle]
    values = np.array([[equation(x, y) for y in points[1]] for x in points[0]], complex)
    for axis, angle in enumerate(is_angle):
        if angle:
            z = np.exp(1j * np.array(points[axis]))
            # At roots of unity the transform is unitary up to a factor: it amplifies no rounding.
            basis = np.stack([1 / z, np.ones(3), z], axis=1)
        else:
            s = np.array([-1.0, 0.0, 1.0])
            basis = np.stack([np.ones(3), s, s * s], axis=1).astype(complex)
        values = np.moveaxis(np.tensordot(np.linalg.inv(basis), values, (1, axis)), 0, axis)
    size = np.max(np.abs(values))
    return values / size if size > 0 else values


def _resultant_zeros(p: np.ndarray, q: np.ndarray) -> tuple[np.ndarray, np.ndarray, bool]:
    """First unknowns at which p and q have a common second one; null vectors; regularity."""
    blocks = []
    for degree in range(3):
        (p0, p1, p2), (q0, q1, q2) = p[degree], q[degree]
        # Rows y p, p, y q, q over y³, y², y, 1.
        blocks.append(
            np.array([[p2, p1, p0, 0], [0, p2, p1, p0], [q2, q1, q0, 0], [0, q2, q1, q0]], complex)
        )
    s0, s1, s2 = blocks
    one, zero = np.eye(4), np.zeros((4, 4))
    # Linearised as a companion pencil; eigenvalues as pairs (α, β), since one at infinity, which
    # every triad has, would be a division by 0 and spoil its neighbours.
    a = np.block([[zero, one], [-s0, -s1]])
    b = np.block([[one, zero], [zero, s2]])
    homogeneous: Any = scipy.linalg.eig(a, b, homogeneous_eigvals=True)
    (alpha, beta), vectors = homogeneous
    size = np.abs(alpha) + np.abs(beta)
    # A pair (0, 0) means that the determinant vanishes everywhere: solutions are not isolated.
    regular = bool(np.all(size > 1e-10))
    finite = np.abs(beta) > 1e-12 * np.maximum(size, 1e-300)
    return alpha[finite] / beta[finite], vectors[:4, finite], regular


def _candidates(
    x: complex,
    vector: np.ndarray,
    polynomials: list[np.ndarray],
    is_angle: list[bool],
    reach: float,
) -> list[tuple[float, float]]:
    """Real values of the two unknowns at a zero of the resultant, none if it is complex."""
    first = _real(x, is_angle[0], reach)
    if first is None:
        return []
    # The null vector is (y³, y², y, 1); where it is not one but a plane of them, the common roots
    # are among those of either polynomial.
    ys = [vector[2] / vector[3]] if abs(vector[3]) > 1e-9 * np.max(np.abs(vector)) else []
    powers = np.array([1, x, x * x])
    for polynomial in polynomials:
        quadratic = (powers @ polynomial)[::-1]
        if np.max(np.abs(quadratic)) > 1e-12:
            ys += list(np.roots(quadratic))
    seconds = (_real(y, is_angle[1], reach) for y in ys)
    return [(first, second) for second in seconds if second is not None]


def _real(value: complex, is_angle: bool, reach: float) -> float | None:
    if is_angle:
        return float(np.angle(value)) if abs(abs(value) - 1) < REAL else None
    return float(value.real * reach) if abs(value.imag) < REAL * (1 + abs(value)) else None


def _polished(
    residual: Residual, guess: np.ndarray, is_angle: tuple[bool, ...]
) -> np.ndarray | None:
    def real(unknowns: np.ndarray) -> np.ndarray:
        gaps: Any = residual(unknowns)
        return np.concatenate([gaps.real, gaps.imag])

    # Least squares and not Newton's method: at a change point two solutions meet, the Jacobian is
    # singular, and the nearest point that closes is wanted all the same.
    found = scipy.optimize.least_squares(real, guess, xtol=1e-15, ftol=1e-15, gtol=1e-15)
    if np.max(np.abs(found.fun)) > CLOSED:
        return None
    return np.where(is_angle, np.angle(np.exp(1j * found.x)), found.x)


def distance(a: np.ndarray, b: np.ndarray, is_angle: tuple[bool, ...]) -> float:
    """How far two solutions are apart, angles as unit vectors."""
    step = np.where(is_angle, np.abs(np.exp(1j * a) - np.exp(1j * b)), np.abs(a - b))
    return float(np.max(step))
