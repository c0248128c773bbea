"""The study itself: from its spec to its results."""

from __future__ import annotations

import os
import statistics
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from designopt.errors import UserError
from designopt.io.spec import SpecFile
from designopt.study.results import PrecisionRow, PrecisionStudy, Results
from designopt.study.study import Context
from optics.chamber import solve_image_rates
from perception.chamber import find_regions
from perception.posture import PostureEstimator, find_posture, make_boundary_image, shrink
from studies.bending_posture import drawings, statements, tables
from studies.bending_posture.elsewhere import elsewhere
from studies.bending_posture.found import AtEta, Found, Shown
from studies.bending_posture.odd import odd_frames, over_bends
from studies.bending_posture.spec import BendingPostureSpec
from studies.bending_posture.trainings import (
    MEAN,
    OURS,
    REGULARISATIONS,
    Data,
    counted,
    data_of,
    fewer,
    ours,
    regularisations,
    size_of,
    trained,
    ways,
)
from studies.models.one_thread import one_thread
from studies.models.soft_finger.finger import DOWN, SoftFinger

SHOWN_DEG = (0.0, 30.0, 60.0, 100.0)

REPEATED = 20
"""Frames at every bend from 0.01° to 120°."""

TIMED = 40


def run(spec: BendingPostureSpec, context: Context) -> Results:
    """Render, train and judge.

    Raises:
        UserError: no such chamber, or another float type than float64.
    """
    context.require_float64("bending-posture tells small displacements apart")
    with one_thread():
        found = find(spec, context)
    return Results(
        findings=statements.findings(found),
        metrics=statements.metrics(spec, found),
        tables=tables.tables(found),
        figures=drawings.figures(spec, found),
        specs=[
            SpecFile(
                "posture.network",
                "the trained network with its preprocessing and its training record, for "
                "`perception.posture.PostureEstimator.load`",
                _saved(found.trained[OURS][0].estimator),
            )
        ],
        precision=PrecisionStudy(
            found.rows,
            error="relative tip error",
            reference="the markers of the rendered finger on unseen images, over the error of the "
            "mean of the labels",
            claims=statements.claims(spec, found),
        ),
    )


def find(spec: BendingPostureSpec, context: Context) -> Found:
    """Everything that is measured."""
    seed = context.seed
    with context.step("The finger"):
        finger = SoftFinger.of(spec)
        chambers = [(eta, _chamber(spec, eta)) for eta in sorted(spec.etas)]
    most = max([spec.samples, *spec.counts])
    with context.step(f"{most + spec.unseen} images"):
        everything = data_of(spec, finger, most, [spec.width, *spec.widths], seed)
    data = fewer(everything, spec.samples)
    size = size_of(spec.width)
    found = {}
    for way, settings in ways(spec, data, finger.length).items():
        with context.step(f"Trainings: {way}"):
            found[way] = [
                trained(way, replace(settings, seed=seed + i), data, size, watch=way == OURS)
                for i in range(spec.seeds)
            ]
    sweep = []
    for regularisation in REGULARISATIONS if spec.sweep else ():
        with context.step(f"L2 regularisation {regularisation:g}"):
            settings = replace(ours(spec), regularisation=regularisation, seed=seed)
            one = trained("sweep", settings, data, size, watch=False)
            sweep.append((regularisation, one.tip_error))
    rows = [_mean_row(everything)]
    for width in sorted(spec.widths):
        for count in sorted(spec.counts):
            with context.step(f"{width} px wide, {counted(count)}"):
                rows.append(_timed(spec, fewer(everything, count), width, count, seed))
    etas = []
    for eta, chamber in chambers:
        with context.step(f"Chamber with η = {eta:g}"):
            etas.append(_at_eta(spec.model_copy(update={"eta": eta}), chamber, seed))
    with context.step("Other lamps and fingers"):
        others = elsewhere(spec, finger, [one.estimator for one in found[OURS]], seed)
    with context.step("0.01° to 120°, and frames that are no proper images"):
        estimator = found[OURS][0].estimator
        bends = over_bends(finger, estimator, REPEATED, seed + 1)
        odd = odd_frames(finger, estimator, seed + 2)
    with context.step("Pictures and run time"):
        shown = _shown(finger, spec, seed + 3)
        seconds = _seconds(finger, estimator, spec, seed + 4)
    marks = regularisations(data, finger.length)
    return Found(
        data, found, sweep, marks, rows, etas, others, bends, odd, seconds, _cores(), shown
    )


def _chamber(spec: BendingPostureSpec, eta: float) -> SoftFinger:
    try:
        return SoftFinger.of(spec.model_copy(update={"eta": eta}))
    except UserError as error:
        raise UserError(
            f"--set etas: no chamber with these dimensions has η = {eta:g}; leave it out"
        ) from error


def _cores() -> int:
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _saved(estimator: PostureEstimator) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "posture.network"
        estimator.save(path)
        return path.read_bytes()


def _mean_row(data: Data) -> PrecisionRow:
    start = time.perf_counter()
    data.labels.mean(axis=0)
    seconds = time.perf_counter() - start
    return PrecisionRow(MEAN, "all samples", "training", 1.0, seconds, seconds, seconds, 0.0)


def _timed(spec: BendingPostureSpec, data: Data, width: int, count: int, seed: int) -> PrecisionRow:
    """One training, timed; what it compiles is seen in its first epoch."""
    columns, rows = size_of(width)
    settings = replace(ours(spec), seed=seed)
    one = trained(OURS, settings, data, (columns, rows), watch=False)
    seconds = np.diff(one.estimator.record.seconds, prepend=0.0)
    # Later epochs are alike; the first one more than these is compiling.
    epoch = statistics.median(seconds[1:].tolist() or seconds.tolist())
    total = epoch * len(seconds)
    return PrecisionRow(
        f"{columns} × {rows} px",
        counted(count),
        "training",
        one.tip_error / data.mean_error,
        total,
        float(seconds[1:].min(initial=epoch)) * len(seconds),
        float(seconds[1:].max(initial=epoch)) * len(seconds),
        max(float(seconds.sum()) - total, 0.0),
    )


def _at_eta(spec: BendingPostureSpec, finger: SoftFinger, seed: int) -> AtEta:
    data = data_of(spec, finger, spec.eta_samples, [spec.width], seed)
    settings, size = ours(spec), size_of(spec.width)
    tips = tuple(
        trained(OURS, replace(settings, seed=seed + i), data, size, watch=False).tip_error
        for i in range(spec.seeds)
    )
    straight = finger.renderer(seed, severity=0.0).render(
        finger.postures(np.zeros(1), np.zeros(1))
    )[0]
    blue, yellow, top = (float(np.ptp(outline[:, 0])) / 2 for outline in straight.outlines)
    chamber = finger.chamber
    rates = solve_image_rates(chamber, finger.endoscope, DOWN)
    rate = float(rates.value[1]) * np.pi / 180 if bool(rates.ok) else None
    clearance = float(chamber.offset_a) - abs(float(chamber.offset_d))
    widths = (blue - yellow, yellow - top)
    return AtEta(spec.eta, widths, rate, clearance, data.unusable, tips)


def _shown(finger: SoftFinger, spec: BendingPostureSpec, seed: int) -> list[Shown]:
    bends = np.deg2rad(SHOWN_DEG)
    images = finger.renderer(seed).render(finger.postures(bends, np.full(len(bends), DOWN)))
    made = []
    for bend, image in zip(SHOWN_DEG, images, strict=True):
        labels = find_regions(image.pixels).nested()
        small = shrink(make_boundary_image(labels), size_of(spec.width))
        made.append(Shown(bend, image.pixels, labels, small))
    return made


def _seconds(
    finger: SoftFinger, estimator: PostureEstimator, spec: BendingPostureSpec, seed: int
) -> float:
    """Median time from a picture to markers, one after the other."""
    bends = np.deg2rad(np.linspace(0, spec.largest_bend_deg, TIMED))
    images = finger.renderer(seed).render(finger.postures(bends, np.full(TIMED, DOWN)))
    taken = []
    for image in images:
        start = time.perf_counter()
        find_posture(image.pixels, estimator)
        taken.append(time.perf_counter() - start)
    return statistics.median(taken)
