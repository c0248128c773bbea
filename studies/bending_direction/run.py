"""The study itself: from its spec to its results."""

from __future__ import annotations

import statistics

import numpy as np

from designopt.study.results import PrecisionStudy, Results
from designopt.study.study import Context
from perception.chamber import Direction, find_points, find_regions
from studies.bending_direction import drawings, precision, statements, tables
from studies.bending_direction.design import best
from studies.bending_direction.found import Found, Shown
from studies.bending_direction.frames import TOWARDS, Series, look_at, series
from studies.bending_direction.odd import odd_frames, over_bends
from studies.bending_direction.spec import BendingDirectionSpec
from studies.models.one_thread import one_thread
from studies.models.soft_finger.finger import SoftFinger

CURVE_DEG = np.arange(0.0, 121.0)
"""Bends of the displacement curves."""

SHOWN = (
    (Direction.DOWN, 0.0),
    (Direction.DOWN, 30.0),
    (Direction.DOWN, 60.0),
    (Direction.DOWN, 110.0),
    (Direction.RIGHT, 30.0),
    (Direction.UP, 30.0),
)
"""Pictures of the report: directions and bends in degrees."""

TIMED = 64
"""Frames whose analysis is timed."""


def run(spec: BendingDirectionSpec, context: Context) -> Results:
    """Render, look, decide and judge.

    Raises:
        UserError: no such chamber, or another float type than float64.
    """
    context.require_float64("bending-direction tells displacements of a hundredth of a pixel apart")
    with one_thread():
        found = find(spec, context)
    return Results(
        findings=statements.findings(spec, found),
        metrics=statements.metrics(spec, found),
        tables=tables.tables(spec, found),
        figures=drawings.figures(spec, found),
        precision=PrecisionStudy(
            found.rows,
            error="error of the outlines' ends (px)",
            reference=f"{precision.REFERENCE} rings per region",
            claims=[precision.claim(found.rows)],
        ),
    )


def find(spec: BendingDirectionSpec, context: Context) -> Found:
    """Everything that is measured."""
    seed = context.seed
    with context.step("The finger"):
        finger = SoftFinger.of(spec)
    with context.step("The chamber whose image moves most"):
        designs, held_by = best(finger, seed)
    with context.step(f"{spec.images} images in every direction"):
        random = _random(spec, finger, spec.images, spec.largest_bend_deg, seed, stream=3)
    with context.step("Bending from nothing to 120°"):
        curves = [
            series(
                finger,
                truth,
                np.deg2rad(CURVE_DEG),
                np.zeros(len(CURVE_DEG)),
                seed=seed + 1,
                first=number * len(CURVE_DEG),
            )
            for number, truth in enumerate(TOWARDS)
        ]
    small: list[list[Series]] = []
    for design in designs:
        with context.step(f"Small bends, chamber {design.name}"):
            small.append(
                _random(spec, design.finger, spec.small_images, spec.small_bend_deg, seed, stream=4)
            )
    with context.step("0.01° to 120° of bend"):
        bends = over_bends(finger, 1, spec.threshold, seed + 2, perfect=True)
        bends += over_bends(finger, spec.stability_images, spec.threshold, seed + 2)
    with context.step("Frames that are no proper images"):
        odd = odd_frames(finger, spec.threshold, seed + 3)
    with context.step("Outlines, error against run time"):
        rows = precision.measured(finger)
    with context.step("Pictures and run time"):
        shown = _shown(finger, seed + 4)
        seconds = _seconds(finger, spec, seed)
    return Found(random, curves, designs, held_by, small, bends, odd, rows, seconds, shown)


def _random(
    spec: BendingDirectionSpec,
    finger: SoftFinger,
    images: int,
    largest_deg: float,
    seed: int,
    stream: int,
) -> list[Series]:
    """Random bends in every direction; the same for every finger."""
    made = []
    for number, truth in enumerate(TOWARDS):
        generator = np.random.default_rng([seed, stream, number])
        bends = np.deg2rad(generator.uniform(0, largest_deg, images))
        scatter = np.deg2rad(spec.scatter_deg) * generator.standard_normal(images)
        # Every direction is an experiment of its own, with its own lamp and its own initial frame.
        own = (seed, stream, number)
        made.append(series(finger, truth, bends, scatter, seed=own, first=0))
    return made


def _shown(finger: SoftFinger, seed: int) -> list[Shown]:
    truths, bends = zip(*SHOWN, strict=True)
    postures = finger.postures(np.deg2rad(bends), np.array([TOWARDS[truth] for truth in truths]))
    images = finger.renderer(seed).render(postures)
    made = []
    for truth, bend, image in zip(truths, bends, images, strict=True):
        title = f"{truth.name.lower()}, {bend:g}°" if bend else "straight"
        made.append(Shown(title, image, find_points(image.pixels, find_regions(image.pixels))))
    return made


def _seconds(finger: SoftFinger, spec: BendingDirectionSpec, seed: int) -> float:
    """Median time of one frame's analysis, one after the other on one core."""
    bends = np.deg2rad(np.linspace(0, spec.largest_bend_deg, TIMED))
    angles = np.resize(np.array(list(TOWARDS.values())), TIMED)
    images = finger.renderer(seed).render(finger.postures(bends, angles))
    return statistics.median(look_at(i, image).seconds for i, image in enumerate(images))
