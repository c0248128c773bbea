"""What bounds a view: lines that a ray to the pad must not cross, each linear along the pad.

From a (virtual) camera S, the part of a pad that is hidden by a segment AB, or seen through it, is
one interval: that where

    (A − S) × (P − S),   (P − S) × (B − S)   and   −(B − A) × (P − A),

all taken with the sign of (A − S) × (B − S), are positive. Each is linear along the pad, so its
values at the pad's two ends give the place where it vanishes as a quotient: there the line of sight
along an end of the segment, or the segment itself, meets the pad. Limits of the field of view and
of the grazing angle are linear conditions too.
"""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from designopt.numerics import safe_divide
from designopt.vectors import Vector, rotation, stack, vector, where
from optics.scene.camera import Camera
from optics.scene.layers import CHANNELS, Layers, Profile
from optics.scene.scene import Placed, Scene
from optics.visibility import boundary_codes as codes
from optics.visibility.boundary_codes import parts_of, with_kind
from optics.visibility.refraction import Stack, least_grazing
from optics.visibility.unfolding import Unfolded, unit


PER_SEGMENT = 3
"""How many of the `conditions` are those of one segment."""

LIMITS = (codes.LEFT_LIMIT, codes.RIGHT_LIMIT, codes.LOW_GRAZING, codes.HIGH_GRAZING)
"""Labels of the last `conditions`, which are not of a segment."""

PAD_ENDS = (codes.FIRST_PAD_END, codes.SECOND_PAD_END)
"""Labels of the last `meetings`."""

WALLS, BEZELS = (codes.FIRST_WALL, codes.SECOND_WALL), (codes.FIRST_BEZEL, codes.SECOND_BEZEL)
DARK = (codes.LOW_TRANSMISSION, codes.HIGH_TRANSMISSION)
"""Labels with which layers may replace others, at both ends of a pad."""


class Cover(eqx.Module):
    """What layers add to a pad in a pose; lengths in units of the placed scene.

    Attributes:
        stack: the layers, places counted from the start of the outermost surface that is free.
        own: which surfaces are of the pad's own body and hide nothing of it: not those of a bezel.
        edges: labels of both ends of the surface that is free.
        flattest: labels of the flattest rays towards both.
    """

    stack: Stack
    own: Bool[Array, "*pads surfaces"]
    edges: Int[Array, "*pads 2"]
    flattest: Int[Array, "*pads 2"]


class Pad(eqx.Module):
    """A pad in a pose, or the outermost surface of its layers, between the lips of its bezel.

    Attributes:
        index: its index among all surfaces.
        start: its first end.
        end: its second end.
        side: +1 if its left side senses, −1 if its right does, 0 if both do.
        grazing: least angle between it and a ray, rad; that at which the least transmission is
            reached, if it is larger.
        cover: its layers; ``None`` where no pad of the scene has any.
    """

    index: Int[Array, "*pads"]
    start: Vector
    end: Vector
    side: Float[Array, "*pads"]
    grazing: Float[Array, "*pads"]
    cover: Cover | None = None

    @classmethod
    def all_of(cls, scene: Scene, placed: Placed) -> Pad:
        """All pads of a placed scene, along one axis."""
        index = len(scene.layout.mirrors) + np.arange(len(scene.layout.pads))
        start, end = placed.segment(index)
        sides = jnp.asarray(scene.layout.sides[index], start.x.dtype)
        if scene.layers is None:
            return cls(jnp.asarray(index), start, end, sides, scene.grazing)
        return _covered(scene, scene.layers, placed, cls(index, start, end, sides, scene.grazing))

    def ends(self) -> Vector:
        """Both ends of one pad, along one axis."""
        return stack(self.start, self.end)

    def edges(self) -> Int[Array, "2"]:
        """Labels of both ends of one pad, or of the surface that is seen of it."""
        return jnp.array(PAD_ENDS) if self.cover is None else self.cover.edges

    def flattest(self) -> Int[Array, "2"]:
        """Labels of the flattest rays towards both ends of one pad."""
        return jnp.array(LIMITS[2:]) if self.cover is None else self.cover.flattest

    def own(self, surfaces: int) -> Bool[Array, " surfaces"]:
        """Which of so many surfaces hide nothing of one pad, as they are itself or of its body."""
        return jnp.arange(surfaces) == self.index if self.cover is None else self.cover.own

    def seen_from(self, source: Vector) -> tuple[Float[Array, ""], Float[Array, ""]]:
        """Height of a source over one pad's outermost surface, and the place along it below.

        The height is positive also of a source behind it.
        """
        along, toward = unit(self.end - self.start), source - self.start
        height = jnp.abs(along.cross(toward))
        return jnp.where(height > 0, height, 1.0), along.dot(toward)


def _covered(scene: Scene, layers: Layers, placed: Placed, faces: Pad) -> Pad:
    """Pads under their layers, from their outermost surfaces."""
    layout, size = scene.layout, placed.size
    ends = vector(scene.pads)
    profile = Profile.of(layers, (ends[:, 1] - ends[:, 0]).length())
    first, last = profile.face()[:, 0] + layers.lip[:, 0], profile.face()[:, 1] - layers.lip[:, 1]
    along = unit(faces.end - faces.start)
    start = faces.start + along.scaled(layers.lip[:, 0] / size)
    end = faces.end - along.scaled(layers.lip[:, 1] / size)
    windows = (profile.windows() - first[:, None, None]) / size
    index = layers.index[..., CHANNELS.index("green")]
    grazing = jax.vmap(least_grazing)(index, layers.transmission)
    bezels, bare = np.array(layout.bezels), np.array([not kinds for kinds in layout.layers])
    edge = np.where(bezels[:, None], BEZELS, np.where(bare[:, None], PAD_ENDS, WALLS))
    dark = (grazing > faces.grazing)[:, None]
    cover = Cover(
        Stack(layers.thickness / size, index, windows),
        jnp.asarray(layout.behind_face == np.arange(len(layout.pads))[:, None]),
        jnp.broadcast_to(jnp.asarray(edge), (len(layout.pads), 2)),
        jnp.where(dark, jnp.array(DARK), jnp.array(LIMITS[2:])),
    )
    return Pad(faces.index, start, end, faces.side, jnp.maximum(grazing, faces.grazing), cover)


def conditions(camera: Camera, path: Unfolded, pad: Pad) -> Float[Array, "2 bounds"]:
    """Values at the pad's two ends of all that may bound a view.

    First the three numbers of the segments, but for their common sign: the first ones of all
    segments on all legs, the second ones, the third ones. Then `LIMITS`, which are positive within
    a field of view below 180°, and where a ray is no flatter than the least grazing angle.
    """
    half, dtype = camera.field_of_view / 2, camera.field_of_view.dtype
    limits = path.axis[None].turned(rotation(jnp.stack([half, -half])))
    inward, towards = jnp.array([-1.0, 1.0], dtype), jnp.array([1.0, -1.0], dtype)
    # notation: where a ray meets the pad at s from the foot of the height h, tan(grazing) = h/|s|;
    # h and s in units of the pad's length.
    step, least = pad.end - pad.start, rotation(pad.grazing)
    h = jnp.abs(step.cross(path.source - pad.start))

    @jax.vmap
    def values(place: Vector) -> Float[Array, " bounds"]:
        ends, ray = path.blockers.ends - path.source, place - path.source
        beside = ends.cross(ray)
        behind = (ends[..., 1] - ends[..., 0]).cross(place - path.blockers.ends[..., 0])
        segments = [beside[..., 0], -beside[..., 1], -behind]
        inside = inward * limits.cross(ray[None])
        steep = h * least.x + towards * (step.dot(ray) * least.y)
        return jnp.concatenate([*(part.reshape(-1) for part in segments), inside, steep])

    return values(pad.ends())


def meetings(camera: Camera, path: Unfolded, pad: Pad) -> Float[Array, " bounds"]:
    """Where all that may bound a view meets the pad, or the outermost surface of its layers.

    That is of `conditions`, the surface's own ends, and what lines of sight may pass at the lower
    side of every layer: the coordinate along the surface, 0 at its start and 1 at its end.
    """
    first, last = conditions(camera, path, pad)
    at, _ = safe_divide(first, first - last)
    ends = jnp.array([0.0, 1.0], at.dtype)
    if pad.cover is None:
        return jnp.concatenate([at, ends])
    return jnp.concatenate([at, ends, windows(path, pad).reshape(-1)])


def windows(path: Unfolded, pad: Pad) -> Float[Array, "layers 2"]:
    """Where the lines of sight to both ends of the windows of all layers enter the outermost."""
    height, foot = pad.seen_from(path.source)
    length = (pad.end - pad.start).length()
    entry = foot + height * pad.cover.stack.slopes(height, foot)
    return safe_divide(entry, jnp.broadcast_to(length, entry.shape))[0]


def labels_of(path: Unfolded, pad: Pad) -> Int[Array, " bounds"]:
    """Labels of all `meetings`."""
    first, last = path.blockers.labels[..., 0], path.blockers.labels[..., 1]
    segments = jnp.stack([first, last, with_kind(first, codes.CROSSING)]).reshape(-1)
    if pad.cover is None:
        return jnp.concatenate([segments, jnp.array([*LIMITS, *PAD_ENDS])])
    sight, inner = jnp.array(LIMITS[:2]), jnp.arange(2, 2 * pad.cover.stack.thickness.size)
    own = [sight, pad.flattest(), pad.edges(), codes.FIRST_WALL - inner, jnp.array(PAD_ENDS)]
    return jnp.concatenate([segments, *own])


def toward(camera: Camera, path: Unfolded, pad: Pad, label: Int[Array, ""]) -> Vector:
    """From the source along the line of sight that a label stands for, of any length."""
    source, axis, step = path.source, path.axis, pad.end - pad.start
    leg, surface, kind = parts_of(jnp.maximum(label, 0))
    edges = jax.tree.map(lambda leaf: leaf[leg, surface], path.blockers)
    first, last = edges.ends[0], edges.ends[1]
    along = last - first
    met, _ = safe_divide(along.cross(pad.start - first), -along.cross(step))
    edge = where(edges.labels[0] == label, first, last)
    edge = where(kind == codes.CROSSING, pad.start + step.scaled(met), edge)

    # The labels below 0 come in pairs, of which one has the sign 1.
    second = (
        (label == codes.SECOND_PAD_END)
        | (label == codes.LEFT_LIMIT)
        | (label == codes.HIGH_GRAZING)
        | (label == codes.HIGH_TRANSMISSION)
    )
    sign = jnp.where(second, 1.0, -1.0).astype(source.x.dtype)
    half = rotation(camera.field_of_view / 2)
    limit = axis.scaled(half.x) + axis.perpendicular().scaled(sign * half.y)
    along_pad = unit(step)
    above = along_pad.cross(source - pad.start)
    drop = along_pad.perpendicular().scaled(-above * jnp.sin(pad.grazing))
    flattest = drop + along_pad.scaled(sign * jnp.abs(above) * jnp.cos(pad.grazing))
    end = where(label >= 0, edge, _own_end(path, pad, label))
    is_limit = (label == codes.LEFT_LIMIT) | (label == codes.RIGHT_LIMIT)
    is_grazing = (label == codes.LOW_GRAZING) | (label == codes.HIGH_GRAZING)
    is_grazing |= (label == codes.LOW_TRANSMISSION) | (label == codes.HIGH_TRANSMISSION)
    return where(is_limit, limit, where(is_grazing, flattest, end - source))


def _own_end(path: Unfolded, pad: Pad, label: Int[Array, ""]) -> Vector:
    """The place on the surface seen, or its line, through which a ray passes an end of the pad."""
    if pad.cover is None:
        return where(label == codes.SECOND_PAD_END, pad.end, pad.start)
    inner = windows(path, pad).reshape(-1)
    entries = jnp.concatenate([jnp.array([0.0, 1.0], inner.dtype), inner])
    own = jnp.array([codes.FIRST_BEZEL, codes.SECOND_BEZEL, *PAD_ENDS])
    at = jnp.array([0, 1, inner.size, inner.size + 1])
    wall = jnp.clip(codes.FIRST_WALL - label, 0, inner.size + 1)
    entry = entries[jnp.where(jnp.any(own == label), at[jnp.argmax(own == label)], wall)]
    return pad.start + (pad.end - pad.start).scaled(entry)
