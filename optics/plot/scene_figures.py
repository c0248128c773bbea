"""Figures of a scene: its views in several poses, and coverage and resolution over a sweep."""

from __future__ import annotations

import math
from typing import Any

import jax
import numpy as np
from jaxtyping import Array, Float
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from designopt.errors import UserError
from designopt.plot.figures import PALETTE, legend_below, new_figure, trim
from designopt.plot.typesetting import drawn_name
from designopt.solution import Solution
from optics.plot.scene_drawing import DASHES, draw_scene, joint_name, scene_legend, widen
from optics.plot.section import Section
from optics.scene.scene import Scene
from optics.visibility.views import Pieces

Poses = Float[Array | np.ndarray, "poses joints"]
Curves = Float[np.ndarray, "poses pads"]

MOST_POSES, COLUMNS = 6, 3
"""Panels of a figure of poses, and how many stand side by side."""
TALLEST = 6.5
"""Height of all panels together, in inches, so that a figure fits on a page."""

UNSEEN: dict[str, Any] = {"facecolor": "white", "edgecolor": "0.6", "hatch": "////"}
COLORS = "cividis"
"""J. R. Nuñez, C. R. Anderton, R. S. Renslow, PLoS ONE 13 (2018) e0199239: made for all eyes."""


def poses_figure(
    scene: Scene,
    poses: Poses,
    views: Solution[Pieces],
    *,
    rays: int = 4,
    labels: bool = True,
    columns: int | None = None,
) -> Figure:
    """The mirror visibility plot: a scene in several poses at one scale, with one legend.

    Args:
        scene: the scene.
        poses: joint angles in the order of ``scene.angle_names``, rad; one to six poses.
        views: what is seen in each of them.
        rays: how many rays are drawn to every piece that a path sees.
        labels: whether mirrors and pads are named.
        columns: how many panels stand side by side; by default up to three, and two of four.

    Raises:
        UserError: there are no poses or more than six.
    """
    poses = np.asarray(poses)
    count = len(poses)
    if not 1 <= count <= MOST_POSES:
        raise UserError(f"poses: a figure shows 1 to {MOST_POSES} poses, not {count}; choose some")
    columns = columns or (2 if count == 4 else min(count, COLUMNS))
    rows = math.ceil(count / columns)
    reach = np.vstack([Section.of(scene, pose).places() for pose in poses])
    width, height = np.ptp(reach, axis=0)
    panel = min(6.6 / columns * max(height / max(width, 1e-9), 0.3), TALLEST / rows)
    figure, grid = new_figure(rows, columns)
    lines = legend_below(figure, *scene_legend(scene, views), most=5)
    figure.set_figheight(rows * (panel + 0.5) + 0.2 * lines + 0.2)
    for axes in grid.ravel()[count:]:
        axes.remove()
    panels = grid.ravel()[:count]
    for index, axes in enumerate(panels):
        axes.set_aspect("equal")
        axes.set(title=" ", xlabel="x (mm)" if index + columns >= count else "")
        axes.set(ylabel="" if index % columns else "y (mm)")
        widen(axes, reach)
    trim(figure)  # labels look for room where the axes will be
    for index, axes in enumerate(panels):
        outer = {"xlabel": axes.get_xlabel(), "ylabel": axes.get_ylabel()}
        one = jax.tree.map(lambda leaf, index=index: leaf[index], views)
        draw_scene(axes, scene, poses[index], one, rays=rays, labels=labels)
        axes.set(**outer)
    return figure


def sweep_figure(
    scene: Scene,
    poses: Poses,
    views: Solution[Pieces],
    px_per_mm: Float[np.ndarray, "poses pads 3"],
) -> Figure:
    """Coverage, redundancy and resolution of every pad over joint angles.

    Over a sweep of one angle (others may be swept with it) curves; over a grid of two angles
    maps of coverage and least resolution.

    Args:
        scene: the scene.
        poses: joint angles in the order of ``scene.angle_names``, rad; in any order.
        views: what is seen in each of them.
        px_per_mm: resolution of what is seen; see `Sharpness`.

    Raises:
        UserError: the poses are neither a sweep of one angle nor a grid of two.
    """
    poses = np.degrees(np.asarray(poses))
    varying = np.flatnonzero(np.ptp(poses, axis=0) > 0) if len(poses) else np.zeros(0, int)
    coverage = 100 * np.asarray(views.value.coverage())
    least, _, greatest = np.moveaxis(np.where(px_per_mm > 0, px_per_mm, np.nan), -1, 0)
    if varying.size:
        first = poses[:, varying[0]]
        if len(np.unique(first)) == len(first):
            order = np.argsort(first)
            redundancy = np.asarray(views.value.redundancy())
            measures = [part[order] for part in (coverage, redundancy, least, greatest)]
            return _curves(scene, poses[order], varying, measures)
    if varying.size == 2:
        columns = [np.unique(poses[:, column]) for column in varying]
        if len(poses) == len(columns[0]) * len(columns[1]):
            order = np.lexsort(poses[:, varying[::-1]].T)
            shape = (len(columns[0]), len(columns[1]), -1)
            maps = [part[order].reshape(shape) for part in (coverage, least)]
            names = [scene.angle_names[column] for column in varying]
            return _maps(scene, names, columns, maps)
    raise UserError("poses: a figure shows a sweep of one joint angle or a grid of two")


def _curves(scene: Scene, poses: np.ndarray, varying: np.ndarray, measures: list[Curves]) -> Figure:
    """Measures of every pad over one joint angle, from above to below."""
    coverage, redundancy, least, greatest = measures
    figure, grid = new_figure(3, 1, height=6.4)
    upper, middle, lower = grid[:, 0]
    abscissa, pads = poses[:, varying[0]], scene.layout.pads
    for level, part in enumerate(pads):
        look: dict[str, Any] = {
            "color": PALETTE[level % len(PALETTE)],
            "linestyle": DASHES[level % len(DASHES)],
            # Earlier curves are wider, to show below later ones.
            "linewidth": min(1.3 + 0.8 * (len(pads) - 1 - level), 3.0),
        }
        upper.plot(
            abscissa,
            coverage[:, level],
            label=drawn_name(part.name),
            gid=f"coverage:{part.name}",
            **look,
        )
        middle.plot(abscissa, redundancy[:, level], gid=f"views:{part.name}", **look)
        band = abscissa, least[:, level], greatest[:, level]
        lower.fill_between(*band, color=look["color"], alpha=0.12, linewidth=0)
        lower.plot(abscissa, least[:, level], gid=f"least:{part.name}", **look)
        look["linewidth"] = 0.8
        lower.plot(abscissa, greatest[:, level], gid=f"greatest:{part.name}", **look)
    units = ("coverage (%)", "number of views", "resolution (px/mm)")
    titles = (
        "Part of each pad that is seen",
        "Number of paths by which a point is seen, on average",
        "Least (lower edge) and greatest (upper edge) resolution, each point in its best view",
    )
    for axes, title, unit in zip(grid[:, 0], titles, units, strict=True):
        axes.set(title=title, ylabel=unit, xlim=(abscissa[0], abscissa[-1]))
        axes.xaxis.set_major_locator(MaxNLocator(9, steps=[1, 1.5, 2, 3, 4.5, 5, 6, 9, 10]))
    low = _floor(coverage)
    room = (100 - low) / 20
    upper.set_ylim(low - room, 100 + room)
    middle.set_ylim(0, 1.08 * max(redundancy.max(), 1))
    lower.set_ylim(0, 1.08 * _span(greatest)[1])
    names = [joint_name(scene.angle_names[column]) for column in varying]
    note = f"; {', '.join(names[1:])} varying with it" if names[1:] else ""
    lower.set_xlabel(drawn_name(f"{names[0]} (°){note}"))
    legend_below(figure, most=5, handlelength=3.5)
    return figure


def _maps(
    scene: Scene, names: list[str], columns: list[np.ndarray], measures: list[np.ndarray]
) -> Figure:
    """Coverage and least resolution over two joint angles, one panel per pad and measure."""
    pads, units = scene.layout.pads, ("coverage (%)", "least resolution (px/mm)")
    across = min(len(pads), COLUMNS)
    down = math.ceil(len(pads) / across)
    figure, grid = new_figure(2 * down, across, height=2 * down * 6.2 / across + 0.4)
    for axes in grid.ravel():
        axes.set_visible(False)
    limits = ((_floor(measures[0]), 100.0), _span(measures[1]))
    for number, (values, unit, (low, high)) in enumerate(zip(measures, units, limits, strict=True)):
        panels = grid[number * down : (number + 1) * down].ravel()[: len(pads)]
        mappable = ScalarMappable(Normalize(low, high), COLORS)
        for axes, part, value in zip(panels, pads, np.moveaxis(values, -1, 0), strict=True):
            axes.set_visible(True)
            axes.grid(visible=False)
            # What is not seen has no resolution: the ground shows there.
            axes.patch.set(**UNSEEN)
            mesh = axes.pcolormesh(
                *columns, value.T, norm=mappable.norm, cmap=COLORS, shading="nearest"
            )
            mesh.set(rasterized=True, gid=f"{unit}:{part.name}")
            there = value[np.isfinite(value)]
            note = f"{there.min():.3g} to {there.max():.3g}" if there.size else "nothing seen"
            axes.set_title(drawn_name(f"{part.name}: {note}"))
            along, up = (drawn_name(f"{joint_name(name)} (°)") for name in names)
            axes.set(xlabel=along, ylabel=up)
            if down == 1:
                axes.label_outer()
        figure.colorbar(mappable, ax=list(panels), aspect=30, pad=0.02, label=unit)
    if np.any(np.isnan(measures[1])):
        unseen = Patch(label="nothing seen", **UNSEEN)
        figure.legend(handles=[unseen], loc="outside lower center")
    return figure


def _floor(coverage: np.ndarray) -> float:
    """Where a scale of coverage begins, in %: so that 100 % always looks the same."""
    return min(10 * math.floor(float(coverage.min()) / 10), 90.0)


def _span(values: np.ndarray) -> tuple[float, float]:
    """Least and greatest of values that are there, apart even if they are one."""
    there = values[np.isfinite(values)]
    low, high = (float(there.min()), float(there.max())) if there.size else (0.0, 1.0)
    return (low, high) if high > low else (0.95 * low, 1.05 * high)
