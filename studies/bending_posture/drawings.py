"""The study's figures."""

from __future__ import annotations

import statistics

import numpy as np
from matplotlib.colors import ListedColormap
from matplotlib.ticker import MaxNLocator

from designopt.plot.figures import (
    MARKERS,
    PALETTE,
    label_plainly,
    legend_below,
    new_figure,
    share_limits,
)
from designopt.plot.typesetting import as_mathtext
from designopt.study.results import Figure
from studies.bending_posture.found import Found
from studies.bending_posture.spec import BendingPostureSpec
from studies.bending_posture.trainings import EQUAL, OURS
from studies.bending_posture.verdicts import ROOM_MM

BLUE, VERMILION, GREEN = PALETTE[:3]
NAMES = ("marker 1", "marker 2", "tip")
COMPARED = ((EQUAL, "without loss weights"), (OURS, "with loss weights"))
REGIONS = ListedColormap(["white", "#C0392B", BLUE, "#E0A800", "#555555"])


def figures(spec: BendingPostureSpec, found: Found) -> list[Figure]:
    """Every figure of the study."""
    drawn = [
        pictures_figure(found),
        dots_figure(found),
        markers_figure(found),
        learning_figure(found),
        ways_figure(found),
        bends_figure(found),
    ]
    if found.sweep:
        drawn.append(regularisation_figure(found))
    return drawn + ([etas_figure(found)] if found.etas else [])


def pictures_figure(found: Found) -> Figure:
    """From pictures to what the network sees."""
    drawing, grid = new_figure(3, len(found.shown), height=4.6)
    for column, shown in zip(grid.T, found.shown, strict=True):
        column[0].imshow(shown.pixels)
        column[0].set_title(f"{shown.bend_deg:g}°")
        column[1].imshow(shown.labels, cmap=REGIONS, vmin=0, vmax=4, interpolation="nearest")
        column[2].imshow(shown.small, cmap="gray_r", interpolation="nearest")
        for axes in column:
            axes.set(xticks=[], yticks=[])
            axes.grid(visible=False)
    for axes, name in zip(grid[:, 0], ("picture", "regions", "boundaries"), strict=True):
        axes.set_ylabel(name)
    columns, rows = found.trained[OURS][0].estimator.record.image_size
    return Figure(
        "pictures",
        "From a picture to what the network sees",
        f"Frames with all effects, their regions, and the boundary image of {columns} × {rows} px; "
        "pixels of mixed colours and highlights belong to no region.",
        drawing,
    )


def dots_figure(found: Found) -> Figure:
    """The paper's Fig. 10: predicted dots on true ones."""
    drawing, grid = new_figure(1, 2, height=4.0)
    for axes, (way, title) in zip(grid[0], COMPARED, strict=True):
        one = found.trained[way][0]
        for i, (name, color) in enumerate(zip(NAMES, (GREEN, BLUE, VERMILION), strict=True)):
            true = found.data.unseen.markers[:, i]
            axes.plot(*true.T, "o", color="0.75", markersize=4)
            axes.plot(*one.predicted[:, i].T, ".", color=color, markersize=2.5, label=name)
        axes.plot([], [], "o", color="0.75", label="true")
        axes.plot(0, 0, "s", color="black", markersize=5)
        axes.set(title=title, xlabel="across (mm)", ylabel="along (mm)", aspect="equal")
    share_limits(grid[0])
    legend_below(drawing, most=4,
                   markerscale=2)  # fmt: skip
    return Figure(
        "dots",
        "Predicted markers on true ones (the paper's Fig. 10)",
        "Places relative to the marker nearest the camera (black square) on unseen images, one "
        "network each.",
        drawing,
    )


def markers_figure(found: Found) -> Figure:
    """The paper's Fig. 11: errors by marker."""
    drawing, grid = new_figure(1, 1, height=3.2)
    axes = grid[0, 0]
    for number, ((way, title), color) in enumerate(zip(COMPARED, (BLUE, VERMILION), strict=True)):
        errors = np.concatenate([one.errors for one in found.trained[way]])
        drawn = axes.boxplot(
            [errors[:, i] for i in range(3)], positions=np.arange(3) + 0.36 * number - 0.18,
            widths=0.28, whis=(5, 95), showfliers=False, patch_artist=True, manage_ticks=False,
        )  # fmt: skip
        for box in drawn["boxes"]:
            box.set(facecolor="white", edgecolor=color, hatch="///" if number else "", label=title)
        for line in (*drawn["whiskers"], *drawn["caps"], *drawn["medians"]):
            line.set(color=color)
    axes.set(xticks=range(3), xticklabels=NAMES, ylabel="error (mm)", ylim=(0, None))
    handles, labels = axes.get_legend_handles_labels()
    axes.legend(handles[::3], labels[::3], loc="upper left")
    return Figure(
        "markers",
        "Error by marker, without and with loss weights (the paper's Fig. 11)",
        "Unseen images of all seeds; boxes from the 25th to the 75th percentile, whiskers from the "
        "5th to the 95th.",
        drawing,
    )


def learning_figure(found: Found) -> Figure:
    """Loss and tip error, epoch by epoch."""
    drawing, grid = new_figure(1, 2, height=3.2)
    left, right = grid[0]
    for one, color, style in zip(
        found.trained[OURS], (BLUE, VERMILION, GREEN, *PALETTE[3:]), ("-", "--", "-.") * 4,
        strict=False,
    ):  # fmt: skip
        record = one.estimator.record
        epochs = np.arange(1, len(record.loss) + 1)
        label = f"seed {record.settings.seed}"
        left.semilogy(epochs, record.loss, style, color=color, label=label)
        right.semilogy(record.seconds, record.tip_error, style, color=color, label=label)
    right.axhline(found.data.mean_error, color="0.4", linestyle=":")
    right.text(0.02, 0.92 * found.data.mean_error, "mean of the labels", va="top", color="0.3",
               transform=right.get_yaxis_transform())  # fmt: skip
    label_plainly(left.yaxis)
    label_plainly(right.yaxis)
    left.xaxis.set_major_locator(MaxNLocator(integer=True))
    left.set(xlabel="epoch", ylabel="weighted loss, Eq. 4 (mm²)", title="Training")
    right.set(
        xlabel="time (s)", ylabel="mean tip error (mm)", title="Unseen images", xlim=(0, None)
    )
    left.legend()
    return Figure(
        "learning",
        "Learning curves",
        "Left: the paper's Eq. 4 over the samples, epoch by epoch. Right: the tip error on unseen "
        "images over the time of training, from its start, what is compiled included.",
        drawing,
    )


def ways_figure(found: Found) -> Figure:
    """Ways of training against each other."""
    drawing, grid = new_figure(1, 1, height=3.2)
    axes = grid[0, 0]
    names = list(found.trained)
    for number, way in enumerate(names):
        tips = found.tips(way)
        axes.plot(tips, [number] * len(tips), MARKERS[0], color=BLUE, alpha=0.7)
        axes.plot(statistics.mean(tips), number, "|", color="black", markersize=14)
    axes.axvline(found.data.mean_error, color="0.4", linestyle=":")
    axes.text(found.data.mean_error * 0.95, len(names) / 2 - 0.5, "mean of the labels",
              rotation=90, va="center", ha="right", color="0.3")  # fmt: skip
    axes.set(xscale="log", yticks=range(len(names)), yticklabels=names)
    label_plainly(axes.xaxis)
    axes.set(xlabel="mean tip error on unseen images (mm)", ylim=(len(names) - 0.5, -0.5))
    return Figure(
        "ways",
        "Ways of training",
        "Every dot is a training from another seed, the bar their mean. “Weighted” is the "
        "study's own; each other way differs from it in what its name says. In the paper the "
        "learning rate is kept and the L2 regularisation is 0.01, of a loss in a unit not said.",
        drawing,
    )


def bends_figure(found: Found) -> Figure:
    """Errors over the bend."""
    drawing, grid = new_figure(1, 1, height=3.0)
    axes = grid[0, 0]
    one = found.trained[OURS][0]
    axes.plot(np.rad2deg(found.data.unseen.bends), one.errors[:, -1], ".", color=BLUE, markersize=4)
    axes.set(xlabel="bend (°)", ylabel="tip error (mm)", ylim=(0, None))
    return Figure(
        "bends",
        "Tip error over the bend",
        "Unseen images of one network, some with something pressed into the wall.",
        drawing,
    )


def regularisation_figure(found: Found) -> Figure:
    """What the weight of the L2 regularisation does, and where the paper's may lie."""
    drawing, grid = new_figure(1, 1, height=3.2)
    axes = grid[0, 0]
    axes.loglog(*zip(*found.sweep, strict=True), "-o", color=BLUE)
    for unit, value in found.paper.items():
        axes.axvline(value, color=VERMILION, linestyle="--", linewidth=1)
        axes.text(value, 1.02, f"0.01 {unit if unit == 'standardised' else 'in ' + unit}",
                  color=VERMILION, ha="center", fontsize=8,
                  transform=axes.get_xaxis_transform())  # fmt: skip
    label_plainly(axes.yaxis)
    axes.set(xlabel="L2 regularisation, of standardised labels")
    axes.set(ylabel="mean tip error on unseen images (mm)")
    return Figure(
        "regularisation",
        "The weight of the regularisation, and what the paper's 0.01 may be",
        "One training each. Dashed: the paper's 0.01, if its loss is in mm, of standardised labels "
        "or in finger lengths; the paper does not say.",
        drawing,
    )


def etas_figure(found: Found) -> Figure:
    """Chambers of different η."""
    drawing, grid = new_figure(1, 3, height=3.0)
    left, middle, right = grid[0]
    etas = [one.eta for one in found.etas]
    left.plot(etas, [statistics.mean(o.tip_errors) for o in found.etas], "-o", color=BLUE)
    for one in found.etas:
        left.plot([one.eta] * len(one.tip_errors), one.tip_errors, ".", color="0.5")
    left.set(title="Posture", ylabel="mean tip error (mm)")
    left.set_ylim(0, 1.1 * max(max(one.tip_errors) for one in found.etas))
    for i, (name, color, style) in enumerate(
        (("blue ring", BLUE, "-o"), ("yellow ring", "#C79A00", "--s"))
    ):
        middle.plot(etas, [one.rings[i] for one in found.etas], style, color=color, label=name)
    middle.set(title="Image, straight", ylabel="width (px)", ylim=(0, None))
    middle.legend(loc="lower right")
    right.plot(etas, [one.clearance for one in found.etas], "-o", color=VERMILION)
    right.axhline(0, color="0.4", linewidth=0.9)
    right.axhline(ROOM_MM, color="0.4", linestyle=":")
    right.text(1, ROOM_MM, f"{ROOM_MM:g} mm", ha="right", va="bottom", color="0.3",
               transform=right.get_yaxis_transform())  # fmt: skip
    right.set(title="Room at D", ylabel=as_mathtext("Δl_A − |Δl_D| (mm)"))
    for axes in (left, middle, right):
        axes.set_xlabel("η, yellow over blue")
    return Figure(
        "etas",
        "Chambers of different η",
        "Left: networks trained on their images, dots are seeds. Middle: how wide their rings are "
        "imaged. Right: the paper's criterion, what |Δl_D| leaves inside Δl_A; dotted: the room "
        "asked for in table1.",
        drawing,
    )
