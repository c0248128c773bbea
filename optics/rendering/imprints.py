"""What is pressed into a pad: height maps of common objects."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float

Map = Float[np.ndarray, "rows columns"]

SMOOTHING = 0.08
"""How sharply a gel can follow an edge: standard deviation of a Gaussian, mm."""


@dataclass(frozen=True)
class Imprint:
    """An object pressed into a pad.

    Attributes:
        kind: one of `list_imprints`.
        along: where its middle is along the pad, mm from the pad's first end.
        across: where it is across the section, mm from the pad's middle.
        depth: how deep its lowest part goes, mm.
        turn: turned in the plane of the pad, rad.
        radius: of a sphere, mm; the other objects have sizes of their own.
    """

    kind: str
    along: float
    across: float = 0.0
    depth: float = 0.6
    turn: float = 0.0
    radius: float = 8.0

    @classmethod
    def of_contact(cls, along: float, across: float, diameter: float, depth: float) -> Imprint:
        """A sphere that touches the pad within a circle of a diameter.

        By Pythagoras r² = (r − depth)² + (diameter / 2)².

        Args:
            along: where its middle is along the pad, mm from the pad's first end.
            across: where it is across the section, mm from the pad's middle.
            diameter: of the circle, mm.
            depth: how deep the sphere goes, mm; at most half the diameter.

        Example:
            >>> Imprint.of_contact(10.0, 0.0, diameter=6.0, depth=1.0).radius
            5.0
        """
        radius = ((diameter / 2) ** 2 + depth**2) / (2 * depth)
        return cls("sphere", along, across, depth, radius=radius)


def list_imprints() -> list[str]:
    """The kinds of objects there are.

    Example:
        >>> list_imprints()
        ['sphere', 'ball array', 'studded brick', 'edge', 'screw thread']
    """
    return list(_DEPTHS)


def make_height_map(imprint: Imprint, along: Map, across: Map, step: float) -> Map:
    """How deep each place of a pad is pressed in, mm.

    Args:
        imprint: the object.
        along: places along the pad, mm.
        across: places across the section from the middle, mm.
        step: from one place to the next, mm.

    Raises:
        ValueError: there is no such object.

    Example:
        >>> import numpy as np
        >>> along, across = np.meshgrid(np.arange(-5, 5.1), np.arange(-5, 5.1), indexing="ij")
        >>> height = make_height_map(Imprint(list_imprints()[0], 0.0), along, across, 1.0)
        >>> height.shape, round(float(height.max()), 2)
        ((11, 11), 0.6)
    """
    if imprint.kind not in _DEPTHS:
        known = ", ".join(list_imprints())
        raise ValueError(f"no imprint is named '{imprint.kind}'; there are: {known}")
    cosine, sine = math.cos(imprint.turn), math.sin(imprint.turn)
    x, y = along - imprint.along, across - imprint.across
    free = _DEPTHS[imprint.kind](cosine * x + sine * y, cosine * y - sine * x, imprint)
    sharp = np.maximum(free, 0).astype(np.float32)
    return cv2.GaussianBlur(sharp, (0, 0), SMOOTHING / step)


def _cap(x: Map, y: Map, depth: float, radius: float) -> Map:
    return depth - (radius - np.sqrt(np.maximum(radius**2 - x**2 - y**2, 0)))


def _sphere(x: Map, y: Map, imprint: Imprint) -> Map:
    return _cap(x, y, imprint.depth, imprint.radius)


def _ball_array(x: Map, y: Map, imprint: Imprint) -> Map:
    """Balls 2 mm in radius, 4 mm apart, in a square of three by three."""
    pitch, balls = 4.0, 3

    def nearest(place: Map) -> Map:
        half = balls // 2
        return place - pitch * np.clip(np.round(place / pitch), -half, half)

    return _cap(nearest(x), nearest(y), imprint.depth, 2.0)


def _studded_brick(x: Map, y: Map, imprint: Imprint) -> Map:
    """Two by two studs, 4.8 mm across and 8 mm apart."""
    stud = np.hypot(np.abs(x) - 4.0, np.abs(y) - 4.0) < 2.4
    return np.where(stud, imprint.depth, 0.0)


def _edge(x: Map, y: Map, imprint: Imprint) -> Map:
    """The straight edge of a box of 90°, pressed in with its corner first."""
    return imprint.depth - np.abs(x)


def _screw_thread(x: Map, y: Map, imprint: Imprint) -> Map:
    """An M2.5 thread lying across: 0.45 mm from turn to turn, 0.27 mm deep."""
    radius, pitch, height = 1.25, 0.45, 0.27
    # Turns lean by half a pitch over the diameter.
    phase = 2 * np.pi * (y / pitch + x / (4 * radius))
    local = radius - height / 2 * (1 - np.cos(phase))
    return imprint.depth - (radius - np.sqrt(np.maximum(local**2 - x**2, 0)))


_DEPTHS: dict[str, Callable[[Map, Map, Imprint], Map]] = {
    "sphere": _sphere,
    "ball array": _ball_array,
    "studded brick": _studded_brick,
    "edge": _edge,
    "screw thread": _screw_thread,
}
