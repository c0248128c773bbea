"""The study itself: from its spec to its results."""

from __future__ import annotations

import statistics
import time

import numpy as np

from designopt.study.results import Results
from designopt.study.study import Context
from perception.chamber import SurfaceKind, find_points, find_regions
from studies.models.one_thread import one_thread
from studies.surface_profile import drawings, statements, tables
from studies.surface_profile.found import Found, Picture
from studies.surface_profile.limits import over_sizes
from studies.surface_profile.odd import odd_frames, over_bends
from studies.surface_profile.sensor import UP, postures_on
from studies.surface_profile.spec import SurfaceProfileSpec
from studies.surface_profile.surfaces import KINDS
from studies.surface_profile.trials import Slide, design_of, made_finger, touched

TIMED = 3
"""How often the points of a picture are found, for the time it takes."""


def run(spec: SurfaceProfileSpec, context: Context) -> Results:
    """Calibrate, slide, find profiles and judge.

    Raises:
        UserError: no map follows from the settings, or another float type than float64.
    """
    context.require_float64("surface-profile predicts points to a thousandth of a pixel")
    found = find(spec, context)
    return Results(
        findings=statements.findings(spec, found),
        metrics=statements.metrics(spec, found),
        tables=tables.tables(spec, found),
        figures=drawings.figures(spec, found),
    )


def find(spec: SurfaceProfileSpec, context: Context) -> Found:
    """Everything that is measured."""
    with context.step("The map that the design predicts"):
        design = design_of(spec)
        slides = [
            Slide.drawn(spec, number, context.seed) for number in range(len(KINDS) * spec.trials)
        ]
    counts = [spec.calibration, *(one for one in spec.calibrations if one != spec.calibration)]
    fingers = []
    for number in range(min(spec.fingers, spec.trials)):
        own = [slide for slide in slides if slide.number // len(KINDS) % spec.fingers == number]
        with context.step(f"Finger {number + 1}: {len(own)} slides"):
            fingers.append(
                touched(
                    spec, design, number, own, context.seed, severity=spec.severity, counts=counts
                )
            )
    severities = []
    some = slides[: len(KINDS) * spec.severity_trials]
    for severity in (one for one in spec.severities if one != spec.severity):
        with context.step(f"Severity {severity:g}: {len(some)} slides"):
            severities.append(
                touched(
                    spec,
                    design,
                    0,
                    some,
                    context.seed,
                    severity=severity,
                    counts=[spec.calibration],
                )
            )
    with context.step(f"{len(spec.sagittas) + len(spec.roughnesses)} sizes through the limits"):
        sized = over_sizes(spec, design, context.seed)
    with context.step("Frames that are no proper images, and bends up to 120°"):
        odd = odd_frames(spec, design, context.seed + 1)
        bends = over_bends(spec, design, context.seed + 2)
    with context.step("Pictures, and the time that a frame takes"):
        pictures, seconds = _pictured(spec, slides, context.seed)
    return Found(design, fingers, severities, sized, odd, bends, seconds, pictures)


def _pictured(
    spec: SurfaceProfileSpec, slides: list[Slide], seed: int
) -> tuple[list[Picture], float]:
    """The first finger at rest and on the first convex surface; seconds for a picture's points."""
    finger = made_finger(spec, seed, 0)
    renderer = finger.renderer(seed)
    slide = next(one for one in slides if one.surface.kind is SurfaceKind.CONVEX)
    order = np.argsort(slide.ridden)
    frames = order[[0, len(order) // 2, -1]]
    deflections = spec.preload + slide.ridden[frames]
    still = renderer.render(finger.postures(np.zeros(1), np.full(1, UP)))
    bent = renderer.render(
        postures_on(finger, spec, deflections, np.full(len(frames), slide.direction)), 1
    )
    titles = ["at rest", *(f"deflected by {one:.1f} mm" for one in deflections)]
    pictures, seconds = [], []
    with one_thread():
        for title, image in zip(titles, [*still, *bent], strict=True):
            for _ in range(TIMED):
                start = time.perf_counter()
                find_points(image.pixels, find_regions(image.pixels))
                seconds.append(time.perf_counter() - start)
            points = find_points(image.pixels, find_regions(image.pixels))
            pictures.append(Picture(title, image.pixels, points))
    return pictures, statistics.median(seconds)
