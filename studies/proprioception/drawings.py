"""The study's figures."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from scipy import stats

from designopt.plot.figures import (
    MARKERS,
    PALETTE,
    angle_ticks,
    label_plainly,
    legend_below,
    new_figure,
)
from designopt.plot.typesetting import drawn_name
from designopt.study.results import Figure
from studies.proprioception.found import Found
from studies.proprioception.ladder import (
    LABELLED,
    RUNGS,
    errors_deg,
    of_method,
)
from studies.proprioception.tables import PAPER

DASHES = ("-", "--", "-.", ":", (0, (5, 1, 1, 1)))
BIN_DEG = 10.0
TICK_DEG = 15.0


def figures(found: Found) -> list[Figure]:
    """Every figure of the study."""
    return [
        ladder_figure(found),
        range_figure(found),
        gap_figure(found),
        bound_figure(found),
        covariance_figure(found),
    ]


def ladder_figure(found: Found) -> Figure:
    """Distribution of errors by method."""
    drawing, ((axes,),) = new_figure(1, 1, height=3.4)
    for index, method in enumerate(RUNGS):
        sizes = np.sort(np.abs(errors_deg(of_method(found.answers, method))))
        if len(sizes):
            parts = 100 * (np.arange(len(sizes)) + 1) / len(sizes)
            axes.plot(np.maximum(sizes, 1e-3), parts, color=PALETTE[index], label=method,
                      linestyle=DASHES[index])  # fmt: skip
    for joint, (mean, _) in PAPER.items():
        axes.axvline(mean, color="0.4", linewidth=1, linestyle=":" if joint == "pip" else "-.",
                     label=f"paper B, mean, {joint.upper()}")  # fmt: skip
    axes.set(xscale="log", ylim=(0, 101), xlabel="absolute error (°)",
             ylabel="part of the defined answers (%)")  # fmt: skip
    axes.set_xlim(left=5e-3)
    label_plainly(axes.xaxis)
    legend_below(drawing)
    return Figure(
        "ladder",
        "Errors of all methods",
        "From rendered images, finding the views included; both joints. Methods differ in how "
        "many angles they define at all (see the table).",
        drawing,
    )


def range_figure(found: Found) -> Figure:
    """Error over the joint's range, and where the gap is undefined."""
    names = found.finger.model.names
    drawing, (row,) = new_figure(1, len(names), height=3.2)
    for axes, name, table in zip(row, names, found.tables, strict=True):
        low, high = math.degrees(table.angles[0]), math.degrees(table.angles[-1])
        left, right = _angle_axis(axes, found)
        axes.axvspan(left, low, color="0.9", zorder=0)
        axes.axvspan(high, right, color="0.9", zorder=0, label="no gap (finger as designed)")
        for index, method in enumerate(RUNGS):
            own = of_method(found.answers, method, name)
            angles = np.rad2deg([answer.truth for answer in own])
            errors = np.abs(np.rad2deg([answer.error for answer in own]))
            axes.plot(*_binned(angles, errors, np.mean), color=PALETTE[index],
                      marker=MARKERS[index], linestyle=DASHES[index], label=method)  # fmt: skip
        axes.set(yscale="log", title=drawn_name(name.upper()), xlabel="joint angle (°)")
    _share_log_ordinate(row)
    row[0].set_ylabel("mean absolute error (°)")
    legend_below(drawing)
    return Figure(
        "range",
        "Errors over the joints' ranges",
        f"Mean over {BIN_DEG:g}° of the joint angle. Where a finger's own errors let it see both "
        "facing ends a little beyond the table, the answer is still undefined.",
        drawing,
    )


def gap_figure(found: Found) -> Figure:
    """The gap by the optics, and as measured on one finger before and after calibration."""
    drawing, (row,) = new_figure(1, len(found.tables), height=3.0)
    seen, climbed = found.watched[0], found.climbed[0]
    for joint, (axes, table) in enumerate(zip(row, found.tables, strict=True)):
        angles = np.rad2deg(table.angles)
        axes.plot(angles, np.rad2deg(table.gaps), color=PALETTE[0], label="optics, as designed")
        meter = climbed.meters[joint]
        if meter is not None:
            calibrated = meter.offset + meter.scale * table.gaps
            axes.plot(angles, np.rad2deg(calibrated), "--", color=PALETTE[1], label="calibrated")
        for frames, marker, name in ((seen.in_gap, "s", "labelled frames"),
                                     (seen.frames, "o", "other frames")):  # fmt: skip
            gaps = np.rad2deg([table.measured(one) for one in frames.sightings])
            axes.plot(np.rad2deg(frames.angles[:, joint]), gaps, marker, color=PALETTE[2],
                      markerfacecolor="none" if marker == "o" else None, label=name)  # fmt: skip
        name = found.finger.model.names[joint].upper()
        axes.set(title=drawn_name(f"{table.pad} pad"), xlabel=drawn_name(f"{name} (°)"))
        _angle_axis(axes, found)
    row[0].set_ylabel("gap, section angle (°)")
    legend_below(drawing, most=4)
    return Figure(
        "gap",
        "The gap and its calibration",
        "The section angle between facing ends of a pad's direct view and its mirror view, on the "
        "first made finger. Outside of the curve there is no gap.",
        drawing,
    )


def bound_figure(found: Found) -> Figure:
    """What was reached, and what the images allow, over the joint angle."""
    names = found.finger.model.names
    drawing, (row,) = new_figure(1, len(names), height=3.0)
    for joint, (axes, name) in enumerate(zip(row, names, strict=True)):
        own = [(one, of_method(one.answers, LABELLED, name)) for one in found.climbed]
        told = [(a, one.bound.calibrated[a.frame, joint]) for one, answers in own for a in answers
                if a.estimate.defined]  # fmt: skip
        angles = np.rad2deg([a.truth for a, _ in told])
        errors = np.abs(np.rad2deg([a.error for a, _ in told]))
        bounds = np.rad2deg([bound for _, bound in told])
        axes.plot(
            angles, np.maximum(errors, 1e-3), ".", color="0.6", markersize=3, label="one frame"
        )
        for values, color, marker, label in (
            (errors, PALETTE[0], "o", "reached, root mean square"),
            (bounds, PALETTE[1], "s", "Cramér–Rao bound, root mean square"),
        ):
            axes.plot(*_binned(angles, values, _root_mean_square), color=color, marker=marker,
                      label=label)  # fmt: skip
        axes.set(yscale="log", title=drawn_name(name.upper()), xlabel="joint angle (°)")
        _angle_axis(axes, found)
    _share_log_ordinate(row)
    row[0].set_ylabel("error, labelled calibration (°)")
    legend_below(drawing)
    return Figure(
        "bound",
        "What was reached, and what the images allow",
        "All corners with labelled frames. The bound takes the corners' stated noise, the labels' "
        "deviation and the errors of fabrication that these frames leave.",
        drawing,
    )


def _angle_axis(axes: Axes, found: Found) -> tuple[float, float]:
    """Limits and ticks for all joint angles of the frames and of the gap's tables, degrees."""
    angles = [table.angles for table in found.tables]
    angles += [seen.frames.angles.ravel() for seen in found.watched]
    last = TICK_DEG * math.ceil(math.degrees(max(map(np.max, angles))) / TICK_DEG - 1e-9)
    axes.set(xlim=(-2, last + 2), xticks=angle_ticks(last, 6))
    return axes.get_xlim()


def _share_log_ordinate(row: np.ndarray) -> None:
    limits = np.array([axes.get_ylim() for axes in row])
    for axes in row:
        axes.set_ylim(limits[:, 0].min(), limits[:, 1].max())
        label_plainly(axes.yaxis)


def _root_mean_square(values: Float[np.ndarray, " _"]) -> np.floating:
    return np.sqrt(np.mean(values**2))


def _binned(
    angles: Float[np.ndarray, " answers"],
    values: Float[np.ndarray, " answers"],
    statistic: Callable[[np.ndarray], np.floating],
) -> tuple[list[float], list[float]]:
    """Middles of the bins that hold three numbers or more, and a statistic of these."""
    middles, found = [], []
    for start in np.arange(0, np.max(angles, initial=0.0) + BIN_DEG, BIN_DEG):
        inside = (angles >= start) & (angles < start + BIN_DEG) & np.isfinite(values)
        if inside.sum() >= 3:
            middles.append(float(start + BIN_DEG / 2))
            found.append(float(statistic(values[inside])))
    return middles, found


def covariance_figure(found: Found) -> Figure:
    """Errors over their predicted deviations against a normal distribution."""
    drawing, ((axes,),) = new_figure(1, 1, height=3.2)
    for index, method in enumerate(RUNGS):
        own = [a for a in of_method(found.answers, method) if a.estimate.defined]
        if len(own) < 5:
            continue
        scaled = np.sort([a.error / a.estimate.deviation for a in own])
        normal = stats.norm.ppf((np.arange(len(scaled)) + 0.5) / len(scaled))
        axes.plot(normal, scaled, color=PALETTE[index], linestyle=DASHES[index], label=method)
    axes.plot([-3, 3], [-3, 3], color="0.4", linewidth=1, linestyle=":", label="as predicted")
    axes.set(xlabel="quantile of the standard normal", ylabel="error over predicted deviation")
    legend_below(drawing)
    return Figure(
        "covariance",
        "Are the predicted deviations right?",
        "Quantiles of errors over predicted deviations. Steeper than the dotted line: the method "
        "is less exact than it says.",
        drawing,
    )
