"""Second images: membranes mirrored in the clear side walls of their layers.

Light that enters a layer by the outermost surface and meets a clear wall from inside is totally
reflected if n sin θ > 1 for the angle θ to the wall's normal. Behind a wall at right angles to the
membrane the way goes on as if everything below were mirrored in the wall, for the angles to the
levels stay what they were: the camera sees the membrane once more, next to the wall. Nothing new is
felt there, so it is never coverage.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Literal, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from designopt.numerics import safe_sqrt
from designopt.vectors import rotation
from optics.scene.layers import Layers
from optics.scene.scene import Layout, Placed, Scene, place
from optics.visibility.boundary_codes import LIMITS, PAD_ENDS
from optics.visibility.coverage import pieces_of
from optics.visibility.outline_edges import Box, OutlineEdges, boxes_of, outline_of
from optics.visibility.pads import Faces, Pad, windows_of
from optics.visibility.refraction import FrontCover
from optics.visibility.searching import find
from optics.visibility.unfolding import paths_of, unfold_all
from optics.visibility.views import Pieces, describe_end

SQUARE = 1e-9
"""rad: a bevel so small leaves a wall at right angles to the membrane."""


class Wall(NamedTuple):
    """A clear side wall of a layer.

    Attributes:
        pad: index of the pad.
        layer: index of the layer.
        side: at which end of the pad it is, or on which side of the section (`EDGES`).
    """

    pad: int
    layer: int
    side: Literal["from", "to", "left", "right"]

    @property
    def name(self) -> str:
        """In words."""
        return f"layer {self.layer + 1} at '{self.side}'"


def clear_walls(layout: Layout, beside: bool = False) -> list[Wall]:
    """All clear walls of layers: those at the ends of pads, or those beside the section.

    Example:
        >>> from importlib.resources import files
        >>> from optics import read_scene
        >>> layered = read_scene(files("studies") / "gallery/scenes/layered-pad.toml").layout
        >>> [wall.name for wall in clear_walls(layered)][:2]
        ["layer 1 at 'from'", "layer 1 at 'to'"]
    """
    sides = ("left", "right") if beside else ("from", "to")
    return [
        Wall(pad, layer, side)
        for pad, kinds in enumerate(layout.layers)
        for layer, of in enumerate(kinds)
        for side, kind in zip(sides, (of.beside,) * 2 if beside else of[:2], strict=True)
        if kind == "clear"
    ]


@partial(jax.jit, static_argnames="bounces")
def find_second_images(
    scene: Scene, angles: Float[Array, " joints"], *, bounces: int | None = None
) -> Pieces:
    """Where the camera sees membranes mirrored in clear ends of their layers; differentiable.

    Light that is reflected once, by a wall at right angles to the membrane; walls with a bevel have
    no second image here.

    Args:
        scene: the scene, its mirrors straight.
        angles: joint angles in the order of ``scene.angle_names``, rad.
        bounces: most reflections of a path in mirrors; the scene's own number by default.

    Returns:
        The pieces that appear in each of the `clear_walls` in place of pads.

    Raises:
        ValueError: no end of a layer is clear.

    Example:
        >>> from importlib.resources import files
        >>> from optics import read_scene
        >>> scene = read_scene(files("studies") / "gallery/scenes/layered-pad.toml")
        >>> images = find_second_images(scene, jnp.zeros(0))
        >>> walls = clear_walls(scene.layout)
        >>> sorted({walls[i].name for i in np.nonzero(images.present)[0]})
        ["layer 1 at 'to'", "layer 2 at 'to'"]
    """
    walls = clear_walls(scene.layout)
    layers = scene.own_layers
    if layers is None or not walls:
        raise ValueError("no end of a layer is clear: there are no second images")
    placed = place(scene, angles)
    words = paths_of(scene.layout, scene.layout.bounces if bounces is None else bounces)
    paths = unfold_all(scene.layout, placed, words)
    mirrored, cover = _mirrored(scene, placed, layers, walls)
    faces = Faces(mirrored, windows_of(paths, cover, mirrored), cover)
    found = find(*jax.lax.stop_gradient((scene.camera, paths, faces)), None)
    pieces = pieces_of(scene.camera, placed.size, paths, faces, found)
    # The mirrored membrane begins where the pad ends.
    turned = {
        "start": jnp.where(found.present, 1 - pieces.end, 0.0),
        "end": jnp.where(found.present, 1 - pieces.start, 0.0),
        "start_label": _turned(pieces.end_label),
        "end_label": _turned(pieces.start_label),
    }
    ends = ("pixels", "px_per_mm", "distance", "spans", "apparent")
    turned |= {name: getattr(pieces, name)[..., ::-1] for name in ends}
    return replace(pieces, **turned)


def _turned(labels: Int[Array, "*pieces"]) -> Int[Array, "*pieces"]:
    """Labels with both ends of the membrane exchanged."""
    first, second = PAD_ENDS
    other = jnp.where(labels == second, first, labels)
    return jnp.where(labels == first, second, other)


def _mirrored(
    scene: Scene, placed: Placed, layers: Layers, walls: list[Wall]
) -> tuple[Pad, FrontCover]:
    """Pads whose layers and membranes are mirrored from the layers with clear ends on."""
    pad, layer, end = np.array([(w.pad, w.layer, w.side == "to") for w in walls], int).T
    size = placed.size
    every = (Pad.all_of(scene, placed), FrontCover.of(scene, layers, size))
    seen, cover = jax.tree.map(lambda leaf: leaf[pad], every)
    outward = layers.overhang[pad, layer, end] * jnp.asarray(2 * end - 1, size.dtype) / size
    wall = cover.places[np.arange(len(pad)), -1, end] + outward
    behind = (np.arange(cover.places.shape[1]) >= layer[:, None])[..., None]
    places = jnp.where(behind, 2 * wall[:, None, None] - cover.places[..., ::-1], cover.places)
    # The ends of the membrane keep their labels.
    turned = behind & (np.arange(cover.places.shape[1]) < cover.places.shape[1] - 1)[:, None]
    labels = jnp.where(turned, seen.labels[..., ::-1], seen.labels)
    # In air: (n cos of the angle to the level)² + sin² = n², and that cosine must exceed 1.
    squared = cover.index[np.arange(len(pad)), layer] ** 2 - 1
    leaks = squared < 1
    flattest = jnp.arccos(safe_sqrt(jnp.where(leaks, squared, 0.5)))
    square = jnp.abs(layers.bevel[pad, layer, end]) < SQUARE
    grazing = jnp.where(square, jnp.where(leaks, flattest, 0.0), jnp.pi / 2)
    flat = jnp.broadcast_to(jnp.array(LIMITS[2:]), seen.flattest.shape)
    seen = replace(seen, grazing=grazing, labels=labels, flattest=flat)
    return seen, replace(cover, places=places)


def describe_second_end(layout: Layout, label: int) -> str:
    """What bounds a second image, in words, from its label.

    Example:
        >>> from importlib.resources import files
        >>> from optics import read_scene
        >>> scene = read_scene(files("studies") / "gallery/scenes/layered-pad.toml")
        >>> describe_second_end(scene.layout, LIMITS[2])
        'where total reflection ends'
    """
    return "where total reflection ends" if label in LIMITS[2:] else describe_end(layout, label)


class SecondOutlines(eqx.Module):
    """Outlines of second images by all paths in all clear walls, those beside the section last.

    Attributes:
        edges: with walls in place of pads; ``along`` and ``beside`` are places on the membrane.
        total: whether all points of an outline are totally reflected.
    """

    edges: OutlineEdges
    total: Bool[Array, "*paths walls"]


def find_second_outlines(
    scene: Scene,
    angles: Float[Array, " joints"],
    *,
    lateral: Float[Array, ""] | float = 0.0,
    bounces: int | None = None,
) -> SecondOutlines:
    """Outlines of membranes mirrored in clear walls, at the ends of pads and beside the section.

    As `find_outline_edges`: wherever other surfaces hide them or not, and differentiable.

    Args:
        scene: the scene, its mirrors straight, with layers and widths of pads.
        angles: joint angles in the order of ``scene.angle_names``, rad.
        lateral: how far the camera is from the middle of the pads, towards greater columns, mm.
        bounces: most reflections of a path; the scene's own number by default.

    Raises:
        ValueError: no pad has layers, or none a width, or no wall is clear.

    Example:
        >>> from importlib.resources import files
        >>> from optics import read_scene
        >>> scene = read_scene(files("studies") / "gallery/scenes/layered-pad.toml")
        >>> jax.jit(find_second_outlines)(scene, jnp.zeros(0)).edges.present.shape
        (2, 8)
    """
    walls = [*clear_walls(scene.layout), *clear_walls(scene.layout, beside=True)]
    if scene.layers is None or not walls:
        raise ValueError("no side wall of a layer is clear: there are no second images")
    given = jnp.asarray(lateral, scene.pads.dtype), bounces
    boxes, behind, looks = boxes_of(scene, angles, *given)
    across = [wall.side in ("left", "right") for wall in walls]
    ends = [wall.side in ("to", "right") for wall in walls]
    pad, layer = np.array([wall[:2] for wall in walls]).T
    axis, end, at = np.array(across, int), np.array(ends, int), np.arange(len(walls))
    own, behind = jax.tree.map(lambda leaf: leaf[:, pad], (boxes, behind))
    overhang = jnp.where(axis == 0, scene.layers.overhang[pad, layer, end], 0.0)
    outward = overhang * jnp.asarray(2 * end - 1, overhang.dtype)
    wall = own.edges[:, at, axis, -1, end] + outward[None]
    below = np.arange(own.edges.shape[3]) >= 2 + layer[:, None]
    turned = (axis[:, None] == np.arange(2))[..., None] & below[:, None]
    images = 2 * wall[..., None, None, None] - own.edges[..., ::-1]
    mirrored = Box(own.stack, own.bezel, jnp.where(turned[None, ..., None], images, own.edges))
    found = jax.vmap(jax.vmap(outline_of))(mirrored, behind)

    def folded(places: Float[Array, "paths walls 4 points"], own: int) -> Array:
        there = jnp.asarray(axis == own)[None, :, None, None]
        return jnp.where(there, 2 * wall[..., None, None] - places, places)

    first, last = (own.edges[:, :, 0, -1, end][..., None, None] for end in range(2))
    along = (folded(found.along, 0) - first) / (last - first)
    # Index times cosine at the wall, in parts of the ray's direction in air.
    direction = jax.tree.map(lambda leaf: leaf[..., None, None], behind.along)
    within = direction.dot(rotation(found.angle))
    part = jnp.where(jnp.asarray(axis == 1)[None, :, None, None], found.slope, within)
    squared = scene.layers.green[pad, layer] ** 2
    total = part**2 / (1 + found.slope**2) <= squared[None, :, None, None] - 1
    square = jnp.abs(scene.layers.bevel[pad, layer, end]) < SQUARE
    present = found.present & looks[:, pad] & (square | (axis == 1))[None]
    beside = folded(found.beside, 1) + lateral
    edges = eqx.tree_at(lambda o: (o.along, o.beside, o.present), found, (along, beside, present))
    return SecondOutlines(edges, jnp.all(total, axis=(-2, -1)))
