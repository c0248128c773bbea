"""The study itself: from its spec to its results."""

from __future__ import annotations

import math
import statistics
from collections.abc import Sequence
from functools import partial
from typing import Any

import jax
import numpy as np
from matplotlib.figure import Figure

from designopt import Context, PrecisionRow, Records, Report, Results
from designopt.plot.figures import PALETTE, angle_ticks, label_plainly, new_figure
from designopt.plot.typesetting import drawn_name
from designopt.study import plots
from optics.scene.fabrication import name_fabrication_errors
from perception.proprioception import GapTable
from studies.models.sensor.finger_sensor import FingerSensor
from studies.models.sensor.sizes import compare_at_sizes
from studies.proprioception import ProprioceptionSpec
from studies.proprioception import methods as by
from studies.proprioception.frames import FingerFrames, ranges, render_finger

PAPER = {"pip": (2.3, 1.6), "dip": (2.5, 2.0)}
"""Paper B, Table 4.1: mean ± standard deviation of the absolute error over 30 frames, degrees."""

MORE_TIME = 1.25
"""All corners take at most so many times as long as the gap."""

AT_SIZE = """{size}: all corners {ours.error:.2f}° in {ours_ms:.0f} ms a frame, the gap, where there
is one, {other.error:.2f}° in {other_ms:.0f} ms."""

BIN_DEG = 10.0

LEAST_DEG = 1e-3
"""Smaller errors are drawn there."""

Fingers = Sequence[tuple[FingerFrames, by.FingerEstimates]]


def run(spec: ProprioceptionSpec, context: Context) -> Results:
    """Render fingers with sampled errors, estimate their joint angles with every method.

    Raises:
        UserError: the scene cannot be read, its joints have no gap, or another float type than
            float64.
    """
    context.require_float64("proprioception solves for angles to 1e-9")
    out, seed = Report(spec, package=__package__), context.seed
    with context.step("The finger, its views and its gaps"):
        estimators = by.Estimators.of(spec)
        finger, gaps = estimators.finger, estimators.gaps
    with context.step("The gap without images"):
        for number in range(spec.gap_fingers):
            estimators.estimate_gap_alone(number, spec, seed)
    fingers: list[tuple[FingerFrames, by.FingerEstimates]] = []
    for number in context.each(range(spec.fingers), lambda number: f"Finger {number + 1}"):
        seen = render_finger(finger, gaps, spec, number, seed)
        fingers.append((seen, estimators.estimate(seen)))
    smooth = range(min(spec.cost_fingers, spec.fingers))
    for number in context.each(smooth, lambda number: f"Finger {number + 1} with smooth edges"):
        seen = render_finger(finger, gaps, spec, number, seed, smooth=True)
        estimators.estimate_smooth(seen)
    rows: list[PrecisionRow] = []
    for size in context.each(spec.sizes, lambda size: f"Images {size} px high"):
        rows += _measure_size(spec, size, seed)
    shown = compare_at_sizes(rows, by.LABELLED, by.GAP, AT_SIZE, MORE_TIME)
    claim = out.claim("corners", *shown, more_time=MORE_TIME)
    out.precision(rows, "mean absolute error (°)", "the joint angles that were rendered", claim)
    errors = estimators.records
    add_metrics(out, errors, fingers)
    add_findings(out, errors, gaps, finger)
    add_tables(out, estimators, fingers)
    add_figures(out, estimators, *fingers[0])
    return out.results()


def _measure_size(spec: ProprioceptionSpec, size: int, seed: int) -> list[PrecisionRow]:
    """Error and run time of the methods over images of one size."""
    estimators = by.Estimators.of(spec, size)
    few = spec.model_copy(update={"frames": spec.size_frames})
    finding, solving, rows = [], [], []
    for number in range(spec.size_fingers):
        seen = render_finger(estimators.finger, estimators.gaps, few, number, seed)
        solving += estimators.estimate(seen).seconds
        finding += seen.frames.seconds
    for method in by.METHODS:
        # Gap and edge are arithmetic on a few corners.
        added = 0.0 if method in (by.GAP, by.EDGE) else statistics.median(solving)
        seconds = [one + added for one in finding]
        error = estimators.records.where(method=method).stat("mean_abs error_deg")
        if math.isfinite(error):
            at = estimators.finger.image_size, "finding the views and the joint angles of a frame"
            times = statistics.median(seconds), min(seconds), max(seconds)
            rows.append(PrecisionRow(method, *at, error, *times, 0.0))
    return rows


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


def add_metrics(out: Report, errors: Records, fingers: Fingers) -> None:
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


def add_findings(out: Report, errors: Records, gaps: list[GapTable], finger: FingerSensor) -> None:
    """Plain sentences, most important first."""
    out.say("labelled", count=out["fingers"] * out["frames"])
    pixels = float(finger.scene.camera.focal_pixels) * math.pi / 180
    rates, ends = [], []
    for table, (low, high) in zip(gaps, ranges(gaps), strict=True):
        rate = float(np.interp((low + high) / 2, table.angles, table.rate))
        rates.append(pixels * abs(rate))
        ends.append(f"{table.pad}: {math.degrees(low):.0f}° to {math.degrees(high):.0f}°")
    out.say("gap", least=min(rates), most=max(rates))
    either = errors.where(method=by.GAP_THEN_EDGE).stat("defined error_deg")
    out.say("no-gap", ranges=", ".join(ends), either=either, twice=2 * out["labelled"])
    for name in ("edge", "designed", "bound", "lens"):
        out.say(name)
    if len(costs := edge_costs(errors)) > 1:
        out.say("edges", cost_fingers=len(costs))
    elif costs:
        out.say("edges-one")
    if out["labelled_defined"] < 1:
        out.say("undefined", missing=1 - out["labelled_defined"])


def add_tables(out: Report, estimators: by.Estimators, fingers: Fingers) -> None:
    """Every method beside the paper's Table 4.1, why answers are undefined, gaps, tolerances."""
    finger, errors = estimators.finger, estimators.records
    names, pixels = finger.model.names, float(finger.scene.camera.focal_pixels)
    statistics_of = {"mean": "mean_abs", "sd": "sd_abs", "bias": "mean", "p95": "p95_abs"}
    table = errors.summary(
        *("method", "joint"),
        frames="count error_deg",
        defined="defined error_deg",
        **{f"{name}_deg": f"{what} error_deg" for name, what in statistics_of.items()},
        predicted_deg="rms deviation_deg",
        variance_over_predicted=variance_over_predicted,
    )
    joints = [name for name in names if name in PAPER]
    means, deviations = ([PAPER[name][i] for name in joints] for i in range(2))
    paper = {"method": "paper B, Table 4.1", "joint": joints, "frames": 30}
    paper |= {"mean_deg": means, "sd_deg": deviations}
    ladder = Records({**dict.fromkeys(table.keys(), math.nan), **paper})
    ladder.add(**table)
    out.table("ladder", ladder)
    undefined = errors.where(~np.isfinite(errors["error_deg"]))
    out.table("undefined", undefined.summary("method", "reason", answers="count error_deg"))
    gaps = Records()
    for joint, one in zip(names, estimators.gaps, strict=True):
        name = {"joint": joint, "pad": one.pad, "mirror": one.mirror}
        angles = {"angle_deg": np.rad2deg(one.angles), "gap_deg": np.rad2deg(one.gaps)}
        lengths = {"gap_px": pixels * one.gaps, "px_per_deg": pixels * np.deg2rad(one.rate)}
        gaps.add(**name, **angles, **lengths)
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
    out: Report, estimators: by.Estimators, seen: FingerFrames, found: by.FingerEstimates
) -> None:
    """Errors of all methods, over the joints' ranges, the gap, the bound, the deviations."""
    usual = estimators.records.where(method=by.METHODS)
    absolute = {"error_deg": "absolute error (°)"}
    marks = {f"paper B, mean, {joint.upper()}": mean for joint, (mean, _) in PAPER.items()}
    drawing = plots.ecdf(
        usual, "error_deg", by="method", marks=marks, log="x", least=1e-3, names=absolute
    )
    drawing.axes[0].set_xlim(left=5e-3)
    drawing.axes[0].set_ylabel("part of the defined answers (%)")
    out.figure("ladder", drawing)
    over_range = partial(
        plots.lines, x="angle_deg", y="error_deg", panel="joint", step=BIN_DEG, log="y"
    )
    name = {"error_deg": "mean absolute error (°)"}
    drawing = over_range(usual, by="method", stat="mean_abs", names=name)
    for axes, (low, high) in zip(
        drawing.axes, np.rad2deg(np.array(ranges(estimators.gaps))), strict=True
    ):
        left, right = axes.get_xlim()
        axes.axvspan(left, low, color="0.9", zorder=0)
        axes.axvspan(high, right, color="0.9", zorder=0, label="no gap (finger as designed)")
        axes.set_xlim(left, right)
    out.figure("range", drawing, bin_deg=BIN_DEG)
    out.figure("gap", draw_gaps(estimators, seen, found), most=4)
    labelled, both = usual.where(method=by.LABELLED), Records()
    labelled = labelled.where(np.isfinite(labelled["error_deg"]))
    for series, column in (("reached", "error_deg"), ("Cramér–Rao bound", "bound_deg")):
        drawn = {"series": f"{series}, root mean square", "error_deg": np.abs(labelled[column])}
        both.add(**(labelled | drawn))
    name = {"error_deg": "error, labelled calibration (°)"}
    drawing = over_range(both, by="series", stat="rms", names=name)
    for axes, own in zip(drawing.axes, labelled.group("joint").values(), strict=True):
        sizes = np.maximum(np.abs(own["error_deg"]), LEAST_DEG)
        dots = {"color": "0.6", "markersize": 3, "zorder": 1, "label": "one frame"}
        axes.plot(own["angle_deg"], sizes, ".", **dots)
        axes.set_ylim(LEAST_DEG / 1.5, 1.5 * np.max(np.abs(labelled["error_deg"])))
        label_plainly(axes.yaxis)
    out.figure("bound", drawing)
    out.figure("covariance", plots.qq(usual, "error_deg", "deviation_deg", by="method"))


def draw_gaps(estimators: by.Estimators, seen: FingerFrames, found: by.FingerEstimates) -> Figure:
    """The gap by the optics, and as measured on one finger before and after calibration."""
    gaps = estimators.gaps
    drawing, [row] = new_figure(1, len(gaps), height=3.0)
    shown = seen.in_gap, seen.frames
    kinds = [("labelled frames", "s", PALETTE[2]), ("other frames", "o", "none")]
    for joint, (axes, table) in enumerate(zip(row, gaps, strict=True)):
        angles, gap = np.rad2deg(table.angles), found.gaps[joint]
        axes.plot(angles, np.rad2deg(table.gaps), color=PALETTE[0], label="optics, as designed")
        if gap is not None:
            calibrated = np.rad2deg(gap.offset + gap.scale * table.gaps)
            axes.plot(angles, calibrated, "--", color=PALETTE[1], label="calibrated")
        for frames, (label, marker, face) in zip(shown, kinds, strict=True):
            measured = np.rad2deg([table.measured(one) for one in frames.sightings])
            style = {"color": PALETTE[2], "markerfacecolor": face, "label": label}
            axes.plot(np.rad2deg(frames.angles[:, joint]), measured, marker, **style)
        name = estimators.finger.model.names[joint].upper()
        axes.set(title=drawn_name(f"{table.pad} pad"), xlabel=drawn_name(f"{name} (°)"))
        axes.set_xticks(angle_ticks(float(np.rad2deg(seen.frames.angles.max())), 6))
    row[0].set_ylabel("gap, section angle (°)")
    return drawing
