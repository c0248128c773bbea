"""The study's figures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure

from designopt import Records
from designopt.plot.figures import PALETTE, label_plainly, legend_below, new_figure, share_limits
from designopt.study import plots
from perception.chamber import find_regions
from perception.posture import PostureEstimator, make_boundary_image, shrink
from studies.bending_posture.trainings import EQUAL, OURS, Data, Trained
from studies.models.soft_finger.finger import DOWN, SoftFinger
from studies.models.soft_finger.samples import Size
from studies.models.soft_finger.spec import CLEARANCE

BLUE, VERMILION, GREEN = PALETTE[:3]
MARKERS = ("marker 1", "marker 2", "tip")
COMPARED = {EQUAL: "without loss weights", OURS: "with loss weights"}
REGIONS = ListedColormap(["white", "#C0392B", BLUE, "#E0A800", "#555555"])
SHOWN_DEG = (0.0, 30.0, 60.0, 100.0)


def draw_pictures(finger: SoftFinger, size: Size, seed: int) -> Figure:
    """From pictures to what enters the network."""
    drawing, grid = new_figure(3, len(SHOWN_DEG), height=4.6)
    images = finger.renderer(seed).render(finger.postures(np.deg2rad(SHOWN_DEG), DOWN))
    for column, bend, image in zip(grid.T, SHOWN_DEG, images, strict=True):
        labels = find_regions(image.pixels).nested()
        column[0].imshow(image.pixels)
        column[0].set_title(f"{bend:g}°")
        column[1].imshow(labels, cmap=REGIONS, vmin=0, vmax=4, interpolation="nearest")
        small = shrink(make_boundary_image(labels), size)
        column[2].imshow(small, cmap="gray_r", interpolation="nearest")
        for axes in column:
            axes.set(xticks=[], yticks=[])
            axes.grid(visible=False)
    for axes, name in zip(grid[:, 0], ("picture", "regions", "boundaries"), strict=True):
        axes.set_ylabel(name)
    return drawing


def draw_dots(networks: Mapping[str, Sequence[Trained]], data: Data) -> Figure:
    """The paper's Fig. 10: predicted dots on true ones."""
    drawing, [row] = new_figure(1, 2, height=4.0)
    for axes, (way, title) in zip(row, COMPARED.items(), strict=True):
        predicted = networks[way][0].predicted
        axes.plot(*data.unseen.markers.reshape(-1, 2).T, "o", color="0.75", label="true")
        for i, (name, color) in enumerate(zip(MARKERS, (GREEN, BLUE, VERMILION), strict=True)):
            axes.plot(*predicted[:, i].T, ".", color=color, markersize=2.5, label=name)
        axes.plot(0, 0, "s", color="black", markersize=5)
        axes.set(title=title, xlabel="across (mm)", ylabel="along (mm)", aspect="equal")
    share_limits(row)
    legend_below(drawing, most=4, markerscale=2)
    return drawing


def draw_markers(errors: Records) -> Figure:
    """The paper's Fig. 11: errors by marker."""
    drawing, [[axes]] = new_figure(height=3.2)
    how = {"widths": 0.28, "whis": (5, 95), "showfliers": False, "patch_artist": True}
    for i, (way, title) in enumerate(COMPARED.items()):
        style = {"color": (BLUE, VERMILION)[i]}
        own = [own["error_mm"] for own in errors.where(way=way).group("marker").values()]
        props = {f"{part}props": style for part in ("whisker", "cap", "median")}
        props["boxprops"] = {"facecolor": "white", "edgecolor": style["color"], "hatch": i * "///"}
        places = np.arange(3) + 0.36 * i - 0.18
        axes.boxplot(own, positions=places, manage_ticks=False, **how, **props)
        axes.plot([], [], "s", **style, markerfacecolor="white", label=title)
    axes.set(xticks=range(3), xticklabels=MARKERS, ylabel="error (mm)", ylim=(0, None))
    return drawing


def draw_learning(estimators: Sequence[PostureEstimator], mean: float) -> Figure:
    """Loss and tip error, epoch by epoch."""
    rows, names = Records(), {"seconds": "time (s)", "loss": "weighted loss, Eq. 4 (mm²)"}
    names["tip_mm"] = "mean tip error, unseen (mm)"
    for record in (one.record for one in estimators):
        columns = {"seconds": record.seconds, "loss": record.loss, "tip_mm": record.tip_error}
        rows.add(seed=f"seed {record.settings.seed}", **columns)
    drawing = plots.lines(rows, "seconds", ["loss", "tip_mm"], by="seed", log="y", names=names)
    drawing.axes[1].axhline(mean, color="0.4", linestyle=":", label="mean of the labels")
    return drawing


def draw_ways(tips: Records, mean: float) -> Figure:
    """Ways of training against each other."""
    drawing, [[axes]] = new_figure(height=3.2)
    of = {way: own["tip_mean_mm"] for way, own in tips.group("way").items()}
    for number, own in enumerate(of.values()):
        axes.plot(own, np.full(len(own), number), "o", color=BLUE, alpha=0.7)
        axes.plot(own.mean(), number, "|", color="black", markersize=14)
    axes.axvline(mean, color="0.4", linestyle=":", label="mean of the labels")
    axes.set(xscale="log", yticks=range(len(of)), yticklabels=list(of))
    label_plainly(axes.xaxis)
    axes.set(xlabel="mean tip error on unseen images (mm)", ylim=(len(of) - 0.5, -0.5))
    return drawing


def draw_bends(errors: Records) -> Figure:
    """Errors over the bend."""
    drawing, [[axes]] = new_figure(height=3.0)
    own = errors.where(way=OURS, marker="tip", seed=errors["seed"][0])
    axes.plot(own["bend_deg"], own["error_mm"], ".", color=BLUE, markersize=4)
    axes.set(xlabel="bend (°)", ylabel="tip error (mm)", ylim=(0, None))
    return drawing


def draw_regularisation(sweep: Records, paper: Mapping[str, float]) -> Figure:
    """Tip error over the weight of the L2 regularisation, and where the paper's may lie."""
    names = {"regularisation": "L2 regularisation, of standardised labels"}
    names["tip_mean_mm"] = "mean tip error on unseen images (mm)"
    drawing = plots.lines(sweep, *names, log="xy", names=names, height=3.8)
    for i, (unit, value) in enumerate(paper.items(), 1):
        label = f"the paper's 0.01, {unit if unit == 'standardised' else 'in ' + unit}"
        drawing.axes[0].axvline(value, color=PALETTE[i], linestyle=plots.DASHES[i], label=label)
    return drawing


def draw_etas(etas: Records) -> Figure:
    """Chambers of different η."""
    names = {
        "tip_mm": "mean tip error (mm)",
        "clearance_mm": "room, Δl_A − |Δl_D| (mm)",
        "blue_px": "width of the blue ring (px)",
        "yellow_px": "width of the yellow ring (px)",
    }
    columns, names = list(names), names | {"eta": "η, yellow over blue"}
    drawing = plots.lines(etas, "eta", columns, names=names, height=5.0)
    tips, room, *_ = drawing.axes
    tips.plot(etas["eta"], etas["tip_mm"], ".", color="0.5", label="one seed")
    room.axhline(CLEARANCE, color="0.4", linestyle=":", label=f"room of {CLEARANCE:g} mm")
    return drawing
