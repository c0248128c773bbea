"""What a camera sees in a bent tube, by marching along rays: plain NumPy, apart from the library.

A ray is followed in three dimensions in small steps. At every place the plane across the centre
line that holds it is that through the centre of curvature, turned about the axis of bending; it
gives the arc length there, and the place's offset from the centre line, which is compared with the
wall's radius and with the flat of the pressed wall. Where the ray first leaves the tube is the wall
that it meets; if it does not before the tube ends, it meets the top.
"""

import functools
from dataclasses import dataclass

import jax
import numpy as np

from optics import Chamber

STEP = 0.25
"""mm. What a ray can be outside for a shorter way than this it is by less than 1e-4 mm."""

HALVINGS = 20
"""Of a step, to find where in it the ray leaves."""


@dataclass(frozen=True)
class Press:
    """A round object against the wall, in mm; a negative depth presses the far side."""

    place: float = 0.0
    radius: float = 1.0
    depth: float = 0.0

    def at(self, arc: np.ndarray) -> np.ndarray:
        """The osculating parabola of a circle."""
        return np.maximum(abs(self.depth) - (arc - self.place) ** 2 / (2 * self.radius), 0.0)


@dataclass(frozen=True)
class Tube:
    """The wall as straight lines between A, B, C and D: distances and radii, mm."""

    arcs: np.ndarray
    radii: np.ndarray
    pinhole: float

    @classmethod
    def of(cls, chamber: Chamber) -> "Tube":
        one = jax.tree.map(float, chamber)
        fall = one.length_bc * np.tan(one.wall_angle_bc)
        offsets = np.array([one.offset_a, one.offset_b, one.offset_b - fall, -one.offset_d])
        arcs = np.cumsum([0.0, one.length_ab, one.length_bc, one.length_cd])
        return cls(arcs, one.reference_height + offsets, one.pinhole_offset)


def regions_met(
    tube: Tube, rays: np.ndarray, bend: float, direction: float, press: Press
) -> np.ndarray:
    """0 red, 1 blue, 2 yellow, 3 top: what each of some rays (x, y, 1) from the pinhole meets."""
    heading = np.concatenate([rays, np.ones((len(rays), 1))], axis=1)
    heading /= np.linalg.norm(heading, axis=1, keepdims=True)
    leaves = functools.partial(_leaves, tube, bend, direction, press)
    way = np.zeros(len(rays))
    met = np.full(len(rays), -1)
    going = np.arange(len(rays))
    while len(going):
        # Several steps at once; the first outside counts.
        ahead = way[going, None] + STEP * np.arange(1, 33)
        stopped, _, _ = leaves(heading[going, None], ahead)
        first = np.argmax(stopped, axis=1)
        stops = stopped.any(axis=1)
        stopping = going[stops]
        high = way[stopping] + STEP * (first[stops] + 1)
        low = high - STEP
        for _ in range(HALVINGS):
            middle = (low + high) / 2
            out, _, _ = leaves(heading[stopping], middle)
            low, high = np.where(out, low, middle), np.where(out, middle, high)
        _, ended, arc = leaves(heading[stopping], high)
        # A wall is met within its region; where the tube ends there is the top.
        met[stopping] = np.where(ended, 3, np.searchsorted(tube.arcs[1:3], arc, side="right"))
        going = going[~stops]
        way[going] += 32 * STEP
    return met


def _leaves(
    tube: Tube, bend: float, direction: float, press: Press, heading: np.ndarray, way: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of places along rays: whether outside of the tube, whether beyond its end; and where."""
    x, y, z = np.moveaxis(heading * way[..., None], -1, 0)
    z = z - tube.pinhole
    side = 1.0 if bend >= 0 else -1.0
    # Towards the centre of curvature, and across the plane of bending.
    towards = side * (x * np.cos(direction) + y * np.sin(direction))
    beside = y * np.cos(direction) - x * np.sin(direction)
    if bend == 0:
        arc, offset = z, towards
    else:
        radius = tube.arcs[-1] / abs(bend)
        arc = radius * np.arctan2(z, radius - towards)
        # radius − distance from the centre of curvature, without the difference of large numbers
        distance = np.hypot(z, radius - towards)
        offset = (2 * radius * towards - towards**2 - z**2) / (radius + distance)
    arc = np.where(arc < -tube.arcs[-1] / 2, np.inf, arc)  # more than half a turn: beyond it all
    wall = np.interp(arc, tube.arcs, tube.radii)
    flat = wall - press.at(arc)
    # The pressed side is that of the bend as it is signed.
    pressed = side * offset if press.depth >= 0 else -side * offset
    inside = (offset**2 + beside**2 <= wall**2) & (pressed <= flat)
    ended = arc >= tube.arcs[-1]
    return ended | ~(inside | (arc < 0)), ended, arc
