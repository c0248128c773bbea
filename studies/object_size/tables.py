"""The study's tables."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

from designopt.results import Cell, Table
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
    return [confusion(spec, found), bottles(spec, found), budget(found), curve(found)]


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
    measured, grasps = found.bottles, found.bottles.grasps
    rows: list[list[Cell]] = []
    for diameter in spec.bottles:
        own = (grasps.diameters == diameter) & measured.known
        if not own.any():
            rows.append([diameter, 0, *[None] * 8])
            continue
        bends = np.rad2deg(np.stack([grasps.bends[own], measured.bends[own]]))
        rows.append(
            [
                diameter,
                int(own.sum()),
                float(measured.diameters[own].mean()),
                float(measured.diameters[own].std()),
                float(np.abs(measured.diameters[own] - diameter).mean()),
                float(bends[0].mean()),
                float(bends[1].mean()),
                float(np.sqrt(np.mean((bends[1] - bends[0]) ** 2))),
                float(grasps.arcs[own].mean()),
                float(measured.residuals[own].mean()),
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
    for name, measured in (("the bottles", found.bottles), ("random", found.random)):
        for way, field in WAYS.items():
            errors = measured.errors(getattr(measured, field))
            rows.append([name, way, len(errors), *summary(errors)])
    return Table(
        "budget",
        "Where errors come from: a bottle off its place and the wall pressed in more or less "
        "(grasp), or markers off on the image",
        [
            "diameters",
            "what_is_off",
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


def told_apart(spec: ObjectSizeSpec, measured: Measured) -> float:
    """Part of the grasps whose bottle was told; one without an answer was not."""
    truth = np.repeat(np.arange(len(spec.bottles)), spec.grasps)
    return float(np.mean(measured.told(spec.bottles) == truth))
