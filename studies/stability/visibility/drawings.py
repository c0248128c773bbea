"""The study's figures: the rays beside the exact answer, and the approach to degenerate scenes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes

from designopt.plot.figures import MARKERS, PALETTE, legend_below, new_figure
from designopt.study.results import Figure
from studies.stability.visibility.spec import StabilitySpec

if TYPE_CHECKING:
    from studies.stability.visibility.comparing import Compared
    from studies.stability.visibility.judging import Judged

FLOOR = 1e-10
"""Deviations from the rays below it are drawn there."""


def rays_figure(spec: StabilitySpec, compared: Sequence[Compared]) -> Figure:
    """Deviations of coverages from the rays' beside what the rays cannot know, and in float32."""
    drawing, axes = new_figure(1, 1 + spec.float32, height=3.6)
    most = compared[-1]
    series = [
        (most.coarse.off, f"off {spec.rays:,} rays", PALETTE[0], "-"),
        (most.coarse.step, f"step of {spec.rays:,} rays", PALETTE[0], ":"),
        (most.fine.off, f"off {spec.fine_rays:,} rays", PALETTE[1], "-"),
        (most.fine.step, f"step of {spec.fine_rays:,} rays", PALETTE[1], ":"),
    ]
    _histogram(axes[0, 0], "part of a pad", series, (FLOOR, 1.0))
    if spec.float32:
        names = [f"{some.bounces} bounce{'s' * (some.bounces > 1)}" for some in compared]
        series = [
            (some.single, name, color, "-")
            for some, name, color in zip(compared, names, PALETTE, strict=False)
        ]
        _histogram(axes[0, 1], "error in float32", series, (FLOOR, 1e-4))
    return Figure(
        "rays",
        "Coverage of random scenes beside brute force, and in float32",
        "Left: how far the exact coverage is from the middle of the rays' bounds, beside how far "
        "apart these are (dotted). Right: error of coverage and of what each path shows in "
        "float32, beside float64 for the same inputs. Scenes without any deviation are left out.",
        drawing,
    )


def _histogram(
    axis: Axes,
    what: str,
    series: Sequence[tuple[np.ndarray, str, str, str]],
    limits: tuple[float, float],
) -> None:
    largest = max([limits[1], *(np.max(values, initial=0.0) for values, *_ in series)])
    bins = np.linspace(np.log10(limits[0]), np.log10(largest), 61)
    for values, label, color, style in series:
        values = np.log10(np.maximum(values[values > 0], limits[0]))
        axis.hist(values, bins, histtype="step", color=color, linestyle=style, label=label)
    axis.set(xlabel=f"log₁₀ of the {what}", ylabel="scenes", yscale="log")
    axis.legend(loc="upper left", fontsize=7)
    axis.set_ylim(0.5, max(10.0, axis.get_ylim()[1]) * 30)


def approach_figure(judged: Sequence[Judged]) -> Figure:
    """Errors of single scenes over how far they are from degenerate."""
    drawing, axes = new_figure(1, 2, height=3.6)
    fields = (("value_error", "coverage, parts and margins"), ("gradient_error", "gradients"))
    for axis, (field, title) in zip(axes[0], fields, strict=True):
        for index, dtype in enumerate(dict.fromkeys(family.dtype for family in judged)):
            mine = [family for family in judged if family.dtype == dtype]
            rounding = float(np.finfo(dtype).eps)
            clear = np.concatenate([family.clear for family in mine])
            errors = np.concatenate([getattr(family, field) for family in mine])
            shown = np.isfinite(clear) & np.isfinite(errors)
            axis.plot(
                clear[shown],
                np.maximum(errors[shown], rounding / 64),
                MARKERS[index],
                color=PALETTE[index],
                markersize=3,
                label=dtype if axis is axes[0, 0] else None,
            )
            axis.axhline(rounding, color=PALETTE[index], linestyle=":")
        axis.set(xscale="log", yscale="log", title=title, xlabel="distance from a change of views")
        axis.invert_xaxis()
    axes[0, 0].set(ylabel="scaled error")
    legend_below(drawing, most=2)
    return Figure(
        "approach",
        "Errors on the way to degenerate scenes",
        "Each dot is a scene of a family that approaches a change of its views, at its distance "
        "from it in units of the scene. Dotted: the rounding of the float types; errors below a "
        "64th of it are drawn there. Nearer than 64 units of rounding nothing is judged but that "
        "all numbers are finite.",
        drawing,
    )
