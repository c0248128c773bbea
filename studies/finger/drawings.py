"""The drawing to build from: linkage, camera, mirrors and pads in the straight finger."""

from __future__ import annotations

import numpy as np

from designopt.plot.figures import PALETTE, legend_below, new_figure
from designopt.study.results import Figure
from studies.models.finger import Finger
from studies.models.linkage_design.figures import draw_finger

MIRROR, PAD, CAMERA = PALETTE[4], PALETTE[5], PALETTE[1]


def section_figure(finger: Finger) -> Figure:
    """The section of the straight finger, to scale, with everything that was designed."""
    drawing, axes = new_figure(1, 1, height=3.4)
    axis, scene = axes[0, 0], finger.scene()
    draw_finger(axis, finger, (0.0, 0.0), named=True)
    for surfaces, color, width, name in (
        (scene.pads, PAD, 4.0, "pads"),
        (scene.mirrors, MIRROR, 2.5, "mirrors"),
    ):
        for index, ends in enumerate(np.asarray(surfaces)):
            axis.plot(*ends.T, color=color, linewidth=width, label=None if index else name)
    position = np.asarray(scene.camera.position)
    axis.plot(*position, "^", color=CAMERA, markersize=8, label="camera")
    towards = float(scene.camera.direction)
    axis.annotate(
        "",
        position + 5 * np.array([np.cos(towards), np.sin(towards)]),
        position,
        arrowprops={"arrowstyle": "->", "color": CAMERA},
    )
    axis.set(xlabel="x from the PIP axis, to the tip (mm)", ylabel="y, to the back (mm)")
    legend_below(drawing, most=4)
    return Figure(
        "drawing",
        "The finger in section",
        "Straight, to scale. The links lie at both sides of the finger, camera, mirrors and pads "
        "between them. The tables of pins and of dimensions have every number.",
        drawing,
    )
