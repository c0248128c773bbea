"""What the study says: findings in sentences, metrics with targets, a claim with evidence."""

from __future__ import annotations

import statistics

import numpy as np

from designopt.results import Claim, Metric, Target
from studies.bending_posture.found import Found
from studies.bending_posture.spec import BendingPostureSpec
from studies.bending_posture.trainings import EQUAL, KEPT, L2, L2_LENGTHS, MEAN, OURS, RAW

TIP_MM, TIMES, SECONDS = 1.5, 20.0, 60.0


def metrics(spec: BendingPostureSpec, found: Found) -> list[Metric]:
    """The study's numbers; targets belong to the stated finger and trainings."""
    own = {"widths", "counts", "etas", "eta_samples"}
    stated = spec.model_dump(exclude=own) == BendingPostureSpec().model_dump(exclude=own)
    made: list[Metric] = []

    def add(
        name: str, value: float, unit: str, description: str, target: Target | None = None
    ) -> None:
        made.append(Metric(name, value, unit, description, None, target if stated else None))

    mean, tips = found.data.mean_error, found.tips(OURS)
    for one in found.trained[OURS]:
        seed = one.estimator.record.settings.seed
        add(f"tip_seed_{seed}_mm", one.tip_error, "mm", "mean tip error on unseen images, trained "
            f"from seed {seed}", Target("<=", TIP_MM))  # fmt: skip
    add("training_seconds", max(o.estimator.record.total_seconds for o in found.trained[OURS]),
        "s", "longest of these trainings, compiling and its record of unseen images included",
        Target("<=", SECONDS))  # fmt: skip
    add("mean_predictor_mm", mean, "mm", "tip error of always answering the mean of the labels")
    add("times_better_than_mean", mean / max(tips), "", "that, over the worst of the seeds",
        Target(">=", TIMES))  # fmt: skip
    p95 = float(np.mean([np.quantile(o.errors[:, -1], 0.95) for o in found.trained[OURS]]))
    add("tip_p95_mm", p95, "mm", "95th percentile of the tip error, mean over the seeds")
    add("equal_weights_tip_mm", statistics.mean(found.tips(EQUAL)), "mm", "tip error "
        "without loss weights, mean over the seeds")  # fmt: skip
    add("weighted_tip_mm", statistics.mean(tips), "mm", "with them")
    add("paper_regularisation_ratio", _ratio(found, L2_LENGTHS, OURS), "", "tip error with the "
        "paper's L2 regularisation of 0.01, its loss read in finger lengths, over that with "
        "0.0001; the least over the seeds", Target(">=", 1.0))  # fmt: skip
    add("standardised_regularisation_ratio", _ratio(found, L2, OURS), "", "the same with its loss "
        "read as that of standardised labels")  # fmt: skip
    add("kept_rate_ratio", _ratio(found, KEPT, OURS), "", "tip error at a learning rate that "
        "stays, as in the paper, over that at one that falls to zero; the least")  # fmt: skip
    add("raw_images_ratio", _ratio(found, RAW, OURS), "", "tip error of images that are "
        "not standardised over that of those that are; the least over the seeds",
        Target(">=", 1.0))  # fmt: skip
    errors = np.concatenate([one.errors for one in found.bends])
    add("unanswered", int(np.sum(~np.isfinite(errors))), "", f"of {len(errors)} frames from 0.01° "
        "to 120° of bend, those without a posture", Target("<=", 0))  # fmt: skip
    add("odd_failures", sum(one.failed for one in found.odd), "", f"of {len(found.odd)} frames "
        "that are no proper images, those without the defined answer", Target("<=", 0))  # fmt: skip
    add("frame_ms", 1e3 * found.seconds, "ms", "median time from a picture to markers")
    if found.etas:
        at = _best_eta(found)
        add("best_eta", at, "", "η of the chamber whose networks have the least tip error")
    return made


def _ratio(found: Found, way: str, other: str) -> float:
    """Least of the seeds' ratios."""
    return min(a / b for a, b in zip(found.tips(way), found.tips(other), strict=True))


def _best_eta(found: Found) -> float:
    return min(found.etas, key=lambda one: statistics.mean(one.tip_errors)).eta


def findings(spec: BendingPostureSpec, found: Found) -> list[str]:
    """Plain sentences, most important first."""
    tips, mean = found.tips(OURS), found.data.mean_error
    lines = [
        f"Trained on {spec.samples} images, a network tells the tip's place on unseen ones to "
        f"{_spread(tips)} mm on average ({len(tips)} seeds), {mean / max(tips):.0f} to "
        f"{mean / min(tips):.0f} times closer than the mean of the labels, {mean:.1f} mm; a "
        f"training takes "
        f"{_spread([o.estimator.record.total_seconds for o in found.trained[OURS]], 0)} s.",
        f"Without loss weights the tip is off by {_spread(found.tips('equal weights'))} mm: "
        + _weights(found),
        "The paper's regularisation of 0.01 is one of a loss whose unit it does not say. In finger "
        f"lengths it makes the tip error {_times(found, L2_LENGTHS, OURS)} times that with our "
        f"0.0001 of standardised labels; of these, {_times(found, L2, OURS)} times.",
        f"A learning rate that stays, as in the paper, makes it {_times(found, KEPT, OURS)} times "
        "that of one that falls to zero.",
        f"Images that are not standardised make it {_times(found, 'raw images', OURS)} times as "
        "large.",
    ]
    lines += _sizes(found)
    if found.etas:
        lines.append(_etas(found))
    worst = max(found.bends, key=lambda one: float(np.nanmean(one.errors)))
    lines.append(
        f"From 0.01° to 120° of bend the mean tip error is at most "
        f"{float(np.nanmean(worst.errors)):.2f} mm, at {worst.bend_deg:g}°."
    )
    failed = sum(one.failed for one in found.odd)
    lines.append(
        f"{len(found.odd)} frames that are no proper images have {failed} answers other than the "
        "defined one: no posture where no chamber is seen."
    )
    return lines


def _spread(values: list[float], places: int = 2) -> str:
    low, high = (f"{one(values):.{places}f}" for one in (min, max))
    return low if low == high else f"{low}–{high}"


def _times(found: Found, way: str, other: str) -> str:
    ratios = [a / b for a, b in zip(found.tips(way), found.tips(other), strict=True)]
    return _spread(ratios)


def _weights(found: Found) -> str:
    ratios = [a / b for a, b in zip(found.tips(EQUAL), found.tips(OURS), strict=True)]
    if min(ratios) > 1.05:
        return "the weights help the tip, as in the paper."
    if max(ratios) < 0.95:
        return "the weights do not help the tip here."
    return "the weights make little difference here; labels are not what limits these networks."


def _sizes(found: Found) -> list[str]:
    rows = [row for row in found.rows if row.method != MEAN]
    if not rows:
        return []
    mean, best = found.data.mean_error, min(rows, key=lambda row: row.error)
    return [
        f"Of all sizes and numbers of images, {best.method} and {best.setting} give the least tip "
        f"error, {mean * best.error:.2f} mm after {best.seconds:.1f} s."
    ]


def _etas(found: Found) -> str:
    means = [statistics.mean(one.tip_errors) for one in found.etas]
    spread = max(max(one.tip_errors) - min(one.tip_errors) for one in found.etas)
    parts = ", ".join(
        f"{mean:.2f} mm at {one.eta:g}" for one, mean in zip(found.etas, means, strict=True)
    )
    verdict = (
        "less than from seed to seed, so the posture is no reason for any η"
        if max(means) - min(means) <= spread
        else f"least at η = {_best_eta(found):g}"
    )
    return f"Chambers of different η: tip errors are {parts}; they differ {verdict}."


def claim(found: Found) -> Claim:
    """More samples against larger images."""
    rows = [row for row in found.rows if row.method != MEAN]
    methods = list(dict.fromkeys(row.method for row in rows))
    evidence, holds = [], bool(rows)
    mean = found.data.mean_error
    for method in methods:
        own = [row for row in rows if row.method == method]
        holds &= len(own) < 2 or own[-1].error < own[0].error
        evidence.append(
            f"{method}: "
            + ", ".join(
                f"{mean * row.error:.2f} mm in {row.seconds:.1f} s ({row.setting})" for row in own
            )
            + "."
        )
    holds &= all(row.error < 1 for row in rows)
    return Claim(
        "More samples lower the error at every image size, and every network beats the mean of the "
        "labels.",
        "Samples differ in bend, shake, direction and what presses the wall; what a network has "
        "not seen of these it cannot leave out of its answer.",
        evidence,
        holds,
    )
