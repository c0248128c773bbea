"""Pictures of parts: flat faces, shaded, by a depth buffer, in parallel projection."""

from __future__ import annotations

import math
from collections.abc import Hashable, Iterator, Sequence
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Float, UInt8
from matplotlib.colors import to_rgb

from designopt.export.parts import Part, Prism, circle

AMBIENT, EDGE = 0.45, 0.5
"""Part of the light that reaches every face, and what edges leave of it."""

FINER = 2
"""Pixels that are averaged to one, each way."""

BITS = 4
"""Of a pixel's fractions in which corners are filled."""

LIGHT = np.array([-0.35, 0.6, 0.72]) / np.linalg.norm([-0.35, 0.6, 0.72])
"""Where light comes from: left, above and the eye."""

TIE = 0.05
"""Of two faces that meet in an edge, pixels by which the nearer one has to be nearer."""

CHORD, MARGIN = 0.05, 0.03
"""The farthest that faces lie from what is round, mm, and room around the picture, as a part."""


class Facet(NamedTuple):
    """A flat face.

    Attributes:
        loops: its outline, counter-clockwise seen from outside, and holes, mm.
        normal: outwards, a unit vector.
        color: of it.
        group: faces of one group, such as those in one plane of a part, have no edge between them.
    """

    loops: list[Float[np.ndarray, "_ 3"]]
    normal: Float[np.ndarray, "3"]
    color: str
    group: Hashable


def draw_parts(
    parts: Sequence[Part], turn_deg: float, lift_deg: float, width: int = 1000
) -> UInt8[np.ndarray, "height width 3"]:
    """Parts in parallel projection, on white.

    What is cut out of them is not drawn but where it is a hole of a prism.

    Args:
        parts: to draw.
        turn_deg: of the eye about the vertical, +y, from +z.
        lift_deg: of the eye above the horizontal.
        width: pixels.

    Example:
        >>> from designopt.export.parts import around
        >>> bar = Prism(around((0.0, 0.0, 2.0), (10.0, 0.0, 2.0)), (0.0, 1.0))
        >>> bar = Part("bar", "bar", "bar", "steel", "", (bar,))
        >>> draw_parts([bar], 0.0, 0.0, width=148).shape
        (49, 148, 3)
    """
    axes = _axes(turn_deg, lift_deg)
    facets = [facet for part in parts for prism in part.prisms for facet in _facets(prism, part)]
    groups = {group: number for number, group in enumerate({facet.group for facet in facets})}
    every = np.concatenate([facet.loops[0] for facet in facets]) @ axes.T
    low, high = every.min(axis=0), every.max(axis=0)
    margin = MARGIN * (high[0] - low[0])
    scale = FINER * width / (high[0] - low[0] + 2 * margin)
    rows = FINER * math.ceil((high[1] - low[1] + 2 * margin) * scale / FINER)
    depth, color = np.full((rows, FINER * width), -np.inf), np.ones((rows, FINER * width, 3))
    owner = np.full(depth.shape, -1)
    # Those that face the eye first: of steeper ones the edges that lie in them are not seen.
    for facet in sorted(facets, key=lambda facet: -float(axes[2] @ facet.normal)):
        normal = axes @ facet.normal
        if normal[2] > 1e-9:
            loops = [(loop @ axes.T - low + margin) * scale for loop in facet.loops]
            light = AMBIENT + (1 - AMBIENT) * max(float(normal @ LIGHT), 0.0)
            shade = light * np.array(to_rgb(facet.color))
            _fill((depth, color, owner), loops, normal, shade, groups[facet.group])
    edge = np.zeros(depth.shape, bool)
    edge[1:] |= owner[1:] != owner[:-1]
    edge[:, 1:] |= owner[:, 1:] != owner[:, :-1]
    color[edge] *= EDGE
    averaged = color.reshape(rows // FINER, FINER, width, FINER, 3).mean(axis=(1, 3))
    return np.round(255 * averaged[::-1]).astype(np.uint8)


def _facets(prism: Prism, part: Part) -> Iterator[Facet]:
    """Both ends of a prism, and its sides: those of one arc are one group."""
    low, high = prism.across
    holes = [np.array(circle(*hole.center, hole.radius).line(CHORD)) for hole in prism.holes]
    line = prism.outline.line(CHORD)
    for height, side in ((low, -1.0), (high, 1.0)):
        loops = [np.column_stack([loop, np.full(len(loop), height)]) for loop in (line, *holes)]
        normal = np.array([0.0, 0.0, side])
        yield Facet(loops, normal, part.color, (part.name, side, round(height, 6)))
    for number, hole in enumerate(holes):
        for corners, normal in _sides(hole[::-1], prism.across):
            yield Facet([corners], normal, part.color, (part.name, prism, number))
    vertices = dict(zip(prism.outline.places, prism.outline.bulges, strict=True))
    edge = line[0]
    for place, (corners, normal) in zip(line, _sides(np.array(line), prism.across), strict=True):
        edge = place if place in vertices else edge
        plane = (*np.round(normal, 6), round(float(normal @ corners[0]), 6))
        group = (part.name, prism, edge) if vertices[edge] else (part.name, *plane)
        yield Facet([corners], normal, part.color, group)


def _sides(
    loop: Float[np.ndarray, "corners 2"], across: tuple[float, float]
) -> Iterator[tuple[Float[np.ndarray, "4 3"], Float[np.ndarray, "3"]]]:
    """Corners and outward normal of the faces over the edges of a loop."""
    low, high = across
    ends = np.roll(loop, -1, axis=0)
    for (x, y), (x_end, y_end) in zip(loop.tolist(), ends.tolist(), strict=True):
        corners = [(x, y, low), (x_end, y_end, low), (x_end, y_end, high), (x, y, high)]
        normal = np.array([y_end - y, x - x_end, 0.0])
        yield np.array(corners), normal / max(math.hypot(y_end - y, x - x_end), 1e-12)


def _axes(turn_deg: float, lift_deg: float) -> Float[np.ndarray, "3 3"]:
    """Unit vectors to the right, up and towards the eye."""
    turn, lift = math.radians(turn_deg), math.radians(lift_deg)
    right = np.array([math.cos(turn), 0.0, -math.sin(turn)])
    across = math.cos(lift)
    eye = np.array([math.sin(turn) * across, math.sin(lift), math.cos(turn) * across])
    return np.stack([right, np.cross(eye, right), eye])


def _fill(
    buffers: tuple[np.ndarray, np.ndarray, np.ndarray],
    loops: Sequence[Float[np.ndarray, "_ 3"]],
    normal: Float[np.ndarray, "3"],
    shade: Float[np.ndarray, "3"],
    group: int,
) -> None:
    """Draw one face where it is nearer than what was there."""
    depth, color, owner = buffers
    first = np.maximum(np.floor(loops[0][:, :2].min(axis=0)).astype(int) - 1, 0)
    last = np.ceil(loops[0][:, :2].max(axis=0)).astype(int) + 2
    window = depth[first[1] : last[1], first[0] : last[0]]
    mask = np.zeros(window.shape, np.uint8)
    corners = [np.round((loop[:, :2] - first - 0.5) * 2**BITS).astype(np.int32) for loop in loops]
    cv2.fillPoly(mask, corners, 1, shift=BITS)
    y = first[1] + np.arange(len(mask))[:, None]
    x = first[0] + np.arange(len(mask[0]))
    place = loops[0][0]
    offset = (x + 0.5 - place[0]) * normal[0] + (y + 0.5 - place[1]) * normal[1]
    # Border pixels reach beyond a face, where a steep one would come too near.
    near = np.minimum(place[2] - offset / normal[2], np.max(loops[0][:, 2]))
    rows, columns = np.nonzero((mask > 0) & (near > window + TIE))
    at = rows + first[1], columns + first[0]
    depth[at], color[at], owner[at] = near[rows, columns], shade, group
