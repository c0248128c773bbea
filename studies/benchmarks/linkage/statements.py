"""What the study says: findings in sentences, metrics with targets, claims with evidence."""

from __future__ import annotations

import math
import statistics
from collections.abc import Sequence

from designopt.study.benchmark import find_dominating
from designopt.study.results import Claim, Metric, PrecisionRow, Target
from studies.benchmarks.linkage.contenders import (
    FLOOR,
    FSOLVE,
    MECHANISM,
    OURS,
    PYLINKAGE_FAST,
    VALUE,
)
from studies.benchmarks.linkage.measuring import Measured, Measurements
from studies.benchmarks.linkage.spec import STATED_POSES, LinkagePrecisionSpec

CLOSE = 1e-9
"""An answer with a larger error does not compete for being the fastest."""

SPEED_TARGETS = (
    ("four-bar", MECHANISM, 1500.0),
    ("four-bar", FSOLVE, 300.0),
    ("four-bar", PYLINKAGE_FAST, 2.0),
    ("four-bar", FLOOR, 0.35),
    ("six-bar", PYLINKAGE_FAST, 2.0),
)
GRADIENT_TARGET = 4.0
FIRST_CALL_TARGETS = {"four-bar": 1.5, "finger": 3.0}

_KEYS = {
    MECHANISM: "over_mechanism",
    FSOLVE: "over_fsolve",
    PYLINKAGE_FAST: "over_pylinkage",
    FLOOR: "of_sin_cos",
}


def fastest(rows: Sequence[Measured], poses: int) -> Measured | None:
    """The fastest of the rows of so many poses that are close; none where none is."""
    close = [m for m in rows if m.work.poses == poses and m.row.error <= CLOSE]
    return min(close, key=lambda m: m.row.seconds, default=None)


def metrics(spec: LinkagePrecisionSpec, found: Measurements) -> list[Metric]:
    """The study's numbers; a target holds for the stated sweep, and where there is a number."""

    def metric(
        name: str, value: float, unit: str, description: str, asked: Target, judged: bool
    ) -> Metric:
        target = asked if judged and math.isfinite(value) else None
        return Metric(name, value, unit, description, None, target)

    stated = spec.poses == STATED_POSES
    rows = []
    for case, method, least in SPEED_TARGETS:
        ratio = found.rivals.get((case, method))
        rows.append(
            metric(
                f"{case.replace('-', '_')}_{_KEYS[method]}",
                ratio.value if ratio else math.nan,
                "",
                f"run time of {method} over that of the closed form, {case}, {spec.poses:,} poses",
                Target(">=", least),
                stated,
            )
        )
    for case, ratio in found.gradients.items():
        rows.append(
            metric(
                f"{case.replace('-', '_')}_gradient_over_value",
                ratio.value,
                "",
                "run time of value and gradient with respect to all dimensions over that of the "
                f"value, {case}, {spec.poses:,} poses",
                Target("<=", GRADIENT_TARGET),
                stated,
            )
        )
    for name, most in FIRST_CALL_TARGETS.items():
        calls = found.first_calls.get(name)
        rows.append(
            metric(
                f"{name.replace('-', '_')}_first_call_s",
                statistics.median(calls) if calls else math.nan,
                "s",
                f"first compiled call of {name} in a fresh process, median of the processes",
                Target("<=", most),
                True,
            )
        )
    errors = [m.row.error for m in found.rows if m.row.method == OURS and m.work.dtype == "float64"]
    rows.append(
        metric(
            "closed_form_worst_error",
            max(errors),
            "",
            "worst error of the closed form's poses and gradients in float64",
            Target("<=", 1e-12),
            True,
        )
    )
    return rows


def findings(spec: LinkagePrecisionSpec, found: Measurements) -> list[str]:
    """Plain sentences, most important first."""
    said = [_speed(case, found) for case in dict.fromkeys(m.work.case.name for m in found.rows)]
    said += _few(found)
    if found.gradients:
        parts = [f"{ratio.value:.2f} for the {case}" for case, ratio in found.gradients.items()]
        said.append(
            "Value and gradient with respect to all dimensions cost, in run times of the value "
            f"alone: {_listed(parts)} ({spec.poses:,} poses)."
        )
    if found.first_calls:
        parts = [f"{statistics.median(v):.2f} s for {k}" for k, v in found.first_calls.items()]
        said.append(f"The first call, compiling included, takes {_listed(parts)}.")
    if not any(m.row.method in (MECHANISM, PYLINKAGE_FAST) for m in found.rows):
        said.append("Other people's tools were not measured (peers=false, or not installed).")
    said.append(
        "All of it ran on one core."
        if all(found.pinned)
        else "This system cannot hold threads on one core, so these are not one core's times."
    )
    return said


def claims(spec: LinkagePrecisionSpec, found: Measurements) -> list[Claim]:
    """What the study says, each with what would prove it wrong."""
    said = [closed_form_claim(spec.poses, [m.row for m in found.rows if m.work.every])]
    if any((case, method) in found.rivals for case, method, _ in SPEED_TARGETS):
        said.insert(0, _speed_claim(spec, found))
    if found.gradients:
        said.append(
            Claim(
                "Value and gradient with respect to all dimensions cost at most "
                f"{GRADIENT_TARGET:g} times the value alone.",
                "The gradient is taken backwards through a program without iterations, block by "
                "block while it is in the cache, and once for all dimensions together.",
                [
                    f"{case}: {ratio.value:.2f} times ({ratio.low:.2f} to {ratio.high:.2f})"
                    for case, ratio in found.gradients.items()
                ],
                all(ratio.value <= GRADIENT_TARGET for ratio in found.gradients.values()),
            )
        )
    if found.first_calls:
        medians = {name: statistics.median(calls) for name, calls in found.first_calls.items()}
        said.append(
            Claim(
                "The first call of a fresh process takes at most "
                + _listed([f"{most:g} s for {name}" for name, most in FIRST_CALL_TARGETS.items()])
                + ", compiling included.",
                "The plan leaves a short program without a loop, so there is little to compile.",
                [
                    f"{name}: {medians[name]:.2f} s (of {', '.join(f'{s:.2f}' for s in calls)})"
                    for name, calls in found.first_calls.items()
                ],
                all(medians[name] <= most for name, most in FIRST_CALL_TARGETS.items()),
            )
        )
    return said


def closed_form_claim(poses: int, rows: Sequence[PrecisionRow]) -> Claim:
    """Whether anything that solves the same sweep is both faster and closer."""
    evidence, beaten = [], []
    for row in (row for row in rows if row.method == OURS):
        others = [
            other
            for other in rows
            if other.panel == row.panel and other.method not in (OURS, FLOOR, VALUE)
        ]
        beaten += find_dominating(row, others)
        near = [other for other in others if other.error <= 10 * row.error]
        text = f"{row.panel}: closed form {row.seconds:.2g} s, error {row.error:.1e}"
        if near:
            best = min(near, key=lambda other: other.seconds)
            text += (
                f"; fastest within ten times its error {best.method}"
                + (f", {best.setting}" if best.setting else "")
                + f": {best.seconds / row.seconds:.2f} times its time, error {best.error:.1e}"
            )
        evidence.append(text)
    for other in beaten:
        evidence.append(
            f"both faster and closer: {other.method}, {other.setting}, {other.panel}: "
            f"{other.seconds:.2g} s, error {other.error:.1e}"
        )
    return Claim(
        f"Of {poses:,} poses, nothing that was measured is both faster and closer than the closed "
        "form; for short sweeps the findings name who is fastest.",
        "It evaluates each loop once, and takes differences of squares only in factored form. An "
        "iteration evaluates the loops several times, and a block of poses waits for its slowest.",
        evidence,
        not beaten,
    )


def _speed_claim(spec: LinkagePrecisionSpec, found: Measurements) -> Claim:
    judged = [
        (case, method, least, found.rivals[case, method])
        for case, method, least in SPEED_TARGETS
        if (case, method) in found.rivals
    ]
    asked = [
        f"at least {least:g} times as fast as {method} on the {case}"
        if method != FLOOR
        else f"at {least:g} of the speed of {FLOOR} or above on the {case}"
        for case, method, least, _ in judged
    ]
    return Claim(
        f"On one core, with {spec.poses:,} poses in float64, the closed form is "
        + _listed(asked)
        + ".",
        "It needs one sine and one cosine, and per dyad one square root and a few divisions; "
        "XLA computes several poses per instruction, and blocks of poses stay in the cache.",
        [
            f"{case}, {method}: {ratio.value:.3g} ({ratio.low:.3g} to {ratio.high:.3g})"
            for case, method, _, ratio in judged
        ],
        all(ratio.value >= least for _, _, least, ratio in judged),
    )


def _speed(case: str, found: Measurements) -> str:
    ours = next(
        m
        for m in found.rows
        if (m.work.case.name, m.row.method, m.work.dtype) == (case, OURS, "float64")
        and m.work.every
    )
    rate = ours.work.poses / ours.row.seconds / 1e6
    parts = [
        f"{ratio.value:.3g} times as fast as {method}"
        for (name, method), ratio in found.rivals.items()
        if name == case and method != FLOOR
    ]
    floor = found.rivals[case, FLOOR].value
    return (
        f"{ours.work.poses:,} poses of the {case} take {1e3 * ours.row.seconds:.3g} ms "
        f"({rate:.3g} million a second) at {ours.row.error:.1e} of its size: {_listed(parts)}, "
        f"and {floor:.2f} of the speed of {FLOOR}."
    )


def _few(found: Measurements) -> list[str]:
    """Who is fastest on short sweeps."""
    said = []
    for poses in sorted({m.work.poses for m in found.rows if not m.work.every}):
        mine = [m for m in found.rows if not m.work.every and m.work.poses == poses]
        said.append(
            f"Fastest for {'one pose' if poses == 1 else f'{poses:,} poses'}: "
            + "; ".join(_winner(mine, case, poses) for case in _names(mine))
            + "."
        )
    return said


def _winner(rows: Sequence[Measured], case: str, poses: int) -> str:
    mine = [m for m in rows if m.work.case.name == case and m.row.method != FLOOR]
    ours = next(m for m in mine if m.row.method == OURS)
    best = fastest(mine, poses) or ours
    if best is ours:
        rest = fastest([m for m in mine if m is not ours], poses)
        behind = (
            ""
            if rest is None
            else (
                f", next {rest.row.method}, {rest.row.seconds / ours.row.seconds:.2g} times as long"
            )
        )
        return f"{case}, the closed form ({_time(ours.row.seconds)}{behind})"
    return (
        f"{case}, {best.row.method} ({_time(best.row.seconds)}; the closed form takes "
        f"{ours.row.seconds / best.row.seconds:.2g} times as long)"
    )


def _names(rows: Sequence[Measured]) -> list[str]:
    return list(dict.fromkeys(m.work.case.name for m in rows))


def _time(seconds: float) -> str:
    return f"{1e6 * seconds:.3g} µs"


def _listed(parts: Sequence[str]) -> str:
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} and {parts[-1]}"
