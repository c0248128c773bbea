"""The pictures of `designopt trace`: the section with its rays, and curves over a sweep."""

from __future__ import annotations

import math
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from designopt.io.files import replaced_when_complete
from designopt.plot.figures import PALETTE, style
from designopt.solution import Solution
from optics.plot.scene_figures import MOST_POSES, poses_figure, sweep_figure
from optics.visibility.scene_trace import SceneTrace
from optics.visibility.tracing import NOTHING
from optics.visibility.views import Pieces

RAY = PALETTE[4]
"""No path's colour."""


def save_section(trace: SceneTrace, path: Path) -> None:
    """Draw the section into a file: views and rays in the pose, or in poses spread over a sweep.

    Raises:
        UserError: the file cannot be written.
    """
    count = len(trace.angles_deg)
    chosen = np.unique(np.linspace(0, count - 1, MOST_POSES).round().astype(int))
    found = _nothing_seen(trace) if trace.views is None else trace.views.found
    with style():
        views = jax.tree.map(lambda leaf: leaf[chosen], found)
        figure = poses_figure(trace.scene, np.deg2rad(trace.angles_deg[chosen]), views)
        for axes, pose in zip(figure.axes, chosen, strict=True):
            _add_rays(axes, trace, int(pose))
        _save(figure, path)


def save_chart(trace: SceneTrace, path: Path) -> None:
    """Draw coverage, redundancy and resolution over the swept angles into a file.

    Raises:
        UserError: the file cannot be written, or other than one or two angles are swept.
    """
    assert trace.views is not None
    with style():
        poses, views = np.deg2rad(trace.angles_deg), trace.views
        _save(sweep_figure(trace.scene, poses, views.found, views.sharpness.px_per_mm), path)


def _save(figure: Figure, path: Path) -> None:
    with replaced_when_complete(path) as partial:
        figure.savefig(partial)


def _nothing_seen(trace: SceneTrace) -> Solution[Pieces]:
    """The views of a scene without pads."""

    def empty(*shape: int, kind: type = float) -> Array:
        return jnp.zeros((len(trace.angles_deg), 0, 1, *shape), kind)

    pieces = Pieces(
        present=empty(kind=bool),
        path=empty(kind=int),
        start=empty(),
        end=empty(),
        start_label=empty(kind=int),
        end_label=empty(kind=int),
        pixels=empty(2),
        px_per_mm=empty(2),
        distance=empty(2),
        spans=empty(trace.bounces, 2),
    )
    return Solution(pieces, empty(), empty(), None)


def _add_rays(axes: Axes, trace: SceneTrace, pose: int) -> None:
    """Draw the rays that were asked for, as far as the axes reach."""
    if trace.hits is None:
        return
    far = math.hypot(*np.ptp([axes.get_xlim(), axes.get_ylim()], axis=1))
    for ray, (x, y, direction) in enumerate(trace.rays.tolist()):
        surface, places, directions, reflected = (
            leaf[pose, ray]
            for leaf in (
                trace.hits.surface,
                trace.hits.place,
                trace.hits.direction,
                trace.hits.reflected,
            )
        )
        met = surface != NOTHING
        corners = np.vstack([[x, y], places[met]])
        heading = np.vstack(
            [
                [math.cos(math.radians(direction)), math.sin(math.radians(direction))],
                directions[met],
            ]
        )[-1]
        if not met.all() and reflected[met][-1:].all():  # it goes on, and meets nothing
            corners = np.vstack([corners, corners[-1] + far * heading])
        line = Line2D(*corners.T, color=RAY, linewidth=0.9, zorder=3.5, gid=f"ray:{ray}")
        start = Line2D([x], [y], color=RAY, marker="o", markersize=3, linestyle="none")
        start.set_zorder(6)
        for artist in (line, start):
            axes.add_artist(artist)
