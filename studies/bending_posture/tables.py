"""The study's tables."""

from __future__ import annotations

import statistics

import numpy as np
from jaxtyping import Float

from designopt.study.results import Cell, Table
from studies.bending_posture.found import Found
from studies.bending_posture.trainings import EQUAL, MEAN, OURS, READINGS
from studies.bending_posture.verdicts import judged
from studies.models.soft_finger.odd import status_words

MARKERS = ("marker 1", "marker 2", "tip")


def tables(found: Found) -> list[Table]:
    """Every table of the study."""
    made = [ways(found), markers(found), readings(found)]
    if found.sweep:
        made.append(regularisations(found))
    if found.etas:
        made.append(etas(found))
    return [*made, elsewhere(found), bends(found), odd(found)]


def ways(found: Found) -> Table:
    """Every training."""
    rows: list[list[Cell]] = [[MEAN, None, found.data.mean_error, None, None, None]]
    for way, networks in found.trained.items():
        for one in networks:
            rows.append(
                [
                    way,
                    one.estimator.record.settings.seed,
                    one.tip_error,
                    float(np.quantile(one.errors[:, -1], 0.95)),
                    found.data.mean_error / one.tip_error,
                    one.estimator.record.total_seconds,
                ]
            )
    return Table(
        "trainings",
        "Tip error on unseen images of every training, beside always answering the mean of the "
        "labels; seconds with what is compiled",
        ["way", "seed", "tip_mean_mm", "tip_p95_mm", "times_better_than_mean", "seconds"],
        rows,
        {"tip_mean_mm": 3, "tip_p95_mm": 3, "times_better_than_mean": 1, "seconds": 1},
    )


def markers(found: Found) -> Table:
    """Errors by marker, with and without weights (the paper's Fig. 11)."""
    rows: list[list[Cell]] = []
    for way in (EQUAL, OURS):
        errors = np.stack([one.errors for one in found.trained[way]])
        for i, name in enumerate(MARKERS):
            one = errors[..., i]
            rows.append(
                [way, name, float(one.mean()), float(one.std()), float(np.quantile(one, 0.95))]
            )
    return Table(
        "markers",
        "Error by marker, nearest to the camera first, without and with loss weights, over all "
        "seeds",
        ["way", "marker", "mean_mm", "deviation_mm", "p95_mm"],
        rows,
        {"mean_mm": 3, "deviation_mm": 3, "p95_mm": 3},
    )


def readings(found: Found) -> Table:
    """The paper's regularisation in each of its readings."""
    rows: list[list[Cell]] = []
    for unit, way in READINGS.items():
        ratios = found.ratios(way)
        mean = statistics.mean(found.tips(way))
        rows.append([unit, found.paper[unit], mean, min(ratios), max(ratios), judged(ratios)])
    return Table(
        "readings",
        "The paper's L2 regularisation of 0.01 by the unit of its loss, which it does not say: its "
        "weight for standardised labels, and tip errors over those with our 0.0001, seed by seed",
        ["unit", "regularisation", "tip_mean_mm", "least_ratio", "largest_ratio", "shown_to_be"],
        rows,
        {"tip_mean_mm": 3, "least_ratio": 2, "largest_ratio": 2},
    )


def regularisations(found: Found) -> Table:
    """Tip error over the weight of the L2 regularisation."""
    return Table(
        "regularisations",
        "Tip error over the weight of the L2 regularisation, of standardised labels; the paper's "
        "0.01 is "
        + ", ".join(f"{value:.2g} if its loss is in {unit}" if unit != "standardised"
                    else f"{value:.2g} if it is {unit}" for unit, value in found.paper.items()),
        ["regularisation", "tip_mean_mm"],
        found.sweep,
        {"tip_mean_mm": 3},
    )  # fmt: skip


def etas(found: Found) -> Table:
    """Postures read from chambers of different η."""
    return Table(
        "etas",
        "Chambers of different η: widths of their rings, how fast yellow's outline starts to move, "
        "what |Δl_D| leaves inside Δl_A, frames that showed no chamber, and the tip error of "
        "networks trained on the others",
        ["eta", "blue_px", "yellow_px", "yellow_px_per_deg", "clearance_mm", "unusable",
         "tip_mean_mm", "tip_least_mm", "tip_most_mm"],
        [
            [one.eta, *one.rings, one.rate, one.clearance, one.unusable,
             statistics.mean(one.tip_errors), min(one.tip_errors), max(one.tip_errors)]
            for one in found.etas
        ],
        {"tip_mean_mm": 3, "tip_least_mm": 3, "tip_most_mm": 3, "blue_px": 1, "yellow_px": 1,
         "clearance_mm": 2},
    )  # fmt: skip


def elsewhere(found: Found) -> Table:
    """Tip errors under other lamps and in other fingers."""
    tips = np.stack([one.errors[:, -1] for one in found.trained[OURS]])
    rows: list[list[Cell]] = [
        ["nothing", 1, tips.shape[1], tips.shape[1], *_mean_and_p95(tips), None]
    ]
    for one in found.elsewhere:
        numbers = [*_mean_and_p95(one.known), one.worst] if one.usable else [None] * 3
        rows.append([one.other, len(one.errors), one.frames, one.usable, *numbers])
    return Table(
        "elsewhere",
        "Tip error over all seeds where something is other than in training: lamps, fingers as "
        "they are made, or both; at last the mean of the lamp or finger where it is largest",
        ["other", "lamps_or_fingers", "frames", "usable", "tip_mean_mm", "tip_p95_mm",
         "worst_mean_mm"],
        rows,
        {"tip_mean_mm": 3, "tip_p95_mm": 3, "worst_mean_mm": 3},
    )  # fmt: skip


def _mean_and_p95(errors: Float[np.ndarray, "..."]) -> list[float]:
    return [float(errors.mean()), float(np.quantile(errors, 0.95))]


def bends(found: Found) -> Table:
    """Tip errors over the bend."""
    rows: list[list[Cell]] = []
    for one in found.bends:
        known = one.known
        numbers = [float(known.mean()), float(known.max())] if len(known) else [None, None]
        rows.append([one.bend_deg, len(one.errors), len(known), *numbers])
    return Table(
        "bends",
        "Tip error from hardly bent to far, frames with all effects under another lamp",
        ["bend_deg", "frames", "answered", "tip_mean_mm", "tip_most_mm"],
        rows,
        {"tip_mean_mm": 3, "tip_most_mm": 3},
    )


def odd(found: Found) -> Table:
    """Answers to frames that are no proper images."""
    rows: list[list[Cell]] = []
    for kind in dict.fromkeys(one.kind for one in found.odd):
        own = [one for one in found.odd if one.kind is kind]
        rows.append(
            [
                kind.name,
                len(own),
                status_words(kind.status),
                "a posture" if kind.usable else "none",
                sum(one.answered for one in own),
                sum(one.failed for one in own),
            ]
        )
    return Table(
        "odd_frames",
        "Frames that are no proper images: the chamber's status, whether a posture "
        "is to be given, and how often it was otherwise",
        ["kind", "frames", "expected_sight", "expected", "with_posture", "failures"],
        rows,
    )
