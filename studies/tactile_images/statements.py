"""What the study says: findings in sentences, metrics with targets, a claim with evidence."""

from __future__ import annotations

import math
import statistics
from collections.abc import Sequence

import numpy as np

from designopt.study.results import Claim, Metric, PrecisionRow, Target
from studies.tactile_images.found import OURS, PAPER, Found
from studies.tactile_images.frames import Frame
from studies.tactile_images.spec import TactileImagesSpec
from studies.tactile_images.tables import all_views, of, paper_found, quantiles, share

FOUND, MEDIAN_PX, P90_PX, UNWARP_MM, DETECTION_MS = 0.95, 2.0, 5.0, 0.3, 100.0


def metrics(spec: TactileImagesSpec, found: Found) -> list[Metric]:
    """The study's numbers; targets belong to the stated finger, images and numbers of them."""
    default = TactileImagesSpec()
    sizes = {"fingers", "grid", "severities", "independent", "corrupted", "corrupted_rows",
             "sizes", "size_frames", "gains"}  # fmt: skip
    stated = spec.model_dump(exclude=sizes) == default.model_dump(exclude=sizes)
    made: list[Metric] = []

    def add(
        name: str, value: float, unit: str, description: str, target: Target | None = None
    ) -> None:
        made.append(Metric(name, value, unit, description, None, target if stated else None))

    at_severity = [frame for frame in found.frames if frame.severity == spec.severity]
    for gain in spec.gains:
        seen = all_views(of(at_severity, gain, spec.severity))
        add(
            f"found_at_gain_{gain:g}",
            share([view.found for view in seen]),
            "",
            f"part of {len(seen)} complete views off the border that were found, gain {gain:g}",
            Target(">=", FOUND),
        )
    if found.independent:
        seen = all_views(found.independent)
        add(
            "found_independent",
            share([view.found for view in seen]),
            "",
            f"part of {len(seen)} such views that were found in {len(found.independent)} frames "
            "whose effects have severities independent of each other",
            Target(">=", FOUND),
        )
    seen = all_views(at_severity)
    median, p90 = quantiles([view.errors for view in seen], 0.5, 0.9)
    add(
        "corner_median_px",
        median,
        "px",
        "median corner error of the views found",
        Target("<=", MEDIAN_PX),
    )
    add("corner_p90_px", p90, "px", "90th percentile of the same", Target("<=", P90_PX))
    add("paper_found", share([paper_found(view) for view in seen]), "", "part of the same views "
        "that the paper's route finds")  # fmt: skip
    paper = quantiles([view.paper_errors for view in seen], 0.5, 0.9)
    add("paper_corner_median_px", paper[0], "px", "median corner error of the views that it finds")
    add("paper_corner_p90_px", paper[1], "px", "90th percentile of the same")
    pads = [one for frame in at_severity for one in frame.unwarped]
    unwarped = quantiles([one.errors for one in pads], 0.9)[0]
    affine = quantiles([one.affine_errors for one in pads], 0.9)[0]
    add(
        "unwarp_p90_mm",
        unwarped,
        "mm",
        "90th percentile of the distance of places on unwarped pads from where they are",
        Target("<=", UNWARP_MM),
    )
    add("affine_unwarp_p90_mm", affine, "mm", "the same by an affine map, as in the paper")
    for name, scales, words in (
        ("view_scale_p10", [one.scale for one in pads], "chosen by its least scale"),
        ("area_view_scale_p10", [one.area_scale for one in pads], "chosen by its area"),
    ):
        value = float(np.quantile(scales, 0.1)) if scales else math.nan
        add(name, value, "px/mm", f"10th percentile of the least scale of a pad's view {words}")
    add(
        "detection_ms",
        1e3 * statistics.median(frame.seconds for frame in at_severity),
        "ms",
        "median time to find all views of a frame of "
        f"{found.finger.imaging.shape[1]} × {found.finger.imaging.shape[0]} px on one core",
        Target("<=", DETECTION_MS),
    )
    if found.trials:
        add(
            "corrupted_failures",
            sum(trial.failed for trial in found.trials),
            "",
            f"of {len(found.trials):,} corrupted frames, those with an exception, with a view or "
            "an angle where there is no finger, or refused though they are images, or the reverse",
            Target("<=", 0),
        )
    add("render_ms", 1e3 * found.times[-1].seconds, "ms", "rendering a frame with all effects")
    add("render_plain_ms", 1e3 * found.times[0].seconds, "ms", "rendering it with none")
    shown = sum(one.shown for one in at_severity)
    add("unwarped", len(pads) / max(shown, 1), "", f"pads unwarped, over the {shown} that some "
        "view shows whole; above 1 where a view too grazing to count was unwarped")  # fmt: skip
    return made


def findings(spec: TactileImagesSpec, found: Found) -> list[str]:
    """Plain sentences, most important first."""
    at_severity = [frame for frame in found.frames if frame.severity == spec.severity]
    seen = all_views(at_severity)
    ours = quantiles([view.errors for view in seen], 0.5, 0.9)
    paper = quantiles([view.paper_errors for view in seen], 0.5, 0.9)
    parts = [
        f"{100 * share([v.found for v in all_views(of(at_severity, gain, spec.severity))]):.1f} % "
        f"at gain {gain:g}"
        for gain in spec.gains
    ]
    lines = [
        f"Of {len(seen)} complete views off the border, on {spec.fingers} fingers with errors of "
        f"fabrication and something pressed into every pad, were found: {', '.join(parts)}. "
        f"Their corners are off by {ours[0]:.2f} px (median) and {ours[1]:.2f} px (90th "
        "percentile).",
        f"The paper's route with one fixed threshold found "
        f"{100 * share([paper_found(view) for view in seen]):.1f} % of them, its corners off by "
        f"{paper[0]:.1f} px and {paper[1]:.1f} px; and it does not say which view is which.",
    ]
    pads = [one for frame in at_severity for one in frame.unwarped]
    if pads:
        mean = np.mean(np.concatenate([one.errors for one in pads]))
        affine = np.mean(np.concatenate([one.affine_errors for one in pads]))
        lines.append(
            f"Unwarped by rays and a homography, places on a pad are off by {mean:.3f} mm on "
            f"average, by an affine map by {affine:.1f} mm."
        )
    lines += _severities(spec, found.frames)
    if found.independent:
        each = [view.found for view in all_views(found.independent)]
        lines.append(
            f"In {len(found.independent)} frames of as many fingers, whose effects have severities "
            "independent of each other (0 to 2, each off in one case of five), "
            f"{100 * share(each):.1f} % of {len(each)} views were found, and "
            f"{sum(frame.wrong for frame in found.independent)} were called complete that are not."
        )
    wrong = sum(frame.wrong for frame in at_severity)
    complete = sum(view.found for view in seen)
    lines.append(f"{wrong} views were called complete that are not, beside {complete} that are.")
    if found.trials:
        crashes = sum(bool(trial.crash) for trial in found.trials)
        failed = sum(trial.failed for trial in found.trials)
        lines.append(
            f"{len(found.trials):,} corrupted frames, of {len({t.kind for t in found.trials})} "
            f"kinds, ended in {crashes} exceptions; {sum(t.refused for t in found.trials)} were "
            f"refused as no images. {failed} have another answer than the one defined for them."
        )
    return lines


def _severities(spec: TactileImagesSpec, frames: list[Frame]) -> list[str]:
    others = [severity for severity in spec.severities if severity != spec.severity]
    if not others:
        return []
    parts = [
        f"{100 * share([v.found for v in all_views(of(frames, 1.0, severity))]):.1f} % at "
        f"severity {severity:g}"
        for severity in sorted(others)
    ]
    return [f"At other severities, gain 1, were found: {', '.join(parts)}."]


def claim(rows: Sequence[PrecisionRow]) -> Claim:
    """Lines in ray space against polygons, at every image size."""
    sizes = list(dict.fromkeys(row.setting for row in rows))
    evidence, holds = [], True
    for size in sizes:
        own = {row.method: row for row in rows if row.setting == size}
        ours, paper = own[OURS], own[PAPER]
        holds &= ours.error < paper.error
        evidence.append(
            f"{size}: {ours.error:.2f} px in {1e3 * ours.seconds:.0f} ms a frame, the paper's "
            f"route {paper.error:.2f} px in {1e3 * paper.seconds:.0f} ms."
        )
    return Claim(
        "Lines fitted in ray space find corners closer than a polygon around a mask, at every "
        "image size.",
        "Straight sides of a pad are straight in the tangent plane of its rays, a line through "
        "many edge places averages their noise, and round corners play no part; a polygon's "
        "corners are those of a mask's rounded outline.",
        evidence,
        holds and bool(evidence),
    )
