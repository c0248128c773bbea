"""Figures of a motion: its curves, and its margins and transmission angles."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import jax
import numpy as np
from jaxtyping import Array, Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.legend_handler import HandlerTuple
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from designopt.errors import UserError
from designopt.plot.figures import new_figure, trim
from designopt.plot.typesetting import drawn_name
from designopt.solution import Solution
from kinematics.model.linkage import Linkage
from kinematics.model.topology import Structure
from kinematics.plot.drawing import CURVES, ROOM, body_colors, draw_pose, widen
from kinematics.plot.scene import Points, Travel, traced_joints
from kinematics.plot.symbols import GRAY, tint
from kinematics.solve.solver import Pose

Inputs = Float[Array | np.ndarray, "poses inputs"]

GHOST_POSES = 5


def good_poses(linkage: Linkage, poses: Solution[Pose]) -> np.ndarray:
    """Numbers of the poses that are ok.

    Raises:
        UserError: there is none; the line has the reason of the first.
    """
    good = np.flatnonzero(np.asarray(poses.ok))
    if good.size == 0:
        first = jax.tree.map(lambda leaf: leaf[:1], poses).messages()
        reason = first[0] if first else "There are no poses."
        raise UserError(f"no pose of '{linkage.structure.name}' to draw: {reason}")
    return good


def pose_at(poses: Solution[Pose], index: int) -> Pose:
    """One of several poses."""
    return jax.tree.map(lambda leaf: np.asarray(leaf)[index], poses.value)


def travel_of(poses: Solution[Pose]) -> Travel:
    """Between which values each slider moves in the poses that are ok, mm."""
    good = np.asarray(poses.ok)
    slides = {index: np.asarray(slide)[good] for index, slide in poses.value.slides.items()}
    return {index: (float(slide.min()), float(slide.max())) for index, slide in slides.items()}


def path_of(poses: Solution[Pose], joint: str) -> Points:
    """A joint's curve, mm; NaN where the pose is not ok, so that a line has a gap there."""
    place = poses.value.joints[joint]
    path = np.stack([np.asarray(place.x), np.asarray(place.y)], axis=-1)
    return np.where(np.asarray(poses.ok)[:, None], path, np.nan)


def motion_figure(
    linkage: Linkage,
    inputs: Inputs,
    poses: Solution[Pose],
    traced: Sequence[str] | None = None,
    *,
    ghosts: int = GHOST_POSES,
) -> Figure:
    """The pose nearest to the sketch, a few faint ones, and the curves of joints.

    Args:
        linkage: the linkage.
        inputs: values of the inputs, rad or mm.
        poses: their solution; what is not ok is left out.
        traced: joints whose curves are drawn; by default those that move otherwise than about a
            fixed pivot or on a fixed line, or if there is none, all that move.
        ghosts: how many faint poses.

    Raises:
        UserError: no pose is ok.
    """
    good = good_poses(linkage, poses)
    strong = int(good[np.argmin(_from_home(linkage, np.asarray(inputs)[good]))])
    structure = linkage.structure
    paths = {joint: path_of(poses, joint) for joint in traced or traced_joints(structure)}
    travel = travel_of(poses)
    reach = np.vstack([path_of(poses, joint)[good] for joint in structure.joints])
    wide, height = shape_of(reach)
    figure, grid = new_figure(height=height)
    axes = grid[0, 0]
    axes.set_title(drawn_name(structure.name))
    widen(axes, reach)
    for index in _spread(good[good != strong], ghosts):
        draw_pose(axes, linkage, pose_at(poses, index), faint=True)
    draw_paths(axes, structure, paths)
    _add_legend(figure, structure, list(paths), below=wide)
    trim(figure)  # labels look for a place where the axes will be
    clear_of = [path[good] for path in paths.values()]
    draw_pose(axes, linkage, pose_at(poses, strong), travel=travel, clear_of=clear_of)
    return figure


def shape_of(reach: Points) -> tuple[bool, float]:
    """Whether the legend goes below, and the figure's height in inches, for places in mm."""
    width, height = np.ptp(reach, axis=0) + 2 * ROOM * float(np.ptp(reach, axis=0).max())
    if height > 0.9 * width:
        return False, float(min(4.9 * height / width + 0.9, 6.6))
    return True, float(max(6.5 * height / width + 1.3, 2.4))


def _add_legend(
    figure: Figure, structure: Structure, traced: Sequence[str], *, below: bool
) -> None:
    """Say outside the axes what the colours mean: the moving bodies, and the curves."""
    colors = body_colors(structure)
    names = [part.name for part in structure.moving]
    handles: list[Any] = [Patch(fc=tint(colors[name]), ec=colors[name]) for name in names]
    if traced:
        shades = dict.fromkeys(_path_color(structure, joint) for joint in traced)
        handles.append(tuple(Line2D([], [], color=shade, linewidth=1.2) for shade in shades))
        names.append(f"path of {', '.join(traced)}")
    figure.legend(
        handles,
        [drawn_name(name) for name in names],
        handler_map={tuple: HandlerTuple(ndivide=None, pad=0.0)},
        loc="outside lower center" if below else "outside right upper",
        ncols=min(len(names), 5) if below else 1,
    )


def _from_home(linkage: Linkage, inputs: Float[np.ndarray, "poses inputs"]) -> np.ndarray:
    """How far inputs are from the sketch's, angles without whole turns, slides in sizes."""
    away = inputs - np.asarray(linkage.reference.inputs)
    size = float(linkage.size())
    for column, part in enumerate(linkage.structure.inputs):
        turn = np.remainder(away[:, column] + np.pi, 2 * np.pi) - np.pi
        away[:, column] = turn if part.slider is None else away[:, column] / size
    return np.sum(away * away, axis=-1)


def _spread(indices: np.ndarray, count: int) -> list[int]:
    """So many of the indices, evenly spread, without the last, which often is the first again."""
    picked = np.linspace(0, len(indices), count, endpoint=False).astype(int)
    return sorted({int(indices[i]) for i in picked}) if len(indices) else []


def draw_paths(axes: Axes, structure: Structure, paths: Mapping[str, Points]) -> None:
    """Draw joints' curves, each in the colour of a body that the joint belongs to."""
    for joint, path in paths.items():
        color = _path_color(structure, joint)
        axes.plot(*path.T, color=color, linewidth=1.2, zorder=CURVES, gid=f"path:{joint}")


def _path_color(structure: Structure, joint: str) -> str:
    """The colour of the last body that holds a joint: the one it carries, not its crank."""
    owners = [part.name for part in structure.moving if joint in part.joints]
    return body_colors(structure)[owners[-1]] if owners else GRAY
