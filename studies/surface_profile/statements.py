"""What the study says: findings in sentences, and metrics."""

from __future__ import annotations

import statistics

import numpy as np

from designopt.study.results import Metric, Target
from perception.chamber import ChamberMap
from perception.chamber.surfaces import CURVED, ROUGH
from studies.models.soft_finger.targets import stated
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
from studies.surface_profile.limits import (
    LIMIT,
    WORD,
    Quantity,
    all_from,
    none_up_to,
    of_quantity,
)
from studies.surface_profile.sensor import highest
from studies.surface_profile.spec import SurfaceProfileSpec
from studies.surface_profile.surfaces import KINDS
from studies.surface_profile.trials import POINTS, WHOLE, YELLOW

TOLD_APART = 0.95

FREE = frozenset(
    {"calibrations", "severities", "severity_trials", "sagittas", "roughnesses", "size_slides"}
)
"""Settings of metrics without a target."""


def resolution(spec: SurfaceProfileSpec, design: ChamberMap) -> np.ndarray:
    """Mm per px of b, e and g, halfway up."""
    return design.resolution(np.array([(spec.preload + highest(spec)) / 2]))[0]


def metrics(spec: SurfaceProfileSpec, found: Found) -> list[Metric]:
    """The study's numbers; targets belong to the stated finger and surfaces."""
    default = SurfaceProfileSpec()
    asked = stated(spec, free=FREE, least={"trials": default.trials, "fingers": default.fingers})
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
            f"part of {len(trials)} surfaces that were taken for what they are; those of which too "
            "few heights are known were not",
            None,
            Target(">=", TOLD_APART) if asked else None,
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
               "that no point says", None, Target("<=", 0) if asked else None),
        *(_least_told(found, name) for name in LIMIT),
        Metric("odd_failures", _failures(found), "", f"of {_odd_frames(found)} frames that are no "
               "proper images or of bends up to 120°, those without the defined answer", None,
               Target("<=", 0) if asked else None),
        Metric("perception_ms", 1e3 * found.seconds, "ms", "median time to find the regions and "
               "points of a frame on one core"),
    ]  # fmt: skip


def _least_told(found: Found, name: Quantity) -> Metric:
    least = all_from(of_quantity(found.sized, name))
    return Metric(
        f"{WORD[name]}_from_mm",
        float("nan") if least is None else least,
        "mm",
        f"least {name} tried from which on all surfaces are called {WORD[name]}",
    )


def _failures(found: Found) -> int:
    return sum(one.failed for one in found.odd) + sum(one.failures for one in found.bends)


def _odd_frames(found: Found) -> int:
    return len(found.odd) + sum(len(one.heights.mm) for one in found.bends)


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
    shake = statistics.median(finger.shake for finger in found.fingers)
    noise = statistics.median(finger.noise for finger in found.fingers)
    lines = [
        f"Of {len(trials)} surfaces, on {_many(len(found.fingers), 'finger')} with errors of "
        f"fabrication, were taken for what they are: {', '.join(parts)}; in whole pixels of e "
        f"alone {100 * share(trial.told(WHOLE) for trial in trials):.1f} %.",
        f"A pixel of yellow's lowest point e is {scale[1]:.3f} mm of height, one of blue's b "
        f"{scale[0]:.3f} mm. In whole pixels of e the profile is off by {whole[0]:.3f} mm (median) "
        f"and {whole[1]:.3f} mm (90th percentile), finer than a pixel by {yellow[0]:.3f} mm and "
        f"{yellow[1]:.3f} mm, and by b, e and g together by {ours[0]:.3f} mm and {ours[1]:.3f} mm. "
        f"At rest all points shake alike by {shake:.2f} px (standard deviation), which is "
        f"{shake * scale[1]:.3f} mm of height by e alone, and each by {noise:.3f} px more.",
    ]
    rough = of_kind(trials, KINDS[3])
    lines.append(
        f"What the pad of radius {spec.tip_radius:g} mm rides is off a rough surface by "
        f"{quantiles(stylus_errors(rough), 0.9)[0]:.2f} mm (90th percentile, up to a constant), "
        f"and the profile is by {quantiles(surface_errors(rough), 0.9)[0]:.2f} mm."
    )
    lines += _margins(found)
    lines += [line for name in LIMIT for line in _through(found, name)]
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
    failures = _failures(found)
    lines.append(
        f"{_odd_frames(found)} frames that are no proper images (dark, saturated, out of the "
        "chamber, a region missing, colours swapped and the like) or of bends from 0.01° to 120° "
        + (f"have {_many(failures, 'wrong answer')}." if failures else
           "have the answer defined for them, each.")
    )  # fmt: skip
    return lines


def _many(count: int, word: str) -> str:
    return f"{count} {word}" if count == 1 else f"{count} {word}s"


def _through(found: Found, name: Quantity) -> list[str]:
    """From which size on surfaces are told."""
    sized = of_quantity(found.sized, name)
    if not sized:
        return []
    parts = []
    for way in (POINTS, WHOLE):
        none, every = none_up_to(sized, way), all_from(sized, way)
        low = f"none up to {none:g} mm" if none is not None else "some even of the least"
        high = f"all from {every:g} mm on" if every is not None else "not even all of the largest"
        parts.append(f"by {way} {low} and {high}")
    return [
        f"Of {_many(len(sized[0].trials), 'surface')} each with a {name} of {sized[0].size:g} to "
        f"{sized[-1].size:g} mm are called {WORD[name]} (limit {LIMIT[name]:g} mm, of the {name} "
        f"found): {'; '.join(parts)}."
    ]


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
