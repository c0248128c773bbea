"""The finger in section on what it closes on."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from designopt.plot.figures import PALETTE, new_figure, share_limits
from studies.models.grasp.analysis import CLOSED, Analysis, radius_of
from studies.models.grasp.closing import Path
from studies.models.grasp.pinch import APPROACH
from studies.models.section import draw_finger

FORCE = PALETTE[4]


def draw_sequences(found: Analysis) -> Figure:
    """The finger in section: pinching, closing on a circle and on a square."""
    pinch = next((path for one, path, _ in found.pinches if one.holds), None)
    touching = found.adaptive.gaps[: CLOSED + 1] < 1e-7
    first, both = (
        int(np.argmax(pads)) if pads.any() else CLOSED
        for pads in (touching[:, 0], touching.all(axis=1))
    )
    adaptive = f"Adaptive: a circle of {2 * radius_of(found.adaptive):.3g} mm"
    every = (
        ("Free closing", found.free, (0, 20, 34, 45, 56)),
        ("Pinch: DIP stays straight", pinch, (0, 8, 16, APPROACH, 120)),
        (adaptive, found.adaptive, (0, first, both)),
        ("A square of 24 mm", found.box, (0, 26, 38, CLOSED)),
    )
    shown = [(title, path, states) for title, path, states in every if path is not None]
    rows = -(-len(shown) // 2)
    drawing, axes = new_figure(rows, 2, height=3.6 * rows)
    for axis, (title, path, states) in zip(axes.flat, shown, strict=False):
        if path.problem.thing is not None:
            outline = np.asarray(path.problem.thing.outline())
            axis.fill(*outline.T, facecolor="0.85", edgecolor="0.5", zorder=0, label="object")
        usable = [state for state in states if path.ok[state]]
        for rank, state in enumerate(usable, 1):
            strength = 1.0 if rank == len(usable) else 0.25 + 0.3 * (rank - 1) / len(usable)
            draw_finger(axis, path.problem.finger, path.joints[state], strength=strength)
        if usable:
            _draw_forces(axis, path, usable[-1])
        axis.set(title=title, xlabel="x (mm)", aspect="equal")
    for axis in axes[:, 0]:
        axis.set_ylabel("y (mm)")
    share_limits(axes.flat[: len(shown)])
    for axis in axes.flat[len(shown) :]:
        axis.set_axis_off()
    return drawing


def _draw_forces(axis: Axes, path: Path, state: int) -> None:
    body, joints = path.problem.finger.body, path.joints[state]
    turns = np.exp(-1j * np.cumsum(joints))
    origins = (0.0, float(body.intermediate) * turns[0])
    for j in np.flatnonzero(path.forces[state] > 1e-3).tolist():
        turn, origin = turns[j // path.per_pad], origins[j // path.per_pad]
        place = origin + turn * complex(path.along[state, j], float(body.palmar))
        # Drawn along the pad's normal, which it is but for contacts at a pad's end.
        tail = place - 1j * turn * path.forces[state, j]
        arrow = {"arrowstyle": "-|>", "color": FORCE, "linewidth": 1.6}
        axis.annotate("", (place.real, place.imag), (tail.real, tail.imag), arrowprops=arrow)
        axis.update_datalim([(tail.real, tail.imag)])
        # An arrow has no entry in a legend of its own.
        axis.plot([], [], color=FORCE, marker=">", linewidth=1.6, label="contact force")
