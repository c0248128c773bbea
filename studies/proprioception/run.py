"""The study itself: from its spec to its results."""

from __future__ import annotations

import math
import statistics
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import jax
import numpy as np
from matplotlib.figure import Figure

from designopt.errors import UserError
from designopt.plot.figures import PALETTE, angle_ticks, new_figure
from designopt.plot.typesetting import drawn_name
from designopt.study import plots
from designopt.study.records import Records
from designopt.study.report import Report
from designopt.study.results import PrecisionRow, Results
from designopt.study.study import Context
from optics.rendering import Effects
from optics.scene.fabrication import name_fabrication_errors
from perception.proprioception import GapTable
from studies.models.sensor.estimators import gap_table
from studies.models.sensor.finger_sensor import FingerSensor
from studies.proprioception import ProprioceptionSpec
from studies.proprioception import methods as by
from studies.proprioception.frames import FingerFrames, render_finger

PAPER = {"pip": (2.3, 1.6), "dip": (2.5, 2.0)}
"""Paper B, Table 4.1: mean ± standard deviation of the absolute error over 30 frames, degrees."""

MORE_TIME = 1.25
"""All corners take at most so many times as long as the gap."""

BIN_DEG = 10.0


def run(spec: ProprioceptionSpec, context: Context) -> Results:
    """Render fingers with sampled errors, estimate their joint angles with every method.

    Raises:
        UserError: the scene cannot be read, its joints have no gap, or another float type than
            float64.
    """
    context.require_float64("proprioception solves for angles to 1e-9")
    out = Report(spec, package=__package__)
    deviation = math.radians(spec.label_deviation_deg)
    with context.step("The finger, its views and its gaps"):
        finger = FingerSensor.of(spec)
        estimators = by.Estimators.of(finger, find_gaps(finger), deviation)
    fingers: list[tuple[FingerFrames, by.FingerEstimates]] = []
    for number in range(spec.fingers):
        with context.step(f"Finger {number + 1} of {spec.fingers}"):
            seen = _render(spec, estimators, number, context.seed)
            fingers.append((seen, estimators.estimate(seen)))
    with context.step("The gap without images"):
        for number in range(spec.gap_fingers):
            estimators.estimate_gap_alone(
                number,
                frames=spec.frames,
                labelled=spec.labelled,
                noise=spec.pixel_noise,
                seed=context.seed,
            )
    for number in range(min(spec.cost_fingers, spec.fingers)):
        with context.step(f"Finger {number + 1} with smooth edges"):
            estimators.estimate_smooth(_render(spec, estimators, number, context.seed, smooth=True))
    rows: list[PrecisionRow] = []
    for size in spec.sizes:
        with context.step(f"Images {size} px high"):
            rows += _measure_size(spec, size, context.seed)
    claim = out.claim("corners", *compare_sizes(rows), more_time=MORE_TIME)
    out.precision(rows, "mean absolute error (°)", "the joint angles that were rendered", claim)
    errors = estimators.records
    add_metrics(out, errors, fingers)
    add_findings(out, errors, estimators.gaps, finger)
    add_tables(out, errors, estimators, fingers)
    add_figures(out, errors, estimators, *fingers[0])
    return out.results()


def find_gaps(finger: FingerSensor) -> list[GapTable]:
    """The gap of every joint, in the joints' order.

    Raises:
        UserError: a joint has none.
    """
    by_joint: dict[int, GapTable] = {}
    cure = "give the scene of a finger with --set scene=FILE"
    for (pad, path), joint in zip(finger.model.views, finger.model.joints, strict=True):
        if joint is not None and path != "direct":
            try:
                by_joint[joint] = gap_table(finger.scene, finger.catalog, pad)
            except ValueError as error:
                needed = "the gap needs both of every pad that moves"
                raise UserError(f"scene: {error}; {needed}: {cure}") from error
    missing = [name for j, name in enumerate(finger.model.names) if j not in by_joint]
    if missing:
        raise UserError(
            f"scene: no mirror shows a pad that {', '.join(missing)} moves, so it has no gap; "
            + cure
        )
    return [by_joint[joint] for joint in range(len(finger.model.names))]


def _render(
    spec: ProprioceptionSpec,
    estimators: by.Estimators,
    number: int,
    seed: int,
    *,
    smooth: bool = False,
    frames: int | None = None,
) -> FingerFrames:
    effects = Effects.graded(spec.severity)
    return render_finger(
        estimators.finger,
        estimators.gaps,
        replace(effects, roughness=0.0, rounding=0.0) if smooth else effects,
        number=number,
        seed=seed,
        frames=frames or spec.frames,
        labelled=spec.labelled,
        label_deviation=estimators.label_deviation,
        range_deg=spec.range_deg,
    )


def _measure_size(spec: ProprioceptionSpec, size: int, seed: int) -> list[PrecisionRow]:
    """Error and run time of the methods over images of one size."""
    finger = FingerSensor.of(spec, size)
    deviation = math.radians(spec.label_deviation_deg)
    estimators = by.Estimators.of(finger, find_gaps(finger), deviation)
    finding, solving = [], []
    for number in range(spec.size_fingers):
        seen = _render(spec, estimators, number, seed, frames=spec.size_frames)
        solving += estimators.estimate(seen).seconds
        finding += seen.frames.seconds
    rows = []
    for method in by.METHODS:
        # Gap and edge are arithmetic on a few corners.
        added = 0.0 if method in (by.GAP, by.EDGE) else statistics.median(solving)
        seconds = [one + added for one in finding]
        error = estimators.records.where(method=method).stat("mean_abs error_deg")
        if math.isfinite(error):
            setting = "{1} × {0} px".format(*finger.imaging.shape)
            panel = "finding the views and the joint angles of a frame"
            times = statistics.median(seconds), min(seconds), max(seconds)
            rows.append(PrecisionRow(method, setting, panel, error, *times, 0.0))
    return rows


def compare_sizes(rows: Sequence[PrecisionRow]) -> tuple[list[str], bool]:
    """All corners against the gap at every image size, and whether they are better."""
    evidence, holds = [], True
    for size in dict.fromkeys(row.setting for row in rows):
        own = {row.method: row for row in rows if row.setting == size}
        if by.GAP not in own or by.LABELLED not in own:
            continue
        gap, corners = own[by.GAP], own[by.LABELLED]
        holds &= corners.error < gap.error and corners.seconds < MORE_TIME * gap.seconds
        evidence.append(
            f"{size}: all corners {corners.error:.2f}° in {1e3 * corners.seconds:.0f} ms a frame, "
            f"the gap, where there is one, {gap.error:.2f}° in {1e3 * gap.seconds:.0f} ms."
        )
    return evidence, holds and bool(evidence)


def variance_over_predicted(own: Records) -> float:
    """Mean squared error over mean predicted variance, of the estimates that are defined."""
    return (own.stat("rms error_deg") / own.stat("rms deviation_deg")) ** 2


def edge_costs(errors: Records) -> list[float]:
    """By finger, what rough edges add to the mean error of the labelled calibration, degrees."""
    rough = errors.where(method=by.LABELLED).group("finger")
    costs = [
        rough[finger].stat("mean_abs error_deg") - own.stat("mean_abs error_deg")
        for finger, own in errors.where(method=by.SMOOTH).group("finger").items()
    ]
    return [cost for cost in costs if math.isfinite(cost)]


def add_metrics(
    out: Report, errors: Records, fingers: Sequence[tuple[FingerFrames, by.FingerEstimates]]
) -> None:
    """The study's numbers."""
    of = errors.group("method")
    mean = {method: own.stat("mean_abs error_deg") for method, own in of.items()}
    labelled, unlabelled, costs = of[by.LABELLED], of[by.UNLABELLED], edge_costs(errors)
    bounded = labelled.where(np.isfinite(labelled["error_deg"]))
    finding = [seconds for one, _ in fingers for seconds in one.frames.seconds]
    solving = [seconds for _, one in fingers for seconds in one.seconds]
    out.metrics(
        gap_mean_deg=mean[by.GAP_ALONE],
        gap_mean_of=of[by.GAP_ALONE].stat("defined error_deg"),
        labelled_defined=labelled.stat("defined error_deg"),
        labelled_mean_deg=mean[by.LABELLED],
        labelled_p95_deg=labelled.stat("p95_abs error_deg"),
        unlabelled_mean_deg=mean[by.UNLABELLED],
        same_unlabelled_mean_deg=mean[by.SAME_UNLABELLED],
        unlabelled_over_labelled=mean[by.UNLABELLED] / mean[by.LABELLED],
        labelled_variance_over_predicted=variance_over_predicted(labelled),
        unlabelled_variance_over_predicted=variance_over_predicted(unlabelled),
        image_gap_mean_deg=mean[by.GAP],
        edge_mean_deg=mean[by.EDGE],
        designed_mean_deg=mean[by.DESIGNED],
        known_finger_mean_deg=mean[by.EXACT],
        gap_defined=of[by.GAP].stat("defined error_deg"),
        bound_rms_deg=bounded.stat("rms bound_deg"),
        bound_known_rms_deg=bounded.stat("rms bound_known_deg"),
        labelled_rms_deg=labelled.stat("rms error_deg"),
        lens_cost_deg=mean[by.LENS_AS_DESIGNED] - mean[by.LABELLED],
        detection_ms=1e3 * statistics.median(finding),
        solve_ms=1e3 * statistics.median(solving),
    )
    if by.SMOOTH in of:
        out.metrics(edge_cost_deg=statistics.mean(costs) if costs else math.nan)
    if len(costs) > 1:
        out.metrics(edge_cost_error_deg=statistics.stdev(costs) / math.sqrt(len(costs)))


def add_findings(
    out: Report, errors: Records, gaps: Sequence[GapTable], finger: FingerSensor
) -> None:
    """Plain sentences, most important first."""
    out.say("labelled", count=out["fingers"] * out["frames"])
    pixels = float(finger.scene.camera.focal_pixels) * math.pi / 180
    ends = [table.angles[[0, -1]] for table in gaps]
    rates = [
        pixels * abs(float(np.interp(end.mean(), table.angles, table.rate)))
        for end, table in zip(ends, gaps, strict=True)
    ]
    out.say("gap", least=min(rates), most=max(rates))
    ranges = [
        "{}: {:.0f}° to {:.0f}°".format(table.pad, *np.rad2deg(end))
        for end, table in zip(ends, gaps, strict=True)
    ]
    either = errors.where(method=by.GAP_THEN_EDGE).stat("defined error_deg")
    out.say("no-gap", ranges=", ".join(ranges), either=either, twice=2 * out["labelled"])
    for name in ("edge", "designed", "bound", "lens"):
        out.say(name)
    if len(costs := edge_costs(errors)) > 1:
        out.say("edges", cost_fingers=len(costs))
    if out["labelled_defined"] < 1:
        out.say("undefined", missing=1 - out["labelled_defined"])


def add_tables(
    out: Report,
    errors: Records,
    estimators: by.Estimators,
    fingers: Sequence[tuple[FingerFrames, by.FingerEstimates]],
) -> None:
    """Every method beside the paper's Table 4.1, why answers are undefined, gaps, tolerances."""
    finger, names = estimators.finger, estimators.finger.model.names
    known = [name for name in names if name in PAPER]
    table = errors.summary(
        "method",
        "joint",
        frames="count error_deg",
        defined="defined error_deg",
        mean_deg="mean_abs error_deg",
        sd_deg="sd_abs error_deg",
        bias_deg="mean error_deg",
        p95_deg="p95_abs error_deg",
        predicted_deg="rms deviation_deg",
        variance_over_predicted=variance_over_predicted,
    )
    ladder = Records(
        {
            **dict.fromkeys(table.keys(), math.nan),
            "method": "paper B, Table 4.1",
            "joint": known,
            "frames": 30,
            "mean_deg": [PAPER[name][0] for name in known],
            "sd_deg": [PAPER[name][1] for name in known],
        }
    )
    ladder.add(**table)
    out.table("ladder", ladder)
    undefined = errors.where(~np.isfinite(errors["error_deg"]))
    out.table("undefined", undefined.summary("method", "reason", answers="count error_deg"))
    gaps, pixels = Records(), float(finger.scene.camera.focal_pixels)
    for joint, one in zip(names, estimators.gaps, strict=True):
        gaps.add(
            joint=joint,
            pad=one.pad,
            mirror=one.mirror,
            angle_deg=np.rad2deg(one.angles),
            gap_deg=np.rad2deg(one.gaps),
            gap_px=pixels * one.gaps,
            px_per_deg=pixels * np.deg2rad(one.rate),
        )
    out.table("gaps", gaps)
    sizes = np.concatenate([np.ravel(leaf) for leaf in jax.tree.leaves(finger.deviations)])
    true = np.stack([one.errors for one, _ in fingers])
    columns: dict[str, Any] = {
        "error": name_fabrication_errors(finger.scene.layout, finger.deviations),
        "stated": sizes,
    }
    for name in ("labelled", "unlabelled"):
        calibrated = [getattr(one, name).value.errors for _, one in fingers]
        left = np.stack([one.mean for one in calibrated]) - true
        predicted = np.stack([np.diagonal(one.covariance)[: true.shape[1]] for one in calibrated])
        columns[f"left_{name}"] = sizes * np.sqrt(np.mean(left**2, axis=0))
        columns[f"predicted_{name}"] = sizes * np.sqrt(predicted.mean(axis=0))
    out.table("tolerances", **columns)


def add_figures(
    out: Report,
    errors: Records,
    estimators: by.Estimators,
    seen: FingerFrames,
    found: by.FingerEstimates,
) -> None:
    """Errors of all methods, over the joints' ranges, the gap, the bound, the deviations."""
    usual = errors.where(method=by.METHODS)
    absolute = {"error_deg": "absolute error (°)"}
    marks = {f"paper B, mean, {joint.upper()}": mean for joint, (mean, _) in PAPER.items()}
    drawing = plots.ecdf(
        usual, "error_deg", by="method", marks=marks, log="x", least=1e-3, names=absolute
    )
    drawing.axes[0].set_xlim(left=5e-3)
    drawing.axes[0].set_ylabel("part of the defined answers (%)")
    out.figure("ladder", drawing)
    drawing = plots.lines(
        usual, "angle_deg", "error_deg", by="method", panel="joint", step=BIN_DEG,
        stat="mean_abs", log="y", names={"error_deg": "mean absolute error (°)"},
    )  # fmt: skip
    for axes, table in zip(drawing.axes, estimators.gaps, strict=True):
        low, high = np.rad2deg(table.angles[[0, -1]])
        left, right = axes.get_xlim()
        axes.axvspan(left, low, color="0.9", zorder=0)
        axes.axvspan(high, right, color="0.9", zorder=0, label="no gap (finger as designed)")
        axes.set_xlim(left, right)
    out.figure("range", drawing, bin_deg=BIN_DEG)
    out.figure("gap", draw_gaps(estimators, seen, found), most=4)
    labelled = errors.where(method=by.LABELLED)
    labelled = labelled.where(np.isfinite(labelled["error_deg"]))
    both = Records()
    for series, column in (("reached", "error_deg"), ("Cramér–Rao bound", "bound_deg")):
        both.add(
            series=f"{series}, root mean square",
            joint=labelled["joint"],
            angle_deg=labelled["angle_deg"],
            error_deg=np.abs(labelled[column]),
        )
    drawing = plots.lines(
        both, "angle_deg", "error_deg", by="series", panel="joint", step=BIN_DEG,
        stat="rms", log="y", names={"error_deg": "error, labelled calibration (°)"},
    )  # fmt: skip
    for axes, own in zip(drawing.axes, labelled.group("joint").values(), strict=True):
        sizes = np.maximum(np.abs(own["error_deg"]), 1e-3)
        axes.plot(
            own["angle_deg"], sizes, ".", color="0.6", markersize=3, zorder=1, label="one frame"
        )
    out.figure("bound", drawing)
    out.figure("covariance", plots.qq(usual, "error_deg", "deviation_deg", by="method"))


def draw_gaps(estimators: by.Estimators, seen: FingerFrames, found: by.FingerEstimates) -> Figure:
    """The gap by the optics, and as measured on one finger before and after calibration."""
    gaps = estimators.gaps
    drawing, [row] = new_figure(1, len(gaps), height=3.0)
    kinds = (
        ("labelled frames", seen.in_gap, "s", PALETTE[2]),
        ("other frames", seen.frames, "o", "none"),
    )
    for joint, (axes, table) in enumerate(zip(row, gaps, strict=True)):
        angles, gap = np.rad2deg(table.angles), found.gaps[joint]
        axes.plot(angles, np.rad2deg(table.gaps), color=PALETTE[0], label="optics, as designed")
        if gap is not None:
            calibrated = np.rad2deg(gap.offset + gap.scale * table.gaps)
            axes.plot(angles, calibrated, "--", color=PALETTE[1], label="calibrated")
        for label, frames, marker, face in kinds:
            measured = np.rad2deg([table.measured(one) for one in frames.sightings])
            axes.plot(
                np.rad2deg(frames.angles[:, joint]), measured, marker, color=PALETTE[2],
                markerfacecolor=face, label=label,
            )  # fmt: skip
        name = estimators.finger.model.names[joint].upper()
        axes.set(title=drawn_name(f"{table.pad} pad"), xlabel=drawn_name(f"{name} (°)"))
        axes.set_xticks(angle_ticks(float(np.rad2deg(seen.frames.angles.max())), 6))
    row[0].set_ylabel("gap, section angle (°)")
    return drawing
