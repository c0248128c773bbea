"""The study's findings and metrics."""

from __future__ import annotations

import numpy as np

from designopt.study.results import Metric, Target
from studies.finger_linkage.comparing import NEAR_DEG, Comparison
from studies.models.body import BodySpec
from studies.models.linkage_design.analysis import LinkageDesign
from studies.models.linkage_design.spec import FingerLinkageSpec, LimitsSpec

ASKED = {(25.0, None): 49.0, (22.0, None): 46.5, (20.0, None): 42.5, (25.0, 0.412): 43.5}
"""Least transmission angle asked for by thickness and bound on φ₂/φ₁, degrees: targets of this
project, a little less than an independent search reached under the same packaging."""

ELSEWHERE = {25.0: 49.6, 22.0: 47.0, 20.0: 43.1}
"""What that search reached, degrees."""

SAME_DEG = 0.02
"""Starts that end within this of the best count as having reached it, degrees."""


def findings(
    spec: FingerLinkageSpec, design: LinkageDesign, compared: Comparison | None
) -> list[str]:
    """What was found, most important first."""
    least = design.verdict.least_deg
    lines = [_result(spec, design)]
    held = [one.words for one in design.search.held_by()[:6]]
    if held:
        lines.append(f"The optimum is held by {_listed(held)}.")
    reached = design.search.rounds[0].feasible_deg
    if reached:
        best = max(reached)
        same = sum(level >= best - SAME_DEG for level in reached)
        lines.append(
            f"Of {spec.search.starts} starts {len(reached)} reached a design that meets all "
            f"requirements on the coarse postures, between {min(reached):.1f}° and {best:.1f}°; "
            f"{same} of them the best one."
        )
    lines.append(
        f"With errors of {spec.tolerance:g} mm (1 σ) in every coordinate the least angle is "
        f"{np.mean(design.drawn):.1f} ± {np.std(design.drawn):.1f}°; "
        f"{100 * np.mean(design.drawn > spec.limits.transmission_deg):.1f} % of "
        f"{len(design.drawn):,} fingers stay above {spec.limits.transmission_deg:g}°."
    )
    counts = [np.unique(part.x).size for part in design.search.rounds[-1].problem.data]
    lines.append(
        f"Left out: {counts[0]} × {counts[1]} postures stand for "
        f"{design.verdict.crank_deg.size:,}, and what DIP alone decides is computed for a row of "
        "them."
    )
    if compared is not None:
        lines.append(
            f"The search itself took {design.search.seconds:.1f} s "
            f"({design.search.compile_seconds:.0f} s of compiling apart) for {least:.2f}°."
        )
    return lines


def _result(spec: FingerLinkageSpec, design: LinkageDesign) -> str:
    least, unmet = design.verdict.least_deg, design.unmet
    where = f"In a finger {spec.body.thickness:g} mm thick"
    if unmet:
        conflict = design.search.conflict()
        if conflict:
            return f"{where} the requirements cannot all be met: they fail at {_listed(conflict)}."
        told = [
            f"{one.name} ({one.achieved:.3g} for {one.required:g} {one.unit})".strip()
            for one in unmet
        ]
        return f"{where} this search met all requirements but {_listed(told)}."
    gave = (
        ""
        if least > spec.limits.transmission_deg
        else (
            f", less than the {spec.limits.transmission_deg:g}° required: this requirement gave way"
        )
    )
    return (
        f"{where} the least of six transmission angles is {least:.2f}° over all postures, every "
        f"other requirement met{gave}."
    )


def _listed(parts: list[str]) -> str:
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} and {parts[-1]}"


def metrics(
    spec: FingerLinkageSpec, design: LinkageDesign, compared: Comparison | None
) -> list[Metric]:
    """The numbers; the targets of the search hold for the body and limits they were found for."""
    body, limits, verdict = spec.body, spec.limits, design.verdict
    usual = body == BodySpec(thickness=body.thickness) and limits == LimitsSpec(
        force_ratio=limits.force_ratio
    )
    asked = ASKED.get((body.thickness, limits.force_ratio)) if usual else None
    reached = design.search.rounds[0].feasible_deg
    found = [
        Metric(
            "min_transmission_angle_deg",
            verdict.least_deg,
            "°",
            "least of the six transmission angles over all postures in steps of 1°",
            ELSEWHERE.get(body.thickness) if usual and limits.force_ratio is None else None,
            Target(">=", asked if asked is not None else limits.transmission_deg),
        ),
        Metric(
            "unmet_requirements",
            len(design.unmet),
            "",
            f"requirements not met, of {len(verdict.checks) + 1} beside the transmission angle",
            None,
            Target("=", 0),
        ),
        Metric(
            "crank_range_deg",
            verdict.crank_range_deg,
            "°",
            "range of the crank",
        ),
        Metric("largest_force_ratio", float(verdict.ratio.max()), "", "largest φ₂/φ₁"),
        Metric("smallest_force_ratio", float(verdict.ratio.min()), "", "smallest φ₂/φ₁"),
        *(
            Metric(f"least_{name}_deg", float(np.min(values)), "°", f"least {name}")
            for name, values in verdict.angles_deg.items()
        ),
        Metric(
            "starts_feasible", len(reached), "", f"starts that met all, of {spec.search.starts}"
        ),
        Metric(
            "starts_spread_deg",
            max(reached) - min(reached) if reached else float("nan"),
            "°",
            "spread of the least angle over these starts, on the coarse postures",
        ),
        Metric(
            "tolerance_mean_deg",
            float(np.mean(design.drawn)),
            "°",
            f"mean least angle with errors of {spec.tolerance:g} mm",
        ),
        Metric(
            "tolerance_deviation_deg", float(np.std(design.drawn)), "°", "its standard deviation"
        ),
        Metric("search_seconds", design.search.seconds, "s", "run time of its solves"),
        Metric("compile_seconds", design.search.compile_seconds, "s", "time to compile them"),
    ]
    if compared is not None:
        found += _yardstick(compared)
    return found


def _yardstick(compared: Comparison) -> list[Metric]:
    own, near = compared.own, compared.evolution_near
    least, seconds = (own.least_deg, own.seconds) if own.feasible else (np.nan, np.nan)
    until = near if near is not None else float(compared.evolution.seconds[-1])
    return [
        Metric(
            "ahead_of_evolution_deg",
            least - compared.evolution_at(own.seconds),
            "°",
            "least angle above that of differential evolution after the same run time",
            None,
            Target(">=", 0),
        ),
        Metric(
            "time_over_evolution",
            seconds / until,
            "",
            f"run time to the optimum over that of differential evolution to within {NEAR_DEG:g}° "
            + ("of it" if near is not None else "of it, which it did not reach: an upper bound"),
            None,
            Target("<=", 0.2),
        ),
    ]
