"""What the study says: its findings in sentences, its metrics with their targets, its tables."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from designopt.study.results import Metric, Table, Target
from designopt.study.stability import GRADIENT_TOLERANCE, VALUE_TOLERANCE
from studies.stability.visibility.judging import largest
from studies.stability.visibility.spec import StabilitySpec

if TYPE_CHECKING:
    from studies.stability.visibility.comparing import Compared
    from studies.stability.visibility.judging import Judged


def findings(
    spec: StabilitySpec, compared: Sequence[Compared], judged: Sequence[Judged]
) -> list[str]:
    """Plain sentences, most important first."""
    failed = [family for family in judged if np.any(family.failed)]
    said = [_rays(spec, compared), _families(judged, failed), _gradients(compared)]
    if spec.float32:
        said.append(_single(compared))
    return [*said, *map(_failure, failed)]


def metrics(
    spec: StabilitySpec, compared: Sequence[Compared], judged: Sequence[Judged]
) -> list[Metric]:
    """The study's numbers; every target is the one the study was set."""
    zero = Target("=", 0)
    result = [
        Metric(
            "random_disagreements",
            _disagreements(compared),
            "",
            f"of {spec.scenes} random scenes, those whose coverage or parts leave the bounds of "
            f"{spec.rays} rays, and then of {spec.fine_rays}, by more than these cannot know",
            target=zero,
        ),
        Metric(
            "worst_coverage_error",
            max(largest(some.fine.off) for some in compared),
            "",
            f"largest difference between a coverage and that of {spec.fine_rays} rays with "
            f"sharpened ends, in the {len(compared[0].fine.off)} scenes that were shot again",
            target=Target("<=", 1e-5),
        ),
        Metric(
            "wrong_verdicts",
            sum(some.wrong_verdicts for some in compared)
            + sum(int(np.sum(family.wrong_verdict)) for family in judged),
            "",
            "views called seen that are not or the other way round, and margins of the wrong sign",
            target=zero,
        ),
        Metric(
            "non_finite",
            sum(sum(some.non_finite.values()) for some in compared)
            + sum(int(np.sum(family.non_finite)) for family in judged),
            "",
            "numbers that are not finite among coverages, margins, pixels, resolutions, distances "
            "and reflections of all scenes, and their gradients",
            target=zero,
        ),
        Metric(
            "worst_gradient_error",
            max(max(some.gradients.worst.values()) for some in compared),
            "",
            "largest error of a random scene's gradient beside central differences, relative to "
            "its largest entry or 1",
            target=Target("<=", 1e-6),
        ),
        Metric(
            "worst_landing",
            max(some.landings.angle for some in compared),
            "rad",
            "largest angle by which a ray from the pixel of a piece's end misses that end",
            target=Target("<=", 1e-9),
        ),
    ]
    if spec.float32:
        result.append(
            Metric(
                "worst_float32_error",
                max(largest(some.single) for some in compared),
                "",
                "largest error of a random scene's coverage or parts in float32, beside float64 "
                "for the same inputs",
                target=Target("<=", 2e-5),
            )
        )
    for dtype in dict.fromkeys(family.dtype for family in judged):
        rounding = float(np.finfo(dtype).eps)
        rows = [family.row for family in judged if family.dtype == dtype]
        result += [
            Metric(
                f"worst_value_error_{dtype}",
                max(row.worst_error for row in rows) / rounding,
                "",
                f"largest scaled error in an extreme scene, units of rounding, {dtype}",
                target=Target("<=", VALUE_TOLERANCE),
            ),
            Metric(
                f"worst_gradient_error_{dtype}",
                max(row.worst_gradient_error for row in rows) / rounding,
                "",
                f"largest scaled error of a gradient there, units of rounding, {dtype}",
                target=Target("<=", GRADIENT_TOLERANCE),
            ),
        ]
    return [
        *result,
        Metric(
            "stability_failures",
            sum(family.row.failures for family in judged),
            "",
            f"extreme scenes answered wrongly in any respect, of {_count(judged)}",
            target=zero,
        ),
    ]


def random_table(compared: Sequence[Compared]) -> Table:
    """The random scenes, by the number of bounces."""
    columns = {
        "bounces": [some.bounces for some in compared],
        "scenes": [len(some.coarse.off) for some in compared],
        "differ": [int(np.sum(some.coarse.differ)) for some in compared],
        "shot_again": [len(some.fine.off) for some in compared],
        "differ_again": [int(np.sum(some.fine.differ)) for some in compared],
        "disagree": [int(np.sum(some.fine.disagree)) for some in compared],
        "worst_excess": [largest(some.coarse.excess) for some in compared],
        "worst_excess_again": [largest(some.fine.excess) for some in compared],
        "worst_error_again": [largest(some.fine.off) for some in compared],
        "worst_step_again": [largest(some.fine.step) for some in compared],
        "wrong_verdicts": [some.wrong_verdicts for some in compared],
        "landings": [some.landings.rays for some in compared],
        "worst_landing_rad": [some.landings.angle for some in compared],
        "worst_distance": [some.landings.distance for some in compared],
        "worst_reflection": [some.landings.reflection for some in compared],
        "worst_resolution": [some.landings.resolution for some in compared],
        "derivatives": [some.gradients.entries for some in compared],
        "left_out": [some.gradients.left_out for some in compared],
    }
    columns |= {
        f"worst_gradient: {name}": [some.gradients.worst[name] for some in compared]
        for name in compared[0].gradients.worst
    }
    return Table.of_columns("random", "Random scenes", columns)


def verdicts(judged: Sequence[Judged]) -> Table:
    """Verdicts and numbers of every family."""
    columns = ["case", "dtype", "scenes", "show_nothing", "judged", "wrong_verdicts", "non_finite"]
    rows = [
        (
            family.case,
            family.dtype,
            len(family.failed),
            family.infeasible,
            int(np.sum(~np.isnan(family.value_error))),
            int(np.sum(family.wrong_verdict)),
            int(np.sum(family.non_finite)),
        )
        for family in judged
    ]
    return Table("verdicts", "Verdicts of every family of extreme scenes", columns, rows)


def _count(judged: Sequence[Judged]) -> int:
    return sum(len(family.failed) for family in judged)


def _disagreements(compared: Sequence[Compared]) -> int:
    return int(np.sum(np.any([some.fine.disagree for some in compared], axis=0)))


def _rays(spec: StabilitySpec, compared: Sequence[Compared]) -> str:
    differ = int(np.sum(np.any([some.coarse.differ for some in compared], axis=0)))
    bounces = " and ".join(str(some.bounces) for some in compared)
    return (
        f"Of {spec.scenes:,} random scenes, each with up to {bounces} bounces, {differ} leave the "
        f"bounds of {spec.rays:,} rays, as something narrower than their spacing lies between two "
        f"of them; beside {spec.fine_rays:,} rays {_disagreements(compared)} disagree. In the "
        f"{len(compared[0].fine.off)} scenes that got so many, exact coverage is within "
        f"{max(largest(some.fine.off) for some in compared):.1e} of theirs, the ends of whose runs "
        "were sharpened by more rays between the last one inside and the next."
    )


def _families(judged: Sequence[Judged], failed: Sequence[Judged]) -> str:
    count, bad = _count(judged), sum(family.row.failures for family in failed)
    names, families = ({family.case for family in some} for some in (failed, judged))
    start = f"Of {count} extreme scenes in {len(families)} families"
    if not bad:
        return (
            f"{start}, none is answered wrongly: every verdict, value and gradient agrees with its "
            "formula in 50 digits."
        )
    return (
        f"{start}, {bad} are answered wrongly; they lie in {len(names)} families, which are named "
        "below, and the targets that they miss stand as missed."
    )


def _gradients(compared: Sequence[Compared]) -> str:
    found = [some.gradients for some in compared]
    entries, left_out = (
        sum(getattr(some, name) for some in found) for name in ("entries", "left_out")
    )
    return (
        f"{entries} derivatives of random scenes are within "
        f"{max(max(some.worst.values()) for some in found):.1e} of central differences; left out, "
        "as differences with two steps do not agree where a view changes its topology: "
        f"{left_out}. {sum(some.landings.rays for some in compared)} rays sent out from "
        "the pixels of pieces' ends arrive there within "
        f"{max(some.landings.angle for some in compared):.0e} rad."
    )


def _single(compared: Sequence[Compared]) -> str:
    errors = np.concatenate([some.single for some in compared])
    return (
        f"In float32 coverages and parts of random scenes are within {largest(errors):.1e} of "
        "float64 for the same, rounded, inputs, unscaled; the median error is "
        f"{np.median(errors):.0e} and one in a thousand exceeds {np.quantile(errors, 0.999):.0e}."
    )


def _failure(family: Judged) -> str:
    rounding = float(np.finfo(family.dtype).eps)
    faults = []
    if np.any(family.wrong_verdict):
        faults.append(f"{np.sum(family.wrong_verdict)} verdicts or signs of margins are wrong")
    if np.any(family.non_finite):
        faults.append(f"{np.sum(family.non_finite)} numbers are not finite")
    for name, errors, limit in (
        ("values", family.value_error, VALUE_TOLERANCE),
        ("gradients", family.gradient_error, GRADIENT_TOLERANCE),
    ):
        wrong = errors > limit * rounding
        if np.any(wrong):
            faults.append(f"{np.sum(wrong)} {name} are off by up to {largest(errors):.1e}")
    return f"{family.case} ({family.dtype}, {len(family.failed)} scenes): {', '.join(faults)}."
