"""Whole outlines of pads behind layers, in space: where they are, and what bounds them.

The section is extruded: every layer, and the opening of a bezel, is a rectangle as wide as the pad.
A ray from the (virtual) camera stays in its plane of incidence. If it points in the direction
(c, s), c² + s² = 1, along the pad and across the section, and has gone ρ(w) from the foot of the
camera at some level (`optics.visibility.refraction`, w is its slope in air), it passes that level's
rectangle where c ρ(w) and s ρ(w) lie between its edges. Of all edges a on one side that with the
extreme a / ρ(w) bounds the view, and which one that is depends on the slope only. So where two
sides A and B of an outline meet, A(w)² + B(w)² = 1, and with a membrane coordinate in place of B
the same equation gives a point of the side A. Its left side falls with w: the root is bisected, and
one Newton step carries its derivatives.
"""

from __future__ import annotations

from functools import partial
from typing import Literal

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from designopt.numerics import bisect, refine_root, safe_arctan2, safe_sqrt
from optics.scene.imaging import Imaging
from optics.scene.scene import Layout, Scene, place
from optics.visibility.outlines import TOUCHING, Behind, behind_layers
from optics.visibility.pads import Pad
from optics.visibility.refraction import FrontCover, Stack
from optics.visibility.unfolding import VirtualCamera, paths_of, virtual_cameras

EDGES = ("left", "to", "right", "from")
"""Edges of an outline, from corner to corner as `CORNERS` has them: beside the section towards
lesser columns, at the pad's second end, beside it towards greater columns, at its first end."""

BoundName = Literal["membrane", "bezel", "wall"]

SAMPLES = 9
"""Of an edge of an outline, evenly along the membrane; between any two lies one more point."""

NEIGHBOURS = np.s_[:-1:2], np.s_[1::2], np.s_[2::2]
"""Of the points of an edge, those before, between and after."""

SPAN = 27.0
"""Slopes are looked for between e⁻²⁷ and e²⁷."""

FAR = 1e9
"""mm: where an edge is that bounds nothing."""

SLACK = 1e4
"""Of rounding: a point of an outline may lie so far beyond another edge, in parts of the pad."""


class OutlineEdges(eqx.Module):
    """Outlines of pads seen through the outermost surfaces of their layers; (paths, pads, edges).

    Paths are in the order of `name_paths`, edges in that of `EDGES`; along an edge are points, and
    between them parts that are each bounded by one level. Levels are the upper edge of the bezel,
    the outermost surface (there also the bezel's lower edge), and the lower sides of the layers.

    Attributes:
        angle: section angle, rad.
        slope: lateral slope; see `Imaging`.
        along: coordinate along the membrane, 0 to 1.
        beside: place on the membrane across the section from the pad's middle, mm.
        level: of every part, the level whose edge bounds it.
        present: whether there is an outline with four edges; elsewhere nothing else counts.
    """

    angle: Float[Array, "*views 4 points"]
    slope: Float[Array, "*views 4 points"]
    along: Float[Array, "*views 4 points"]
    beside: Float[Array, "*views 4 points"]
    level: Int[Array, "*views 4 parts"]
    present: Bool[Array, "*views"]

    def places(self, imaging: Imaging) -> Float[Array, "*views 4 points 2"]:
        """Where the points are imaged: column and row."""
        return imaging.place(self.angle, self.slope)


def name_bound(layout: Layout, pad: int, level: int) -> BoundName:
    """What bounds a part of an outline, from its level.

    Example:
        >>> from importlib.resources import files
        >>> from optics import read_scene
        >>> layered = read_scene(files("studies") / "gallery/scenes/layered-pad.toml").layout
        >>> [name_bound(layered, 1, level) for level in range(4)]
        ['bezel', 'bezel', 'wall', 'membrane']
    """
    if level > len(layout.layers[pad]):
        return "membrane"
    return "bezel" if level < 2 and layout.bezels[pad] else "wall"


class Box(eqx.Module):
    """The rectangles that rays must pass at all levels, from the foot of a (virtual) camera, mm.

    Attributes:
        stack: the camera over the layers.
        bezel: height of the bezel.
        edges: along the pad and across, at every level, first and second edge.
    """

    stack: Stack
    bezel: Float[Array, "*views"]
    edges: Float[Array, "*views 2 levels 2"]

    def reach(self, slope: Float[Array, ""]) -> Float[Array, " levels"]:
        """How far from the foot a ray of a slope in air is at every level."""
        stack, levels = self.stack, self.edges.shape[1]
        height, n, t = stack.height, stack.index, stack.thickness
        passed = jnp.tril(jnp.ones((levels, len(t)), slope.dtype), -2)
        air = jnp.full(levels, height).at[0].add(-self.bezel)
        # From within the bezel's opening its upper edge is no nearer than the foot.
        air = jnp.maximum(air, height / FAR)
        return air * slope + passed @ (t * slope / jnp.sqrt(n**2 + (n**2 - 1) * slope**2))

    def meet(
        self, one: Float[Array, " levels"], other: Float[Array, " levels"]
    ) -> tuple[Float[Array, ""], Float[Array, ""], Float[Array, ""]]:
        """Slope at which two sides meet, and how far the ray then points towards each."""
        given = self, one, other
        still = jax.lax.stop_gradient(given)

        def short(given: tuple[Box, Array, Array], log: Float[Array, ""]) -> Float[Array, ""]:
            (box, *sides), slope = given, jnp.exp(log)
            first, second = (box.toward(side, slope) for side in sides)
            return first**2 + second**2 + (TOUCHING / box.reach(slope)[-1]) ** 2 - 1

        end = jnp.full_like(self.bezel, SPAN)
        low, high = bisect(lambda log: short(still, log) > 0, -end, end)
        slope = jnp.exp(refine_root(short, given, (low + high) / 2))
        return slope, self.toward(one, slope), self.toward(other, slope)

    def nearest(self, side: Float[Array, " levels"], slope: Float[Array, ""]) -> Int[Array, ""]:
        """The level that bounds a side; of several in one place the lowest."""
        return len(side) - 1 - jnp.argmin((side / self.reach(slope))[::-1])

    def toward(self, side: Float[Array, " levels"], slope: Float[Array, ""]) -> Float[Array, ""]:
        """The part of a ray's direction towards a side with which it just meets what bounds it."""
        level = jax.lax.stop_gradient(self.nearest(side, slope))
        return side[level] / self.reach(slope)[level]

    def turn(
        self, side: Float[Array, " levels"], low: Float[Array, ""], high: Float[Array, ""]
    ) -> Float[Array, ""]:
        """The slope between two at which another level begins to bound a side."""
        still, own, ends = jax.lax.stop_gradient((self, side, (jnp.log(low), jnp.log(high))))
        before = still.nearest(own, jnp.exp(ends[0]))

        first, last = bisect(lambda log: still.nearest(own, jnp.exp(log)) == before, *ends)
        after = still.nearest(own, jnp.exp(last))

        def apart(given: tuple[Box, Array], log: Float[Array, ""]) -> Float[Array, ""]:
            box, side = given
            reach = box.reach(jnp.exp(log))
            return side[before] / reach[before] - side[after] / reach[after]

        return jnp.exp(refine_root(apart, (self, side), (first + last) / 2))


class _Point(eqx.Module):
    """Of a ray: its slope in air, its direction out of a side and across, what bounds it."""

    slope: Float[Array, "*points"]
    out: Float[Array, "*points"]
    across: Float[Array, "*points"]
    level: Int[Array, "*points"]


def _edge(box: Box, side: Float[Array, " levels"], first: Array, last: Array) -> _Point:
    """Points of one edge of an outline, between two places across it on the membrane."""
    membrane = jnp.arange(len(side)) == len(side) - 1

    def at(place: Float[Array, ""]) -> _Point:
        slope, out, across = box.meet(side, jnp.where(membrane, place, FAR))
        return _Point(slope, out, across, box.nearest(side, slope))

    def turned(before: _Point, between: _Point, after: _Point) -> _Point:
        """The place between two points at which another level begins to bound the side."""
        slope = box.turn(side, before.slope, after.slope)
        out = box.toward(side, slope)
        sign = jnp.sign(jnp.where(before.slope > after.slope, before.across, after.across))
        turn = _Point(slope, out, sign * safe_sqrt(1 - out**2), box.nearest(side, slope))
        same = before.level == after.level
        return jax.tree.map(lambda own, new: jnp.where(same, own, new), between, turn)

    points = jax.vmap(at)(jnp.linspace(first, last, 2 * SAMPLES - 1))
    neighbours = (jax.tree.map(lambda leaf, s=s: leaf[s], points) for s in NEIGHBOURS)
    turns = jax.vmap(turned)(*neighbours)
    return jax.tree.map(lambda leaf, turns: leaf.at[1::2].set(turns), points, turns)


def outline_of(box: Box, behind: Behind) -> OutlineEdges:
    """The outline of one view; ``along`` and ``beside`` are from the camera's foot, mm."""
    away = jnp.array([-1.0, 1.0, 1.0, -1.0], box.bezel.dtype)
    # Corner i is where edge i and the one before it meet.
    sides = away[:, None] * box.edges[np.array([1, 0, 1, 0]), :, np.array([0, 1, 1, 0])]
    before = np.arange(-1, 3)
    slope, out, across = jax.vmap(box.meet)(sides, sides[before])
    reach = jax.vmap(box.reach)(slope)[:, -1]
    first, last = reach * away[before] * across, (reach * away * out)[np.arange(1, 5) % 4]
    points = jax.vmap(partial(_edge, box))(sides, first, last)

    slope, own = points.slope, away[:, None] * points.out
    lies_beside = np.array([True, False, True, False])[:, None]
    along, beside = (jnp.where(where, points.across, own) for where in (lies_beside, ~lies_beside))
    entry = behind.along.scaled(slope * along) + behind.into
    reach = jax.vmap(jax.vmap(box.reach))(slope)
    # No point may lie beyond another edge at any level.
    met = jnp.stack([along, beside])[..., None] * reach[None]
    first, last = (box.edges[:, None, None, :, end] for end in range(2))
    room = jnp.min(jnp.minimum(met - first, last - met))
    least = -SLACK * jnp.finfo(slope.dtype).eps * jnp.max(jnp.abs(box.edges))
    return OutlineEdges(
        safe_arctan2(entry.y, entry.x),
        slope * beside / entry.length(),
        along * reach[..., -1],
        beside * reach[..., -1],
        jnp.repeat(points.level[:, ::2], 2, axis=1)[:, 1:-1],
        room >= least,
    )


def boxes_of(
    scene: Scene, angles: Float[Array, " joints"], lateral: Float[Array, ""], bounces: int | None
) -> tuple[Box, Behind, Bool[Array, "paths pads"]]:
    """Of every path and pad what rays must pass, where it is, and whether the camera looks at it.

    Raises:
        ValueError: no pad has layers, or none a width, or rays slide.
    """
    layers = scene.own_layers
    if layers is None or scene.widths is None:
        raise ValueError("only pads with layers and a 'width' have outlines of named edges")
    if scene.rays_slide:
        raise ValueError(
            "outlines with named edges are those of rays from one place; leave out 'pupil_shift' "
            "and the layers of mirrors"
        )
    words = paths_of(scene.layout, scene.layout.bounces if bounces is None else bounces)
    placed = place(scene, angles)
    pads, covers = Pad.all_of(scene, placed), FrontCover.of(scene, layers, placed.size)
    cameras = virtual_cameras(scene.layout, placed, words)
    known = jnp.isfinite(scene.widths)
    half = jnp.where(known, scene.widths, 1.0) / 2

    def box(
        camera: VirtualCamera, pad: Pad, cover: FrontCover, half: Array, lip: Array, bezel: Array
    ) -> tuple[Box, Behind, Bool[Array, ""]]:
        behind = behind_layers(camera, pad, cover, placed.size)
        step, places = pad.end - pad.start, cover.places
        surface = jnp.stack([jnp.zeros_like(half), step.length()])
        levels = jnp.concatenate([surface[None], surface[None], places])
        along = levels * placed.size + (behind.offset[0] - places[-1, 0] * placed.size)
        # A bezel goes all around.
        free = jnp.full(len(levels), half).at[:2].add(-jnp.max(lip))
        beside = jnp.stack([-free, free], axis=-1) - lateral
        above = step.cross(camera.source - pad.start)
        looks = (above != 0) & (pad.side * above >= 0)
        return Box(behind.stack, bezel, jnp.stack([along, beside])), behind, looks

    of_pads = jax.vmap(box, (None, 0, 0, 0, 0, 0))
    of_paths = jax.vmap(of_pads, (0, *[None] * 5))
    boxes, behind, looks = of_paths(cameras, pads, covers, half, layers.lip, layers.height)
    return boxes, behind, looks & known[None]


def find_outline_edges(
    scene: Scene,
    angles: Float[Array, " joints"],
    *,
    lateral: Float[Array, ""] | float = 0.0,
    bounces: int | None = None,
) -> OutlineEdges:
    """Whole outlines of all pads by all paths, and what bounds every part of them; differentiable.

    An outline is that of the view through the outermost surface, wherever other surfaces hide it or
    not, as in `find_outlines`. A wall bounds it whether it is black or clear. A bezel goes all
    around: beside the section its lip is as wide as the wider one of its two lips.

    Args:
        scene: the scene, its mirrors straight, with layers and widths of pads.
        angles: joint angles in the order of ``scene.angle_names``, rad.
        lateral: how far the camera is from the middle of the pads, towards greater columns, mm.
        bounces: most reflections of a path; the scene's own number by default.

    Raises:
        ValueError: no pad has layers, or none a width.

    Example:
        >>> from importlib.resources import files
        >>> from optics import Imaging, read_scene
        >>> scene = read_scene(files("studies") / "gallery/scenes/layered-pad.toml")
        >>> found = jax.jit(find_outline_edges)(scene, jnp.zeros(0))
        >>> [name_bound(scene.layout, 0, int(level)) for level in found.level[0, 0, :, 0]]
        ['membrane', 'membrane', 'membrane', 'wall']
    """
    given = jnp.asarray(lateral, scene.pads.dtype), bounces
    boxes, behind, looks = boxes_of(scene, angles, *given)
    found = jax.vmap(jax.vmap(outline_of))(boxes, behind)
    first, last = boxes.edges[:, :, 0, -1, 0], boxes.edges[:, :, 0, -1, 1]
    along = (found.along - first[..., None, None]) / (last - first)[..., None, None]
    return eqx.tree_at(
        lambda o: (o.along, o.beside, o.present),
        found,
        (along, found.beside + lateral, found.present & looks),
    )
