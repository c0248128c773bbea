"""The signs a mechanism is drawn with: pins, ground, bars, blocks, slots and springs.

Places are in mm; the signs themselves are sized in points, so that they look the same whatever
the scale of the drawing.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.lines import Line2D
from matplotlib.patches import PathPatch, Polygon
from matplotlib.path import Path
from matplotlib.patheffects import withTickedStroke
from matplotlib.transforms import Affine2D, ScaledTranslation, Transform

from kinematics.plot.scene import Place, Points

INK, GRAY, PAPER = "#222222", "#8A8A8A", "white"
BAR, STRIP, HOLE, EDGE = 7.0, 15.0, 9.5, 0.9
"""Widths of bars, of bars with a slot, of the slot and of outlines, in points."""
BLOCK, SLOT_BLOCK = (20.0, 12.0), (13.0, HOLE - 2 * EDGE)
"""Length and height of a block on a line and of one in a slot, in points."""
GROUND = np.array([(0.0, 0.0), (-7.0, -11.0), (7.0, -11.0)])
COIL = 8.5
"""Radius of a torsion spring's coil, in points."""


def tint(color: str, white: float = 0.72) -> tuple[float, float, float]:
    """A colour mixed with so much white."""
    red, green, blue = (white + (1 - white) * part for part in to_rgb(color))
    return red, green, blue


def anchored(axes: Axes, place: Place) -> Transform:
    """From points on paper, counted from a place in mm, to the display."""
    figure: Any = axes.figure
    to_display: Any = axes.transData
    shift = ScaledTranslation(float(place[0]), float(place[1]), to_display)
    return Affine2D().scale(1 / 72) + figure.dpi_scale_trans + shift


def add(axes: Axes, artist: Artist) -> None:
    """Add an artist that takes no part in choosing the axes' limits."""
    axes.add_artist(artist)


def body(
    axes: Axes, name: str, outlines: list[Points], strips: list[Points], color: str, z: float
) -> None:
    """A rigid body: bars and polygons of one outline, with slots in it.

    Args:
        axes: where to draw.
        name: the body's, by which its artists are found (``gid``).
        outlines: lines through the body's joints; closed where they are polygons, mm.
        strips: the two ends of each of its slots, mm.
        color: of its outline; it is filled with a tint.
        z: order of drawing; up to z + 0.5 is used.
    """
    light = tint(color)
    for inset, shade, level in ((0.0, color, 0.0), (2 * EDGE, light, 0.1)):
        for lines, width in ((outlines, BAR), (strips, STRIP)):
            for line in lines:
                stroke(axes, line, shade, width - inset, z + level, f"body:{name}")
    for line in outlines:
        if len(line) > 3:
            fill = Polygon(line, closed=True, facecolor=light, edgecolor="none", zorder=z + 0.1)
            add(axes, fill)
    for inset, shade, level in ((0.0, color, 0.2), (2 * EDGE, PAPER, 0.3)):
        for line in strips:
            stroke(axes, line, shade, HOLE - inset, z + level, f"slot:{name}")


def frame(axes: Axes, name: str, outline: Points, z: float) -> None:
    """The fixed body: a thin grey line through its joints."""
    stroke(axes, outline, tint(GRAY, 0.55), 1.6, z, f"body:{name}")


def stroke(
    axes: Axes, line: Points, color: Any, width: float, z: float, gid: str, **style: Any
) -> None:
    """A line with round ends and corners."""
    artist = Line2D(line[:, 0], line[:, 1], color=color, linewidth=width, zorder=z, **style)
    artist.set(solid_capstyle="round", solid_joinstyle="round", gid=gid)
    add(axes, artist)


def pin(axes: Axes, name: str, place: Place, z: float, *, color: str = INK) -> None:
    """A pin joint: a circle filled with white."""
    _dot(axes, name, place, z, 6.2, color, PAPER)


def point(axes: Axes, name: str, place: Place, z: float, color: str) -> None:
    """A point of a body that joins nothing: a small filled circle."""
    _dot(axes, name, place, z, 4.2, color, color)


def _dot(axes: Axes, name: str, place: Place, z: float, size: float, edge: str, face: str) -> None:
    artist = Line2D([place[0]], [place[1]], marker="o", color=edge, markerfacecolor=face)
    artist.set(markersize=size, markeredgewidth=1.1, zorder=z, gid=f"joint:{name}")
    add(axes, artist)


def ground(axes: Axes, place: Place, z: float) -> None:
    """A fixed pivot: a triangle on hatched ground."""
    at = anchored(axes, place)
    triangle = Path([*GROUND, GROUND[0]], closed=True)
    add(axes, PathPatch(triangle, fc=PAPER, ec=INK, lw=1.0, transform=at, zorder=z, gid="ground"))
    base = Line2D([-11.0, 11.0], [GROUND[1, 1]] * 2, transform=at, zorder=z)
    _hatch(axes, base)


def track(axes: Axes, ends: Points, z: float) -> None:
    """A fixed line on which a block slides: drawn under the block, hatched on its far side.

    Args:
        axes: where to draw.
        ends: of the line through the block's middle, mm.
        z: order of drawing.
    """
    step = ends[1] - ends[0]
    if step[0] < 0 or (step[0] == 0 and step[1] < 0):  # so that its right-hand side is below
        ends, step = ends[::-1], -step
    down = np.array([step[1], -step[0]]) / math.hypot(*step) * BLOCK[1] / 2 / 72
    figure: Any = axes.figure
    shift = ScaledTranslation(float(down[0]), float(down[1]), figure.dpi_scale_trans)
    base = Line2D(ends[:, 0], ends[:, 1], transform=axes.transData + shift, zorder=z, gid="track")
    _hatch(axes, base)


def _hatch(axes: Axes, line: Line2D) -> None:
    line.set(color=INK, linewidth=1.0)
    strokes = withTickedStroke(spacing=4.0, angle=-130, length=1.0, linewidth=0.7)
    line.set_path_effects([strokes])
    add(axes, line)


def block(
    axes: Axes, place: Place, direction: Place, z: float, *, size: tuple[float, float], color: str
) -> None:
    """A block that slides along a direction, its middle at a place."""
    x, y = size[0] / 2, size[1] / 2
    corners = Path([(-x, -y), (x, -y), (x, y), (-x, y), (-x, -y)], closed=True)
    turn = Affine2D().rotate(math.atan2(direction[1], direction[0]))
    patch = PathPatch(corners, fc=tint(color), ec=color, lw=1.0, zorder=z, gid="block")
    patch.set_transform(turn + anchored(axes, place))
    add(axes, patch)


def spring(axes: Axes, place: Place, legs: tuple[Place, Place], z: float) -> None:
    """A torsion spring: a coil around a place, whose two legs lie along the bodies' directions."""
    start, end = (math.atan2(leg[1], leg[0]) for leg in legs)
    turns = np.linspace(start, start + 2 * math.pi + (end - start) % (2 * math.pi), 121)
    radii = np.linspace(COIL - 1.5, COIL + 1.5, len(turns))
    coil = np.stack([radii * np.cos(turns), radii * np.sin(turns)], axis=-1)
    outer = COIL + 8.0
    feet = [outer * np.array([math.cos(angle), math.sin(angle)]) for angle in (start, end)]
    path = Path(np.vstack([feet[:1], coil, feet[1:]]))
    patch = PathPatch(path, fc="none", ec=INK, lw=1.1, zorder=z, gid="spring")
    patch.set_transform(anchored(axes, place))
    add(axes, patch)
