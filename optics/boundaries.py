"""Every end of a view is the place where a line meets the pad; here are these lines.

Which line bounds what is found without derivatives (`optics.visibility`). Computed anew from its
label, as here, the end carries its derivative and nothing else does: the end of a piece moves as
its line does, and it jumps from one line to another only where the view changes its topology.
"""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from designopt.numerics import safe_divide
from designopt.vectors import Vector, rotation
from optics.camera import Camera
from optics.scene import Placed
from optics.unfolding import (
    CROSSING,
    CUT_AFTER,
    CUT_BEFORE,
    KINDS,
    SECOND_END,
    folds_of,
    unit,
)
from optics.views import (
    FIRST_PAD_END,
    HIGH_GRAZING,
    LEFT_LIMIT,
    LOW_GRAZING,
    RIGHT_LIMIT,
    SECOND_PAD_END,
)


class Pad(eqx.Module):
    """A pad in a pose.

    Attributes:
        index: its index among all surfaces.
        start: its first end.
        end: its second end.
        side: +1 if its left side senses, −1 if its right does, 0 if both do.
        grazing: least angle between it and a ray, rad.
    """

    index: Int[Array, "*pads"]
    start: Vector
    end: Vector
    side: Float[Array, "*pads"]
    grazing: Float[Array, "*pads"]


class Routes(eqx.Module):
    """All paths of a scene in a pose, of all lengths, ready to be looked up.

    Attributes:
        words: mirrors along each path, −1 after its end, shape (paths, reflections).
        sources: virtual cameras.
        axes: their optical axes.
        handedness: −1 after an odd number of reflections, else +1.
        shifts: of the motions that unfold the legs of each path, shape (paths, legs).
        turns: of these motions.
        flips: whether they mirror: −1, else +1.
    """

    words: Int[Array, "*paths reflections"]
    sources: Vector
    axes: Vector
    handedness: Float[Array, "*paths"]
    shifts: Vector
    turns: Vector
    flips: Float[Array, "*paths legs"]


def routes_of(placed: Placed, words: list[np.ndarray]) -> Routes:
    """The paths over given mirrors, in one table."""
    longest = max(of_length.shape[1] for of_length in words)
    parts = []
    for of_length in words:
        count = of_length.shape[1]

        def one(word: Int[Array, " reflections"], count: int = count) -> Routes:
            folds = folds_of(placed, word)
            folds += folds[-1:] * (longest - count)
            shifts, turns = jax.tree.map(
                lambda *leaves: jnp.stack(leaves), *((fold.shift, fold.turn) for fold in folds)
            )
            flips = jnp.array([-1.0 if fold.flips else 1.0 for fold in folds], placed.size.dtype)
            padded = jnp.pad(word, (0, longest - count), constant_values=-1)
            source, axis = folds[0].place(placed.camera), folds[0].arrow(placed.axis)
            return Routes(padded, source, axis, flips[0], shifts, turns, flips)

        parts.append(jax.vmap(one)(jnp.asarray(of_length)))
    return jax.tree.map(lambda *leaves: jnp.concatenate(leaves), *parts)


class Line(eqx.Module):
    """A line, by a point and a direction of any length.

    Attributes:
        point: the virtual camera, or a place on a surface that meets the pad.
        direction: along the line.
        crosses: whether it lies along such a surface.
    """

    point: Vector
    direction: Vector
    crosses: Bool[Array, ""]


def bounding_line(
    camera: Camera,
    placed: Placed,
    routes: Routes,
    pad: Pad,
    path: Int[Array, ""],
    label: Int[Array, ""],
) -> Line:
    """The line that a label stands for: of sight along an edge, or along a surface.

    All of it unfolded behind the last mirror of the path.
    """
    source, axis = jax.tree.map(lambda leaf: leaf[path], (routes.sources, routes.axes))
    surfaces = placed.starts.x.shape[0]
    kind, surface = label % KINDS, jnp.maximum(label, 0) // KINDS % surfaces
    leg = jnp.maximum(label, 0) // KINDS // surfaces

    start, end = jax.tree.map(lambda leaf: leaf[surface], (placed.starts, placed.ends))
    longest = routes.words.shape[1]
    if longest:
        # Where a surface meets the line of the mirror before or after the leg.
        neighbour = routes.words[
            path, jnp.clip(jnp.where(kind == CUT_BEFORE, leg - 1, leg), 0, longest - 1)
        ]
        mirror = jax.tree.map(lambda leaf: leaf[neighbour], (placed.starts, placed.ends))
        cut = _meeting(start, end, *mirror)
    else:
        cut = start
    edge = _pick(
        [(kind == SECOND_END, end), ((kind == CUT_BEFORE) | (kind == CUT_AFTER), cut)], start
    )
    seen = folded(routes, path, leg, edge)
    along = folded(routes, path, leg, end) - folded(routes, path, leg, start)

    half = camera.field_of_view / 2
    above = unit(pad.end - pad.start)
    height = above.cross(source - pad.start)
    slope = above.scaled(jnp.abs(height) * jnp.cos(pad.grazing))
    drop = above.perpendicular().scaled(-height * jnp.sin(pad.grazing))
    direction = _pick(
        [
            (label == FIRST_PAD_END, pad.start - source),
            (label == SECOND_PAD_END, pad.end - source),
            (label == LEFT_LIMIT, axis.turned(rotation(half))),
            (label == RIGHT_LIMIT, axis.turned(rotation(-half))),
            (label == LOW_GRAZING, drop - slope),
            (label == HIGH_GRAZING, drop + slope),
            (kind == CROSSING, along),
        ],
        seen - source,
    )
    crossing = (label >= 0) & (kind == CROSSING)
    return Line(_pick([(crossing, seen)], source), direction, crossing)


def where_met(line: Line, pad: Pad) -> Float[Array, ""]:
    """Pad coordinate at which a line meets a pad; 0 if it does not."""
    first = line.direction.cross(pad.start - line.point)
    last = line.direction.cross(pad.end - line.point)
    return safe_divide(first, first - last)[0]


def _pick(choices: list[tuple[Array, Vector]], otherwise: Vector) -> Vector:
    chosen = otherwise
    for condition, vector in reversed(choices):
        chosen = Vector(
            jnp.where(condition, vector.x, chosen.x), jnp.where(condition, vector.y, chosen.y)
        )
    return chosen


def _meeting(start: Vector, end: Vector, first: Vector, last: Vector) -> Vector:
    """Where the line through ``start`` and ``end`` meets that through two other places."""
    along, step = last - first, end - start
    part, _ = safe_divide(along.cross(first - start), along.cross(step))
    return start + step.scaled(part)


def folded(routes: Routes, path: Int[Array, ""], leg: Int[Array, ""], place: Vector) -> Vector:
    """A place of a leg, unfolded behind the last mirror of the path."""
    shift, turn = jax.tree.map(lambda leaf: leaf[path, leg], (routes.shifts, routes.turns))
    return shift + Vector(place.x, routes.flips[path, leg] * place.y).turned(turn)
