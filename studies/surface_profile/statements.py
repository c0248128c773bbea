"""What the study says: findings in sentences, and metrics."""

from __future__ import annotations

import numpy as np

from designopt.results import Metric, Target
from perception.chamber.profile import CURVED, ROUGH, ChamberMap
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
from studies.surface_profile.sensor import highest
from studies.surface_profile.spec import SurfaceProfileSpec
from studies.surface_profile.surfaces import KINDS
from studies.surface_profile.trials import POINTS, WHOLE, YELLOW

TOLD_APART = 0.95


def resolution(spec: SurfaceProfileSpec, design: ChamberMap) -> np.ndarray:
    """Mm per px of b, e and g, halfway up."""
    return design.resolution(np.array([(spec.preload + highest(spec)) / 2]))[0]


def metrics(spec: SurfaceProfileSpec, found: Found) -> list[Metric]:
    """The study's numbers; the target belongs to the stated finger and surfaces."""
    default = SurfaceProfileSpec()
    numbers = {"trials", "fingers", "calibrations", "severities", "severity_trials"}
    stated = spec.model_dump(exclude=numbers) == default.model_dump(exclude=numbers)
    trials = found.trials
    ours, yellow, whole = (
        quantiles(errors(trials, way), 0.5, 0.9) for way in (POINTS, YELLOW, WHOLE)
    )
    bare, pad = (quantiles(one, 0.9)[0] for one in (surface_errors(trials), stylus_errors(trials)))
    full = calibrated_errors(spec, found.fingers, spec.calibration, POINTS)[1]
    blue_px, yellow_px, _ = resolution(spec, found.design)
    unknown = sum(int((~trial.heights[POINTS].known).sum()) for trial in trials)

    def mm(name: str, value: float, description: str) -> Metric:
        return Metric(name, float(value), "mm", description)

    return [
        Metric(
            "told_apart",
            share(trial.told() for trial in trials),
            "",
            f"part of {len(trials)} surfaces that were taken for what they are",
            None,
            Target(">=", TOLD_APART) if stated else None,
        ),
        mm("profile_median_mm", ours[0], "median error of the profile up to a constant, by b, e "
           "and g finer than a pixel"),
        mm("profile_p90_mm", ours[1], "90th percentile of the same"),
        mm("yellow_median_mm", yellow[0], "median error by e alone, finer than a pixel"),
        mm("yellow_p90_mm", yellow[1], "90th percentile of the same"),
        mm("whole_median_mm", whole[0], "median error by e alone in whole pixels, as in the paper"),
        mm("whole_p90_mm", whole[1], "90th percentile of the same"),
        mm("full_p90_mm", quantiles(full, 0.9)[0], "90th percentile of the error of calibrated "
           "heights themselves, with their constant"),
        mm("pad_p90_mm", pad, "90th percentile of how far the height that the pad rides is off the "
           "bare surface, up to a constant"),
        mm("bare_p90_mm", bare, "90th percentile of the profile's error from the bare surface"),
        Metric("resolution_mm_per_px", float(yellow_px), "mm/px", "height for a pixel of e, "
               "yellow's lowest point, halfway up"),
        Metric("blue_resolution_mm_per_px", float(blue_px), "mm/px", "the same of b, blue's"),
        Metric("whole_told_apart", share(trial.told(WHOLE) for trial in trials), "", "part of the "
               "same surfaces told apart by e in whole pixels"),
        Metric("heights_unknown", unknown, "", f"of {spec.frames * len(trials):,} heights, those "
               "that no point says"),
        Metric("perception_ms", 1e3 * found.seconds, "ms", "median time to find the regions and "
               "points of a frame on one core"),
    ]  # fmt: skip


def findings(spec: SurfaceProfileSpec, found: Found) -> list[str]:
    """Plain sentences, most important first."""
    trials = found.trials
    ours, yellow, whole = (
        quantiles(errors(trials, way), 0.5, 0.9) for way in (POINTS, YELLOW, WHOLE)
    )
    parts = [
        f"{sum(trial.told() for trial in of_kind(trials, kind))} of {len(of_kind(trials, kind))} "
        f"{kind.name.lower()}"
        for kind in KINDS
    ]
    scale = resolution(spec, found.design)
    lines = [
        f"Of {len(trials)} surfaces, on {spec.fingers} fingers with errors of fabrication, were "
        f"taken for what they are: {', '.join(parts)}; in whole pixels of e alone "
        f"{100 * share(trial.told(WHOLE) for trial in trials):.1f} %.",
        f"A pixel of yellow's lowest point e is {scale[1]:.3f} mm of height, one of blue's b "
        f"{scale[0]:.3f} mm. In whole pixels of e the profile is off by {whole[0]:.3f} mm (median) "
        f"and {whole[1]:.3f} mm (90th percentile), finer than a pixel by {yellow[0]:.3f} mm and "
        f"{yellow[1]:.3f} mm, which is the camera's shaking; by b, e and g together, between which "
        f"shaking cancels, by {ours[0]:.3f} mm and {ours[1]:.3f} mm.",
    ]
    rough = of_kind(trials, KINDS[3])
    lines.append(
        f"Of a rough surface the pad of radius {spec.tip_radius:g} mm does not reach the bottoms: "
        f"what it rides is off the surface by {quantiles(stylus_errors(rough), 0.9)[0]:.2f} mm "
        f"(90th percentile), and so is the profile: {quantiles(surface_errors(rough), 0.9)[0]:.2f} "
        "mm."
    )
    lines += _margins(found)
    counts = sorted(found.fingers[0].calibrations)
    if 0 in counts:
        first = calibrated_errors(spec, found.fingers, 0, POINTS)
        last = calibrated_errors(spec, found.fingers, spec.calibration, POINTS)
        lines.append(
            f"Heights themselves are off by {quantiles(first[1], 0.9)[0]:.3f} mm (90th percentile) "
            f"by the design's map and by {quantiles(last[1], 0.9)[0]:.3f} mm after "
            f"{spec.calibration} frames on a plate; profiles, up to a constant, by "
            f"{quantiles(first[0], 0.9)[0]:.3f} mm and {quantiles(last[0], 0.9)[0]:.3f} mm."
        )
    return lines


def _margins(found: Found) -> list[str]:
    """How near surfaces came to what tells them apart."""
    flat, concave, convex, rough = (
        [trial.shapes[POINTS] for trial in of_kind(found.trials, kind)] for kind in KINDS
    )
    smooth = [one.roughness for one in flat if one]
    uneven = [one.roughness for one in rough if one]
    curved = [abs(one.sagitta) for one in [*concave, *convex] if one]
    level = [abs(one.sagitta) for one in [*flat, *rough] if one]
    if not (smooth and uneven and curved and level):
        return []
    return [
        f"Roughness was at most {max(smooth):.3f} mm on flat and at least {min(uneven):.3f} mm on "
        f"rough surfaces (limit {ROUGH:g} mm); sagittas at least {min(curved):.2f} mm on curved "
        f"and at most {max(level):.2f} mm on other surfaces (limit {CURVED:g} mm)."
    ]
