"""The study's tables."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from jaxtyping import Float

from designopt.plot.typesetting import spell_out
from designopt.study.results import Table
from studies.tactile_images.corrupted import NO_FINGER, NO_IMAGE, Trial
from studies.tactile_images.found import Found
from studies.tactile_images.frames import FoundView, Frame
from studies.tactile_images.rendering import EffectTime


def tables(found: Found) -> list[Table]:
    """Every table of the study."""
    made = [conditions(found.frames), views(found.frames), unwarping(found.frames)]
    made.append(rendering(found.times))
    return made + ([corrupted(found.trials)] if found.trials else [])


def of(frames: Iterable[Frame], gain: float, severity: float) -> list[Frame]:
    """The frames of one condition."""
    return [frame for frame in frames if (frame.gain, frame.severity) == (gain, severity)]


def all_views(frames: Iterable[Frame]) -> list[FoundView]:
    """The views of frames that can be found."""
    return [view for frame in frames for view in frame.views]


def share(found: Sequence[bool]) -> float:
    """Part that is true; NaN of nothing."""
    return float(np.mean(found)) if len(found) else float("nan")


def quantiles(errors: Sequence[Float[np.ndarray, " _"]], *at: float) -> tuple[float, ...]:
    """Quantiles of all numbers that are not NaN; NaN of nothing."""
    numbers = np.concatenate([*errors, np.zeros(0)])
    numbers = numbers[np.isfinite(numbers)]
    return tuple(float(np.quantile(numbers, q)) if len(numbers) else float("nan") for q in at)


def paper_found(view: FoundView) -> bool:
    """Whether the paper's route found a view."""
    return bool(np.isfinite(view.paper_errors).all())


def _row(seen: list[FoundView]) -> tuple[float, ...]:
    return (
        len(seen),
        share([view.found for view in seen]),
        *quantiles([view.errors for view in seen], 0.5, 0.9),
        share([paper_found(view) for view in seen]),
        *quantiles([view.paper_errors for view in seen], 0.5, 0.9),
    )


_COLUMNS = [
    "views",
    "found",
    "corner_median_px",
    "corner_p90_px",
    "paper_found",
    "paper_corner_median_px",
    "paper_corner_p90_px",
]


def conditions(frames: list[Frame]) -> Table:
    """What was found at every exposure and severity."""
    rows = []
    for gain, severity in sorted({(frame.gain, frame.severity) for frame in frames}):
        own = of(frames, gain, severity)
        rows.append((gain, severity, len(own), *_row(all_views(own)), sum(f.wrong for f in own)))
    return Table(
        "conditions",
        "Complete views off the border that were found, and their corners, at every exposure and "
        "severity; beside it the paper's route with one fixed threshold",
        ["gain", "severity", "frames", *_COLUMNS, "wrongly_complete"],
        rows,
        {"found": 3, "paper_found": 3, "corner_median_px": 2, "corner_p90_px": 2},
    )


def views(frames: list[Frame]) -> Table:
    """What was found of every view."""
    seen = all_views(frames)
    kinds = sorted({(view.pad, view.path) for view in seen})
    rows = [
        (*kind, *_row([view for view in seen if (view.pad, view.path) == kind])) for kind in kinds
    ]
    return Table(
        "views",
        "The same for every view, over all conditions",
        ["pad", "path", *_COLUMNS],
        rows,
        {"found": 3, "paper_found": 3, "corner_median_px": 2, "corner_p90_px": 2},
    )


def unwarping(frames: list[Frame]) -> Table:
    """How far from its place an unwarped pad shows things."""
    every = [one for frame in frames for one in frame.unwarped]
    rows = []
    for pad in dict.fromkeys(one.pad for one in every):
        own = [one for one in every if one.pad == pad]
        rows.append(
            (
                pad,
                len(own),
                share([one.path != "direct" for one in own]),
                float(np.mean([one.errors for one in own])),
                *quantiles([one.errors for one in own], 0.9),
                float(np.mean([one.affine_errors for one in own])),
                *quantiles([one.affine_errors for one in own], 0.9),
            )
        )
    return Table(
        "unwarping",
        "Unwarped pads: distance of places from where they are, by rays and a homography, and by "
        "an affine map as in the paper",
        [
            "pad",
            "pads",
            "by_mirror",
            "mean_mm",
            "p90_mm",
            "affine_mean_mm",
            "affine_p90_mm",
        ],
        rows,
        {"mean_mm": 3, "p90_mm": 3, "by_mirror": 2},
    )


def rendering(times: list[EffectTime]) -> Table:
    """What every effect costs by itself."""
    base = times[0].seconds
    rows = [(spell_out(one.effect), 1e3 * one.seconds, 1e3 * (one.seconds - base)) for one in times]
    return Table(
        "rendering",
        "Rendering one frame without effects, with each alone, and with all of them",
        ["effect", "milliseconds", "more_than_none_ms"],
        rows,
        {"milliseconds": 1, "more_than_none_ms": 1},
    )


def corrupted(trials: list[Trial]) -> Table:
    """What became of frames that are no proper images."""
    rows = []
    for kind in dict.fromkeys(trial.kind for trial in trials):
        own = [trial for trial in trials if trial.kind == kind]
        rows.append(
            (
                kind,
                len(own),
                sum(bool(trial.crash) for trial in own),
                sum(trial.refused for trial in own),
                sum(trial.complete > 0 for trial in own),
                sum(trial.angles > 0 for trial in own),
                "refused" if kind in NO_IMAGE else "undefined" if kind in NO_FINGER else "any",
            )
        )
    return Table(
        "corrupted",
        "Frames that are no proper images: exceptions, frames refused as no images, frames with a "
        "view called complete, frames with a joint angle, and what was to come out",
        [
            "kind",
            "frames",
            "exceptions",
            "refused",
            "with_complete_views",
            "with_angles",
            "expected",
        ],
        rows,
    )
