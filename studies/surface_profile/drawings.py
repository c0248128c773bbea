"""The study's figures."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

from designopt.plot.figures import MARKERS, PALETTE, legend_below, new_figure
from designopt.study.results import Figure
from perception.chamber.heights import TRACKED
from perception.chamber.points import NAMES
from perception.chamber.surfaces import CURVED, CURVED_OVER_ROUGH, ROUGH
from studies.surface_profile.found import (
    Found,
    Picture,
    calibrated_errors,
    errors,
    of_kind,
    quantiles,
)
from studies.surface_profile.limits import LIMIT, WORD, Quantity, Sized, of_quantity
from studies.surface_profile.spec import SurfaceProfileSpec
from studies.surface_profile.surfaces import KINDS
from studies.surface_profile.trials import POINTS, WAYS, WHOLE, YELLOW, Trial

COLORS = {POINTS: PALETTE[0], YELLOW: PALETTE[6], WHOLE: PALETTE[4]}
STYLES = {POINTS: "-", YELLOW: "--", WHOLE: ":"}

LEAST_RANGE = 1.0
"""Of heights that are shown, mm."""

DRAWN = 401
"""Places at which surfaces are drawn."""

BRIGHTER = 1.6
"""Brightness of shown pictures."""


def figures(spec: SurfaceProfileSpec, found: Found) -> list[Figure]:
    """Every figure of the study."""
    return [
        profiles_figure(spec, found),
        pictures_figure(found.pictures),
        kinds_figure(found),
        errors_figure(spec, found),
        *limits_figure(found),
    ]


def profiles_figure(spec: SurfaceProfileSpec, found: Found) -> Figure:
    """One slide of each kind, as in the paper's Fig. 14 and in mm."""
    shown = [of_kind(found.trials, kind)[:1] for kind in KINDS]
    drawing, grid = new_figure(2, len(KINDS), height=4.8)
    for column, (kind, trials) in enumerate(zip(KINDS, shown, strict=True)):
        grid[0, column].set_title(kind.name.lower())
        for trial in trials:
            _in_px(grid[0, column], trial)
            _in_mm(grid[1, column], trial, spec.tip_radius)
        grid[1, column].set_xlabel("along the slide (mm)")
    grid[0, 0].set_ylabel("movement of e (px)")
    grid[1, 0].set_ylabel("height (mm)")
    legend_below(drawing)
    return Figure(
        "profiles",
        "Profiles of four surfaces, in pixels and in millimetres",
        "Above, the movement of yellow's lowest point e, as in the paper's Fig. 14 in whole pixels "
        "and finer than a pixel; below, the profile by b, e and g through the calibrated map, "
        "shifted onto the height that the pad rides. Scales differ from surface to surface.",
        drawing,
    )


def _in_px(axes: Axes, trial: Trial) -> None:
    e = TRACKED.index("e")
    x = trial.slide.x
    axes.step(x, trial.whole.px[:, e], where="mid", color=COLORS[WHOLE], label="e in whole pixels")
    axes.plot(x, trial.moved.px[:, e], color=COLORS[YELLOW], linewidth=1,
              label="e finer than a pixel")  # fmt: skip


def _in_mm(axes: Axes, trial: Trial, tip: float) -> None:
    slide, heights = trial.slide, trial.heights[POINTS]
    off = (heights.mm - slide.ridden)[heights.known]
    constant = off.mean() if len(off) else 0.0
    x = np.linspace(slide.x[0], slide.x[-1], DRAWN)
    lowest = slide.surface.ridden(slide.x, tip).min()
    bare, ridden = slide.surface.height(x), slide.surface.ridden(x, tip)
    axes.plot(x, bare - lowest, color="0.6", label="surface")
    axes.plot(x, ridden - lowest, color="black", linestyle="--", linewidth=1,
              label="ridden by the pad")  # fmt: skip
    axes.plot(
        slide.x[heights.known],
        (heights.mm - constant)[heights.known],
        ".",
        color=COLORS[POINTS],
        markersize=3.5,
        label="found by b, e and g",
    )
    low, high = axes.get_ylim()
    more = max(LEAST_RANGE - (high - low), 0) / 2
    axes.set_ylim(low - more, high + more)


def pictures_figure(pictures: list[Picture]) -> Figure:
    """What the camera sees, with the points that are followed."""
    drawing, grid = new_figure(1, len(pictures), height=2.0)
    for axes, picture in zip(grid[0], pictures, strict=True):
        pixels = np.clip(BRIGHTER * picture.pixels.astype(float), 0, 255).astype(np.uint8)
        axes.imshow(pixels)
        axes.grid(visible=False)
        axes.set_axis_off()
        axes.set_title(picture.title, fontsize=8)
        for marker, name in zip("ovs", TRACKED, strict=True):
            number = NAMES.index(name)
            if picture.points.seen[number]:
                axes.plot(*picture.points.xy[number], marker, markersize=5, color="white",
                          markeredgecolor="black", linestyle="none", label=name)  # fmt: skip
    legend_below(drawing)
    return Figure(
        "pictures",
        "What the endoscope sees of it",
        "A made finger at rest and on the first convex surface, brightened for the eye, with the "
        "points whose height in the image is followed: blue's lowest b, yellow's lowest e, and "
        "the middle g of blue.",
        drawing,
    )


def kinds_figure(found: Found) -> Figure:
    """Sagitta and roughness of all surfaces, and the limits between the kinds."""
    drawing, ((axes,),) = new_figure(1, 1, height=3.6)
    for index, kind in enumerate(KINDS):
        shapes = [trial.shapes[POINTS] for trial in of_kind(found.trials, kind)]
        axes.plot(
            [one.sagitta for one in shapes if one],
            [one.roughness for one in shapes if one],
            MARKERS[index],
            color=PALETTE[index],
            markerfacecolor="none",
            label=kind.name.lower(),
        )
    low, high = axes.get_ylim()
    low, high = min(low, 0.5 * ROUGH), max(high, 2 * ROUGH)
    ends = np.array([CURVED, max(CURVED_OVER_ROUGH * high, 2 * CURVED)])
    corner = CURVED / CURVED_OVER_ROUGH
    line = {"color": "black", "linewidth": 1, "linestyle": ":"}
    axes.plot([-CURVED, CURVED], [ROUGH, ROUGH], **line, label="limits")
    for side in (-1, 1):
        axes.plot(side * np.array([CURVED, CURVED, ends[1]]), [0, corner, ends[1] / 4], **line)
    reach = max(max(map(abs, axes.get_xlim())), 2 * CURVED)
    axes.set(xlabel="sagitta (mm)", ylabel="roughness (mm)", xlim=(-reach, reach), ylim=(0, high))
    legend_below(drawing, most=5)
    return Figure(
        "kinds",
        "Four kinds told apart by sagitta and roughness",
        "Every slide's, by its reconstructed profile. Curved surfaces with flat shoulders have "
        "corners, which are rough.",
        drawing,
    )


def errors_figure(spec: SurfaceProfileSpec, found: Found) -> Figure:
    """Distribution of errors; errors over the number of calibration frames and severity."""
    drawing, (axes,) = new_figure(1, 3, height=3.1, width_ratios=(1.2, 1, 1))
    for way in WAYS:
        numbers = np.sort(np.abs(errors(found.trials, way)))
        parts = 100 * (np.arange(len(numbers)) + 1) / max(len(numbers), 1)
        axes[0].plot(numbers, parts, color=COLORS[way], linestyle=STYLES[way], label=way)
    axes[0].set(
        xlabel="error of a height (mm)", ylabel="part below (%)", ylim=(0, 101), title="all slides"
    )

    counts = sorted(found.fingers[0].calibrations)
    at = np.arange(len(counts))
    full = [calibrated_errors(spec, found.fingers, count, POINTS) for count in counts]
    for number, (label, color, marker) in enumerate(
        (("profile", PALETTE[3], "^"), ("height itself", PALETTE[2], "s"))
    ):
        values = [quantiles(one[number], 0.9)[0] for one in full]
        axes[1].plot(at, values, color=color, marker=marker, label=label)
    axes[1].set(xlabel="calibration frames", ylabel="90 % are below (mm)", xticks=at,
                xticklabels=[str(count) for count in counts])  # fmt: skip
    axes[1].set_ylim(bottom=0)
    axes[1].set_title("over calibration")

    groups = {one.severity: one.trials for one in found.severities} | {spec.severity: found.trials}
    for way in WAYS:
        values = [quantiles(errors(trials, way), 0.9)[0] for _, trials in sorted(groups.items())]
        axes[2].plot(sorted(groups), values, color=COLORS[way], linestyle=STYLES[way], marker="o")
    axes[2].set(xlabel="severity", ylabel="90 % are below (mm)")
    axes[2].set_ylim(bottom=0)
    axes[2].set_title("over severity")
    legend_below(drawing, most=5, fontsize=8)
    return Figure(
        "errors",
        "How far off profiles are",
        "Left: heights of all slides from what the pad rides, up to a constant. Middle: over the "
        "number of frames a finger is calibrated with, by b, e and g; none is the design's own "
        "map. Right: over the severity of shaking, noise and light.",
        drawing,
    )


def limits_figure(found: Found) -> list[Figure]:
    """Part told over the true size, of both quantities; none where no sizes are asked for."""
    every: list[tuple[Quantity, list[Sized]]] = [
        (name, of_quantity(found.sized, name)) for name in LIMIT
    ]
    shown = [one for one in every if one[1]]
    if not shown:
        return []
    drawing, (row,) = new_figure(1, len(shown), height=2.9)
    for axes, (name, sized) in zip(row, shown, strict=True):
        size = [one.size for one in sized]
        exact = [100 * one.told_exactly() for one in sized]
        axes.plot(size, exact, color="0.6", linewidth=3, label="by the ridden heights, exactly")
        for way, marker in ((POINTS, "o"), (WHOLE, "s")):
            told = [100 * one.told(way) for one in sized]
            axes.plot(size, told, marker=marker, color=COLORS[way], linestyle=STYLES[way],
                      label=f"by {way}")  # fmt: skip
        axes.axvline(LIMIT[name], color="black", linewidth=1, linestyle="-.", label="limit")
        axes.set(xlabel=f"true {name} (mm)", ylabel=f"called {WORD[name]} (%)", ylim=(-3, 103))
        axes.set_xlim(left=0)
    legend_below(drawing, most=4, fontsize=8)
    return [
        Figure(
            "limits",
            "From which size on surfaces are called curved or rough",
            f"{len(shown[0][1][0].trials)} surfaces of every size. Limits apply to the sizes "
            "found, by the parabola and the filter, of what the pad rides.",
            drawing,
        )
    ]
