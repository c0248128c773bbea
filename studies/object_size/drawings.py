"""The study's figures."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle, Polygon

from designopt.plot.figures import MARKERS, PALETTE, legend_below, new_figure
from designopt.study.results import Figure
from optics.chamber import bend_center_line
from studies.object_size.found import Found, Shown
from studies.object_size.spec import ObjectSizeSpec
from studies.object_size.statements import ERROR_MM
from studies.object_size.tables import counts

BLUE, VERMILION, GREEN = PALETTE[:3]
GLASS, SKIN = "#D8E6EE", "#F3D9C8"


def figures(spec: ObjectSizeSpec, found: Found) -> list[Figure]:
    """Every figure of the study."""
    return [
        grasps_figure(spec, found),
        pictures_figure(found),
        estimates_figure(spec, found),
        confusion_figure(spec, found),
        curve_figure(spec, found),
    ]


def grasps_figure(spec: ObjectSizeSpec, found: Found) -> Figure:
    """Finger, palm and bottle to scale."""
    columns = min(4, len(found.shown))
    rows = -(-len(found.shown) // columns)
    drawing, grid = new_figure(rows, columns, height=2.1 * rows + 0.5)
    reach = spec.palm + max(spec.bottles) / 2 + 4
    top = max(float(found.hand.length), spec.gap + max(spec.bottles)) + spec.finger_radius
    for axes in grid.flat[len(found.shown) :]:
        axes.set_axis_off()
    for axes, shown in zip(grid.flat, found.shown, strict=False):
        _grasp(axes, spec, found, shown, reach)
        axes.set(title=f"{shown.diameter:g} mm: bend {np.rad2deg(shown.bend):.0f}°")
        axes.set(xlim=(-spec.finger_radius - 4, reach), ylim=(min(spec.gap, 0) - 12, top + 4))
        axes.set(aspect="equal", xlabel="x (mm)")
        axes.grid(visible=False)
    for axes in grid[:, 0]:
        axes.set_ylabel("z (mm)")
    legend_below(drawing, most=5)
    return Figure(
        "grasps",
        "The finger around each bottle, to scale",
        "The plane in which the finger bends. Each bottle lies on the palm in its place and "
        "presses the finger's skin in as deep as in the mean.",
        drawing,
    )


def _grasp(axes: Axes, spec: ObjectSizeSpec, found: Found, shown: Shown, reach: float) -> None:
    arcs = jnp.linspace(0, found.hand.length, 101)
    line = bend_center_line(arcs, jnp.asarray(shown.bend), found.hand.length)
    across, along, turned = (np.asarray(part) for part in (line.across, line.along, line.turned))
    normal = spec.finger_radius * np.array([np.cos(turned), -np.sin(turned)])
    inner, outer = np.array([across, along]) + normal, np.array([across, along]) - normal
    round_tip = np.linspace(np.pi, 0, 31)
    end = turned[-1]
    # About the tip, from the outer side over the way ahead to the inner side.
    tip = np.array([across[-1], along[-1]])[:, None] + spec.finger_radius * (
        np.cos(round_tip) * np.array([[np.cos(end)], [-np.sin(end)]])
        + np.sin(round_tip) * np.array([[np.sin(end)], [np.cos(end)]])
    )
    skin = np.concatenate([outer, tip, inner[:, ::-1]], axis=1).T
    center = (spec.palm, spec.gap + shown.diameter / 2)
    axes.add_patch(Polygon(skin, facecolor=SKIN, edgecolor=VERMILION, label="finger"))
    axes.add_patch(
        Circle(center, shown.diameter / 2, facecolor=GLASS, edgecolor=BLUE, label="bottle")
    )
    axes.plot(across, along, "--", color="black", linewidth=0.9, label="centre line")
    axes.plot(
        [spec.finger_radius, reach], [spec.gap] * 2, color="0.35", linewidth=2.5, label="palm"
    )
    place = bend_center_line(jnp.asarray(shown.arc), jnp.asarray(shown.bend), found.hand.length)
    away = np.array([center[0] - float(place.across), center[1] - float(place.along)])
    way = away / np.hypot(*away) * float(found.hand.radius)
    touch = (float(place.across) + way[0], float(place.along) + way[1])
    axes.plot(*touch, "x", color="black", markeredgewidth=1.5, label="contact")


def pictures_figure(found: Found) -> Figure:
    """The paper's Fig. 13, and what the network is given."""
    drawing, grid = new_figure(2, len(found.shown), height=3.3)
    for column, shown in enumerate(found.shown):
        above, below = grid[:, column]
        above.imshow(shown.pixels)
        above.set_title(f"{shown.diameter:g} mm")
        rows, columns = shown.boundary.shape
        below.imshow(shown.boundary, cmap="gray", interpolation="nearest")
        below.set_title(f"boundaries, {columns} × {rows} px", fontsize=8)
        for axes in (above, below):
            axes.set(xticks=[], yticks=[])
            axes.grid(visible=False)
    return Figure(
        "pictures",
        "The chamber around each bottle (the paper's Fig. 13)",
        "Rendered frames with all effects, and below the boundaries between regions as the network "
        "takes them. The narrower the bottle, the farther the finger bends down in the image.",
        drawing,
    )


def estimates_figure(spec: ObjectSizeSpec, found: Found) -> Figure:
    """Estimated over true diameters, and where errors come from."""
    drawing, grid = new_figure(1, 2, height=3.9)
    left, right = grid[0]
    random, known = found.random, found.random.estimates.known
    truth = random.grasps.diameters[known]
    shown = np.concatenate([truth, random.diameters[known], [spec.least, spec.largest]])
    ends = np.array([shown.min() - 3, shown.max() + 3])
    left.fill_between(
        ends, ends - ERROR_MM, ends + ERROR_MM, color="0.9", label=f"± {ERROR_MM:g} mm"
    )
    left.plot(ends, ends, color="black", linewidth=0.9, label="as it is")
    left.plot(truth, random.diameters[known], "o", color=BLUE, markersize=3, label="a grasp")
    left.set(xlim=ends, ylim=ends, aspect="equal", title=f"{len(truth)} grasps")
    left.set(xlabel="diameter (mm)", ylabel="estimate (mm)")
    left.legend(loc="upper left")
    ways = (
        ("image and grasp", random.diameters, BLUE, "-"),
        ("grasp alone", random.by_true_bend, VERMILION, "--"),
        ("image alone", random.by_true_place, GREEN, "-."),
    )
    for name, diameters, color, style in ways:
        size = np.sort(np.abs(random.errors(diameters)))
        part = 100 * np.arange(1, len(size) + 1) / max(len(size), 1)
        right.plot(size, part, style, color=color, label=name)
    right.axvline(ERROR_MM, color="0.6", linewidth=0.9, linestyle=":")
    right.set(xlabel="absolute error (mm)", ylabel="grasps with no larger error (%)")
    right.set(title="What is off", xlim=(0, None), ylim=(0, 101))
    right.legend(loc="lower right")
    right.set_box_aspect(1)
    return Figure(
        "estimates",
        "Estimated diameters, and where their errors come from",
        "Right: errors of the estimates; by the true bend, where only the bottle's place and the "
        "depth of its imprint are not as assumed; and with both known, where only the bend found "
        f"on the image is off. Dotted: {ERROR_MM:g} mm.",
        drawing,
    )


def confusion_figure(spec: ObjectSizeSpec, found: Found) -> Figure:
    """Which bottle was taken for which."""
    table = counts(spec, found)
    drawing, grid = new_figure(1, 2, height=3.4, width_ratios=(1, 1.25))
    axes, right = grid[0]
    axes.imshow(table, cmap="Blues", vmin=0, vmax=spec.grasps, aspect="auto")
    for (row, column), count in np.ndenumerate(table):
        color = "white" if count > spec.grasps / 2 else "black"
        axes.text(column, row, str(count), ha="center", va="center", color=color)
    names = [f"{diameter:g}" for diameter in spec.bottles]
    axes.set(xticks=range(len(names) + 1), xticklabels=[*names, "none"])
    axes.set(yticks=range(len(names)), yticklabels=names)
    axes.set(xlabel="taken for (mm)", ylabel="bottle (mm)", title="Grasps by answer")
    axes.grid(visible=False)
    measured = found.bottles
    for number, diameter in enumerate(spec.bottles):
        own = (measured.grasps.diameters == diameter) & measured.estimates.known
        # Spread downwards by their order, so that points do not hide each other.
        height = number + np.linspace(-0.3, 0.3, int(own.sum()))
        right.plot(
            measured.diameters[own], height, MARKERS[number % len(MARKERS)],
            color=PALETTE[number % len(PALETTE)], markersize=3,
        )  # fmt: skip
        right.plot([diameter] * 2, [number - 0.4, number + 0.4], color="black", linewidth=0.9)
    for low, high in zip(spec.bottles, spec.bottles[1:], strict=False):
        right.axvline((low + high) / 2, color="0.6", linewidth=0.9, linestyle=":")
    right.set(yticks=range(len(names)), yticklabels=names, ylim=(len(names) - 0.4, -0.6))
    right.set(xlabel="estimate (mm)", title="Estimates of each bottle")
    return Figure(
        "confusion",
        "The bottles told apart",
        'Left: every grasp by the bottle nearest to its estimate; "none": no answer. Right: '
        "estimates, one after the other; black: true diameters; dotted: halfway between.",
        drawing,
    )


def curve_figure(spec: ObjectSizeSpec, found: Found) -> Figure:
    """Diameter over bend, and the resolution."""
    drawing, grid = new_figure(1, 2, height=3.4)
    left, right = grid[0]
    one = found.curve
    bottles = [size for size in spec.bottles if one.diameters[0] <= size <= one.diameters[-1]]
    bends, tip = np.rad2deg(one.bends), one.arcs >= float(found.hand.length)
    for axes, values in ((left, one.diameters), (right, np.abs(one.slopes))):
        axes.plot(bends[~tip], values[~tip], color=BLUE, label="touches before the tip")
        axes.plot(bends[tip], values[tip], "--", color=VERMILION, label="touches the tip")
        at = np.interp(bottles, one.diameters, values)
        where = np.interp(bottles, one.diameters, bends)
        axes.plot(where, at, "o", color="black", label="the bottles")
        axes.set_xlabel("bend (°)")
    for place, size in zip(where, bottles, strict=True):
        left.annotate(f"{size:g} mm", (place, size), (6, 3), textcoords="offset points")
    room = 0.15 * (bends.max() - bends.min())
    left.set(xlim=(bends.min() - room / 3, bends.max() + room))
    left.set(ylabel="diameter (mm)", title="Diameter over bend")
    right.set(ylabel="diameter per bend (mm/°)", title="What a degree of bend is worth")
    right.set_ylim(0, 1.1 * float(np.abs(one.slopes).max()))
    right.legend(loc="lower right")
    return Figure(
        "curve",
        "Diameter over bend",
        "A bottle in its place, pressed in as deep as in the mean. The less a degree is worth, the "
        "finer is the diameter for the same error of the bend.",
        drawing,
    )
