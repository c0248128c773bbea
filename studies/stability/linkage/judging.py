"""Judge the library's answers by the formulas of `exact`, case by case.

Values are judged as in `designopt.study.stability`, a position as one plane vector (its larger
coordinate), so that the direction of the axes plays no part. Coordinates count from the first
fixed joint: where the world's origin is conditions nothing. A column of the gradient passes if its
error is small on either of two scales: what it would do to the position, as there, or what
rounding the inputs does to the column itself. The second is needed near lock-up: at a margin m of
the linkage's size the gradient grows as m^(−1/2), and a relative change ε of an input changes it
by ε / m of itself, whoever computes it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import mpmath
import numpy as np

from designopt.study.results import StabilityRow
from designopt.study.stability import DIGITS, GRADIENT_TOLERANCE, VALUE_TOLERANCE
from studies.oracles import linkages as exact
from studies.stability.linkage.mechanisms import Mechanism, Solved

UNDECIDED = {"float64": 1e-12, "float32": 32 * float(np.finfo("float32").eps)}
"""Margins, in units of the linkage's size, up to which either verdict is accepted.

float32 cannot resolve 1e-12: there it is 32 units of rounding (3.8e-6), twice the 16 that the
library itself counts as touching, as the margin it compares with them is rounded as well.
"""

CLOSURE = {"float64": 1e-12, "float32": 64 * float(np.finfo("float32").eps)}
"""Largest gap of a pose that is marked ok, in units of the linkage's size."""

HARD = 1e-6
"""Margin, in units of the size, below which cases are judged in `DIGITS` digits."""

FAR = 1e3
"""Coordinates, in units of the size, beyond which they are too: their differences cost digits."""


@dataclass(frozen=True)
class Judged:
    """What came out of a batch of cases; arrays of shape (cases,).

    Attributes:
        margin: exact, in units of the linkage's size.
        ok: the library's verdict.
        value_error: condition-scaled error of the position, NaN where none is defined.
        gradient_error: the same of the worst column of its gradient.
        gradient_size: largest entry of the gradient, each times its input, in units of size.
        gradient_relative_error: worst error of a column relative to that column.
        closure: what the library says of its own closure, in units of size.
        gap: how far the pins miss the dimensions, in units of the largest length or coordinate.
        non_finite: how many numbers are not finite.
        dtype: float type of the inputs.
    """

    margin: np.ndarray
    ok: np.ndarray
    value_error: np.ndarray
    gradient_error: np.ndarray
    gradient_size: np.ndarray
    gradient_relative_error: np.ndarray
    closure: np.ndarray
    gap: np.ndarray
    non_finite: np.ndarray
    dtype: str

    @property
    def wrong_verdict(self) -> np.ndarray:
        """Cases called feasible that are not, or the other way round."""
        return (abs(self.margin) > UNDECIDED[self.dtype]) & (self.ok != (self.margin > 0))

    @property
    def open_closure(self) -> np.ndarray:
        """Cases marked ok that do not close."""
        limit = CLOSURE[self.dtype]
        return self.ok & ~((self.closure <= limit) & (self.gap <= limit))

    @property
    def failed(self) -> np.ndarray:
        """Cases answered wrongly in any respect."""
        rounding = float(np.finfo(self.dtype).eps)
        wrong = self.wrong_verdict | self.open_closure | (self.non_finite > 0)
        wrong |= self.value_error > VALUE_TOLERANCE * rounding
        return wrong | (self.gradient_error > GRADIENT_TOLERANCE * rounding)

    def row(self, case: str) -> StabilityRow:
        """The batch as one row of a stability table."""
        return StabilityRow(
            case=case,
            dtype=self.dtype,
            cases=len(self.ok),
            infeasible=int(np.sum(self.margin < 0)),
            failures=int(np.sum(self.failed)),
            worst_error=largest(self.value_error),
            worst_gradient_error=largest(self.gradient_error),
            worst_gradient_relative_error=largest(self.gradient_relative_error),
            non_finite=int(np.sum(self.non_finite)),
        )

    def part(self, cases: slice) -> Judged:
        """Some of the cases."""
        arrays = {field.name: getattr(self, field.name) for field in fields(self)[:-1]}
        return Judged(**{name: array[cases] for name, array in arrays.items()}, dtype=self.dtype)


def largest(errors: np.ndarray) -> float:
    """The largest error, 0 where none is defined; NaN counts as none."""
    return float(np.max(np.nan_to_num(errors, nan=0.0, posinf=np.inf), initial=0.0))


def judge(mechanism: Mechanism, inputs: np.ndarray, sides: np.ndarray, solved: Solved) -> Judged:
    """Judge a batch of solved cases.

    Args:
        mechanism: which.
        inputs: shape (cases, inputs), as they were solved.
        sides: shape (cases,).
        solved: the library's answers.
    """
    easy = exact.EXTENDED
    hard = np.ones(len(inputs), bool)
    # Where long double is no wider than float64, nothing can be judged in it.
    if mechanism.closed_form and np.finfo(np.longdouble).eps < 1e-18:
        found = mechanism.formula(easy, easy.number(inputs), sides)
        far = np.max(abs(inputs[:, :-1]), axis=1) > FAR * found.size
        hard = far | (abs(_relative_margin(found)) < HARD)
    parts: dict[str, np.ndarray] = {
        name: np.full(len(inputs), np.nan)
        for name in ("margin", "value_error", "gradient_error", "gradient_relative_error")
    }
    for mask, arithmetic in ((~hard, easy), (hard, exact.DIGITS)):
        if np.any(mask):
            some = Solved(*(part[mask] for part in solved))
            with mpmath.workdps(DIGITS):
                found = _errors(mechanism, arithmetic, inputs[mask], sides[mask], some)
            for name, values in zip(parts, found, strict=True):
                parts[name][mask] = values
    wide_inputs = easy.number(inputs)
    size = np.max(abs(inputs[:, :-1]), axis=1)
    effect = np.max(abs(solved.gradient.astype(float)), axis=1) * abs(inputs.astype(float))
    return Judged(
        **parts,
        ok=solved.ok,
        gradient_size=np.max(effect, axis=1) / np.where(size > 0, size, 1),
        closure=solved.residual.astype(float),
        gap=mechanism.gaps(wide_inputs, solved.crank_pin, solved.value).astype(float),
        non_finite=solved.non_finite,
        dtype=str(inputs.dtype),
    )


def _errors(
    mechanism: Mechanism,
    arithmetic: exact.Arithmetic,
    inputs: np.ndarray,
    sides: np.ndarray,
    solved: Solved,
) -> Sequence[np.ndarray]:
    x = arithmetic.number(inputs)
    right = mechanism.formula(arithmetic, x, sides)
    margin = _relative_margin(right)
    own = mechanism.own_sizes(x)
    tolerated = exact.gradient_scale(mechanism.formula, arithmetic, x, own, sides, right)
    slopes = np.max(abs(right.gradient), axis=1)
    swing = np.sum(own * slopes, axis=1)
    value_missed = np.max(abs(_number(arithmetic, solved.value) - right.value), axis=1)
    value_error = _ratio(value_missed, np.max(abs(right.value), axis=1) + swing)
    missed = np.max(abs(_number(arithmetic, solved.gradient) - right.gradient), axis=1)
    reach = np.max(abs(right.value - x[:, mechanism.coordinates[0]]), axis=1) + swing
    # Both scales, times the input so that inputs of 0 need no division.
    gradient_error = np.where(
        own == 0,
        _ratio(missed, tolerated),
        _ratio(missed * own, reach[:, None] + own * tolerated),
    )
    exists = solved.ok & (margin > 0)
    decided = solved.ok & (margin > UNDECIDED[str(inputs.dtype)])
    return (
        margin,
        np.where(exists, value_error, np.nan),
        np.where(decided, np.max(gradient_error, axis=1), np.nan),
        np.where(decided, np.max(_ratio(missed, slopes), axis=1), np.nan),
    )


def _number(arithmetic: exact.Arithmetic, values: np.ndarray) -> np.ndarray:
    # What is not finite is counted as such; here it must not pass for accurate either.
    return arithmetic.number(np.where(np.isfinite(values), values, 1e30))


def _ratio(error: np.ndarray, scale: np.ndarray) -> np.ndarray:
    # What stays zero whatever the inputs do must come out as zero.
    divided = (error / (scale + (scale == 0))).astype(float)
    return np.where((scale == 0) & (error != 0), np.inf, divided)


def _relative_margin(found: exact.Exact) -> np.ndarray:
    return (found.margin / (found.size + (found.size == 0))).astype(float)


@dataclass(frozen=True)
class Family:
    """A family and what came of it in one float type."""

    case: str
    judged: Judged
