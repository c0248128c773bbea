"""The study's tables."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence

import jax
import numpy as np

from designopt.study.results import Cell, Table
from optics.scene.fabrication import name_fabrication_errors
from studies.proprioception.found import Found
from studies.proprioception.gap_alone import METHOD as GAP_ALONE
from studies.proprioception.ladder import (
    EXACT,
    GAP_THEN_EDGE,
    LENS_AS_DESIGNED,
    RUNGS,
    SAME_UNLABELLED,
    Answer,
    defined_share,
    errors_deg,
    of_method,
    variance_ratio,
)

PAPER = {"pip": (2.3, 1.6), "dip": (2.5, 2.0)}
"""Paper B, Table 4.1: mean ± standard deviation of the absolute error over 30 frames, degrees."""

SMOOTH = "4 with smooth edges"


def tables(found: Found) -> list[Table]:
    """Every table of the study."""
    return [ladder(found), undefined(found), gaps(found), tolerances(found)]


def every_method(found: Found) -> dict[str, list[Answer]]:
    """The answers of all methods, in the order of the ladder."""
    answers = found.answers
    made = {GAP_ALONE: found.gap_alone}
    made |= {method: of_method(answers, method) for method in (RUNGS[0], GAP_THEN_EDGE, *RUNGS[1:])}
    made[SAME_UNLABELLED] = of_method(answers, SAME_UNLABELLED)
    made[LENS_AS_DESIGNED] = of_method(answers, LENS_AS_DESIGNED)
    if found.smooth:
        made[SMOOTH] = found.smooth
    made[EXACT] = of_method(answers, EXACT)
    return made


def ladder(found: Found) -> Table:
    """Every method beside the paper's Table 4.1."""
    rows: list[Sequence[Cell]] = [
        ("paper B, Table 4.1", joint, 30, None, *PAPER[joint], None, None, None, None)
        for joint in found.finger.model.names
        if joint in PAPER
    ]
    for method, answers in every_method(found).items():
        for joint in found.finger.model.names:
            own = [answer for answer in answers if answer.joint == joint]
            errors = errors_deg(own)
            if not len(errors):
                rows.append((method, joint, len(own), 0.0, *[None] * 6))
                continue
            sizes = np.abs(errors)
            predicted = [a.estimate.deviation for a in own if a.estimate.defined]
            rows.append(
                (
                    method,
                    joint,
                    len(own),
                    defined_share(own),
                    float(sizes.mean()),
                    float(sizes.std()),
                    float(errors.mean()),
                    float(np.quantile(sizes, 0.95)),
                    math.degrees(float(np.sqrt(np.mean(np.square(predicted))))),
                    variance_ratio(own),
                )
            )
    return Table(
        "ladder",
        "Errors of joint angles: mean and standard deviation of the absolute error as in the "
        "paper's Table 4.1, bias, 95th percentile, and the standard deviation that was predicted",
        [
            "method",
            "joint",
            "frames",
            "defined",
            "mean_deg",
            "sd_deg",
            "bias_deg",
            "p95_deg",
            "predicted_deg",
            "variance_over_predicted",
        ],
        rows,
        {
            "defined": 3,
            "mean_deg": 2,
            "sd_deg": 2,
            "bias_deg": 2,
            "p95_deg": 2,
            "predicted_deg": 2,
            "variance_over_predicted": 2,
        },
    )


def undefined(found: Found) -> Table:
    """Why answers are undefined, method by method."""
    counts: Counter[tuple[str, str]] = Counter()
    for method, answers in every_method(found).items():
        counts.update((method, a.estimate.reason) for a in answers if not a.estimate.defined)
    rows = [(*key, count) for key, count in sorted(counts.items())]
    return Table("undefined", "Why answers are undefined", ["method", "reason", "answers"], rows)


def gaps(found: Found) -> Table:
    """The gap's table of both joints."""
    pixels = float(found.finger.scene.camera.focal_pixels)
    rows = []
    for joint, table in zip(found.finger.model.names, found.tables, strict=True):
        for angle, gap, rate in zip(table.angles, table.gaps, table.rate, strict=True):
            rows.append(
                (
                    joint,
                    table.pad,
                    table.mirror,
                    math.degrees(angle),
                    math.degrees(gap),
                    pixels * gap,
                    pixels * math.radians(rate),
                )
            )
    return Table(
        "gaps",
        "The gap between the facing ends of a pad's direct view and its mirror view, from the "
        "optics of the finger as designed; where it is not listed there is none",
        ["joint", "pad", "mirror", "angle_deg", "gap_deg", "gap_px", "px_per_deg"],
        rows,
        {"angle_deg": 0, "gap_deg": 2, "gap_px": 1, "px_per_deg": 2},
    )


def tolerances(found: Found) -> Table:
    """What calibration finds of every error of fabrication."""
    sizes = np.concatenate([np.ravel(leaf) for leaf in jax.tree.leaves(found.finger.deviations)])
    names = name_fabrication_errors(found.finger.scene.layout, found.finger.deviations)
    true = np.stack([one.errors for one in found.watched])
    columns: dict[str, list[float]] = {"stated": sizes.tolist()}
    for name in ("labelled", "unlabelled"):
        calibrated = [getattr(one, name).value.errors for one in found.climbed]
        left = np.stack([one.mean for one in calibrated]) - true
        predicted = np.stack([np.diagonal(one.covariance)[: true.shape[1]] for one in calibrated])
        columns[f"left_{name}"] = (sizes * np.sqrt(np.mean(left**2, axis=0))).tolist()
        columns[f"predicted_{name}"] = (sizes * np.sqrt(predicted.mean(axis=0))).tolist()
    return Table.of_columns(
        "tolerances",
        "Errors of fabrication: their stated standard deviation, and what is left of them when "
        "they have been found, with labels and without (root mean square, and as predicted)",
        {"error": names, **columns},
        dict.fromkeys(columns, 4),
    )
