"""What the study says: findings in sentences, metrics with targets, a claim with evidence."""

from __future__ import annotations

import math
import statistics
from collections.abc import Sequence

import numpy as np

from designopt.study.results import Claim, Metric, PrecisionRow, Target
from studies.proprioception.found import Found
from studies.proprioception.ladder import (
    DESIGNED,
    EDGE,
    EXACT,
    GAP,
    GAP_THEN_EDGE,
    LABELLED,
    LENS_AS_DESIGNED,
    SAME_UNLABELLED,
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
MORE_TIME = 1.25
"""All corners take hardly longer than the gap: at most so many times as long."""


def mean_deg(answers: Sequence[Answer]) -> float:
    """Mean absolute error of the answers that are defined, degrees."""
    errors = np.abs(errors_deg(answers))
    return float(errors.mean()) if len(errors) else math.nan


def metrics(spec: ProprioceptionSpec, found: Found) -> list[Metric]:
    """The study's numbers; targets belong to the stated finger, images and numbers of them."""
    default = ProprioceptionSpec()
    sizes = {"fingers", "frames", "gap_fingers", "cost_fingers", "sizes", "size_fingers",
             "size_frames"}  # fmt: skip
    stated = (
        spec.model_dump(exclude=sizes) == default.model_dump(exclude=sizes)
        and spec.fingers >= default.fingers
        and spec.frames >= default.frames
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
        "°",
        f"mean error of the gap with {spec.labelled} labelled frames, corners with "
        f"{spec.pixel_noise:g} px of noise",
        Target("=", middle, GAP_HIGH - middle),
        paper,
    )
    add(
        "gap_mean_of",
        defined_share(found.gap_alone),
        "",
        "part of these that fell within its table",
    )
    labelled = of_method(answers, LABELLED)
    add("labelled_defined", defined_share(labelled), "", "part of the joint angles that complete "
        "views tell")  # fmt: skip
    sizes_deg = np.abs(errors_deg(labelled))
    p95 = float(np.quantile(sizes_deg, 0.95)) if len(sizes_deg) else math.nan
    add("labelled_mean_deg", mean_deg(labelled), "°", f"mean error of all corners with "
        f"{spec.labelled} labelled frames, from images", Target("<=", MEAN_DEG), paper)  # fmt: skip
    add("labelled_p95_deg", p95, "°", "95th percentile of the same", Target("<=", P95_DEG))
    unlabelled = of_method(answers, UNLABELLED)
    add("unlabelled_mean_deg", mean_deg(unlabelled), "°", f"mean error with all {spec.frames} "
        "frames and no label")  # fmt: skip
    add("same_unlabelled_mean_deg", mean_deg(of_method(answers, SAME_UNLABELLED)), "°",
        f"mean error with the same {spec.labelled} frames and no label")  # fmt: skip
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
        add(f"{name}_mean_deg", mean_deg(own), "°", f"mean error from images: {method}")
    add("gap_defined", defined_share(of_method(answers, GAP)), "", "part of the joint angles for "
        "which the gap gives an answer")  # fmt: skip
    add("bound_rms_deg", _bound_deg(found), "°", "Cramér-Rao bound of the labelled calibration, "
        "root mean square over the same frames")  # fmt: skip
    add("bound_known_rms_deg", _bound_deg(found, known=True), "°", "the bound if the finger's "
        "errors were known")  # fmt: skip
    add("labelled_rms_deg", _rms_deg(labelled), "°", "what it reached")
    plain = of_method(answers, LENS_AS_DESIGNED)
    add("lens_cost_deg", mean_deg(plain) - mean_deg(labelled), "°", "what it costs if the model "
        "takes the lens as designed")  # fmt: skip
    if found.smooth:
        cost, error = _edge_cost_deg(found)
        add("edge_cost_deg", cost, "°", "what rough edges and round corners cost, which no model "
            "has")  # fmt: skip
        if math.isfinite(error):
            add("edge_cost_error_deg", error, "°", "standard error of that")
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
    errors = errors_deg(answers)
    return float(np.sqrt(np.mean(errors**2))) if len(errors) else math.nan


def _bound_deg(found: Found, *, known: bool = False) -> float:
    """The bound over those angles that the labelled calibration gives."""
    names, kept = list(found.finger.model.names), []
    for one in found.climbed:
        bound = one.bound.finger_known if known else one.bound.calibrated
        told = of_method(one.answers, LABELLED)
        kept += [bound[a.frame, names.index(a.joint)] for a in told if a.estimate.defined]
    return math.degrees(float(np.sqrt(np.mean(np.square(kept))))) if kept else math.nan


def _edge_cost_deg(found: Found) -> tuple[float, float]:
    """Mean over fingers of what rough edges add to the mean error, and its standard error."""
    rough = of_method(found.answers, LABELLED)
    costs = [
        mean_deg([a for a in rough if a.finger == finger])
        - mean_deg([a for a in found.smooth if a.finger == finger])
        for finger in {answer.finger for answer in found.smooth}
    ]
    known = [cost for cost in costs if math.isfinite(cost)]
    if len(known) < 2:
        return (known[0] if known else math.nan), math.nan
    return statistics.mean(known), statistics.stdev(known) / math.sqrt(len(known))


def _edge_cost_words(found: Found) -> str:
    cost, error = _edge_cost_deg(found)
    fingers = len({answer.finger for answer in found.smooth})
    exact = f" (standard error {error:.3f}° over {fingers} fingers)" if math.isfinite(error) else ""
    return f"{cost:+.3f}°{exact}"


def findings(spec: ProprioceptionSpec, found: Found) -> list[str]:
    """Plain sentences, most important first."""
    answers = found.answers
    of = {m: of_method(answers, m) for m in (GAP, GAP_THEN_EDGE, EDGE, DESIGNED, LABELLED,
                                             UNLABELLED, EXACT, LENS_AS_DESIGNED)}  # fmt: skip
    frames = sum(len(one.frames.angles) for one in found.watched)
    told = [f"{table.pad}: {math.degrees(table.angles[0]):.0f}° to "
            f"{math.degrees(table.angles[-1]):.0f}°" for table in found.tables]  # fmt: skip
    pixels = float(found.finger.scene.camera.focal_pixels) * math.pi / 180
    middles = [np.array([t.angles[0], t.angles[-1]]).mean() for t in found.tables]
    per_degree = [abs(float(np.interp(m, t.angles, t.rate))) * pixels
                  for m, t in zip(middles, found.tables, strict=True)]  # fmt: skip
    edge, gap = mean_deg(of[EDGE]), mean_deg(found.gap_alone)
    lines = [
        f"From {frames} frames of {spec.fingers} made fingers, all corners with {spec.labelled} "
        f"labelled frames, whose labels are {spec.label_deviation_deg:g}° off, give joint angles "
        f"within {mean_deg(of[LABELLED]):.2f}° on average; calibrated by the {spec.frames} frames "
        f"themselves without any label, within {mean_deg(of[UNLABELLED]):.2f}°. Paper B's "
        "Table 4.1 has 2.3° and 2.5°.",
        f"The paper's gap with {spec.labelled} labelled frames and {spec.pixel_noise:g} px of "
        f"noise on every corner: {gap:.2f}° on average over the "
        f"{100 * defined_share(found.gap_alone):.0f} % of the gaps that fall within its table. It "
        f"changes by {min(per_degree):.2f} to {max(per_degree):.2f} px per degree. On corners as "
        f"they are found in images it gives {mean_deg(of[GAP]):.2f}°.",
        f"By the optics there is a gap only at joint angles of {', '.join(told)}. It answered for "
        f"{100 * defined_share(of[GAP]):.0f} % of the random frames' angles; elsewhere the answer "
        "is 'undefined', and with one edge as its fall-back there is one for "
        f"{100 * defined_share(of[GAP_THEN_EDGE]):.0f} % (which takes {2 * spec.labelled} labelled "
        "frames: those of the gap and those of the edge).",
        f"One edge without any model: {edge:.2f}°.",
        f"The model taken as designed, without calibration, gives {mean_deg(of[DESIGNED]):.2f}°; "
        f"with the finger's errors known it would give {mean_deg(of[EXACT]):.3f}°.",
        f"The labelled calibration reaches {_rms_deg(of[LABELLED]):.3f}° (root mean square) where "
        f"the information in images and labels allows {_bound_deg(found):.3f}°, and "
        f"{_bound_deg(found, known=True):.3f}° if the finger's errors were known.",
        f"What the model does not have costs: the lens taken as designed "
        f"{mean_deg(of[LENS_AS_DESIGNED]) - mean_deg(of[LABELLED]):+.3f}°"
        + (f"; rough edges and round corners {_edge_cost_words(found)}." if found.smooth else "."),
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
        holds &= corners.error < gap.error and corners.seconds < MORE_TIME * gap.seconds
        evidence.append(
            f"{size}: all corners {corners.error:.2f}° in {1e3 * corners.seconds:.0f} ms a frame, "
            f"the gap, where there is one, {gap.error:.2f}° in {1e3 * gap.seconds:.0f} ms."
        )
    return Claim(
        "All corners with a calibrated model are closer than the gap at every image size, and take "
        "hardly longer.",
        "A gap is the difference of two edges that move alike and throws away where they are; "
        "corners keep it, and calibration tells what else moves them. Nearly all of the time goes "
        "into finding the views.",
        evidence,
        holds and bool(evidence),
    )
