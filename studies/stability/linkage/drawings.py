"""The study's figures: the approach to lock-up, and the random linkages."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from designopt.plot.figures import MARKERS, PALETTE, legend_below, new_figure
from designopt.study.results import Figure
from studies.stability.linkage.statements import random_families

if TYPE_CHECKING:
    from studies.stability.linkage.judging import Family

APPROACHES = ("stretching: margin 1e-1", "folding: margin 1e-1", "slider-crank, margin 1e-1")
"""How the families that approach lock-up from inside are told by their names."""

DTYPES = ("float64", "float32")


def approach_figure(found: Sequence[Family]) -> Figure:
    """Errors and gradient sizes of single cases over their exact margin."""
    drawing, axes = new_figure(1, 2, height=3.6)
    errors, sizes = axes[0]
    for index, dtype in enumerate(DTYPES):
        judged = [
            family.judged
            for family in found
            if family.judged.dtype == dtype and any(name in family.case for name in APPROACHES)
        ]
        rounding = float(np.finfo(dtype).eps)
        margin = np.concatenate([some.margin for some in judged])
        inside = margin > 0
        series = (
            (errors, "value_error", "positions", PALETTE[index]),
            (errors, "gradient_error", "gradients", "none"),
            (sizes, "gradient_size", "gradients", PALETTE[index]),
        )
        for axis, field, name, face in series:
            values = np.concatenate([getattr(some, field) for some in judged])[inside]
            if axis is errors:
                values = np.maximum(values, rounding / 64)
            axis.plot(
                margin[inside],
                values,
                MARKERS[index],
                color=PALETTE[index],
                markerfacecolor=face,
                markersize=3,
                label=f"{dtype}, {name}" if axis is errors else None,
            )
        errors.axhline(rounding, color=PALETTE[index], linestyle=":")
    line = np.array([1e-16, 1e-1])
    sizes.plot(line, line**-0.5, color="0.35", linewidth=0.9, label="margin$^{-1/2}$")
    for axis in (errors, sizes):
        axis.set(xscale="log", yscale="log", xlabel="exact margin, of the linkage's size")
        axis.invert_xaxis()
    errors.set(ylabel="condition-scaled error")
    sizes.set(ylabel="largest gradient entry, of the size")
    sizes.legend(loc="upper left")
    legend_below(drawing, *errors.get_legend_handles_labels(), most=4)
    return Figure(
        "approach",
        "Errors and gradients on the way to lock-up",
        "Four-bars that stretch and fold, and slider-cranks at the end of their reach: each dot is "
        "one case, at its exact margin after rounding its inputs to the float type. Dotted: the "
        "rounding of the float types; errors below a 64th of it are drawn there. Gradients are "
        "judged down to the margin below which the verdict is left open (1e-12, in float32 "
        "3.8e-6).",
        drawing,
    )


def _sixths(exponents: Float[np.ndarray, " _"]) -> Float[np.ndarray, " edges"]:
    """Edges of bins, six a decade, that hold all."""
    low, high = np.floor(np.min(exponents, initial=0.0)), np.ceil(np.max(exponents, initial=0.0))
    return np.arange(6 * low, 6 * high + 1) / 6


def random_figure(found: Sequence[Family]) -> Figure:
    """Margins of the random linkages, and the errors of those that can be assembled."""
    drawing, axes = new_figure(1, 2, height=3.4)
    margins, errors = axes[0]
    for index, family in enumerate(random_families(found)):
        judged = family.judged
        kind = family.case.split(",")[0]
        color = PALETTE[index % len(PALETTE)]
        if judged.dtype == "float64":
            for sign, style, word in ((1, "-", "can be assembled"), (-1, ":", "cannot")):
                depth = np.log10(sign * judged.margin[sign * judged.margin > 0])
                margins.hist(
                    depth,
                    _sixths(depth),
                    histtype="step",
                    linestyle=style,
                    color=color,
                    label=f"{kind}, {word}",
                )
        units = judged.value_error[judged.ok] / float(np.finfo(judged.dtype).eps)
        units = np.log10(np.maximum(units[np.isfinite(units)], 1e-4))
        errors.hist(
            units,
            _sixths(units),
            histtype="step",
            color=color,
            label=f"{kind}, {judged.dtype}",
        )
    margins.set(yscale="log", xlabel="log₁₀ of |margin|, of the size", ylabel="linkages")
    errors.set(yscale="log", xlabel="log₁₀ of error in units of rounding")
    for axis in (margins, errors):
        axis.legend(loc="upper left", fontsize=7)
        axis.set_ylim(top=axis.get_ylim()[1] * 30)
    return Figure(
        "random",
        "Random linkages: how far from lock-up, and how accurate",
        "Left: exact margins of the random linkages, on both sides of lock-up. Right: "
        "condition-scaled errors of the positions of those that can be assembled; errors below "
        "1e-4 units of rounding are counted there.",
        drawing,
    )
