"""The study's tables."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

from designopt.study.results import Cell, Table
from studies.models.soft_finger.odd import status_words
from studies.object_size.found import Found
from studies.object_size.spec import ObjectSizeSpec
from studies.object_size.trials import Measured

WAYS = {
    "image and grasp": "diameters",
    "grasp alone (true bend)": "by_true_bend",
    "image alone (true place)": "by_true_place",
}
"""What may be off in a diameter, and the field of `Measured` with diameters that are off by it."""


def tables(spec: ObjectSizeSpec, found: Found) -> list[Table]:
    """Every table of the study."""
    return [
        confusion(spec, found),
        bottles(spec, found),
        budget(found),
        curve(found),
        bends(found),
        odd(found),
    ]


def counts(spec: ObjectSizeSpec, found: Found) -> Int[np.ndarray, "bottles answers"]:
    """How often every bottle was taken for each, and last, how often there was no answer."""
    told = found.bottles.told(spec.bottles).reshape(len(spec.bottles), -1)
    answers = np.arange(len(spec.bottles) + 1)
    return np.sum(told[:, :, None] == answers[None, None], axis=1)


def confusion(spec: ObjectSizeSpec, found: Found) -> Table:
    """Which bottle was taken for which."""
    rows: list[list[Cell]] = [
        [diameter, *map(int, row)]
        for diameter, row in zip(spec.bottles, counts(spec, found), strict=True)
    ]
    names = [f"taken_for_{diameter:g}_mm" for diameter in spec.bottles]
    return Table(
        "confusion",
        "Grasps of each bottle, by the bottle whose diameter is nearest to the estimate",
        ["bottle_mm", *names, "undefined"],
        rows,
        {"bottle_mm": 0},
    )


def bottles(spec: ObjectSizeSpec, found: Found) -> Table:
    """What was found of each bottle."""
    measured, grasps, said = found.bottles, found.bottles.grasps, found.bottles.estimates
    rows: list[list[Cell]] = []
    for diameter in spec.bottles:
        own = (grasps.diameters == diameter) & said.known
        if not own.any():
            rows.append([diameter, 0, *[None] * 8])
            continue
        bent = np.rad2deg(np.stack([grasps.bends[own], said.bends[own]]))
        rows.append(
            [
                diameter,
                int(own.sum()),
                float(measured.diameters[own].mean()),
                float(measured.diameters[own].std()),
                float(np.abs(measured.diameters[own] - diameter).mean()),
                float(bent[0].mean()),
                float(bent[1].mean()),
                float(np.sqrt(np.mean((bent[1] - bent[0]) ** 2))),
                float(grasps.arcs[own].mean()),
                float(said.residuals[own].mean()),
            ]
        )
    return Table(
        "bottles",
        "Each bottle as it was found; means over its grasps",
        [
            "bottle_mm",
            "answers",
            "estimate_mm",
            "deviation_mm",
            "absolute_error_mm",
            "bend_deg",
            "estimated_bend_deg",
            "bend_rms_error_deg",
            "contact_mm",
            "marker_residual_mm",
        ],
        rows,
        {"bottle_mm": 0},
    )


def budget(found: Found) -> Table:
    """Where errors come from."""
    rows: list[list[Cell]] = []
    all_grasps = (
        ("the bottles", found.bottles),
        ("random", found.random),
        ("random, another lamp", found.other_lamp),
    )
    for name, measured in all_grasps:
        for way, field in WAYS.items():
            errors = measured.errors(getattr(measured, field))
            trials = len(measured.diameters)
            rows.append([name, way, trials, measured.grasps.redrawn, len(errors), *summary(errors)])
    return Table(
        "budget",
        "Where errors come from: a bottle off its place and the wall pressed in more or less "
        "(grasp), or markers off on the image; redrawn: bottles that the finger missed, put in "
        "anew",
        [
            "diameters",
            "what_is_off",
            "grasps",
            "redrawn",
            "answers",
            "absolute_error_mm",
            "bias_mm",
            "deviation_mm",
            "p95_mm",
        ],
        rows,
    )


def summary(errors: Float[np.ndarray, " answers"]) -> list[float]:
    """Mean absolute error, bias, standard deviation and 95th percentile of the absolute error."""
    if not len(errors):
        return [float("nan")] * 4
    size = np.abs(errors)
    return [
        float(size.mean()),
        float(errors.mean()),
        float(errors.std()),
        float(np.quantile(size, 0.95)),
    ]


def curve(found: Found) -> Table:
    """Diameter over bend."""
    one = found.curve
    chosen = np.linspace(0, len(one.diameters) - 1, 13).round().astype(int)
    return Table.of_columns(
        "curve",
        "The bend of the finger around a bottle in its place, where it touches, and what a degree "
        "of bend is worth",
        {
            "diameter_mm": one.diameters[chosen].tolist(),
            "bend_deg": np.rad2deg(one.bends[chosen]).tolist(),
            "contact_mm": one.arcs[chosen].tolist(),
            "mm_per_deg": one.slopes[chosen].tolist(),
        },
        {"diameter_mm": 0},
    )


def bends(found: Found) -> Table:
    """Answers over the bend."""
    rows: list[list[Cell]] = []
    for one in found.bends:
        answers = [said.diameter for said in one.said if said.diameter is not None]
        range_: list[Cell] = [min(answers), max(answers)] if answers else [None, None]
        undefined = len(one.said) - len(answers)
        rows.append([one.bend_deg, one.diameter, len(one.said), undefined, *range_, one.failures])
    return Table(
        "bends",
        "Diameters from hardly bent to far: what a finger so bent holds, and what was said of "
        "frames with all effects; undefined: the markers read lie on no arc, or on one that holds "
        "nothing",
        [
            "bend_deg",
            "held_mm",
            "frames",
            "undefined",
            "least_estimate_mm",
            "largest_estimate_mm",
            "failures",
        ],
        rows,
        {"held_mm": 1, "least_estimate_mm": 1, "largest_estimate_mm": 1},
    )


def odd(found: Found) -> Table:
    """Answers to frames that are no proper images."""
    rows: list[list[Cell]] = []
    for kind in dict.fromkeys(one.kind for one in found.odd):
        own = [one for one in found.odd if one.kind is kind]
        statuses = {status_words(one.said.status) for one in own}
        rows.append(
            [
                kind.name,
                len(own),
                status_words(kind.status),
                "a diameter, or a bend of none" if kind.usable else "undefined",
                ", ".join(sorted(statuses)),
                sum(one.said.diameter is not None for one in own),
                sum(one.failed for one in own),
            ]
        )
    return Table(
        "odd_frames",
        "Frames that are no proper images: what is to be answered, and how often it was not",
        ["kind", "frames", "expected_sight", "expected", "sights", "with_diameter", "failures"],
        rows,
    )


def told_apart(spec: ObjectSizeSpec, measured: Measured) -> float:
    """Part of the grasps whose bottle was told; one without an answer was not."""
    truth = np.repeat(np.arange(len(spec.bottles)), spec.grasps)
    return float(np.mean(measured.told(spec.bottles) == truth))
