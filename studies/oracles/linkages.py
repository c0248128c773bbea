"""Four-bar and slider-crank written out a second time, for arithmetic of any precision.

Nothing here passes through the library: pins are intersections of two circles, or of a circle and
a line, and derivatives come from the constraints they satisfy. The same lines run on arrays of
mpmath numbers and on NumPy's extended floats.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import mpmath
import numpy as np

HARD = 1e-6
"""Margin, in units of the size, below which cases are judged in mpmath numbers."""

FAR = 1e3
"""Coordinates, in units of the size, beyond which they are too: their differences cost digits."""


class Arithmetic(NamedTuple):
    """The operations that depend on the kind of number.

    Attributes:
        number: from an array of floats to an array of such numbers, exactly.
        sqrt: square root of an array.
        cos: cosine.
        sin: sine.
        step: relative step for differences of a first derivative.
    """

    number: Callable[[Any], Any]
    sqrt: Callable[[Any], Any]
    cos: Callable[[Any], Any]
    sin: Callable[[Any], Any]
    step: float


DIGITS = Arithmetic(
    np.frompyfunc(lambda value: mpmath.mpf(float(value)), 1, 1),
    np.frompyfunc(mpmath.sqrt, 1, 1),
    np.frompyfunc(mpmath.cos, 1, 1),
    np.frompyfunc(mpmath.sin, 1, 1),
    1e-25,
)
"""Arrays of mpmath numbers, in the digits of ``mpmath.workdps``."""

EXTENDED = Arithmetic(
    lambda values: np.asarray(values).astype(np.longdouble), np.sqrt, np.cos, np.sin, 1e-10
)
"""NumPy's long double: 64 bits of mantissa on x86, for the many cases that are not near lock-up."""


@dataclass(frozen=True)
class Exact:
    """What the formulas say of a batch of cases.

    Attributes:
        value: the last pin, shape (cases, 2), mm; the nearest there is where it does not exist.
        gradient: its derivatives, shape (cases, 2, inputs).
        margin: signed distance to lock-up, shape (cases,), mm.
        size: the largest dimension, shape (cases,), mm.
    """

    value: np.ndarray
    gradient: np.ndarray
    margin: np.ndarray
    size: np.ndarray


def four_bar(arithmetic: Arithmetic, inputs: np.ndarray, sides: np.ndarray) -> Exact:
    """Pin B of a four-bar as the intersection of circles about A and O4.

    Args:
        arithmetic: the kind of number of ``inputs``.
        inputs: shape (cases, 8), in the order of `FOUR_BAR`; mm and radians.
        sides: +1 where B lies to the left of A → O4, −1 to the right, shape (cases,).
    """
    o2_x, o2_y, o4_x, o4_y, crank, coupler, rocker, angle = inputs.T
    cosine, sine = arithmetic.cos(angle), arithmetic.sin(angle)
    e_x, e_y = o4_x - o2_x - crank * cosine, o4_y - o2_y - crank * sine
    distance = arithmetic.sqrt(e_x * e_x + e_y * e_y)
    # Where A lies on O4 there is no direction, and no case is judged by its value.
    apart = distance + (distance == 0)
    along = (coupler - rocker) * (coupler + rocker) / (2 * apart) + distance / 2
    # Heron's formula for the height of the triangle A O4 B.
    fourth = (coupler + rocker + distance) * (coupler + rocker - distance)
    fourth = fourth * (distance - coupler + rocker) * (distance + coupler - rocker)
    height = sides * arithmetic.sqrt(np.maximum(fourth, 0 * fourth)) / (2 * apart)
    u_x = (along * e_x - height * e_y) / apart
    u_y = (along * e_y + height * e_x) / apart
    v_x, v_y = u_x - e_x, u_y - e_y  # from O4
    # (B − A)·(dB − dA) = c dc and (B − O4)·(dB − dO4) = b db.
    none = 0 * crank
    moved_a = (
        (none + 1, none),
        (none, none + 1),
        (none, none),
        (none, none),
        (cosine, sine),
        (none, none),
        (none, none),
        (-crank * sine, crank * cosine),
    )
    first = [u_x * x + u_y * y for x, y in moved_a]
    first[5] = coupler
    second = [none, none, v_x, v_y, none, none, rocker, none]
    gradient = _two_equations(distance * height, (u_x, u_y), (v_x, v_y), first, second)
    value = (o2_x + crank * cosine + u_x, o2_y + crank * sine + u_y)
    margin = np.minimum(coupler + rocker - distance, distance - abs(coupler - rocker))
    ground = arithmetic.sqrt((o4_x - o2_x) ** 2 + (o4_y - o2_y) ** 2)
    size = np.maximum(np.maximum(ground, crank), np.maximum(coupler, rocker))
    return Exact(np.stack(value, axis=1), gradient, margin, size)


def slider_crank(arithmetic: Arithmetic, inputs: np.ndarray, sides: np.ndarray) -> Exact:
    """Pin C of a slider-crank as the intersection of a circle about A and the slider's line.

    Args:
        arithmetic: the kind of number of ``inputs``.
        inputs: shape (cases, 8), in the order of `SLIDER_CRANK`; mm and radians.
        sides: +1 where C lies ahead of A along the line, −1 behind it, shape (cases,).
    """
    o2_x, o2_y, crank, rod, point_x, point_y, direction, angle = inputs.T
    cosine, sine = arithmetic.cos(angle), arithmetic.sin(angle)
    w_x, w_y = arithmetic.cos(direction), arithmetic.sin(direction)
    a_x, a_y = o2_x + crank * cosine - point_x, o2_y + crank * sine - point_y
    across, along = w_x * a_y - w_y * a_x, w_x * a_x + w_y * a_y
    square = (rod - across) * (rod + across)
    reach = sides * arithmetic.sqrt(np.maximum(square, 0 * square))
    slide = along + reach
    u_x, u_y = reach * w_x + across * w_y, reach * w_y - across * w_x  # from A
    # (C − A)·(dC − dA) = l dl and n·(dC − dP) = slide dφ, with n normal to the line.
    none = 0 * crank
    first = [u_x, u_y, u_x * cosine + u_y * sine, rod, none, none, none]
    first.append(crank * (u_y * cosine - u_x * sine))
    second = [none, none, none, none, -w_y, w_x, slide, none]
    gradient = _two_equations(reach, (u_x, u_y), (-w_y, w_x), first, second)
    value = np.stack((point_x + slide * w_x, point_y + slide * w_y), axis=1)
    offset = abs(w_x * (o2_y - point_y) - w_y * (o2_x - point_x))
    size = np.maximum(np.maximum(crank, rod), offset)
    return Exact(value, gradient, rod - abs(across), size)


def four_bar_gaps(inputs: np.ndarray, crank_pin: np.ndarray, last: np.ndarray) -> np.ndarray:
    """How far pins miss the lengths of a four-bar's links.

    Args:
        inputs: shape (cases, 8), in extended floats.
        crank_pin: A, shape (cases, 2), mm.
        last: B, shape (cases, 2), mm.

    Returns:
        The largest gap in units of the largest dimension or coordinate given, shape (cases,).
    """
    o2, o4 = inputs[:, :2], inputs[:, 2:4]
    gaps = [
        abs(_length(crank_pin - o2) - inputs[:, 4]),
        abs(_length(last - crank_pin) - inputs[:, 5]),
        abs(_length(last - o4) - inputs[:, 6]),
    ]
    return np.max(gaps, axis=0) / _largest(inputs[:, :7])


def slider_crank_gaps(inputs: np.ndarray, crank_pin: np.ndarray, last: np.ndarray) -> np.ndarray:
    """How far pins miss the lengths and the line of a slider-crank; otherwise `four_bar_gaps`."""
    o2, point, direction = inputs[:, :2], inputs[:, 4:6], inputs[:, 6]
    step = last - point
    gaps = [
        abs(_length(crank_pin - o2) - inputs[:, 2]),
        abs(_length(last - crank_pin) - inputs[:, 3]),
        abs(np.cos(direction) * step[:, 1] - np.sin(direction) * step[:, 0]),
    ]
    return np.max(gaps, axis=0) / _largest(inputs[:, :6])


def _length(vectors: np.ndarray) -> np.ndarray:
    return np.hypot(vectors[:, 0], vectors[:, 1])


def _largest(lengths: np.ndarray) -> np.ndarray:
    largest = np.max(abs(lengths), axis=1)
    return np.where(largest > 0, largest, 1)


def _two_equations(
    determinant: Any, u: Any, v: Any, first: list[Any], second: list[Any]
) -> np.ndarray:
    """Solve u·dB = first, v·dB = second for every input; 0 where u and v are parallel."""
    inverse = (determinant != 0) / (determinant + (determinant == 0))
    columns = [
        ((p * v[1] - q * u[1]) * inverse, (q * u[0] - p * v[0]) * inverse)
        for p, q in zip(first, second, strict=True)
    ]
    return np.stack([np.stack(column, axis=1) for column in columns], axis=2)


class Formula(NamedTuple):
    """What is exact of a kind of linkage.

    Attributes:
        inputs: names of a row's entries, the last of them the driven one.
        pin: the last pin, from arithmetic, inputs and sides.
        gaps: how far given pins miss the dimensions (`four_bar_gaps`).
        points: where in a row the x of fixed points are, the first fixed joint first.
        closed_form: whether it works in any arithmetic; otherwise in mpmath numbers only.
    """

    inputs: tuple[str, ...]
    pin: Callable[[Arithmetic, np.ndarray, np.ndarray], Exact]
    gaps: Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]
    points: tuple[int, ...]
    closed_form: bool = True


FOUR_BAR = Formula(
    ("o2_x", "o2_y", "o4_x", "o4_y", "crank", "coupler", "rocker", "angle"),
    four_bar,
    four_bar_gaps,
    (0, 2),
)
SLIDER_CRANK = Formula(
    ("o2_x", "o2_y", "crank", "rod", "point_x", "point_y", "direction", "angle"),
    slider_crank,
    slider_crank_gaps,
    (0, 4),
)


def gradient_scale(
    formula: Callable[[Arithmetic, np.ndarray, np.ndarray], Exact],
    arithmetic: Arithmetic,
    inputs: np.ndarray,
    own: np.ndarray,
    sides: np.ndarray,
    found: Exact,
) -> np.ndarray:
    """What inputs changed by their own size would do to each column of a gradient, first order.

    T_i = |g_i| + Σ_j s_j |∂g_i/∂x_j|, the condition-scaled forward error's scale for the gradient
    itself, with s_j the size of input j; second derivatives by differences of first ones.

    Args:
        formula: `four_bar` or `slider_crank`.
        arithmetic: the kind of number of ``inputs``.
        inputs: shape (cases, inputs).
        own: sizes of the inputs, shape (cases, inputs).
        sides: shape (cases,).
        found: the formula's answer for them.

    Returns:
        Shape (cases, inputs), of each column the larger coordinate.
    """
    scale = np.max(abs(found.gradient), axis=1)
    for column in range(inputs.shape[1]):
        moved = inputs.copy()
        moved[:, column] = inputs[:, column] + own[:, column] * arithmetic.step
        change = formula(arithmetic, moved, sides).gradient - found.gradient
        scale = scale + np.max(abs(change), axis=1) / arithmetic.step
    return scale


Answers = tuple[np.ndarray, np.ndarray]


class ScaledErrors(NamedTuple):
    """Condition-scaled errors of a batch of answers, each of shape (cases,).

    Attributes:
        margin: exact, in units of the linkage's size.
        value: of the pin, as one plane vector.
        gradient: of the worst column of its gradient.
        gradient_relative: the same relative to that column.
    """

    margin: np.ndarray
    value: np.ndarray
    gradient: np.ndarray
    gradient_relative: np.ndarray


def scaled_errors(
    formula: Formula, inputs: np.ndarray, sides: np.ndarray, answers: Answers, digits: int
) -> ScaledErrors:
    """Compare pins and their gradients with a formula's; in mpmath numbers where a case is hard.

    Args:
        formula: what is exact; coordinates count from the first fixed joint.
        inputs: shape (cases, inputs), floats.
        sides: shape (cases,).
        answers: pins, shape (cases, 2), and gradients, shape (cases, 2, inputs).
        digits: of mpmath numbers.
    """
    hard = np.ones(len(inputs), bool)
    # Where long double is no wider than float64, nothing can be judged in it.
    if formula.closed_form and np.finfo(np.longdouble).eps < 1e-18:
        found = formula.pin(EXTENDED, EXTENDED.number(inputs), sides)
        far = np.max(abs(inputs[:, :-1]), axis=1) > FAR * found.size
        hard = far | (abs(_relative_margin(found)) < HARD)
    errors = ScaledErrors(*np.full((4, len(inputs)), np.nan))
    for mask, arithmetic in ((~hard, EXTENDED), (hard, DIGITS)):
        if np.any(mask):
            some = inputs[mask], sides[mask], (answers[0][mask], answers[1][mask])
            with mpmath.workdps(digits):
                found = _scaled_errors(formula, arithmetic, *some)
            for whole, part in zip(errors, found, strict=True):
                whole[mask] = part
    return errors


def _scaled_errors(
    formula: Formula,
    arithmetic: Arithmetic,
    inputs: np.ndarray,
    sides: np.ndarray,
    answers: Answers,
) -> ScaledErrors:
    x = arithmetic.number(inputs)
    own = x.copy()
    for at in formula.points:
        own[:, at : at + 2] = x[:, at : at + 2] - x[:, :2]
    own = abs(own)
    right = formula.pin(arithmetic, x, sides)
    # What is not finite must not pass for accurate.
    value, gradient = (
        arithmetic.number(np.where(np.isfinite(found), found, 1e30)) for found in answers
    )
    tolerated = gradient_scale(formula.pin, arithmetic, x, own, sides, right)
    slopes = np.max(abs(right.gradient), axis=1)
    swing = np.sum(own * slopes, axis=1)
    value_missed = np.max(abs(value - right.value), axis=1)
    missed = np.max(abs(gradient - right.gradient), axis=1)
    reach = np.max(abs(right.value - x[:, :2]), axis=1) + swing
    # Both scales, times the input so that inputs of 0 need no division.
    both = _ratio(missed * own, reach[:, None] + own * tolerated)
    return ScaledErrors(
        _relative_margin(right),
        _ratio(value_missed, np.max(abs(right.value), axis=1) + swing),
        np.max(np.where(own == 0, _ratio(missed, tolerated), both), axis=1),
        np.max(_ratio(missed, slopes), axis=1),
    )


def _relative_margin(found: Exact) -> np.ndarray:
    """Margins in units of the linkages' sizes, as floats."""
    return (found.margin / (found.size + (found.size == 0))).astype(float)


def _ratio(error: np.ndarray, scale: np.ndarray) -> np.ndarray:
    # What stays zero whatever the inputs do must come out as zero.
    divided = (error / (scale + (scale == 0))).astype(float)
    return np.where((scale == 0) & (error != 0), np.inf, divided)
