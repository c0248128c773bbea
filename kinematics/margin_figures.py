"""The figure of a motion's margins and transmission angles, and where it fails."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping

import numpy as np
from jaxtyping import Array, Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from designopt.figures import PALETTE, new_figure
from designopt.solution import Solution
from kinematics.linkage import Linkage
from kinematics.plan import Group, make_plan
from kinematics.solver import Pose
from kinematics.structure import Structure

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
    figure, grid = new_figure(2, 1, height=5.6)
    upper, lower = grid[:, 0]
    margins = [(text, np.where(ok, curve, np.nan)) for text, curve in _margins(linkage, poses)]
    _draw(upper, abscissa, margins)
    upper.axhline(0, color="0.3", linewidth=0.9)
    upper.set(ylabel="margin (mm)", title=f"{linkage.structure.name}: distance to each limit")
    degrees = {pin: np.degrees(np.where(ok, angle, np.nan)) for pin, angle in angles.items()}
    _draw(lower, abscissa, list(degrees.items()))
    lower.axhline(LEAST_TRANSMISSION_DEG, color="0.3", linewidth=0.9, linestyle=(0, (4, 3)))
    lower.annotate(
        f"{LEAST_TRANSMISSION_DEG:g}°",
        (1, LEAST_TRANSMISSION_DEG),
        (3, 0),
        xycoords=("axes fraction", "data"),
        textcoords="offset points",
        va="center",
        color="0.3",
    )
    lower.set(xlabel=label, ylabel="transmission angle (deg)", ylim=(0, 92))
    lower.set(yticks=np.arange(0, 91, 15), title="Transmission angle at each pin")
    for axes in (upper, lower):
        for number, (start, end) in enumerate(failed_stretches(abscissa, ok)):
            note = "cannot be assembled" if number == 0 else None
            axes.axvspan(start, end, color="0.88", linewidth=0, zorder=0, label=note)
        axes.set_xlim(float(abscissa.min()), float(abscissa.max()))
        if axes.get_legend_handles_labels()[0]:
            axes.legend(loc="upper left", bbox_to_anchor=(1.04, 1.0))
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
        return np.degrees(inputs[:, column]), f"{part.name} (deg){note}"
    return inputs[:, column], f"{part.name} (mm){note}"


def _margins(linkage: Linkage, poses: Solution[Pose]) -> Iterator[tuple[str, Curve]]:
    for group in make_plan(linkage.structure).groups:
        for limit, margin in zip(
            LIMITS[group.kind], poses.value.margins.get(group.index, ()), strict=False
        ):
            yield f"{_title(group)}: {limit}", np.asarray(margin)


def _title(group: Group) -> str:
    """A short name of a group: its bodies, or the first and the last of many."""
    names = group.bodies
    return ", ".join(names) if len(names) < 3 else f"{names[0]} … {names[-1]}"


def _draw(axes: Axes, abscissa: Curve, curves: list[tuple[str, Curve]]) -> None:
    styles = itertools.product(("-", (0, (5, 2)), (0, (1, 1.2))), PALETTE)
    for (label, curve), (dashes, colour) in zip(curves, itertools.cycle(styles), strict=False):
        axes.plot(abscissa, curve, color=colour, linestyle=dashes, label=label)
