"""Judge an engine's answers for the families of extreme scenes by the formulas of `cases`.

Inputs count from the camera and in units of the scene's size, so that an origin far away excuses
nothing, and y is what is exact for the inputs as they were rounded. Parts of a pad and angles are
judged relative to 1 + Σ|x_j ∂y/∂x_j|, what rounding the inputs and one end of a piece would do
(`designopt.study.stability`); entries of a gradient relative to its largest entry, or by what they
would do to y. Where surfaces or views just touch there is no derivative.
"""

from __future__ import annotations

from dataclasses import dataclass

import mpmath
import numpy as np

from designopt.study.results import StabilityRow
from designopt.study.stability import DIGITS, GRADIENT_TOLERANCE, VALUE_TOLERANCE
from studies.stability.visibility.answers import Answers, Asked, ask, uneven
from studies.stability.visibility.cases import families
from studies.stability.visibility.exact import ExactScene, judged_numbers, slopes
from studies.stability.visibility.families import Family
from studies.stability.visibility.scenes import CAMERA, PADS

UNDECIDED = 64
"""How near to a change of its views, in units of rounding of its size, a scene is not judged."""


@dataclass(frozen=True)
class Judged:
    """What came of a family in one float type; arrays of shape (cases,).

    Attributes:
        case: what is extreme in it.
        dtype: float type of the inputs and of the arithmetic.
        infeasible: how many of the scenes show nothing.
        clear: how far each scene is from where its views change, of its size.
        value_error: worst scaled error of coverage, parts and margins, NaN if not judged.
        gradient_error: the same of the gradient's entries.
        gradient_relative_error: worst error of an entry relative to that entry alone, of those
            that are not rounding beside the largest.
        wrong_verdict: whether a pad is said to be seen by a path that does not show it or the
            other way round, or the margin has the other sign.
        non_finite: how many numbers are not finite.
    """

    case: str
    dtype: str
    infeasible: int
    clear: np.ndarray
    value_error: np.ndarray
    gradient_error: np.ndarray
    gradient_relative_error: np.ndarray
    wrong_verdict: np.ndarray
    non_finite: np.ndarray

    @property
    def failed(self) -> np.ndarray:
        """Cases answered wrongly in any respect."""
        rounding = float(np.finfo(self.dtype).eps)
        wrong = self.wrong_verdict | (self.non_finite > 0)
        wrong |= self.value_error > VALUE_TOLERANCE * rounding
        return wrong | (self.gradient_error > GRADIENT_TOLERANCE * rounding)

    @property
    def row(self) -> StabilityRow:
        """The family as one row of a stability table."""
        return StabilityRow(
            case=self.case,
            dtype=self.dtype,
            cases=len(self.failed),
            infeasible=self.infeasible,
            failures=int(np.sum(self.failed)),
            worst_error=largest(self.value_error),
            worst_gradient_error=largest(self.gradient_error),
            worst_gradient_relative_error=largest(self.gradient_relative_error),
            non_finite=int(np.sum(self.non_finite)),
        )


def largest(errors: np.ndarray) -> float:
    """The largest error, 0 where none is defined; NaN counts as none."""
    return float(np.max(np.nan_to_num(errors, nan=0.0, posinf=np.inf), initial=0.0))


def judge_families(asked: Asked, dtype: str, count: int) -> list[Judged]:
    """Ask for all families at once, twice: for all gradients, and for the one that is judged.

    Args:
        asked: what is asked of which engine.
        dtype: float type.
        count: cases in each family.
    """
    found = list(families(dtype, count))
    rows = [family.rows.astype(dtype) for family in found]
    with mpmath.workdps(DIGITS):
        exact = [
            [_exact(row, family, asked.bounces) for row in some]
            for family, some in zip(found, rows, strict=True)
        ]
    views = np.array([case.views for cases in exact for case in cases])
    everything = ask(asked, np.concatenate(rows))
    judged = ask(asked, np.concatenate(rows), {"coverage": 1.0, "seen": 1.0, "margin": views})
    result, start = [], 0
    for family, cases in zip(found, exact, strict=True):
        part = slice(start, start + len(cases))
        in_all = everything.part(part).non_finite
        result.append(_judge(family, dtype, cases, judged.part(part), in_all))
        start = part.stop
    return result


@dataclass(frozen=True)
class _Exact:
    """What a scene shows.

    Attributes:
        numbers: coverage of the pads, then parts, then margins by all views.
        slopes: their derivatives, coordinates in units of the scene's size; if there are any.
        own: the inputs, counted from the camera, in the same units.
        unit: that size for coordinates, 1 for angles.
        views: whether each path shows each pad.
    """

    numbers: np.ndarray
    slopes: np.ndarray | None
    own: np.ndarray
    unit: np.ndarray
    views: np.ndarray


def _exact(row: np.ndarray, family: Family, bounces: int) -> _Exact:
    number = digits(row)
    scene = ExactScene(number)
    numbers = judged_numbers(scene, family.formula, bounces)
    views = np.split(numbers[PADS:], 2)[0].reshape(-1, PADS) > 0
    places = number[: CAMERA.stop].reshape(-1, 2)
    own = abs(places - places[-1])
    own[-1] = np.max(own, axis=0)  # moving the camera moves all else the other way
    size = np.max(own) or mpmath.mpf(1)
    unit = np.array([size] * CAMERA.stop + [mpmath.mpf(1)] * (len(row) - CAMERA.stop))
    own = np.concatenate([own.reshape(-1), abs(number[CAMERA.stop :])]) / unit
    moved = slopes(scene, family.formula, bounces, unit) if family.smooth else None
    return _Exact(numbers, moved, own, unit, views)


def _judge(
    family: Family, dtype: str, exact: list[_Exact], answers: Answers, non_finite: np.ndarray
) -> Judged:
    rounding = float(np.finfo(dtype).eps)
    parts = [
        answers.numbers[name].reshape(len(exact), -1) for name in ("coverage", "seen", "margin")
    ]
    said = np.concatenate(parts, axis=1)
    views, margin = np.array([case.views for case in exact]), answers.numbers["margin"]
    wrong = (answers.ok != views) | np.where(views, margin <= 0, margin > UNDECIDED * rounding)
    clear = np.broadcast_to(family.clear, len(exact))
    decided = clear > UNDECIDED * rounding
    errors = np.full((3, len(exact)), np.nan)
    with mpmath.workdps(DIGITS):
        for index in np.flatnonzero(decided):
            errors[:, index] = _errors(exact[index], said[index], answers.gradient[index])
    return Judged(
        case=family.case,
        dtype=dtype,
        infeasible=int(np.sum(~np.any(views, axis=(1, 2)))),
        clear=clear,
        value_error=errors[0],
        gradient_error=errors[1] / family.steepness,
        gradient_relative_error=errors[2],
        wrong_verdict=decided & np.any(wrong, axis=(1, 2)),
        non_finite=non_finite + answers.non_finite,
    )


def _errors(exact: _Exact, said: np.ndarray, gradient: np.ndarray) -> tuple[float, float, float]:
    # A margin is judged where there is a view; how far another is missed, the engine alone says.
    shapes = {"coverage": (PADS,), "seen": exact.views.shape, "margin": exact.views.shape}
    weights = np.concatenate([uneven(*item).reshape(-1) for item in shapes.items()])
    weights[-exact.views.size :] *= exact.views.reshape(-1)
    missed, judged = abs(digits(said) - exact.numbers), weights > 0
    if exact.slopes is None:
        return float(max(missed[: -exact.views.size])), np.nan, np.nan
    swing = np.sum(exact.own * abs(exact.slopes), axis=1)
    value = float(max((missed / (1 + swing))[judged]))
    slope = np.sum(weights[:, None] * exact.slopes, axis=0)
    off, steepest = abs(digits(gradient) * exact.unit - slope), max(abs(slope))
    if steepest == 0:  # nothing is seen, whatever moves
        return value, float(max(off)), float(max(off))
    effect = np.sum(weights * (abs(exact.numbers) + swing))
    steep = abs(slope) > 1e-15 * steepest
    return (
        value,
        float(max(np.minimum(off / steepest, exact.own * off / effect))),
        float(max(off[steep] / abs(slope[steep]))),
    )


def digits(values: np.ndarray) -> np.ndarray:
    """Numbers in as many digits as are in use."""
    # What is not finite is counted as such; here it must not pass for accurate either.
    return np.array([mpmath.mpf(float(v)) if np.isfinite(v) else mpmath.mpf(1e300) for v in values])
