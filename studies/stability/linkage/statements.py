"""What the study says: its findings in sentences, its metrics with their targets, its table."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from designopt.study.results import Metric, Table, Target
from designopt.study.stability import GRADIENT_TOLERANCE, VALUE_TOLERANCE
from studies.stability.linkage.judging import CLOSURE, UNDECIDED, largest

if TYPE_CHECKING:
    from studies.stability.linkage.judging import Family


def findings(found: Sequence[Family]) -> list[str]:
    """Plain sentences, most important first."""
    said = [_counts(found), _random(found), _accuracy(found)]
    failed = [family for family in found if np.any(family.judged.failed)]
    return [*said, *map(_failure, failed)]


def metrics(found: Sequence[Family]) -> list[Metric]:
    """The study's numbers; every target is the one the study was set."""
    cases = sum(len(family.judged.ok) for family in found)
    double = [family for family in found if family.judged.dtype == "float64"]
    single = [family for family in found if family.judged.dtype == "float32"]
    zero = Target("=", 0)
    result = [
        Metric(
            "non_finite",
            sum(int(np.sum(family.judged.non_finite)) for family in found),
            "",
            f"numbers that are not finite in the solutions and gradients of {cases} cases",
            target=zero,
        ),
        Metric(
            "wrong_verdicts_float64",
            _wrong(double),
            "",
            "cases called feasible that are not or the other way round, float64, beyond a margin "
            f"of {UNDECIDED['float64']:.0e} of the size",
            target=zero,
        ),
        Metric(
            "wrong_verdicts_float32",
            _wrong(single),
            "",
            f"the same in float32, beyond {UNDECIDED['float32']:.1e} of the size (32 units of "
            "rounding)",
            target=zero,
        ),
        Metric(
            "open_poses_float64",
            sum(int(np.sum(family.judged.open_closure)) for family in double),
            "",
            f"poses marked ok that do not close to {CLOSURE['float64']:.0e} of the size, float64",
            target=zero,
        ),
        Metric(
            "worst_closure_float64",
            max(map(_closure, double)),
            "",
            "largest gap of a pose marked ok, in units of the size, float64",
            target=Target("<=", CLOSURE["float64"]),
        ),
    ]
    for families in (double, single):
        dtype = families[0].judged.dtype
        rounding = float(np.finfo(dtype).eps)
        rows = [family.judged.row(family.case) for family in families]
        result += [
            Metric(
                f"worst_value_error_{dtype}",
                max(row.worst_error for row in rows) / rounding,
                "",
                f"largest condition-scaled error of a position, units of rounding, {dtype}",
                target=Target("<=", VALUE_TOLERANCE),
            ),
            Metric(
                f"worst_gradient_error_{dtype}",
                max(row.worst_gradient_error for row in rows) / rounding,
                "",
                f"largest condition-scaled error of a gradient, units of rounding, {dtype}",
                target=Target("<=", GRADIENT_TOLERANCE),
            ),
        ]
    return [
        *result,
        Metric(
            "stability_failures",
            sum(int(np.sum(family.judged.failed)) for family in found),
            "",
            f"cases answered wrongly in any respect, of {cases}",
            target=zero,
        ),
    ]


def verdicts(found: Sequence[Family]) -> Table:
    """Verdicts and closure of every family."""
    rows = []
    for family in found:
        judged = family.judged
        rows.append(
            (
                family.case,
                judged.dtype,
                len(judged.ok),
                int(np.sum(judged.margin < 0)),
                int(np.sum(judged.ok)),
                int(np.sum(abs(judged.margin) <= UNDECIDED[judged.dtype])),
                int(np.sum(judged.wrong_verdict)),
                int(np.sum(judged.open_closure)),
                largest(judged.closure[judged.ok]),
                largest(judged.gap[judged.ok]),
                int(np.sum(judged.non_finite)),
            )
        )
    columns = [
        *("case", "dtype", "cases", "infeasible", "marked_ok", "undecided", "wrong_verdicts"),
        *("open_poses", "worst_residual", "worst_gap", "non_finite"),
    ]
    return Table("verdicts", "Verdicts and closure of every family", columns, rows)


def random_families(found: Sequence[Family]) -> list[Family]:
    """The families of random linkages."""
    return [family for family in found if family.case.endswith("random")]


def _wrong(families: Sequence[Family]) -> int:
    return sum(int(np.sum(family.judged.wrong_verdict)) for family in families)


def _closure(family: Family) -> float:
    judged = family.judged
    return max(largest(judged.closure[judged.ok]), largest(judged.gap[judged.ok]))


def _counts(found: Sequence[Family]) -> str:
    cases = sum(len(family.judged.ok) for family in found)
    bad = sum(int(np.sum(family.judged.failed)) for family in found)
    names = {family.case for family in found if np.any(family.judged.failed)}
    families = {family.case for family in found}
    if not bad:
        return (
            f"Of {cases} cases in {len(families)} families, in float64 and float32, none is "
            "answered wrongly: every verdict, position, gradient and closure is within its limit."
        )
    return (
        f"Of {cases} cases in {len(families)} families, in float64 and float32, {bad} are answered "
        f"wrongly; they lie in {len(names)} families, which are named below, and the targets that "
        "they miss stand as missed."
    )


def _random(found: Sequence[Family]) -> str:
    random = random_families(found)
    double = [family for family in random if family.judged.dtype == "float64"]
    shares = " and ".join(
        f"{np.mean(family.judged.margin < 0):.0%} of {len(family.judged.ok)} "
        f"{family.case.split(',')[0]}s"
        for family in double
    )
    non_finite = sum(int(np.sum(family.judged.non_finite)) for family in random)
    return (
        f"Of the random linkages {shares} cannot be assembled as they are driven; verdicts that "
        f"differ from exact arithmetic: {_wrong(random)}; numbers among values, margins, residuals "
        f"and gradients that are not finite: {non_finite}; largest gap of a pose in float64: "
        f"{max(map(_closure, double)):.1e} of the size."
    )


def _accuracy(found: Sequence[Family]) -> str:
    parts = []
    for dtype in ("float64", "float32"):
        judged = [f.judged for f in random_families(found) if f.judged.dtype == dtype]
        rounding = float(np.finfo(dtype).eps)
        value = max(largest(some.value_error) for some in judged) / rounding
        gradient = max(largest(some.gradient_error) for some in judged) / rounding
        parts.append(f"{value:.1f} and {gradient:.1f} units of rounding in {dtype}")
    return (
        "Scaled by the conditioning of each case, the worst errors of a random linkage's position "
        f"and gradient are {', '.join(parts)}. Near lock-up gradients grow as the inverse root of "
        "the margin and stay finite beyond it."
    )


def _failure(family: Family) -> str:
    judged = family.judged
    rounding = float(np.finfo(judged.dtype).eps)
    faults = []
    if np.any(judged.wrong_verdict):
        refused = int(np.sum(judged.wrong_verdict & ~judged.ok))
        accepted = int(np.sum(judged.wrong_verdict & judged.ok))
        margins = abs(judged.margin[judged.wrong_verdict])
        faults.append(
            f"{refused} poses that exist are refused and {accepted} that do not are marked ok, at "
            f"margins from {np.min(margins):.1e} to {np.max(margins):.1e}"
        )
    if np.any(judged.open_closure):
        faults.append(
            f"{np.sum(judged.open_closure)} poses marked ok leave gaps of up to "
            f"{_closure(family):.1e} of the size"
        )
    if np.any(judged.non_finite):
        faults.append(f"{np.sum(judged.non_finite)} numbers are not finite")
    for name, errors, limit in (
        ("positions", judged.value_error, VALUE_TOLERANCE),
        ("gradients", judged.gradient_error, GRADIENT_TOLERANCE),
    ):
        wrong = errors > limit * rounding
        if np.any(wrong):
            faults.append(
                f"{np.sum(wrong)} {name} are off by up to {largest(errors) / rounding:.2g} units "
                "of rounding"
            )
    return f"{family.case} ({judged.dtype}, {len(judged.ok)} cases): {', '.join(faults)}."
