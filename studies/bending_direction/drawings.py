"""The study's figures."""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Bool, Float
from matplotlib.patches import Polygon

from designopt.plot.figures import MARKERS, PALETTE, legend_below, new_figure
from designopt.study.results import Figure
from perception.chamber import Direction, compute_displacements
from perception.chamber.points import NAMES
from studies.bending_direction.design import OUTLINES
from studies.bending_direction.found import USES, Found
from studies.bending_direction.frames import Series
from studies.bending_direction.spec import BendingDirectionSpec
from studies.bending_direction.tables import RULES, THRESHOLDS, paper_tally

BLUE, VERMILION, GREEN = PALETTE[:3]
YELLOW = "#C79A00"

ALONG = {
    Direction.UP: ("b", "e", "g"),
    Direction.DOWN: ("b", "e", "g"),
    Direction.LEFT: ("a", "c", "d", "f", "g"),
    Direction.RIGHT: ("a", "c", "d", "f", "g"),
}
"""Points whose displacement tells a direction."""

STYLES = {"a": "-", "b": "-", "c": ":", "d": "--", "e": "--", "f": ":", "g": "-."}

WORDS = {"a": "leftmost", "b": "lowest", "c": "rightmost", "d": "leftmost", "e": "lowest",
         "f": "rightmost", "g": "centre"}  # fmt: skip


def figures(spec: BendingDirectionSpec, found: Found) -> list[Figure]:
    """Every figure of the study."""
    return [
        pictures_figure(found),
        curves_figure(found),
        rules_figure(spec, found),
        thresholds_figure(spec, found),
        small_figure(spec, found),
    ]


def pictures_figure(found: Found) -> Figure:
    """Pictures with outlines as they are and points as they were found."""
    drawing, grid = new_figure(2, 3, height=4.2)
    for axes, shown in zip(grid.flat, found.shown, strict=True):
        axes.imshow(shown.image.pixels)
        for outline, seen in zip(shown.image.outlines, shown.image.seen, strict=True):
            if seen:
                axes.add_patch(Polygon(outline, fill=False, color="white", linewidth=0.8))
        for name, place, seen in zip(NAMES, shown.points.xy, shown.points.seen, strict=True):
            if seen:
                axes.plot(*place, "+", color="black", markersize=8, markeredgewidth=1.6)
                axes.annotate(name, place, (3, 3), textcoords="offset points", color="white")
        rows, columns = shown.image.pixels.shape[:2]
        axes.set(title=shown.title, xlim=(-0.5, columns - 0.5), ylim=(rows - 0.5, -0.5))
        axes.set_axis_off()
    return Figure(
        "pictures",
        "The chamber as it bends, with the points that were found",
        "Rendered frames with all effects. White: outlines of blue, yellow and top as they are; "
        "crosses: the seven points of the paper's Fig. 7 as found in the pixels. Points that the "
        "image's border cuts off are left out.",
        drawing,
    )


def moved(frames: Series, name: str) -> tuple[Float[np.ndarray, " _"], Bool[np.ndarray, " _"]]:
    """Displacement of a point along the direction of bending, px, and where it is seen."""
    index = NAMES.index(name)
    axis = 0 if frames.truth in (Direction.LEFT, Direction.RIGHT) else 1
    along = [
        compute_displacements(look.points, frames.initial)[index, axis] for look in frames.looks
    ]
    return np.array(along), np.array([bool(look.points.seen[index]) for look in frames.looks])


def curves_figure(found: Found) -> Figure:
    """The paper's Fig. 12: displacements over the bend, and what is left of the regions."""
    drawing, grid = new_figure(3, 2, height=8.0)
    for axes, frames in zip(grid[:2].flat, found.curves, strict=True):
        bends = np.rad2deg(frames.bends)
        for name in ALONG[frames.truth]:
            along, seen = moved(frames, name)
            color = YELLOW if name in "def" else BLUE
            region = "yellow" if name in "def" else "blue"
            axes.plot(
                bends[seen], along[seen], STYLES[name], color=color,
                linewidth=2.2 if name == "g" else 1.3, label=f"{name}: {WORDS[name]} of {region}",
            )  # fmt: skip
        axis = "x" if frames.truth in (Direction.LEFT, Direction.RIGHT) else "y"
        axes.set(title=f"Bending {frames.truth.name.lower()}", xlim=(0, 120))
        axes.set(xlabel="bend (°)", ylabel=f"displacement along {axis} (px)")
    for axes, truth in zip(grid[2], (Direction.DOWN, Direction.RIGHT), strict=True):
        frames = next(one for one in found.curves if one.truth is truth)
        areas = np.array([look.areas for look in frames.looks])
        for index, (name, color) in enumerate((("blue", BLUE), ("yellow", YELLOW))):
            axes.plot(
                np.rad2deg(frames.bends), 1e-3 * areas[:, index], color=color, linewidth=2.2,
                label=f"below: area of {name}", linestyle=("--", "-.")[index],
            )  # fmt: skip
        axes.set(title=f"What is seen, bending {truth.name.lower()}", xlim=(0, 120), ylim=(0, None))
        axes.set(xlabel="bend (°)", ylabel="area (1000 px)")
    legend_below(drawing, handlelength=3.5)
    return Figure(
        "curves",
        "Displacements of the reference points over the bend (the paper's Fig. 12)",
        "Each frame is a picture with all effects, shake among them. Curves end where the image's "
        "border cuts a point off or its region is gone. Below, the two stages: yellow shrinks and "
        "is gone, then blue shrinks.",
        drawing,
    )


def rules_figure(spec: BendingDirectionSpec, found: Found) -> Figure:
    """Table II and ours, rule by rule."""
    drawing, grid = new_figure(2, 2, height=5.6)
    for axes, rule in zip(grid.flat, RULES, strict=True):
        lowest = 100.0
        for number, (source, color) in enumerate((("paper A", "0.6"), ("blue", BLUE),
                                                   ("all", GREEN))):  # fmt: skip
            for threshold, hatch in ((False, ""), (True, "///")):
                heights = []
                for frames in found.series:
                    tally = (
                        paper_tally(frames.truth, threshold)
                        if source == "paper A"
                        else frames.tally(spec.threshold if threshold else 0.0,
                                          "blue" if source == "blue" else "all")
                    )  # fmt: skip
                    heights.append(100 * getattr(tally, rule))
                lowest = min([lowest, *(height for height in heights if math.isfinite(height))])
                label = source if source == "paper A" else f"ours, {source} points"
                axes.bar(
                    np.arange(len(heights)) + (2 * number + threshold - 2.5) * 0.14,
                    heights, 0.13, color=color, hatch=hatch, edgecolor="white",
                    label=f"{label}, {'with' if threshold else 'no'} threshold",
                )  # fmt: skip
        names = [frames.truth.name.lower() for frames in found.series]
        axes.set(xticks=range(len(names)), xticklabels=names, ylabel="images (%)")
        title = {"paper": 'the paper\'s rule: "initial" is correct', "strict": "strict",
                 "decided": "of the decided ones, right", "abstained": "undecided"}  # fmt: skip
        axes.set(title=title[rule])
        if rule == "abstained":
            axes.set(ylim=(0, None))
        else:
            axes.set(ylim=(math.floor(lowest) - 2, 100.3))
    legend_below(drawing)
    return Figure(
        "rules",
        "Table II and ours, rule by rule",
        "Three of the axes do not start at 0. "
        f"Threshold: {spec.threshold:g} px; the paper does not say its own. Its bends and hands "
        "are not ours, so the bars are no race; compare what the rules make of the same answers.",
        drawing,
    )


def thresholds_figure(spec: BendingDirectionSpec, found: Found) -> Figure:
    """Decided and undecided images over the threshold."""
    drawing, grid = new_figure(1, 2, height=3.2)
    lowest = 100.0
    for use, color, style in zip(USES, (BLUE, GREEN, VERMILION), ("-", "--", "-."), strict=True):
        tallies = [[f.tally(least, use) for f in found.series] for least in THRESHOLDS]
        decided = [min(100 * tally.decided for tally in row) for row in tallies]
        abstained = [max(100 * tally.abstained for tally in row) for row in tallies]
        lowest = min([lowest, *(part for part in decided if math.isfinite(part))])
        grid[0, 0].plot(THRESHOLDS, decided, style, color=color, label=f"{use} points")
        grid[0, 1].plot(THRESHOLDS, abstained, style, color=color)
    for axes, name in zip(
        grid[0], ("of the decided ones, right (%)", "undecided (%)"), strict=True
    ):
        axes.axvline(spec.threshold, color="0.5", linestyle=":", linewidth=1)
        axes.set(xlabel="threshold (px)", ylabel=name)
    grid[0, 0].set(ylim=(math.floor(lowest) - 2, 100.3))
    grid[0, 1].set(ylim=(0, None))
    legend_below(drawing)
    return Figure(
        "thresholds",
        "What the threshold does",
        "In the direction where it is worst. Dotted: the study's threshold.",
        drawing,
    )


def small_figure(spec: BendingDirectionSpec, found: Found) -> Figure:
    """Small bends: what is left undecided, and how fast outlines move."""
    drawing, grid = new_figure(1, 2, height=3.7)
    left, right = grid[0]
    edges = np.linspace(0, spec.small_bend_deg, 9)
    shown = (found.designs[0], found.designs[-1])
    for design, series, style, color in zip(
        shown, (found.small[0], found.small[-1]), ("-", "--"), (VERMILION, BLUE), strict=True
    ):
        for use, marker in zip(USES[:2], MARKERS, strict=False):
            bends = np.rad2deg(np.concatenate([frames.bends for frames in series]))
            answers = [a for frames in series for a in frames.tally(spec.threshold, use).answers]
            open_ = np.array([answer is Direction.INITIAL for answer in answers])
            counts, _ = np.histogram(bends, edges)
            share = np.histogram(bends[open_], edges)[0] / np.maximum(counts, 1)
            left.plot(
                (edges[:-1] + edges[1:]) / 2, 100 * share, style, color=color, marker=marker,
                label=f"{design.name}, {use} points",
            )  # fmt: skip
        offset = -0.18 if style == "-" else 0.18
        right.bar(
            np.arange(3) + offset, design.rates, 0.34, color=color,
            label=f"chamber {design.name}", hatch="" if style == "-" else "///", edgecolor="white",
        )  # fmt: skip
    left.set(xlabel="bend (°)", ylabel="undecided (%)", title="Small bends", ylim=(0, 105))
    drawing.legend(*left.get_legend_handles_labels(), loc="outside lower left", ncols=2, fontsize=7)
    top = max(float(design.rates.max()) for design in shown)
    right.set(xticks=range(3), xticklabels=OUTLINES, ylabel="displacement (px/°)")
    right.set(title="How fast outlines start to move", ylim=(0, 1.3 * top))
    right.legend(fontsize=7, loc="upper left")
    return Figure(
        "small_bends",
        "The chamber whose image moves most, on images of small bends",
        "Left: images left undecided at small bends, the same bends, shake and noise for both "
        "chambers. Right: px per degree of bend of each outline as the finger starts to bend.",
        drawing,
    )
