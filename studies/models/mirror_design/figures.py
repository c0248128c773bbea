"""What designed mirrors show, as drawings; studies give them their words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from designopt.plot.figures import PALETTE, angle_ticks, new_figure
from optics.plot.scene_drawing import DASHES
from optics.plot.scene_figures import COLORS, UNSEEN, poses_figure
from optics.scene.scene import Scene
from studies.models.finger_parts import PHALANGES
from studies.models.mirror_design.judging import Square, Verdict
from studies.models.mirror_design.seeing import best_resolution, pad_lengths, together
from studies.models.mirror_design.yields import STEPS, Sensitivity, Yield

PARTS = (0.0, 1 / 3, 2 / 3, 1.0)
"""Of the range of both joints, at which the finger is drawn: open, about the hand-overs, closed."""

PLACES = 161


def moving_pads(scene: Scene) -> dict[str, str]:
    """The pads that move against the camera, each with the joint next to it on the camera's side.

    Example:
        >>> from studies.models.finger_file import packaged_finger
        >>> moving_pads(packaged_finger().scene())
        {'proximal': 'PIP', 'distal': 'DIP'}
    """
    layout = scene.layout
    pads = [pad.name for pad in layout.pads if pad.frame != layout.camera_frame]
    return dict(zip(pads, map(str.upper, layout.angles), strict=True))


def drawn_postures(verdict: Verdict) -> list[int]:
    """Indices of the degrees of both joints at which `draw_views` shows the finger."""
    return [round(part * (len(verdict.degrees) - 1)) for part in PARTS]


def draw_views(scene: Scene, verdict: Verdict) -> Figure:
    """The mirror visibility plot in four poses."""
    kept = np.array(drawn_postures(verdict))
    poses = together(jnp.deg2rad(jnp.asarray(verdict.degrees[kept])))
    return poses_figure(scene, poses, jax.tree.map(lambda leaf: leaf[kept], verdict.views))


def draw_coverage(squares: Mapping[str, Square], degrees: np.ndarray) -> Figure:
    """The pad that is seen least, for all pairs of joint angles, before and after."""
    drawing, grid = new_figure(1, len(squares), height=3.4)
    colors = ScalarMappable(Normalize(0, 100), COLORS)
    for index, (axes, (name, square)) in enumerate(zip(grid[0], squares.items(), strict=True)):
        least = 100 * np.min(square.coverage, axis=-1)
        _shade(axes, degrees, degrees, least, colors)
        low, high = (f"{value:.4g}" for value in (least.min(), least.max()))
        span = low if low == high else f"{low} to {high}"
        axes.set(title=f"{name}: {span} %", xlabel="PIP (°)")
        axes.set(ylabel="" if index else "DIP (°)", aspect="equal")
        axes.set(xticks=angle_ticks(degrees[-1], 6), yticks=angle_ticks(degrees[-1], 6))
    drawing.colorbar(colors, ax=list(grid[0]), label="coverage of the least seen pad (%)")
    return drawing


def _shade(axes: Axes, x: Any, y: Any, values: np.ndarray, colors: ScalarMappable) -> None:
    style = {"norm": colors.norm, "cmap": COLORS, "shading": "nearest"}
    axes.pcolormesh(x, y, values.T, rasterized=True, **style)
    axes.grid(visible=False)


def draw_resolution(scenes: Mapping[str, tuple[Scene, Verdict]]) -> Figure:
    """Resolution along `moving_pads` over their joints' angles, before and after."""
    [joints] = {tuple(moving_pads(scene).items()) for scene, _ in scenes.values()}
    drawing, grid = new_figure(len(scenes), len(joints), height=2.6 * len(scenes) + 0.5)
    places, pads = jnp.linspace(0, 1, PLACES), [PHALANGES.index(pad) for pad, _ in joints]
    maps = []
    for scene, verdict in scenes.values():
        views = jax.tree.map(jnp.asarray, verdict.views.value)
        best = np.asarray(best_resolution(views, pad_lengths(scene), places))[:, pads]
        maps.append(np.where(best > 0, best, np.nan))
    seen = np.concatenate([values[np.isfinite(values)] for values in maps])
    colors = ScalarMappable(LogNorm(max(seen.min(), 0.5), seen.max()), COLORS)
    for row, values, (name, (scene, verdict)) in zip(grid, maps, scenes.items(), strict=True):
        for column, (axes, (pad, _)) in enumerate(zip(row, joints, strict=True)):
            along = float(pad_lengths(scene)[pads[column]]) * np.asarray(places)
            axes.patch.set(**UNSEEN)
            _shade(axes, verdict.degrees, along, values[:, column], colors)
            there = values[:, column][np.isfinite(values[:, column])]
            note = f"{there.min():.3g} to {there.max():.3g} px/mm" if there.size else "nothing seen"
            axes.set(title=f"{name}, {pad}: {note}", xticks=angle_ticks(verdict.degrees[-1], 6))
        row[0].set_ylabel("along the pad (mm)")
    for axes, (_, joint) in zip(grid[-1], joints, strict=True):
        axes.set_xlabel(f"{joint} (°)")
    bar = drawing.colorbar(colors, ax=grid.ravel().tolist(), label="resolution (px/mm)")
    ticks = [tick for tick in (0.5, 1, 2, 5, 10, 20, 50) if seen.min() <= tick <= seen.max()]
    bar.set_ticks(ticks, labels=[f"{tick:g}" for tick in ticks])
    bar.minorticks_off()
    unseen = Patch(label="not seen", **UNSEEN)
    drawing.legend(handles=[unseen], loc="outside lower center")
    return drawing


def draw_sensitivity(found: Sensitivity, names: Sequence[str]) -> Figure:
    """What each error hides by itself, and what its tolerance does to the yield.

    Args:
        found: of the finger.
        names: of its errors.
    """
    drawing, grid = new_figure(1, 2, height=3.6, width_ratios=[1.6, 1])
    left, right = grid[0]
    _lines(left, STEPS, dict(zip(names, found.worst, strict=True)))
    left.set(xlabel="error (standard deviations)", ylabel="worst coverage (%)")
    left.set(title="One error at a time", xlim=(STEPS[0], STEPS[-1]))
    yields = {"as stated": found.base}
    yields |= {f"2 × {name}": one for name, one in found.doubled.items()}
    value, low, high = 100 * np.array([one[:3] for one in yields.values()]).T
    style: dict[str, Any] = {"color": PALETTE[0], "ecolor": "black", "capsize": 3, "height": 0.6}
    right.barh(list(yields), value, xerr=[value - low, high - value], **style)
    right.set(title="Yield, a tolerance doubled", xlabel="yield (%)", xlim=(0, 105))
    right.invert_yaxis()
    right.grid(visible=False, axis="y")
    return drawing


def _lines(axes: Axes, x: np.ndarray, parts: Mapping[str, np.ndarray]) -> None:
    for index, (name, part) in enumerate(parts.items()):
        style = {"color": PALETTE[index % len(PALETTE)], "linestyle": DASHES[index % len(DASHES)]}
        axes.plot(x, 100 * part, label=name, **style)


def draw_yield(
    yields: Mapping[str, Yield], degrees: np.ndarray, joints: Mapping[str, str]
) -> Figure:
    """In which postures draws fail, pad by pad.

    Args:
        yields: by what people read.
        degrees: of both joints, bent alike.
        joints: `moving_pads` of the finger.
    """
    drawing, grid = new_figure(1, 2, height=3.4)
    for axes, (pad, joint) in zip(grid[0], joints.items(), strict=True):
        column = PHALANGES.index(pad)
        named = {f"{name}: yield {100 * one.value:.1f} %": one for name, one in yields.items()}
        _lines(axes, degrees, {name: one.by_pose[:, column] for name, one in named.items()})
        axes.set(title=f"{pad} pad", xlabel=f"{joint} (°)", xticks=angle_ticks(degrees[-1], 6))
    grid[0, 0].set_ylabel("draws with the pad wholly seen (%)")
    lowest = min(float(np.min(one.by_pose)) for one in yields.values())
    for axes in grid[0]:
        axes.set_ylim(100 * lowest - 1, 100.5)
    return drawing
