"""The study itself: from its spec to its results."""

from __future__ import annotations

import math

import numpy as np

from designopt.study.benchmark import BenchmarkMethod, benchmark
from designopt.study.results import PrecisionRow, PrecisionStudy, Results
from designopt.study.study import Context
from optics.rendering import Effects
from perception.detection import detect_quads
from perception.paper_route import PaperRoute
from studies.models.one_thread import one_thread
from studies.models.sensor.finger_sensor import FingerSensor
from studies.tactile_images import drawings, statements, tables
from studies.tactile_images.corrupted import Analysis, Trial, tried
from studies.tactile_images.found import OURS, PAPER, Found
from studies.tactile_images.frames import (
    FAR,
    Frame,
    can_be_found,
    independent_effects,
    nearest_errors,
    poses,
    rendered,
    touched,
)
from studies.tactile_images.pictures import shown
from studies.tactile_images.rendering import effect_times
from studies.tactile_images.spec import TactileImagesSpec

BASES = 4
"""Good images, from one end of the grid of poses to the other, that are corrupted."""


def run(spec: TactileImagesSpec, context: Context) -> Results:
    """Render, find, unwarp and judge.

    Raises:
        UserError: the scene cannot be read, or another float type than float64.
    """
    context.require_float64("tactile-images predicts corners to a thousandth of a pixel")
    found = find(spec, context)
    return Results(
        findings=statements.findings(spec, found),
        metrics=statements.metrics(spec, found),
        tables=tables.tables(found),
        figures=drawings.figures(spec, found),
        precision=PrecisionStudy(
            found.rows,
            error="median corner error (px of 1080 rows)",
            reference="the corners of the rendered pads' sharp rectangles",
            claims=[statements.claim(found.rows)],
        )
        if found.rows
        else None,
    )


def find(spec: TactileImagesSpec, context: Context) -> Found:
    """Everything that is measured."""
    with context.step("The finger and its views"):
        finger = FingerSensor.of(spec)
    angles = poses(spec.grid, spec.range_deg, len(finger.model.names))
    frames: list[Frame] = []
    conditions = [(gain, spec.severity, number) for gain in spec.gains
                  for number in range(spec.fingers)]  # fmt: skip
    conditions += [(1.0, severity, 0) for severity in spec.severities if severity != spec.severity]
    for gain, severity, number in conditions:
        with context.step(f"Finger {number + 1}, gain {gain:g}, severity {severity:g}"):
            frames += rendered(
                finger,
                effects=Effects.graded(severity, gain),
                severity=severity,
                angles=angles,
                number=number,
                seed=context.seed,
            )
    independent: list[Frame] = []
    if spec.independent:
        with context.step("Effects of independent severities"):
            generator = np.random.default_rng([context.seed, 7])
            for number in range(spec.independent):
                independent += rendered(
                    finger,
                    effects=independent_effects(generator),
                    severity=np.nan,
                    angles=np.deg2rad(generator.uniform(0, spec.range_deg, angles[:1].shape)),
                    number=number,
                    seed=context.seed,
                )
    trials: list[Trial] = []
    if spec.corrupted:
        with context.step("Corrupted frames"):
            small = FingerSensor.of(spec, spec.corrupted_rows)
            renderer = small.renderer(Effects.graded(spec.severity), None, context.seed)
            some = angles[np.linspace(0, len(angles) - 1, BASES).round().astype(int)]
            pictures = [
                renderer.render(pose, touched(small, frame), frame=frame).pixels
                for frame, pose in enumerate(some)
            ]
            analysis = Analysis.of(small, pictures, some)
            trials = tried(analysis, pictures, spec.corrupted, context.seed)
    rows: list[PrecisionRow] = []
    for size in spec.sizes:
        with context.step(f"Images {size} px high"):
            rows += _over_sizes(spec, size, context.seed)
    with context.step("Rendering, effect by effect"):
        times = effect_times(finger, spec.severity, context.seed)
    with context.step("Pictures"):
        figures = shown(finger, spec, context.seed)
    return Found(frames, independent, trials, rows, times, finger, figures)


def _over_sizes(spec: TactileImagesSpec, size: int, seed: int) -> list[PrecisionRow]:
    """Our way and the paper's over images of one size."""
    finger = FingerSensor.of(spec, size)
    errors, _ = finger.made(seed, 0)
    renderer = finger.renderer(Effects.graded(spec.severity), errors, seed)
    generator = np.random.default_rng([seed, 6])
    joints = len(finger.model.names)
    angles = np.deg2rad(generator.uniform(0, spec.range_deg, (spec.size_frames, joints)))
    images = [renderer.render(pose, frame=frame) for frame, pose in enumerate(angles)]
    far = FAR * size / 1080

    def ours() -> list[list[np.ndarray]]:
        return [[q.corners for q in detect_quads(i.pixels, finger.lens)] for i in images]

    def paper() -> list[list[np.ndarray]]:
        block = round(PaperRoute.block * size / 1080) | 1
        return [PaperRoute(block=block).corners(image.pixels) for image in images]

    def error(found: list[list[np.ndarray]]) -> float:
        off = [
            nearest_errors(quads, view.corners, far)
            for quads, image in zip(found, images, strict=True)
            for view in can_be_found(finger, image)
        ]
        known = np.concatenate([*off, np.zeros(0)])
        known = known[np.isfinite(known)]
        return float(np.median(known)) * 1080 / size if len(known) else math.nan

    rows = []
    for method, call in ((OURS, ours), (PAPER, paper)):
        setting = "{1} × {0} px".format(*finger.imaging.shape)
        contender = BenchmarkMethod(method, setting, "all views of a frame", call, error,
                              scale=1 / len(images))  # fmt: skip
        with one_thread():
            rows += benchmark([contender], repeats=3)
    return rows
