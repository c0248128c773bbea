"""Extreme cases as rows, one for each case: which of them failed, and what is reported of them.

Columns are ``case`` (the family), ``dtype``, ``infeasible``, ``wrong_verdict``, ``value_error``,
``gradient_error`` and ``gradient_relative_error`` (NaN where none is defined), ``non_finite`` (how
many numbers of the answer are not finite), ``failed``, and what a study adds.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np

from designopt.study.records import Records
from designopt.study.report import Report
from designopt.study.results import StabilityRow
from designopt.study.stability import GRADIENT_TOLERANCE, VALUE_TOLERANCE

DTYPES = ("float64", "float32")
LIMITS = {"value_error": VALUE_TOLERANCE, "gradient_error": GRADIENT_TOLERANCE}
"""Largest error of a case that has not failed, units of rounding."""


def rounding(dtype: Any) -> float:
    """Unit of rounding of a float type."""
    return float(np.finfo(dtype).eps)


def largest(errors: np.ndarray) -> float:
    """The largest error, 0 where none is defined; NaN counts as none."""
    return float(np.fmax.reduce(errors, axis=None, initial=0.0))


def total(column: str) -> Callable[[Records], int]:
    """The sum of a column of counts or truth values, as a whole number."""
    return lambda own: int(own.stat(f"sum {column}"))


def failed(columns: Mapping[str, np.ndarray], dtype: Any) -> np.ndarray:
    """Cases whose verdict, numbers or errors are wrong, shape (cases,)."""
    over = [columns[name] > limit * rounding(dtype) for name, limit in LIMITS.items()]
    return np.any([columns["wrong_verdict"], columns["non_finite"] > 0, *over], axis=0)


def row(own: Records) -> StabilityRow:
    """The cases of a family in one float type as a row of the stability table."""
    return StabilityRow(
        case=own["case"][0],
        dtype=own["dtype"][0],
        cases=len(own),
        infeasible=total("infeasible")(own),
        failures=total("failed")(own),
        worst_error=largest(own["value_error"]),
        worst_gradient_error=largest(own["gradient_error"]),
        worst_gradient_relative_error=largest(own["gradient_relative_error"]),
        non_finite=total("non_finite")(own),
    )


def report_cases(out: Report, cases: Records) -> None:
    """Put down every family's row and the metrics of all; give the numbers of cases for braces."""
    out.stability([row(own) for own in cases.group("case", "dtype").values()])
    bad = cases.where(cases["failed"])
    count = {"cases": len(cases), "families": len(cases.group("case")), "bad": len(bad)}
    out.values(**count, bad_families=len(set(bad["case"])))
    for dtype, own in cases.group("dtype").items():
        for name in LIMITS:
            worst = largest(own[name]) / rounding(dtype)
            out.metric(f"worst_{name}_{dtype}", worst, f"worst_{name}", dtype=dtype)
    out.metrics(stability_failures=len(bad))


def say_failures(out: Report, cases: Records, verdicts: Callable[[Records], Iterable[str]]) -> None:
    """Put down a sentence for each family with wrong answers.

    Args:
        out: has an entry ``failure``.
        cases: all of them.
        verdicts: what is wrong with a family's verdicts.
    """
    for (case, dtype), own in cases.group("case", "dtype").items():
        faults, unit = [*verdicts(own)], rounding(dtype)
        if count := total("non_finite")(own):
            faults.append(f"{count} numbers are not finite")
        for name, limit in LIMITS.items():
            if count := np.sum(own[name] > limit * unit):
                worst = largest(own[name]) / unit
                what = name.replace("_error", "s")
                faults.append(f"{count} {what} are off by up to {worst:.2g} units of rounding")
        if own["failed"].any():
            out.say("failure", case=case, dtype=dtype, count=len(own), faults=", ".join(faults))
