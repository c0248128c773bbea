"""The study itself: from its spec to its results."""

from __future__ import annotations

import math
import statistics
from dataclasses import replace

import numpy as np

from designopt.errors import UserError
from designopt.study.results import PrecisionRow, PrecisionStudy, Results
from designopt.study.study import Context
from optics.rendering import Effects
from perception.proprioception import GapTable
from studies.models.sensor.estimators import gap_table
from studies.models.sensor.finger_sensor import FingerSensor
from studies.proprioception import drawings, gap_alone, statements, tables
from studies.proprioception.found import Found
from studies.proprioception.ladder import (
    EDGE,
    GAP,
    RUNGS,
    Answer,
    Ladder,
    errors_deg,
    of_method,
    solved,
)
from studies.proprioception.spec import ProprioceptionSpec
from studies.proprioception.watching import Watched, watched


def run(spec: ProprioceptionSpec, context: Context) -> Results:
    """Watch made fingers, climb the ladder, and judge it.

    Raises:
        UserError: the scene cannot be read, its joints have no gap, or another float type than
            float64.
    """
    context.require_float64("proprioception solves for angles to 1e-9")
    found = find(spec, context)
    return Results(
        findings=statements.findings(spec, found),
        metrics=statements.metrics(spec, found),
        tables=tables.tables(found),
        figures=drawings.figures(found),
        precision=PrecisionStudy(
            found.rows,
            error="mean absolute error (°)",
            reference="the joint angles that were rendered",
            claims=[statements.claim(found.rows)],
        )
        if found.rows
        else None,
    )


def find(spec: ProprioceptionSpec, context: Context) -> Found:
    """Everything that is measured."""
    label_deviation = math.radians(spec.label_deviation_deg)
    with context.step("The finger, its views and its gaps"):
        finger = FingerSensor.of(spec)
        gaps = _gap_tables(finger)
    ladder = Ladder.of(finger, gaps, label_deviation)
    seen, climbed = [], []
    for number in range(spec.fingers):
        with context.step(f"Finger {number + 1} of {spec.fingers}"):
            seen.append(_watch(spec, finger, gaps, number, context.seed))
            climbed.append(ladder.climbed(number, seen[-1], context.seed))
    with context.step("The gap without images"):
        alone = gap_alone.tried(
            finger,
            gaps,
            fingers=spec.gap_fingers,
            frames=spec.frames,
            labelled=spec.labelled,
            label_deviation=label_deviation,
            noise=spec.pixel_noise,
            seed=context.seed,
        )
    smooth: list[Answer] = []
    for number in range(min(spec.cost_fingers, spec.fingers)):
        with context.step(f"Finger {number + 1} with smooth edges"):
            polished = _watch(spec, finger, gaps, number, context.seed, smooth=True)
            smooth += solved(ladder, number, polished, context.seed)
    rows: list[PrecisionRow] = []
    for size in spec.sizes:
        with context.step(f"Images {size} px high"):
            rows += _over_sizes(spec, size, context.seed)
    return Found(finger, gaps, seen, climbed, alone, smooth, rows)


def _gap_tables(finger: FingerSensor) -> list[GapTable]:
    """The gap of every joint, in the joints' order."""
    by_joint: dict[int, GapTable] = {}
    for (pad, path), joint in zip(finger.model.views, finger.model.joints, strict=True):
        if joint is not None and path != "direct":
            try:
                table = gap_table(finger.scene, finger.catalog, pad)
            except ValueError as error:
                raise UserError(
                    f"scene: {error}; the gap needs both of every pad that moves: give the scene "
                    "of a finger with --set scene=FILE"
                ) from error
            by_joint[joint] = table
    missing = [name for j, name in enumerate(finger.model.names) if j not in by_joint]
    if missing:
        raise UserError(
            f"scene: no mirror shows a pad that {', '.join(missing)} moves, so it has no gap; give "
            "the scene of a finger with --set scene=FILE"
        )
    return [by_joint[joint] for joint in range(len(finger.model.names))]


def _watch(
    spec: ProprioceptionSpec,
    finger: FingerSensor,
    gaps: list[GapTable],
    number: int,
    seed: int,
    *,
    smooth: bool = False,
    frames: int | None = None,
) -> Watched:
    effects = Effects.graded(spec.severity)
    if smooth:
        effects = replace(effects, roughness=0.0, rounding=0.0)
    return watched(
        finger,
        gaps,
        effects=effects,
        number=number,
        seed=seed,
        frames=frames or spec.frames,
        labelled=spec.labelled,
        range_deg=spec.range_deg,
    )


def _over_sizes(spec: ProprioceptionSpec, size: int, seed: int) -> list[PrecisionRow]:
    """Error and run time of the methods over images of one size."""
    finger = FingerSensor.of(spec, size)
    gaps = _gap_tables(finger)
    ladder = Ladder.of(finger, gaps, math.radians(spec.label_deviation_deg))
    answers: list[Answer] = []
    finding: list[float] = []
    solving: list[float] = []
    for number in range(spec.size_fingers):
        seen = _watch(spec, finger, gaps, number, seed, frames=spec.size_frames)
        climbed = ladder.climbed(number, seen, seed)
        answers += climbed.answers
        finding += seen.frames.seconds
        solving += climbed.seconds
    rows = []
    for method in RUNGS:
        # Gap and edge are arithmetic on a few corners.
        added = 0.0 if method in (GAP, EDGE) else statistics.median(solving)
        seconds = [one + added for one in finding]
        errors = np.abs(errors_deg(of_method(answers, method)))
        if len(errors):
            rows.append(
                PrecisionRow(
                    method,
                    "{1} × {0} px".format(*finger.imaging.shape),
                    "finding the views and the joint angles of a frame",
                    float(errors.mean()),
                    statistics.median(seconds),
                    min(seconds),
                    max(seconds),
                    0.0,
                )
            )
    return rows
