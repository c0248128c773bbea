"""Extreme cases as rows, one for each case: which of them failed, and what is reported of them.

Columns are ``case`` (the family), ``dtype``, ``infeasible``, ``wrong_verdict``, ``value_error``,
``gradient_error`` and ``gradient_relative_error`` (NaN where none is defined), ``non_finite`` (how
many numbers of the answer are not finite), ``failed``, and what a study adds.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from designopt.plot.figures import MARKERS, PALETTE
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


def say_failures(out: Report, cases: Records, verdicts: Callable[[Records], Iterable[str]]) -> None:
    """Put down a sentence for each family with wrong answers.

    Args:
        out: has an entry ``failure``.
        cases: all of them.
        verdicts: what is wrong with a family's verdicts.
    """
    for (case, dtype), own in cases.group("case", "dtype").items():
        faults, unit = [*verdicts(own)], rounding(dtype)
        if count := own.stat("sum non_finite"):
            faults.append(f"{count} numbers are not finite")
        for name, limit in LIMITS.items():
            if count := np.sum(own[name] > limit * unit):
                worst = largest(own[name]) / unit
                what = name.replace("_error", "s")
                faults.append(f"{count} {what} are off by up to {worst:.2g} units of rounding")
        if own["failed"].any():
            out.say("failure", case=case, dtype=dtype, count=len(own), faults=", ".join(faults))


def draw_errors(
    axis: Axes, judged: Records, x: str, name: str, label: str = "", *, hollow: bool = False
) -> None:
    """Errors of single cases over a column, beside the rounding of their float types.

    Args:
        axis: to draw into.
        judged: rows.
        x: column of the abscissae; those that are not positive and finite are left out.
        name: column of the errors; below a 64th of rounding they are drawn there.
        label: what follows the float type in the legend.
        hollow: whether markers are.
    """
    for index, (dtype, own) in enumerate(judged.group("dtype").items()):
        own = own.where((own[x] > 0) & np.isfinite(own[x]) & np.isfinite(own[name]))
        color, unit = PALETTE[index], rounding(dtype)
        face = "none" if hollow else color
        style = {"color": color, "markerfacecolor": face, "markersize": 3, "label": dtype + label}
        axis.plot(own[x], np.maximum(own[name], unit / 64), MARKERS[index], **style)
        axis.axhline(unit, color=color, linestyle=":")
    axis.set(xscale="log", yscale="log")


Series = tuple[np.ndarray, str, str, str]
"""Values, what they are called, and color and style of their line."""


def draw_counts(axis: Axes, what: str, counted: str, series: Sequence[Series]) -> None:
    """How many values are how large, in sixths of a decade."""
    logs = [np.log10(values) for values, *_ in series]
    low = np.floor(np.min(np.concatenate(logs), initial=0.0))
    high = np.ceil(np.max(np.concatenate(logs), initial=low))
    edges = np.arange(6 * low, 6 * high + 1) / 6
    for values, (_, label, color, style) in zip(logs, series, strict=True):
        axis.hist(values, edges, histtype="step", color=color, linestyle=style, label=label)
    axis.set(xlabel=f"log₁₀ of {what}", ylabel=counted, yscale="log")
    axis.legend(loc="upper left", fontsize=7)
    axis.set_ylim(0.5, max(10.0, axis.get_ylim()[1]) * 30)
