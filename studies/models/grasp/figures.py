"""The finger in section on what it closes on."""

from __future__ import annotations

import mpmath
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from designopt.plot.figures import PALETTE, legend_below, new_figure, share_limits
from studies.models.grasp.analysis import CLOSED, Analysis, radius_of
from studies.models.grasp.closing import Path
from studies.models.grasp.comparing import setting_of
from studies.models.grasp.pinch import APPROACH
from studies.oracles.grasp import pin_places

BLUE, VERMILION, GREEN = PALETTE[:3]


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
            _draw_finger(axis, path, state, strength)
        if usable:
            _draw_forces(axis, path, usable[-1])
        axis.set(title=title, xlabel="x (mm)", aspect="equal")
    for axis in axes[:, 0]:
        axis.set_ylabel("y (mm)")
    share_limits(axes.flat[: len(shown)])
    # Every name once, by what is drawn full: the last of its name.
    named = {
        label: handle
        for axis in axes.flat[: len(shown)]
        for handle, label in zip(*axis.get_legend_handles_labels(), strict=True)
    }
    for axis in axes.flat[len(shown) :]:  # where no drawing stands the legend does
        axis.set_axis_off()
        axis.legend(named.values(), named.keys(), loc="center")
    if axes.size == len(shown):
        legend_below(drawing, named.values(), named.keys())
    return drawing


def _draw_finger(axis: Axes, path: Path, state: int, strength: float) -> None:
    body, (pip, dip) = path.problem.finger.body, path.joints[state].tolist()
    at = pin_places(setting_of(path.problem, 0.0), pip, dip, mpmath.fp)

    def draw(places: np.ndarray, style: str, color: str, width: float, label: str) -> None:
        line = {"color": color, "linewidth": width, "label": label, "alpha": strength}
        axis.plot(np.real(places), np.imag(places), style, markersize=2.2, **line)

    palmar, dorsal = 1j * float(body.palmar), 1j * float(body.dorsal)
    lengths = (body.proximal, body.intermediate, body.distal, body.axis_height, body.rim)
    proximal, middle, distal, h, rim = map(float, lengths)
    turns = np.exp(-1j * np.cumsum([0.0, pip, dip]))
    for origin, turn, (low, high), (start, end) in zip(
        "AAB",
        turns,
        ((-proximal, 0.0), (0.0, middle), (0.0, distal)),
        ((rim - proximal, -h), (h, middle - h), (h, distal - rim)),
        strict=True,
    ):
        outline = np.array([low + palmar, high + palmar, high + dorsal, low + dorsal, low + palmar])
        draw(at[origin] + turn * outline, "-", "0.35", 0.7, "phalanges")
        draw(at[origin] + turn * np.array([start + palmar, end + palmar]), "-", BLUE, 2.5, "pads")
    for chain in ("FED", "DCHD", "GH"):
        draw(np.array([at[name] for name in chain]), "-o", VERMILION, 1.1, "linkage")
    draw(np.array([at["A"], at["B"]]), "-o", "0.2", 1.1, "joints")


def _draw_forces(axis: Axes, path: Path, state: int) -> None:
    body, joints = path.problem.finger.body, path.joints[state]
    turns = np.exp(-1j * np.cumsum(joints))
    origins = (0.0, float(body.intermediate) * turns[0])
    for j in np.flatnonzero(path.forces[state] > 1e-3).tolist():
        turn, origin = turns[j // path.per_pad], origins[j // path.per_pad]
        place = origin + turn * complex(path.along[state, j], float(body.palmar))
        # Drawn along the pad's normal, which it is but for contacts at a pad's end.
        tail = place - 1j * turn * path.forces[state, j]
        arrow = {"arrowstyle": "-|>", "color": GREEN, "linewidth": 1.6}
        axis.annotate("", (place.real, place.imag), (tail.real, tail.imag), arrowprops=arrow)
        axis.update_datalim([(tail.real, tail.imag)])
        # An arrow has no entry in a legend of its own.
        axis.plot([], [], color=GREEN, marker=">", linewidth=1.6, label="contact force")
