"""The finger in section, in any posture."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from matplotlib.axes import Axes
from scipy.spatial import ConvexHull

from designopt.plot.figures import PALETTE
from kinematics.model.linkage import Linkage
from kinematics.solve.poses import solve_poses
from studies.models.finger import Finger
from studies.models.pins import pin_name

BODY, VERMILION, GREEN, PINK, _, PAD, ORANGE = PALETTE
COLORS = {
    "crank": VERMILION,
    "rod": ORANGE,
    "plate": GREEN,
    "bar": PINK,
    "driver": VERMILION,
    "coupler": ORANGE,
    "coupling": GREEN,
}
"""Of the links; those of the motor's parallelogram are dashed in the colors of the linkage's."""

ROUND = np.exp(1j * np.linspace(0, 2 * np.pi, 48, endpoint=False))


@jax.jit
def _places(linkage: Linkage, inputs: Float[Array, " inputs"]) -> dict[str, Float[Array, "2"]]:
    pose = solve_poses(linkage, inputs).value
    names = [name for name in "ABCDEFGHPQKMN" if pin_name(name) in pose.joints]
    return {name: pose.position(pin_name(name)) for name in names}


def _outline(corners: Sequence[complex], radius: float) -> np.ndarray:
    """The convex hull of circles about the corners, complex."""
    points: Any = np.concatenate([corner + radius * ROUND for corner in corners])
    hull = ConvexHull(np.stack([points.real, points.imag], axis=-1))
    return points[hull.vertices]


def draw_finger(
    axis: Axes,
    finger: Finger,
    joints: Sequence[float] | np.ndarray,
    *,
    strength: float = 1.0,
    named: bool = False,
) -> None:
    """Phalanges with their pads, links and pins, in the frame of the proximal phalanx.

    Args:
        axis: where to draw.
        finger: its body and pins.
        joints: flexion of PIP and DIP, rad.
        strength: opacity of everything, such as of one posture among several.
        named: write the pins' names, for which the drawing has to be large.
    """
    body = finger.body
    places = _places(finger.linkage(), -jnp.asarray(joints)[: finger.kind.freedoms])
    at = {name: complex(*np.asarray(place)) for name, place in places.items()}

    def draw(path: Sequence[complex] | np.ndarray, color: str, label: str, **style: Any) -> None:
        line = {"color": color, "label": label, "alpha": strength, **style}
        axis.plot(np.real(path), np.imag(path), **line)

    palmar, dorsal = 1j * float(body.palmar), 1j * float(body.dorsal)
    turns = np.exp(-1j * np.cumsum([0.0, *joints]))
    spans = ((-body.proximal, 0.0), (0.0, body.intermediate), (0.0, body.distal))
    pads = np.asarray(finger.pads())[..., 0] - np.array([[0.0], [0.0], [body.intermediate]])
    for origin, turn, span, pad in zip("AAB", turns, spans, pads, strict=True):
        rear, front = map(float, span)
        corners = np.array([rear + palmar, front + palmar, front + dorsal, rear + dorsal])
        outline = at[origin] + turn * corners
        look = {"facecolor": "0.95", "edgecolor": BODY, "linewidth": 1.0, "alpha": strength}
        axis.fill(outline.real, outline.imag, label="phalanges", **look)
        draw(at[origin] + turn * (pad + palmar), PAD, "pads", linewidth=2.5)
    radius = 0.0 if finger.links is None else float(finger.links.bar_width) / 2
    for name, pins in finger.kind.outlines.items():
        corners, color = [at[pin] for pin in pins if pin in at], COLORS[name]
        if len(corners) < 2:
            continue
        if radius > 0:
            outline: Any = _outline(corners, radius)
            look = {"facecolor": color, "edgecolor": color, "alpha": 0.35 * strength}
            axis.fill(outline.real, outline.imag, label="_", **look)
        dashed = "--" if name in ("driver", "coupler") else "-"
        line = {"linewidth": 1.0 if radius else 2.0, "linestyle": dashed}
        draw([*corners, *corners[:1]], color, name, **line)
    for host, *pins in finger.kind.walls.values():
        for pin in (pin for pin in pins if pin in at and pin not in "BM"):
            draw([at[host], at[pin]], BODY, "_", linewidth=1.0, linestyle=":")
    size = 4 if named else 2.5
    hole = {"marker": "o", "linestyle": "", "markerfacecolor": "white", "markersize": size}
    draw([*at.values()], "black", "_", **hole)
    if named:
        above = {"xytext": (5, 4), "textcoords": "offset points", "fontsize": 9}
        for pin, place in at.items():
            axis.annotate(pin_name(pin), (place.real, place.imag), **above)
    axis.set_aspect("equal")
    axis.grid(visible=False)
