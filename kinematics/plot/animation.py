"""A linkage in motion as a GIF or an MP4."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from matplotlib.animation import AbstractMovieWriter, FFMpegWriter, PillowWriter
from matplotlib.axes import Axes

from designopt.errors import UserError
from designopt.io.files import replaced_when_complete
from designopt.plot.figures import new_figure, style
from designopt.plot.typesetting import drawn_name
from designopt.solution import Solution
from kinematics.model.linkage import Linkage
from kinematics.model.topology import InputPart
from kinematics.plot.drawing import draw_pose, offsets_of, widen
from kinematics.plot.label_layout import turned
from kinematics.plot.motion_figures import (
    Inputs,
    draw_paths,
    good_poses,
    path_of,
    pose_at,
    shape_of,
    travel_of,
)
from kinematics.plot.scene import Scene, traced_joints
from kinematics.solve.solver import Pose

FPS = 20
DPI = 100
LABELED_POSES = 12
"""Poses in which the labels, which stand still relative to their bodies, are to keep clear."""


def save_animation(
    path: str | Path,
    linkage: Linkage,
    inputs: Inputs,
    poses: Solution[Pose],
    *,
    fps: int = FPS,
) -> None:
    """Write a linkage's motion, one frame per pose that is ok; the others are left out.

    The file appears when it is complete; one of that name is replaced.

    Args:
        path: ends with ``.gif`` or ``.mp4``.
        linkage: the linkage.
        inputs: values of the inputs, rad or mm.
        poses: their solution.
        fps: frames per second.

    Raises:
        UserError: another ending, no ffmpeg for an MP4, no pose that is ok, or a place that
            cannot be written.
    """
    path = Path(path)
    writer = _writer(path, fps)
    try:
        good = good_poses(linkage, poses)
    except UserError as error:
        raise UserError(f"{path}: {error}") from error
    with replaced_when_complete(path) as partial, style():
        film = _Film(linkage, np.asarray(inputs), poses, good)
        with writer.saving(film.figure, str(partial), DPI):
            for index in good:
                film.show(int(index))
                writer.grab_frame()


def check_animation(path: Path) -> None:
    """Refuse an animation of a kind that cannot be written here.

    Raises:
        UserError: another ending than .gif and .mp4, or no ffmpeg for an MP4.
    """
    _writer(path, FPS)


def _writer(path: Path, fps: int) -> AbstractMovieWriter:
    match path.suffix.lower():
        case ".gif":
            return PillowWriter(fps=fps)
        case ".mp4" if FFMpegWriter.isAvailable():
            return FFMpegWriter(fps=fps)
        case ".mp4":
            raise UserError(
                f"{path}: an MP4 needs ffmpeg, which is not found; install it or write a .gif"
            )
    raise UserError(f"{path}: an animation ends with .gif or .mp4; name it so")


class _Film:
    """One figure, drawn anew for each pose: same limits, same places of labels."""

    def __init__(
        self, linkage: Linkage, inputs: np.ndarray, poses: Solution[Pose], good: np.ndarray
    ) -> None:
        self.linkage, self.inputs, self.poses = linkage, inputs, poses
        structure = linkage.structure
        self.travel = travel_of(poses)
        self.reach = np.vstack([path_of(poses, joint)[good] for joint in structure.joints])
        self.paths = {joint: path_of(poses, joint) for joint in traced_joints(structure)}
        self.figure, grid = new_figure(height=min(shape_of(self.reach)[1], 6.0))
        self.axes: Axes = grid[0, 0]
        self.labels: dict[str, tuple[float, float]] = dict.fromkeys(structure.joints, (0.0, 9.0))
        self.show(int(good[0]))
        # Once laid out, the axes stay where they are; those of equal scales take two passes.
        self.figure.draw_without_rendering()
        self.figure.draw_without_rendering()
        self.figure.set_layout_engine("none")
        some = good[np.linspace(0, len(good) - 1, min(LABELED_POSES, len(good))).astype(int)]
        scenes = [Scene.of(linkage, pose_at(poses, int(index)), self.travel) for index in some]
        self.labels = offsets_of(self.axes, scenes, [p[good] for p in self.paths.values()])

    def show(self, index: int) -> None:
        """Draw one pose."""
        self.axes.clear()
        widen(self.axes, self.reach)
        draw_paths(self.axes, self.linkage.structure, self.paths)
        pose = pose_at(self.poses, index)
        angles = Scene.of(self.linkage, pose).angles
        labels = {name: _turned(self.labels[name], angle) for name, angle in angles.items()}
        draw_pose(self.axes, self.linkage, pose, labels=labels, travel=self.travel)
        words = f"{self.linkage.structure.name}: {self._values(index)}"
        self.axes.set_title(drawn_name(words))

    def _values(self, index: int) -> str:
        parts = zip(self.linkage.structure.inputs, self.inputs[index], strict=True)
        return ", ".join(f"{part.name} {_value(part, value)}" for part, value in parts)


def _value(part: InputPart, value: float) -> str:
    number = f"{math.degrees(value):.1f}°" if part.slider is None else f"{value:.2f} mm"
    return number.replace("-", "−")


def _turned(offset: tuple[float, float], angle: float) -> tuple[float, float]:
    x, y = turned(np.array(offset), angle)
    return float(x), float(y)
