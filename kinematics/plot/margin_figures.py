"""The figure of a motion's margins and transmission angles, and where it fails."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Array, Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from designopt.plot.figures import PALETTE, new_figure
from designopt.plot.typesetting import drawn_name
from designopt.solution import Solution
from kinematics.model.linkage import Linkage
from kinematics.model.topology import Structure
from kinematics.solve.plan import make_plan
from kinematics.solve.solver import Pose
from kinematics.solve.steps import Group

Inputs = Float[Array | np.ndarray, "poses inputs"]
Angles = Mapping[str, Float[Array | np.ndarray, " poses"]]
Curve = Float[np.ndarray, " poses"]

LEAST_TRANSMISSION_DEG = 40.0
"""A common limit of design: R. L. Norton, Design of Machinery, 6th ed., section 4.10."""

LIMITS = {
    "RRR": ("stretched", "folded"),
    "RRP": ("off its line",),
    "RPR": ("inside its slot",),
    "PRP": ("lines parallel",),
    "RPP": ("lines parallel",),
    # The second margin differs from the first only where the pose failed.
    "iterated": ("locked",),
}
"""What each margin of a group is the distance to."""

DASHES = ("-", (0, (5, 2)))
"""Lines of a group's first and second margin."""


def margin_figure(
    linkage: Linkage, inputs: Inputs, poses: Solution[Pose], angles: Angles
) -> Figure:
    """Margins of every group, and transmission angles at the pins, over a motion.

    Args:
        linkage: the linkage.
        inputs: values of the inputs, rad or mm; the first that varies is the abscissa.
        poses: their solution; where it is not ok, nothing is drawn on a grey ground.
        angles: transmission angles by joint, rad, 0 to π/2.
    """
    ok = np.asarray(poses.ok)
    abscissa, label = _abscissa(linkage.structure, np.asarray(inputs))
    groups = make_plan(linkage.structure).groups
    figure, grid = new_figure(2, 1, height=5.6)
    upper, lower = grid[:, 0]
    for level, group in enumerate(groups):
        margins = poses.value.margins.get(group.index, ())
        for limit, margin, dashes in zip(LIMITS[group.kind], margins, DASHES, strict=False):
            style = {**_style(level, len(groups)), "linestyle": dashes}
            curve = np.where(ok, np.asarray(margin), np.nan)
            upper.plot(abscissa, curve, label=drawn_name(f"{_title(group)}: {limit}"), **style)
    upper.axhline(0, color="0.3", linewidth=0.9)
    upper.set(
        ylabel="margin (mm)", title=f"{drawn_name(linkage.structure.name)}: distance to each limit"
    )
    levels = {group.pin: level for level, group in enumerate(groups)}
    for pin, angle in angles.items():
        curve = np.degrees(np.where(ok, np.asarray(angle), np.nan))
        # A pin has the colour of its group.
        lower.plot(
            abscissa, curve, label=drawn_name(pin), **_style(levels.get(pin, 0), len(groups))
        )
    if not angles:
        note = "no pin of this linkage has a transmission angle"
        lower.text(0.5, 0.65, note, transform=lower.transAxes, ha="center", color="0.3")
    _mark_limit(lower)
    lower.set(xlabel=drawn_name(label), ylabel="transmission angle (°)", ylim=(0, 92))
    lower.set(yticks=np.arange(0, 91, 15), title="Transmission angle at each pin")
    for axes in (upper, lower):
        _finish(axes, abscissa, failed_stretches(abscissa, ok))
    return figure


def failed_stretches(abscissa: Curve, ok: np.ndarray) -> list[tuple[float, float]]:
    """From where to where poses fail: half-way to the neighbours that are ok."""
    middles = (abscissa[1:] + abscissa[:-1]) / 2
    edges = np.concatenate([abscissa[:1], middles, abscissa[-1:]])
    stretches = []
    for good, run in itertools.groupby(range(len(ok)), key=lambda index: bool(ok[index])):
        if not good:
            first, *_, last = [*(indices := list(run)), indices[-1]]
            stretches.append((float(edges[first]), float(edges[last + 1])))
    return stretches


def _abscissa(structure: Structure, inputs: Float[np.ndarray, "poses inputs"]) -> tuple[Curve, str]:
    varying = np.flatnonzero(np.ptp(inputs, axis=0) > 0) if len(inputs) else np.zeros(0, int)
    column = int(varying[0]) if varying.size else 0
    part = structure.inputs[column]
    others = [structure.inputs[index].name for index in varying if index != column]
    note = f"; {', '.join(others)} varying with it" if others else ""
    if part.slider is None:
        return np.degrees(inputs[:, column]), f"{part.name} (°){note}"
    return inputs[:, column], f"{part.name} (mm){note}"


def _title(group: Group) -> str:
    """A short name of a group: its pin, else its bodies, or the first and the last of many."""
    if group.pin is not None:
        return group.pin
    names = group.bodies
    return ", ".join(names) if len(names) < 3 else f"{names[0]} … {names[-1]}"


def _style(level: int, count: int) -> dict[str, Any]:
    """Colour and width of a group's curves; earlier ones are wider, to show below later ones."""
    return {
        "color": PALETTE[level % len(PALETTE)],
        "linewidth": min(1.3 + 0.8 * (count - 1 - level), 3),
    }


def _mark_limit(axes: Axes) -> None:
    axes.axhline(LEAST_TRANSMISSION_DEG, color="0.3", linewidth=0.9, linestyle=(0, (4, 3)))
    place = (1.0, LEAST_TRANSMISSION_DEG)
    text = axes.annotate(f"{LEAST_TRANSMISSION_DEG:g}°", place, (3, 0), textcoords="offset points")
    text.set(va="center", color="0.3")
    text.xycoords = ("axes fraction", "data")


def _finish(axes: Axes, abscissa: Curve, failed: list[tuple[float, float]]) -> None:
    for number, (start, end) in enumerate(failed):
        note = "no pose" if number == 0 else None
        axes.axvspan(start, end, color="0.88", linewidth=0, zorder=0, label=note)
    low, high = float(abscissa.min()), float(abscissa.max())
    if high > low:
        axes.set_xlim(low, high)
    axes.xaxis.set_major_locator(MaxNLocator(9, steps=[1, 1.5, 2, 3, 4.5, 5, 6, 9, 10]))
    if axes.get_legend_handles_labels()[0]:
        axes.legend(loc="upper left", bbox_to_anchor=(1.04, 1.0))
