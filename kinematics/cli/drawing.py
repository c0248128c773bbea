"""Figures and animations of ``designopt solve``."""

from __future__ import annotations

from pathlib import Path

import jax
import numpy as np

from designopt.io.files import replaced_when_complete
from designopt.plot.figures import style
from kinematics.io.assembled_sketch import AssembledSketch
from kinematics.model.linkage import Linkage
from kinematics.plot.animation import save_animation
from kinematics.plot.motion_figures import motion_figure
from kinematics.solve.poses import solve_poses


def draw_motion(
    sketch: AssembledSketch,
    inputs: np.ndarray,
    of: tuple[str, ...] | None,
    figure: Path | None,
    animation: Path | None,
) -> bool:
    """Draw poses into files.

    Args:
        sketch: the linkage.
        inputs: values of its inputs, rad or mm, shape (poses, inputs).
        of: joints and bodies asked for; all if none.
        figure: where a picture goes; none if it is not asked for.
        animation: likewise.

    Returns:
        Whether any pose can be assembled; nothing is drawn otherwise.
    """
    with jax.enable_x64(True):
        linkage = Linkage.of(sketch.numbers, sketch.structure, sketch.assembly)
        poses = jax.jit(solve_poses, static_argnames="of")(linkage, inputs, of=of)
        poses = jax.tree.map(np.asarray, poses)
        if not np.any(poses.ok):
            return False
        if figure is not None:
            with style(), replaced_when_complete(figure) as partial:
                motion_figure(linkage, inputs, poses).savefig(partial)
        if animation is not None:
            save_animation(animation, linkage, inputs, poses)
    return True
