"""Figures of the closings over the motor's angle, the postures, the circles and the pinches."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.figure import Figure

from designopt.plot.figures import (
    MARKERS,
    PALETTE,
    angle_ticks,
    label_plainly,
    legend_below,
    new_figure,
)
from studies.models.grasp.analysis import CLOSED, Analysis, radius_of
from studies.models.grasp.pinch import APPROACH, least_place


def draw_closings(found: Analysis) -> Figure:
    """Joints and forces over the motor's angle: free, blocked, and against a load."""
    drawing, axes = new_figure(2, 2, height=6.0)
    last = 1.03 * found.finger.body.range_deg
    shown = (("free", found.free, "-"), ("circle", found.adaptive, "-"))
    shown += (("circle, loaded", found.loaded, "--"),)
    for (name, path, style), color in zip(shown, PALETTE, strict=False):
        states = np.flatnonzero(path.ok[: CLOSED + 1])
        angle = np.degrees(path.commands[states])
        columns = (*np.degrees(path.joints).T, path.motor)
        for axis, column in zip(axes.flat, columns, strict=False):
            axis.plot(angle, column[states], style, color=color, label=name)
        for pad, mark, key in ((0, "s", "intermediate"), (1, "o", "distal")):
            if path.per_pad:
                force, line = path.push(pad)[states], {"color": color, "label": f"{name}, {key}"}
                axes[1, 1].plot(angle, force, style, marker=mark, markevery=8, markersize=4, **line)
    titles = {"PIP": "PIP flexion (°)", "DIP": "DIP flexion (°)"}
    titles |= {"Motor": "motor moment (N mm)", "Contact forces": "contact force (N)"}
    for axis, (title, label) in zip(axes.flat, titles.items(), strict=True):
        axis.set(title=title, ylabel=label, xlabel="motor angle α (°)")
    for axis in axes[0]:
        axis.set_ylim(-0.03 * last, last)
    axes[1, 1].legend(loc="upper left", fontsize=8)
    legend_below(drawing, *axes[0, 0].get_legend_handles_labels())
    return drawing


def draw_stability_map(found: Analysis) -> Figure:
    """φ₂/φ₁ over all postures, and where a contact must lie for the grasp to hold both pads."""
    drawing, axes = new_figure(1, 2, height=3.6)
    angles, ratio = np.degrees(found.angles), found.relative_pull
    place = least_place(ratio, found.angles[None, :], float(found.finger.body.intermediate))
    for axis, values, title, unit in (
        (axes[0, 0], ratio, "φ₂/φ₁", ""),
        (axes[0, 1], place, "least k₂ with f₁ > 0", " (mm)"),
    ):
        filled = axis.contourf(angles, angles, values.T, levels=12, cmap="cividis", alpha=0.75)
        lines = axis.contour(angles, angles, values.T, levels=6, colors="black", linewidths=0.6)
        axis.clabel(lines, fontsize=7, fmt="%.2g")
        drawing.colorbar(filled, ax=axis, label=title + unit, shrink=0.72)
        axis.set(xlabel="PIP flexion (°)", ylabel="DIP flexion (°)", title=title)
        axis.set(xticks=angle_ticks(angles[-1]), yticks=angle_ticks(angles[-1]), aspect="equal")
        axis.grid(visible=False)
    return drawing


def draw_circles(found: Analysis) -> Figure:
    """Posture and forces on the circles, with the motor at its end."""
    drawing, [[posture, force]] = new_figure(1, 2, height=3.6)
    ends = [path for path in found.circles if path.ok[CLOSED]]
    diameters = [2 * radius_of(path) for path in ends]
    for pad, (joint, name) in enumerate((("PIP", "intermediate"), ("DIP", "distal"))):
        line = {"marker": MARKERS[pad], "color": PALETTE[pad], "linestyle": ("-", "--")[pad]}
        flexion = [math.degrees(path.joints[CLOSED, pad]) for path in ends]
        posture.plot(diameters, flexion, label=joint, **line)
        force.plot(
            diameters, [path.push(pad)[CLOSED] for path in ends], label=f"{name} pad", **line
        )
    posture.set(ylabel="flexion (°)", title="Posture")
    force.set(ylabel="contact force (N)", title="Forces")
    for axis in (posture, force):
        axis.set(xlabel="diameter of the circle (mm)", ylim=(0, None))
        axis.legend(loc="best")
    return drawing


def draw_pinches(found: Analysis) -> Figure:
    """The limit of every pinch that gives way, by the formula, between what loading showed."""
    drawing, [[limit, loading]] = new_figure(1, 2, height=3.6)
    pips = list(dict.fromkeys(pinch.pip for pinch, _, _ in found.pinches))
    for i, pip in enumerate(pips):
        color, label = PALETTE[i % len(PALETTE)], f"PIP {math.degrees(pip):.0f}°"
        own = [part for part in found.pinches if part[0].pip == pip and not part[0].holds]
        if own:
            places = [one.place for one, _, _ in own]
            limits, mark = [one.limit for one, _, _ in own], MARKERS[i % len(MARKERS)]
            open_mark = {"color": color, "markerfacecolor": "none", "markersize": 8}
            limit.plot(places, limits, mark, label=f"{label}, formula", **open_mark)
            low, high = np.array([(shown.low, shown.high) for _, _, shown in own]).T
            bars = {"fmt": "none", "color": color, "capsize": 4, "label": f"{label}, loading"}
            limit.errorbar(places, (low + high) / 2, (high - low) / 2, **bars)
        for one, path, _ in own:
            states = APPROACH + np.flatnonzero(path.ok[APPROACH:])
            line = {"color": color, "linewidth": 1, "linestyle": ("-", "--", ":")[i % 3]}
            dip = np.degrees(path.joints[states, 1])
            loading.plot(path.motor[states] / one.limit, dip, **line)
    limit.set(xlabel="k₂ (mm)", ylabel="largest motor moment (N mm)", yscale="log")
    limit.set(title="Where a pinch gives way")
    label_plainly(limit.yaxis)
    limit.legend(loc="upper left", fontsize=8)
    loading.axvline(1.0, color="0.4", linewidth=0.8)
    loading.set(xlabel="motor moment over the formula's limit", ylabel="DIP flexion (°)")
    loading.set(title="DIP under load")
    return drawing
