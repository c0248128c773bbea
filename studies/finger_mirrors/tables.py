"""The study's tables."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from designopt.plot.typesetting import heading
from designopt.study.results import Table
from studies.finger_mirrors.findings import Case, Found
from studies.finger_mirrors.solvers import Run, best_objective
from studies.models.finger import camera_of
from studies.models.mirror_design.errors import NAMES, deviations
from studies.models.mirror_design.spec import FingerMirrorsSpec


def tables(spec: FingerMirrorsSpec, found: Found) -> list[Table]:
    """Every table of the study."""
    made = [arrangements(found), verdicts(spec, found), rows(found), starts(spec, found)]
    made += [tolerances(spec, found), rays(found)]
    return made + ([solvers(found.runs)] if found.runs else [])


def arrangements(found: Found) -> Table:
    """Where camera and mirrors are."""
    names = ["camera_x_mm", "camera_y_mm", "camera_tilt_deg"]
    names += [
        f"{mirror}_{end}_{axis}_mm"
        for mirror in ("distal", "proximal")
        for end in ("near", "far")
        for axis in "xy"
    ]
    kept = list(found.cases)
    return Table.of_columns(
        "arrangements",
        "Camera (in the intermediate phalanx; tilt from straight down, counter-clockwise) and "
        "mirror ends (in their own phalanges)",
        {"number": list(map(heading, names))}
        | {
            case.name: values for case, values in zip(found.cases, map(_numbers, kept), strict=True)
        },
        {case.name: 3 for case in found.cases},
    )


def _numbers(case: Case) -> list[float]:
    """Heights above the axes, for they are what a drawing shows."""
    dorsal, camera = float(case.finger.body.dorsal), camera_of(case.finger)
    ends = np.stack([np.asarray(mirror.ends) for mirror in case.finger.mirrors])
    ends[..., 1] = dorsal - ends[..., 1]
    place = [float(camera.along), dorsal - float(camera.depth), math.degrees(float(camera.tilt))]
    return [*place, *ends.ravel().tolist()]


def verdicts(spec: FingerMirrorsSpec, found: Found) -> Table:
    """What every arrangement is worth."""
    body = []
    for case in found.cases:
        verdict, lengths = case.verdict, case.mirror_lengths
        body.append(
            (
                case.name,
                case.thickness,
                verdict.mean_coverage,
                verdict.worst_coverage,
                float(np.mean(np.all(verdict.single >= 1 - 1e-9, axis=1))),
                verdict.worst_px_per_mm,
                sum(lengths),
                case.yields.draws,
                case.yields.value,
                case.yields.low,
                case.yields.high,
            )
        )
    return Table(
        "verdicts",
        "What each arrangement is worth: coverage and resolution on a 1° grid, yield with its 95 % "
        "confidence interval",
        [
            "arrangement",
            "thickness_mm",
            "mean_coverage",
            "worst_coverage",
            "postures_in_single_views",
            "worst_px_per_mm",
            "mirror_mm",
            "draws",
            "yield",
            "yield_low",
            "yield_high",
        ],
        body,
        {"mean_coverage": 4, "worst_px_per_mm": 2, "mirror_mm": 1},
    )


def rows(found: Found) -> Table:
    """Coverage, resolution and the share of good draws degree by degree, of the design."""
    case = found.after
    pads = [pad.name for pad in case.scene.layout.pads]
    columns: dict[str, list[float]] = {"pip_and_dip_deg": case.verdict.degrees.tolist()}
    for index, pad in enumerate(pads):
        columns[f"{pad}_coverage"] = case.verdict.coverage[:, index].tolist()
        columns[f"{pad}_px_per_mm"] = case.verdict.px_per_mm[:, index].tolist()
        columns[f"{pad}_yield"] = case.yields.by_pose[:, index].tolist()
    return Table.of_columns("degrees", f"Degree by degree: {case.name}", columns)


def starts(spec: FingerMirrorsSpec, found: Found) -> Table:
    """What every start led to."""
    design = found.design
    body = []
    for number, (trial, verdict) in enumerate(zip(design.trials, design.verdicts, strict=True)):
        body.append(
            (
                f"random {number}" if number else "poor",
                found.start_coverages[number],
                trial.objective,
                trial.violation,
                verdict.worst_coverage,
                verdict.worst_px_per_mm,
                design.meets(number, spec.floor),
                number == design.chosen,
                trial.steps,
                trial.seconds,
            )
        )
    return Table(
        "starts",
        "What every start led to; the first one waits for the compiler",
        [
            "start",
            "mean_coverage_at_start",
            "objective",
            "violation",
            "worst_coverage",
            "worst_px_per_mm",
            "met",
            "chosen",
            "steps",
            "seconds",
        ],
        body,
    )


def tolerances(spec: FingerMirrorsSpec, found: Found) -> Table:
    """How far each error may go by itself."""
    sizes, limits = deviations(spec.tolerances), found.sensitivity.limits
    body = []
    for name, size, (below, above) in zip(NAMES, sizes, limits, strict=True):
        tilt = "tilt" in name
        factor, unit = (math.degrees(size), "°") if tilt else (size, "mm")
        body.append((name, unit, factor, below * factor, above * factor, below, above))
    return Table(
        "tolerances",
        "Largest single error to either side that hides nothing (searched in steps of 0.1 "
        "standard deviations up to 5)",
        [
            "error",
            "unit",
            "standard_deviation",
            "least",
            "greatest",
            "least_over_deviation",
            "greatest_over_deviation",
        ],
        body,
    )


def rays(found: Found) -> Table:
    """The second check."""
    body = [
        (case.name, *map(float, degrees), *map(float, seen))
        for case, check in found.checks
        for degrees, seen in zip(check.degrees, check.coverage, strict=True)
    ]
    pads = [pad.name for pad in found.after.scene.layout.pads]
    return Table(
        "rays",
        "Coverage by a fan of rays at the postures in which errors hide something most often",
        ["arrangement", "pip_deg", "dip_deg", *pads],
        body,
        dict.fromkeys(pads, 6),
    )


def solvers(runs: Sequence[Run]) -> Table:
    """Objective gap and violation of every solver."""
    best = best_objective(runs)
    return Table(
        "solvers",
        "Every solver on the last stage's problem: the best so far (held before not held)",
        [
            "solver",
            "setting",
            "objective",
            "gap",
            "violation",
            "seconds",
            "compile_seconds",
        ],
        [
            (
                run.method,
                run.setting,
                run.objective,
                run.objective - best,
                run.violation,
                run.seconds,
                run.compile_seconds,
            )
            for run in runs
        ],
    )
