"""The study's tables."""

from __future__ import annotations

import numpy as np

from designopt.study.results import Cell, Table
from perception.chamber import SurfaceKind
from studies.models.soft_finger.odd import status_words
from studies.surface_profile.found import (
    Found,
    calibrated_errors,
    errors,
    of_kind,
    quantiles,
    share,
    stylus_errors,
    surface_errors,
)
from studies.surface_profile.limits import LIMIT
from studies.surface_profile.odd import WITHIN
from studies.surface_profile.spec import SurfaceProfileSpec
from studies.surface_profile.surfaces import KINDS
from studies.surface_profile.trials import POINTS, WAYS, WHOLE, YELLOW


def tables(spec: SurfaceProfileSpec, found: Found) -> list[Table]:
    """Every table of the study."""
    return [
        confusion(found),
        kinds(found),
        ways(found),
        calibration(spec, found),
        severities(spec, found),
        fingers(spec, found),
        sizes(found),
        odd_frames(found),
        bends(found),
    ]


def confusion(found: Found) -> Table:
    """What surfaces were taken for."""
    answers = [*KINDS, SurfaceKind.UNDEFINED]
    rows = []
    for kind in KINDS:
        taken = [trial.kind() for trial in of_kind(found.trials, kind)]
        rows.append((kind.name.lower(), *(taken.count(answer) for answer in answers)))
    return Table(
        "confusion",
        "Surfaces, and what they were taken for",
        ["surface", *(answer.name.lower() for answer in answers)],
        rows,
    )


def kinds(found: Found) -> Table:
    """How far profiles are off, by kind."""
    rows = []
    for kind in KINDS:
        own = of_kind(found.trials, kind)
        rows.append(
            (
                kind.name.lower(),
                len(own),
                *quantiles(errors(own), 0.5, 0.9),
                *quantiles(errors(own, WHOLE), 0.5, 0.9),
                *quantiles(stylus_errors(own), 0.5, 0.9),
                *quantiles(surface_errors(own), 0.5, 0.9),
            )
        )
    return Table(
        "kinds",
        "Profiles by kind, up to a constant: how far off the height that the pad rides they are, "
        "by all points and by whole pixels; how far that height is off the bare surface; and how "
        "far off the bare surface the profile is",
        [
            "surface",
            "slides",
            "median_mm",
            "p90_mm",
            "whole_median_mm",
            "whole_p90_mm",
            "pad_median_mm",
            "pad_p90_mm",
            "bare_median_mm",
            "bare_p90_mm",
        ],
        rows,
        dict.fromkeys(("median_mm", "p90_mm", "whole_median_mm", "whole_p90_mm",
                              "pad_median_mm", "pad_p90_mm", "bare_median_mm", "bare_p90_mm"), 3),
    )  # fmt: skip


def ways(found: Found) -> Table:
    """What following several points finer than a pixel is good for."""
    trials = found.trials
    rows = [
        (way, *quantiles(errors(trials, way), 0.5, 0.9), share(one.told(way) for one in trials))
        for way in WAYS
    ]
    return Table(
        "ways",
        "Three ways to a height, all calibrated, over all surfaces, up to a constant",
        ["points", "median_mm", "p90_mm", "told_apart"],
        rows,
        {"median_mm": 3, "p90_mm": 3, "told_apart": 3},
    )


def calibration(spec: SurfaceProfileSpec, found: Found) -> Table:
    """Error over the number of calibration frames."""
    rows = []
    for count in sorted(found.fingers[0].calibrations):
        shapes, full = calibrated_errors(spec, found.fingers, count, POINTS)
        alone, alone_full = calibrated_errors(spec, found.fingers, count, YELLOW)
        rows.append(
            (
                count,
                *quantiles(shapes, 0.5, 0.9),
                *quantiles(full, 0.5, 0.9),
                *quantiles(alone, 0.9),
                *quantiles(alone_full, 0.9),
            )
        )
    return Table(
        "calibration",
        "Errors of heights over the number of frames on a plate at known heights, none of them "
        "being the design's own map: up to a constant, and in full; then of e alone",
        ["frames", "median_mm", "p90_mm", "full_median_mm", "full_p90_mm", "e_p90_mm",
         "e_full_p90_mm"],
        rows,
        dict.fromkeys(("median_mm", "p90_mm", "full_median_mm", "full_p90_mm", "e_p90_mm",
                              "e_full_p90_mm"), 3),
    )  # fmt: skip


def severities(spec: SurfaceProfileSpec, found: Found) -> Table:
    """Worse pictures."""
    groups = {one.severity: one.trials for one in found.severities}
    groups[spec.severity] = found.trials
    rows = []
    for severity, trials in sorted(groups.items()):
        rows.append(
            (
                severity,
                len(trials),
                share(one.told() for one in trials),
                *quantiles(errors(trials), 0.5, 0.9),
                *quantiles(errors(trials, YELLOW), 0.9),
                *quantiles(errors(trials, WHOLE), 0.9),
                sum(int((~one.heights[POINTS].known).sum()) for one in trials),
            )
        )
    return Table(
        "severities",
        "The same over the severity of shaking, noise and light; at others than the stated one "
        "with one finger",
        ["severity", "slides", "told_apart", "median_mm", "p90_mm", "e_p90_mm", "whole_p90_mm",
         "heights_unknown"],
        rows,
        dict.fromkeys(("told_apart", "median_mm", "p90_mm", "e_p90_mm", "whole_p90_mm"), 3),
    )  # fmt: skip


def fingers(spec: SurfaceProfileSpec, found: Found) -> Table:
    """What calibrating found of every finger."""
    rows = []
    for finger in found.fingers:
        made, _ = finger.calibrations[spec.calibration]
        scales = (made.moved[-1] - made.moved[0]) / (found.design.moved[-1] - found.design.moved[0])
        rows.append(
            (
                finger.number + 1,
                *(float(scale) for scale in scales),
                finger.shake,
                finger.noise,
                *quantiles(errors(finger.trials), 0.9),
            )
        )
    return Table(
        "fingers",
        "Fingers as made: scales of b's, e's and g's movement against the design, and at rest the "
        "scatter of all points alike and of each",
        ["finger", "scale_b", "scale_e", "scale_g", "shake_px", "noise_px", "p90_mm"],
        rows,
        {"scale_b": 3, "scale_e": 3, "scale_g": 3, "shake_px": 2, "noise_px": 3, "p90_mm": 3},
    )


def sizes(found: Found) -> Table:
    """Surfaces through the limits."""
    return Table(
        "sizes",
        "Surfaces of sizes through the limits: the part called what it is by b, e and g, by e in "
        "whole pixels, and by the very heights that the pad rides; and the median size found",
        ["quantity", "limit_mm", "size_mm", "slides", "told", "whole_told", "exact_told",
         "found_mm"],
        [
            (
                one.quantity,
                LIMIT[one.quantity],
                one.size,
                len(one.trials),
                one.told(),
                one.told(WHOLE),
                one.told_exactly(),
                one.found(),
            )
            for one in found.sized
        ],
        {"limit_mm": 2, "size_mm": 2, "told": 2, "whole_told": 2, "exact_told": 2, "found_mm": 3},
    )  # fmt: skip


def odd_frames(found: Found) -> Table:
    """Answers to frames that are no proper images."""
    rows: list[list[Cell]] = []
    for kind in dict.fromkeys(one.kind for one in found.odd):
        own = [one for one in found.odd if one.kind == kind]
        statuses = sorted({status_words(one.status) for one in own})
        rows.append(
            [
                kind.name,
                len(own),
                status_words(kind.status),
                f"within {WITHIN:g} mm" if kind.in_view else "not known",
                ", ".join(statuses),
                sum(one.failed for one in own),
            ]
        )
    return Table(
        "odd_frames",
        "Frames that are no proper images: what is to be answered, and how often it was not",
        ["kind", "frames", "expected_sight", "expected_height", "sights", "failures"],
        rows,
    )


def bends(found: Found) -> Table:
    """Heights from hardly bent to far beyond the map."""
    rows: list[list[Cell]] = []
    for one in found.bends:
        off = np.abs(one.heights.mm - one.deflection)[one.heights.known]
        rows.append(
            [
                one.severity,
                one.bend_deg,
                one.deflection,
                len(one.heights.mm),
                int(one.heights.known.sum()),
                float(off.max()) if len(off) else None,
                one.failures,
            ]
        )
    return Table(
        "bends",
        f"Heights over the bend: the map ends at {found.design.heights[-1]:.1f} mm of deflection, "
        f"beyond which none is to be known; within it, none is to be off by more than {WITHIN:g} "
        "mm",
        ["severity", "bend_deg", "deflection_mm", "frames", "known", "worst_mm", "failures"],
        rows,
        {"deflection_mm": 2, "worst_mm": 3},
    )
