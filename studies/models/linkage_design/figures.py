"""Figures of a designed linkage; their words are in ``report.md`` of this package."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import BoundaryNorm
from matplotlib.contour import QuadContourSet
from matplotlib.figure import Figure

from designopt.plot.figures import MARKERS, PALETTE, angle_ticks, new_figure, share_limits
from designopt.plot.typesetting import as_mathtext
from designopt.study.plots import ecdf
from designopt.study.records import Records
from designopt.study.report import Report
from studies.models.finger import Finger
from studies.models.linkage_design.analysis import LinkageDesign
from studies.models.linkage_design.coupling.judging import CoupledVerdict
from studies.models.linkage_design.judging import Verdict
from studies.models.linkage_design.spec import LimitsSpec
from studies.models.section import draw_finger


def draw_straight(finger: Finger, height: float = 3.0) -> Figure:
    """The straight finger with every pin's place: what one builds from."""
    drawing, [[axis]] = new_figure(1, 1, height=height)
    draw_finger(axis, finger, np.zeros(2), named=True)
    axis.set(xlabel="x from the PIP axis, to the tip (mm)", ylabel="y, to the back (mm)")
    return drawing


def draw_sequences(finger: Finger) -> Figure:
    """Pinch and adaptive closing, as paper B's Fig. 3.4."""
    drawing, axes = new_figure(2, 4, height=4.2)
    for row, name, dip in zip(axes, ("Pinch", "Adaptive"), (0.0, 1.0), strict=True):
        for axis, part in zip(row, np.linspace(0.0, 1.0, 4), strict=True):
            degrees = part * np.array(finger.body.ranges_deg) * (1.0, dip)
            draw_finger(axis, finger, np.deg2rad(degrees))
            title = f"{name}:\nPIP {degrees[0]:.0f}°, DIP {degrees[1]:.0f}°"
            axis.set_title(title, fontsize=8)
            axis.tick_params(labelsize=7)
        row[0].set_ylabel("y (mm)")
    for axis in axes[1]:
        axis.set_xlabel("x (mm)")
    share_limits(axes.ravel())
    return drawing


def draw_closing(finger: Finger, verdict: CoupledVerdict) -> Figure:
    """A coupled finger on its way."""
    drawing, [row] = new_figure(1, 4, height=2.6)
    last = len(verdict.pip_deg) - 1
    for axis, index in zip(row, (0, last // 3, 2 * last // 3, last), strict=True):
        degrees = verdict.pip_deg[index], verdict.dip_deg[index]
        draw_finger(axis, finger, np.deg2rad(degrees))
        axis.set_title(f"PIP {degrees[0]:.0f}°, DIP {abs(degrees[1]):.0f}°", fontsize=8)
        axis.tick_params(labelsize=7)
        axis.set_xlabel("x (mm)")
    row[0].set_ylabel("y (mm)")
    share_limits(row)
    return drawing


def draw_curve(verdict: CoupledVerdict) -> Figure:
    """DIP, its slope and the transmission angles of a coupled finger over PIP."""
    drawing, [row] = new_figure(1, 3, height=2.8)
    shown = (
        ("DIP (°)", {"DIP": verdict.dip_deg}),
        ("dDIP/dPIP", {"ratio": verdict.ratio}),
        ("transmission angle (°)", verdict.angles_deg),
    )
    for axis, (label, lines) in zip(row, shown, strict=True):
        for (name, values), color in zip(lines.items(), PALETTE, strict=False):
            axis.plot(verdict.pip_deg, values, color=color, label=as_mathtext(name))
        axis.set(xlabel="PIP (°)", ylabel=label, xticks=angle_ticks(verdict.pip_deg[-1]))
        if len(lines) > 1:
            axis.legend()
    return drawing


def draw_maps(verdict: Verdict) -> Figure:
    """The six transmission angles over all postures."""
    drawing, axes = new_figure(2, 3, height=5.0)
    levels = np.arange(5 * np.floor(verdict.least_deg / 5), 91, 5)
    for axis, (name, values) in zip(axes.flat, verdict.angles_deg.items(), strict=True):
        full = np.broadcast_to(values, verdict.crank_deg.shape)
        degrees = verdict.pip_deg, verdict.dip_deg
        _contours(axis, degrees, full, levels)
        worst = np.unravel_index(np.argmin(full), full.shape)
        place = [angles[i] for angles, i in zip(degrees, worst, strict=True)]
        axis.plot(*place, "X", color=PALETTE[1], markersize=9, clip_on=False, zorder=5)
        axis.set_title(as_mathtext(f"{name}: least {full.min():.1f}°"), fontsize=9)
    for axis in axes[1]:
        axis.set_xlabel("PIP (°)")
    for axis in axes[:, 0]:
        axis.set_ylabel("DIP (°)")
    colors = ScalarMappable(BoundaryNorm(levels, 256), "cividis")
    drawing.colorbar(colors, ax=axes, label="transmission angle (°)", shrink=0.8)
    return drawing


def draw_over_postures(
    degrees: tuple[Float[np.ndarray, " pip"], Float[np.ndarray, " dip"]],
    shown: Mapping[str, Float[np.ndarray, "pip dip"]],
) -> Figure:
    """Numbers over all postures, side by side.

    Args:
        degrees: flexion of PIP and of DIP.
        shown: by what they are, with the unit, over PIP and DIP.
    """
    drawing, [row] = new_figure(1, len(shown), height=3.4)
    for axis, (label, values) in zip(row, shown.items(), strict=True):
        mesh = _contours(axis, degrees, values, 12)
        axis.set(xlabel="PIP (°)", ylabel="DIP (°)")
        drawing.colorbar(mesh, ax=axis, label=label, shrink=0.9)
    return drawing


def _contours(
    axis: Axes,
    degrees: tuple[Float[np.ndarray, " pip"], Float[np.ndarray, " dip"]],
    values: Float[np.ndarray, "pip dip"],
    levels: Any,
) -> QuadContourSet:
    mesh = axis.contourf(*degrees, values.T, levels=levels, cmap="cividis")
    pip, dip = (angle_ticks(angles[-1]) for angles in degrees)
    axis.set(aspect="equal", xticks=pip, yticks=dip)
    axis.grid(visible=False)
    return mesh


def draw_starts(levels: Sequence[Sequence[float]]) -> Figure:
    """Where the starts of every round led to that meet all requirements."""
    drawing, [[axis]] = new_figure(1, 1, height=3.0)
    for number, values in enumerate(levels):
        style = {"marker": MARKERS[number % len(MARKERS)], "color": PALETTE[number % len(PALETTE)]}
        axis.plot([number] * len(values), values, linestyle="", markerfacecolor="none", **style)
    names = ["starts", *(f"exchange {n}" for n in range(1, len(levels)))]
    axis.set(xticks=range(len(levels)), xticklabels=names)
    axis.set(ylabel="least transmission angle (°)", xlim=(-0.5, len(levels) - 0.5))
    return drawing


def add_figures(out: Report, limits: LimitsSpec, design: LinkageDesign) -> None:
    """Figures of a designed linkage."""
    verdict = design.verdict
    out.figure("finger", draw_straight(design.finger), most=5)
    if isinstance(verdict, CoupledVerdict):
        out.figure("coupled", draw_closing(design.finger, verdict), most=5)
        out.figure("curve", draw_curve(verdict))
    else:
        out.figure("sequences", draw_sequences(design.finger), most=5)
        out.figure("transmission", draw_maps(verdict))
        ratios = {"turn of the crank (°)": verdict.crank_deg, "φ₂/φ₁": verdict.ratio}
        out.figure("ratios", draw_over_postures((verdict.pip_deg, verdict.dip_deg), ratios))
    nominal, required = verdict.least_deg, limits.transmission_deg
    marks = {f"without errors {nominal:.1f}°": nominal, f"required {required:g}°": required}
    least = Records({"least_transmission_angle_deg": design.drawn})
    out.figure("tolerance", ecdf(least, "least_transmission_angle_deg", marks=marks), most=2)
    reached = [one.feasible_deg for one in design.search.rounds]
    if any(reached):
        out.figure("starts", draw_starts(reached))
