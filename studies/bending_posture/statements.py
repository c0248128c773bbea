"""What the study says: findings in sentences, metrics with targets, a claim with evidence."""

from __future__ import annotations

import statistics

import numpy as np

from designopt.study.results import Claim, Metric, Target
from studies.bending_posture.elsewhere import BOTH, LAMP, MADE
from studies.bending_posture.found import Found
from studies.bending_posture.spec import BendingPostureSpec
from studies.bending_posture.trainings import (
    EQUAL,
    KEPT,
    L2_LENGTHS,
    L2_MM,
    L2_STANDARDISED,
    MEAN,
    OURS,
    RAW,
    READINGS,
    counted,
)
from studies.bending_posture.verdicts import MARGIN, ROOM_MM, compared, judged, roomy
from studies.models.soft_finger.targets import stated

TIP_MM, TIMES, SECONDS = 1.5, 20.0, 60.0

FREE = frozenset({"widths", "counts", "etas", "eta_samples", "sweep"})
"""Settings that touch no target."""

ELSEWHERE = {LAMP: "other_lamp_tip_mm", MADE: "made_finger_tip_mm", BOTH: "both_other_tip_mm"}
"""Names of metrics, by what is other than in training."""


def metrics(spec: BendingPostureSpec, found: Found) -> list[Metric]:
    """The study's numbers; targets belong to the stated finger and trainings."""
    asked = stated(spec, free=FREE, least={"unseen": 400, "seeds": 3})
    made: list[Metric] = []

    def add(
        name: str, value: float, unit: str, description: str, target: Target | None = None
    ) -> None:
        made.append(Metric(name, value, unit, description, None, target if asked else None))

    def add_ratio(name: str, way: str, description: str, target: Target | None = None) -> None:
        description = f"tip error {description}; the least over the seeds"
        add(name, min(found.ratios(way)), "", description, target)

    mean, tips = found.data.mean_error, found.tips(OURS)
    for one in found.trained[OURS]:
        seed = one.estimator.record.settings.seed
        add(f"tip_seed_{seed}_mm", one.tip_error, "mm", "mean tip error on unseen images, trained "
            f"from seed {seed}", Target("<=", TIP_MM))  # fmt: skip
    add("training_seconds", max(_training_seconds(found)), "s", "longest of these trainings, "
        "compiling and its record of unseen images included, on a machine with "
        f"{_cores(found)}", Target("<=", SECONDS))  # fmt: skip
    add("mean_predictor_mm", mean, "mm", "tip error of always answering the mean of the labels")
    add("times_better_than_mean", mean / max(tips), "", "that, over the worst of the seeds",
        Target(">=", TIMES))  # fmt: skip
    p95 = float(np.mean([np.quantile(o.errors[:, -1], 0.95) for o in found.trained[OURS]]))
    add("tip_p95_mm", p95, "mm", "95th percentile of the tip error, mean over the seeds")
    add("equal_weights_tip_mm", statistics.mean(found.tips(EQUAL)), "mm", "tip error "
        "without loss weights, mean over the seeds")  # fmt: skip
    add("weighted_tip_mm", statistics.mean(tips), "mm", "with them")
    worse = Target(">=", MARGIN)
    paper = "with the paper's L2 regularisation of 0.01, its loss read as one"
    ours = "over that with our 0.0001 of standardised labels"
    add_ratio("regularisation_mm_ratio", L2_MM, f"{paper} in mm, {ours}")
    add_ratio("regularisation_standardised_ratio", L2_STANDARDISED,
              f"{paper} of standardised labels, {ours}")  # fmt: skip
    add_ratio("regularisation_finger_lengths_ratio", L2_LENGTHS,
              f"{paper} in finger lengths, {ours}", worse)  # fmt: skip
    add_ratio("kept_rate_ratio", KEPT, "at a learning rate that stays, as in the paper, over that "
              "at one that falls to zero")  # fmt: skip
    add_ratio("raw_images_ratio", RAW, "from images that are not standardised over that from "
              "those that are", worse)  # fmt: skip
    for one in found.elsewhere:
        what = {LAMP: "under another lamp", MADE: "in a finger as it is made",
                BOTH: "in a finger as it is made, under another lamp"}[one.other]  # fmt: skip
        add(ELSEWHERE[one.other], one.mean, "mm", f"tip error {what}, mean over the seeds and "
            f"{one.usable} images, {len(one.errors)} of these")  # fmt: skip
    add("unusable", found.data.unusable, "", "frames of training and unseen images that showed no "
        "chamber and were left out")  # fmt: skip
    errors = np.concatenate([one.errors for one in found.bends])
    add("unanswered", int(np.sum(~np.isfinite(errors))), "", f"of {len(errors)} frames from 0.01° "
        "to 120° of bend, those without a posture", Target("<=", 0))  # fmt: skip
    add("odd_failures", sum(one.failed for one in found.odd), "", f"of {len(found.odd)} frames "
        "that are no proper images, those without the defined answer", Target("<=", 0))  # fmt: skip
    add("frame_ms", 1e3 * found.seconds, "ms", "median time from a picture to markers, one after "
        f"the other, on a machine with {_cores(found)}")  # fmt: skip
    comparison = compared(found.etas)
    if comparison:
        add("eta_difference_mm", comparison.difference, "mm", "between the largest and the least "
            "mean tip error of the chambers of different η")  # fmt: skip
        add("eta_difference_errors", comparison.errors, "", "that in standard errors of a mean "
            f"over the seeds; alike chambers stay below {comparison.limit:.1f} in 95 % of the "
            "cases")  # fmt: skip
    return made


def findings(found: Found) -> list[str]:
    """Plain sentences, most important first."""
    tips, mean = found.tips(OURS), found.data.mean_error
    times = [mean / tip for tip in tips]
    seeds = "one seed" if len(tips) == 1 else f"{len(tips)} seeds"
    lines = [
        f"Trained on {len(found.data.labels)} images, a network tells the tip's place on unseen "
        f"ones to {_spread(tips)} mm on average ({seeds}), "
        f"{_spread(times, 0 if min(times) > 10 else 1)} times closer than the mean of "
        f"the labels, {mean:.1f} mm; a training takes "
        f"{_spread(_training_seconds(found))} s on a machine with {_cores(found)}.",
        f"Without loss weights the tip is off by {_spread(found.tips(EQUAL))} mm, "
        f"{_spread(found.ratios(EQUAL))} times as far as with them: {_weights(found)}.",
        _readings(found),
        "A learning rate that stays, as in the paper, makes the tip error "
        f"{_spread(found.ratios(KEPT))} times that at one that falls to zero.",
        f"Images that are not standardised make it {_spread(found.ratios(RAW))} times as large.",
    ]
    lines += _elsewhere(found) + _sizes(found)
    if found.etas:
        lines.append(_etas(found))
    lines.append(_bends(found))
    failed = sum(one.failed for one in found.odd)
    lines.append(
        f"{len(found.odd)} frames that are no proper images have {failed} answers other than the "
        "defined one: no posture where no chamber is seen."
    )
    return lines


def _spread(values: list[float], places: int = 2) -> str:
    low, high = (f"{one(values):.{places}f}" for one in (min, max))
    return low if low == high else f"{low}–{high}"


def _training_seconds(found: Found) -> list[float]:
    return [one.estimator.record.total_seconds for one in found.trained[OURS]]


def _cores(found: Found) -> str:
    one = "one core" if found.cores == 1 else f"{found.cores} cores"
    return f"{one}, OpenCV on one thread"


def _weights(found: Found) -> str:
    shown = judged(found.ratios(EQUAL))
    if shown == "worse":
        return "the weights help the tip, as in the paper"
    return "the weights harm the tip here" if shown == "better" else "no difference is shown here"


def _readings(found: Found) -> str:
    """In which units of the loss the paper's regularisation is worse than ours."""
    where = {"mm": "in mm", "standardised": "of standardised labels",
             "finger lengths": "in finger lengths"}  # fmt: skip
    parts = [
        f"{where[unit]} it is {judged(found.ratios(way))} ({_spread(found.ratios(way))} times the "
        f"tip error; a weight of {found.paper[unit]:.2g})"
        for unit, way in READINGS.items()
    ]
    best = ""
    if found.sweep:
        weight, tip = min(found.sweep, key=lambda one: one[1])
        best = f" Of the weights compared, {weight:g} gives the least, {tip:.2f} mm (one training)."
    return (
        "The paper does not say in which unit the loss is that its regularisation of 0.01 is added "
        f"to. Compared with our 0.0001 of standardised labels: {'; '.join(parts)}. Worse and "
        f"better mean at least {MARGIN:g} times at every seed.{best}"
    )


def _elsewhere(found: Found) -> list[str]:
    known = {one.other: one.mean for one in found.elsewhere if one.usable}
    if set(known) != set(ELSEWHERE):
        return []
    return [
        "Unseen images share the finger and its lamp with training. Under another lamp the tip "
        f"error is {known[LAMP]:.2f} mm, in a finger as it is made {known[MADE]:.2f} mm, and with "
        f"both {known[BOTH]:.2f} mm."
    ]


def _sizes(found: Found) -> list[str]:
    rows = [row for row in found.rows if row.method != MEAN]
    if not rows:
        return []
    mean, best = found.data.mean_error, min(rows, key=lambda row: row.error)
    return [
        f"Of all sizes and numbers of images, {best.method} and {best.setting} give the least tip "
        f"error, {mean * best.error:.2f} mm after {best.seconds:.1f} s (one training each)."
    ]


def _etas(found: Found) -> str:
    """Whether accuracy chooses η, and what the paper's own criterion says of it."""
    means = [statistics.mean(one.tip_errors) for one in found.etas]
    parts = ", ".join(
        f"{mean:.2f} mm at {one.eta:g}" for one, mean in zip(found.etas, means, strict=True)
    )
    comparison, best = compared(found.etas), found.etas[int(np.argmin(means))]
    if comparison is None:
        verdict = "That says nothing of η: it needs two chambers and two seeds at least."
    else:
        by = (
            f"{comparison.difference:.2f} mm, {comparison.errors:.1f} standard errors of a mean "
            f"over the seeds, {{}} than the {comparison.limit:.1f} that alike chambers reach in "
            "one of twenty cases"
        )
        verdict = f"The largest and the least differ by {by.format('less')}: the posture's "
        verdict += "accuracy does not choose η."
        if comparison.told:
            verdict = f"The largest and the least differ by {by.format('more')}: the posture is "
            verdict += f"read best at η = {best.eta:g}."
    rooms = ", ".join(f"{one.clearance:.2f} mm at {one.eta:g}" for one in found.etas)
    chosen = roomy(found.etas)
    choice = (
        f"{chosen.eta:g} is the largest η of these with"
        if chosen
        else "none of these chambers leaves"
    )
    return (
        f"Tip errors of chambers of different η are {parts}. {verdict} The paper's own criterion "
        f"is the room that |Δl_D| leaves inside Δl_A: {rooms}; {choice} {ROOM_MM:g} mm of it."
    )


def _bends(found: Found) -> str:
    answered = [one for one in found.bends if len(one.known)]
    if not answered:
        return "No frame from 0.01° to 120° of bend has an answer."
    worst = max(answered, key=lambda one: float(one.known.mean()))
    return (
        f"From 0.01° to 120° of bend, under another lamp, the mean tip error is at most "
        f"{float(worst.known.mean()):.2f} mm, at {worst.bend_deg:g}°."
    )


def claims(spec: BendingPostureSpec, found: Found) -> list[Claim]:
    """More samples against larger images; nothing where there is nothing to compare."""
    rows = {(row.method, row.setting): row for row in found.rows if row.method != MEAN}
    methods = list(dict.fromkeys(method for method, _ in rows))
    settings = [counted(count) for count in sorted(spec.counts)]
    if not methods or len(settings) < 2:
        return []
    evidence, holds, mean = [], True, found.data.mean_error
    for method in methods:
        own = [rows[method, setting] for setting in settings]
        holds &= own[-1].error < own[0].error and all(row.error < 1 for row in own)
        tried = [f"{mean * row.error:.2f} mm in {row.seconds:.1f} s ({row.setting})" for row in own]
        evidence.append(f"{method}: {', '.join(tried)}.")
    return [
        Claim(
            f"At every image size {settings[-1]} leave a smaller error than {settings[0]}, and "
            "every network beats the mean of the labels.",
            "Samples differ in bend, shake, direction and what presses the wall; what a network "
            "has not seen of these it cannot leave out of its answer.",
            evidence,
            holds,
        )
    ]
