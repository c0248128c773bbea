"""Extreme cases as rows, one for each case: which of them failed, and what is reported of them.

Columns are ``case`` (the family), ``dtype``, ``infeasible``, ``wrong_verdict``, ``value_error``,
``gradient_error`` and ``gradient_relative_error`` (NaN where none is defined), ``non_finite`` (how
many numbers of the answer are not finite), ``failed``, and what a study adds.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from designopt.plot.figures import MARKERS, PALETTE, new_figure
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
        infeasible=int(own.stat("sum infeasible")),
        failures=int(own.stat("sum failed")),
        worst_error=largest(own["value_error"]),
        worst_gradient_error=largest(own["gradient_error"]),
        worst_gradient_relative_error=largest(own["gradient_relative_error"]),
        non_finite=int(own.stat("sum non_finite")),
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
            out.metric(f"worst_{name}_{dtype}", worst, f"extreme_{name}", dtype=dtype)
    out.metrics(stability_failures=len(bad))


def say_failures(out: Report, cases: Records, *further: str) -> None:
    """Put down a sentence for each family with wrong answers.

    Args:
        out: has an entry ``failure``, for the largest errors, in units of rounding, and for sums of
            other columns, by their names.
        cases: all of them.
        further: columns of the study whose sums stand in that entry.
    """
    for (case, dtype), own in cases.group("case", "dtype").items():
        if own["failed"].any():
            worst = {name: largest(own[name]) / rounding(dtype) for name in LIMITS}
            counted = ("failed", "wrong_verdict", "non_finite", *further)
            sums = {name: own.stat(f"sum {name}") for name in counted}
            out.say("failure", case=case, dtype=dtype, count=len(own), **worst, **sums)


def draw_approach(judged: Records, x: str, columns: Mapping[str, str]) -> Figure:
    """Single cases on the way to a limit: each a dot, the errors beside what rounding does.

    Args:
        judged: rows.
        x: column of how far they are from it, of which those that are not positive and finite are
            left out.
        columns: what is drawn over it, each with its title; errors below a 64th of rounding are
            drawn there.
    """
    drawing, [row] = new_figure(1, len(columns), height=3.6)
    for axis, (name, title) in zip(row, columns.items(), strict=True):
        for index, (dtype, own) in enumerate(judged.group("dtype").items()):
            own = own.where((own[x] > 0) & np.isfinite(own[x]) & np.isfinite(own[name]))
            style, values = {"color": PALETTE[index], "markersize": 3, "label": dtype}, own[name]
            if name in LIMITS:
                values = np.maximum(values, rounding(dtype) / 64)
                axis.axhline(rounding(dtype), color=PALETTE[index], linestyle=":")
            axis.plot(own[x], values, MARKERS[index], **style)
        axis.set(xscale="log", yscale="log", title=title)
        axis.invert_xaxis()
    return drawing
