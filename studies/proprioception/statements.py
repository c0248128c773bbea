"""What the study says: findings in sentences, metrics with targets, a claim with evidence."""

from __future__ import annotations

import math
import statistics
from collections.abc import Sequence

import numpy as np

from designopt.results import Claim, Metric, PrecisionRow, Target
from studies.proprioception.found import Found
from studies.proprioception.ladder import (
    DESIGNED,
    EDGE,
    EXACT,
    GAP,
    GAP_THEN_EDGE,
    LABELLED,
    LENS_AS_DESIGNED,
    UNLABELLED,
    Answer,
    defined_share,
    errors_deg,
    of_method,
    variance_ratio,
)
from studies.proprioception.spec import ProprioceptionSpec
from studies.proprioception.tables import PAPER

GAP_LOW, GAP_HIGH = 1.5, 4.0
MEAN_DEG, P95_DEG, UNLABELLED_TIMES, VARIANCE_OFF = 0.5, 1.2, 1.5, 0.3
DETECTION_MS, SOLVE_MS = 100.0, 5.0


def mean_deg(answers: Sequence[Answer]) -> float:
    """Mean absolute error of the answers that are defined, degrees."""
    errors = np.abs(errors_deg(answers))
    return float(errors.mean()) if len(errors) else math.nan


def metrics(spec: ProprioceptionSpec, found: Found) -> list[Metric]:
    """The study's numbers; targets belong to the stated sizes."""
    default = ProprioceptionSpec()
    stated = (
        spec.severity == default.severity
        and spec.fingers >= default.fingers
        and spec.frames >= default.frames
        and found.finger.imaging.shape[0] == 1080
    )
    made: list[Metric] = []

    def add(
        name: str,
        value: float,
        unit: str,
        description: str,
        target: Target | None = None,
        reference: float | None = None,
    ) -> None:
        asked = target if stated else None
        made.append(Metric(name, value, unit, description, reference, asked))

    answers = found.answers
    paper = statistics.mean(mean for mean, _ in PAPER.values())
    middle = (GAP_LOW + GAP_HIGH) / 2
    add(
        "gap_mean_deg",
        mean_deg(found.gap_alone),
        "deg",
        f"mean error of the gap with {spec.labelled} labelled frames, corners with "
        f"{spec.pixel_noise:g} px of noise",
        Target("=", middle, GAP_HIGH - middle) if spec.pixel_noise == 1 else None,
        paper,
    )
    labelled = of_method(answers, LABELLED)
    p95 = float(np.quantile(np.abs(errors_deg(labelled)), 0.95)) if labelled else math.nan
    add("labelled_mean_deg", mean_deg(labelled), "deg", f"mean error of all corners with "
        f"{spec.labelled} labelled frames, from images", Target("<=", MEAN_DEG), paper)  # fmt: skip
    add("labelled_p95_deg", p95, "deg", "95th percentile of the same", Target("<=", P95_DEG))
    unlabelled = of_method(answers, UNLABELLED)
    add("unlabelled_mean_deg", mean_deg(unlabelled), "deg", "mean error without any label")
    add(
        "unlabelled_over_labelled",
        mean_deg(unlabelled) / mean_deg(labelled),
        "",
        "mean error without labels over that with labels",
        Target("<=", UNLABELLED_TIMES),
    )
    for name, own in (("labelled", labelled), ("unlabelled", unlabelled)):
        add(
            f"{name}_variance_over_predicted",
            variance_ratio(own),
            "",
            f"mean squared error over mean predicted variance, {name}",
            Target("=", 1.0, VARIANCE_OFF),
        )
    for name, method in (
        ("image_gap", GAP),
        ("edge", EDGE),
        ("designed", DESIGNED),
        ("known_finger", EXACT),
    ):
        own = of_method(answers, method)
        add(f"{name}_mean_deg", mean_deg(own), "deg", f"mean error from images: {method}")
    add("gap_defined", defined_share(of_method(answers, GAP)), "", "part of the joint angles at "
        "which there is a gap")  # fmt: skip
    add("bound_rms_deg", _bound_deg(found), "deg", "Cramér-Rao bound of the labelled calibration, "
        "root mean square over the same frames")  # fmt: skip
    add("labelled_rms_deg", _rms_deg(labelled), "deg", "what it reached")
    plain = of_method(answers, LENS_AS_DESIGNED)
    add("lens_cost_deg", mean_deg(plain) - mean_deg(labelled), "deg", "what it costs if the model "
        "takes the lens as designed")  # fmt: skip
    if found.smooth:
        add("edge_cost_deg", _edge_cost_deg(found), "deg", "what rough edges and round corners "
            "cost, which no model has")  # fmt: skip
    add(
        "detection_ms",
        1e3 * statistics.median(s for one in found.watched for s in one.frames.seconds),
        "ms",
        "median time to find all views of a frame on one core",
        Target("<=", DETECTION_MS),
    )
    add(
        "solve_ms",
        1e3 * statistics.median(s for one in found.climbed for s in one.seconds),
        "ms",
        "median time of the joint-angle solve of a frame",
        Target("<=", SOLVE_MS),
    )
    return made


def _rms_deg(answers: Sequence[Answer]) -> float:
    return float(np.sqrt(np.mean(errors_deg(answers) ** 2)))


def _bound_deg(found: Found) -> float:
    """The bound over those angles that the labelled calibration gives."""
    kept = []
    for one in found.climbed:
        told = of_method(one.answers, LABELLED)
        names = list(found.finger.model.names)
        kept += [one.bounds[a.frame, names.index(a.joint)] for a in told if a.estimate.defined]
    return math.degrees(float(np.sqrt(np.mean(np.square(kept)))))


def _edge_cost_deg(found: Found) -> float:
    fingers = {answer.finger for answer in found.smooth}
    rough = [a for a in of_method(found.answers, LABELLED) if a.finger in fingers]
    return mean_deg(rough) - mean_deg(found.smooth)


def findings(spec: ProprioceptionSpec, found: Found) -> list[str]:
    """Plain sentences, most important first."""
    answers = found.answers
    of = {m: of_method(answers, m) for m in (GAP, GAP_THEN_EDGE, EDGE, DESIGNED, LABELLED,
                                             UNLABELLED, EXACT, LENS_AS_DESIGNED)}  # fmt: skip
    frames = sum(len(one.frames.angles) for one in found.watched)
    told = [f"{table.pad}: {math.degrees(table.angles[0]):.0f}° to "
            f"{math.degrees(table.angles[-1]):.0f}°" for table in found.tables]  # fmt: skip
    rates = [abs(float(np.median(t.rate))) for t in found.tables]
    pixels = float(found.finger.scene.camera.focal_pixels) * math.pi / 180
    lines = [
        f"From {frames} frames of {spec.fingers} made fingers, all corners with {spec.labelled} "
        f"labelled frames give joint angles within {mean_deg(of[LABELLED]):.2f}° on average, "
        f"without any label within {mean_deg(of[UNLABELLED]):.2f}°; paper B's Table 4.1 has 2.3° "
        "and 2.5°.",
        f"The paper's gap with {spec.labelled} labelled frames and {spec.pixel_noise:g} px of "
        f"noise on every corner: {mean_deg(found.gap_alone):.2f}° on average. It changes by only "
        f"{pixels * min(rates):.2f} to {pixels * max(rates):.2f} px per degree, for both of its "
        "ends move alike.",
        f"The gap exists only at joint angles of {', '.join(told)}, which is "
        f"{100 * defined_share(of[GAP]):.0f} % of the random frames' angles; elsewhere the answer "
        f"is 'undefined', and one edge, its fall-back, answers for "
        f"{100 * defined_share(of[GAP_THEN_EDGE]):.0f} %.",
        f"One edge without any model ({mean_deg(of[EDGE]):.2f}°) is the better ruler of the two: "
        "it moves by several pixels per degree.",
        f"Taken as designed, without calibration, the model gives {mean_deg(of[DESIGNED]):.2f}°: "
        "errors of fabrication, not pixels, limit it. With the finger's errors known it would give "
        f"{mean_deg(of[EXACT]):.3f}°.",
        f"The calibrated corners reach {_rms_deg(of[LABELLED]):.3f}° (root mean square) where the "
        f"information in the images allows {_bound_deg(found):.3f}°; labels that are "
        f"{spec.label_deviation_deg:g}° off weigh most in both.",
        f"What the model does not have costs: the lens taken as designed "
        f"{mean_deg(of[LENS_AS_DESIGNED]) - mean_deg(of[LABELLED]):+.3f}°"
        + (
            f"; rough edges and round corners {_edge_cost_deg(found):+.3f}°."
            if found.smooth
            else "."
        ),
    ]
    missing = 1 - defined_share(of[LABELLED])
    if missing:
        lines.append(
            f"{100 * missing:.1f} % of the joint angles are undefined by all corners, too: no "
            "complete view tells them. They stay undefined."
        )
    return lines


def claim(rows: Sequence[PrecisionRow]) -> Claim:
    """All corners against the gap, at every image size."""
    sizes = list(dict.fromkeys(row.setting for row in rows))
    evidence, holds = [], True
    for size in sizes:
        own = {row.method: row for row in rows if row.setting == size}
        if GAP not in own or LABELLED not in own:
            continue
        gap, corners = own[GAP], own[LABELLED]
        holds &= corners.error < gap.error
        evidence.append(
            f"{size}: all corners {corners.error:.2f}° in {1e3 * corners.seconds:.0f} ms a frame, "
            f"the gap {gap.error:.2f}° in {1e3 * gap.seconds:.0f} ms."
        )
    return Claim(
        "All corners with a calibrated model are closer than the gap at every image size, for a "
        "few milliseconds more.",
        "A gap is the difference of two edges that move alike and throws away where they are; "
        "corners keep it, and calibration tells what else moves them.",
        evidence,
        holds,
    )
