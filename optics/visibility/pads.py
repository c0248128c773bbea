"""Pads in a pose, as lines of sight meet them: the surface that is seen, and what lies behind it.

Of a pad without layers that surface is the pad itself; of a layered one it is the outermost
surface, or a clear end face of a layer. Coordinates on it, 0 to 1, are called entries.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, Shaped

from designopt.vectors import Vector, stack
from optics.scene.scene import Placed, Scene
from optics.visibility.boundary_codes import BEZELS, DARK, LIMITS, PAD_ENDS, edge_of_layers
from optics.visibility.clear_ends import FREE, EndCover, backwards
from optics.visibility.lines_of_sight import windows
from optics.visibility.refraction import Cover, FrontCover, least_grazing
from optics.visibility.unfolding import Unfolded, unit


class Pad(eqx.Module):
    """A pad in a pose, or the outermost surface of its layers, or a clear end face.

    Attributes:
        index: its index among all surfaces.
        start: its first end; of an outermost surface, the edge of the bezel's lip.
        end: its second end.
        side: +1 if its left side senses, −1 if its right does, 0 if both do.
        grazing: least angle between it and a ray, rad; that at which the least transmission is
            reached, if it is larger.
        own: which surfaces, in the order of the solids, hide nothing of it, as they are itself or
            of its body.
        edges: labels of its two ends.
        flattest: labels of the flattest rays towards both.
        labels: labels of both ends of its windows, as the layers behind it have them.
    """

    index: Int[Array, "*pads"]
    start: Vector
    end: Vector
    side: Float[Array, "*pads"]
    grazing: Float[Array, "*pads"]
    own: Bool[Array, "*pads order"]
    edges: Int[Array, "*pads 2"]
    flattest: Int[Array, "*pads 2"]
    labels: Int[Array, "*pads rows 2"]

    @classmethod
    def all_of(cls, scene: Scene, placed: Placed) -> Pad:
        """All pads of a placed scene by their outermost surfaces, along one axis."""
        layout, count = scene.layout, len(scene.layout.pads)
        index = len(layout.mirrors) + np.arange(count)
        start, end = placed.segment(index)
        grazing, flattest = scene.grazing, jnp.tile(jnp.array(LIMITS[2:]), (count, 1))
        edges, labels = np.tile(PAD_ENDS, (count, 1)), np.zeros((count, 0, 2), int)
        if (layers := scene.own_layers) is not None:
            along, lips = unit(end - start), layers.lip / placed.size
            start, end = start + along.scaled(lips[:, 0]), end - along.scaled(lips[:, 1])
            dim = jax.vmap(least_grazing)(layers.green, layers.transmission)
            flattest = jnp.where((dim > grazing)[:, None], jnp.array(DARK), flattest)
            grazing = jnp.maximum(dim, grazing)
            edges[[bool(kinds) for kinds in layout.layers]] = edge_of_layers(0, np.arange(2))
            edges[np.array(layout.bezels)] = BEZELS
            inner = edge_of_layers(np.arange(1, layers.green.shape[1])[:, None], np.arange(2))
            labels = np.repeat([[*inner, PAD_ENDS]], count, axis=0)
        return cls(
            index=jnp.asarray(index),
            start=start,
            end=end,
            side=jnp.asarray(layout.sides[index], start.x.dtype),
            grazing=grazing,
            own=jnp.asarray(layout.behind_face[layout.solids.order] == np.arange(count)[:, None]),
            edges=jnp.asarray(edges),
            flattest=flattest,
            labels=jnp.asarray(labels),
        )

    @classmethod
    def clear_ends(cls, scene: Scene, placed: Placed, pads: Pad, clear: list[int]) -> Pad:
        """The clear end faces, by their indices among the faces of all bodies.

        Their windows are those of the outermost surfaces of all pads, and one more.
        """
        layout, count = scene.layout, len(scene.layout.surfaces)
        surface = count - len(layout.bodies) + np.array(clear)
        of = [layout.bodies[i] for i in clear]
        pad, layer, end = np.array([(face.pad, face.layer, face.end) for face in of]).T
        solids = [next(own for own in layout.solids.together if i in own) for i in surface]
        start, stop = placed.segment(surface)
        # The camera is outside of the body: on the sensing side's left at the first end.
        side = -layout.sides[len(layout.mirrors) + pad] * (2 * end - 1)
        dark = jnp.array([[DARK]] * len(pad))
        return cls(
            index=jnp.asarray(surface),
            start=start,
            end=stop,
            side=jnp.asarray(side, start.x.dtype),
            grazing=scene.grazing[pad],
            own=jnp.asarray([np.isin(layout.solids.order, solid) for solid in solids]),
            edges=jnp.asarray(edge_of_layers(layer[:, None] + [[1, 0]], end[:, None])),
            flattest=jnp.array([LIMITS[2:]] * len(pad)),
            labels=jnp.concatenate([backwards(end, pads.labels[pad]), dark], axis=1),
        )

    def ends(self) -> Vector:
        """Both ends of one pad, along one axis."""
        return stack(self.start, self.end)


Windows = Float[Array, "*views rows 2"]
"""Entries of the rays to both ends of what may be passed behind the surface seen."""


class Faces(eqx.Module):
    """All surfaces of a scene in a pose by which pads are seen.

    Attributes:
        seen: the pads themselves, or the outermost surfaces of their layers, and then clear end
            faces.
        windows: what the layers behind them let through, of every path; no rows in air.
        fronts: the layers behind the outermost surfaces; ``None`` if no pad has any.
        ends: the layers behind the clear end faces; ``None`` if there are none.
        ends_of: of every pad, which of the clear end faces are its, filled up with −1.
    """

    seen: Pad
    windows: Windows
    fronts: FrontCover | None
    ends: EndCover | None = None
    ends_of: tuple[tuple[int, ...], ...] = eqx.field(static=True, default=())

    @classmethod
    def all_of(cls, scene: Scene, placed: Placed, paths: Unfolded) -> Faces:
        """Those of a placed scene, and what each lets through by given paths."""
        layout, layers, pads = scene.layout, scene.own_layers, Pad.all_of(scene, placed)
        fronts = None if layers is None else FrontCover.of(scene, layers, placed.size)
        passed = windows_of(paths, fronts, pads)
        clear = [i for i, face in enumerate(layout.bodies) if face.kind == "clear"]
        if not clear:
            return cls(pads, passed, fronts)
        of_pad = [layout.bodies[i].pad for i in clear]
        of = [[i for i, own in enumerate(of_pad) if own == pad] for pad in range(len(layout.pads))]
        most = max(map(len, of))
        ends_of = tuple(tuple(own + [-1] * (most - len(own))) for own in of)
        behind = EndCover.of(scene, placed, [layout.bodies[i] for i in clear])
        ends = Pad.clear_ends(scene, placed, pads, clear)
        # The flattest ray limits what an outermost surface lets through already.
        free, dark = jnp.array([[FREE]], passed.dtype), jnp.array([[DARK]])
        open_ = jnp.broadcast_to(free, (*passed.shape[:2], 1, 2))
        unlimited = jnp.broadcast_to(dark, (len(layout.pads), 1, 2))
        pads = eqx.tree_at(
            lambda pad: pad.labels, pads, jnp.concatenate([pads.labels, unlimited], axis=1)
        )
        both = jnp.concatenate([passed, open_], axis=2), windows_of(paths, behind, ends)
        seen = jax.tree.map(lambda *leaves: jnp.concatenate(leaves), pads, ends)
        return cls(seen, jnp.concatenate(both, axis=1), fronts, behind, ends_of)

    def end_of(self, face: Int[Array, "pads pieces"]) -> Int[Array, "pads pieces"]:
        """Which clear end face shows every piece; any where it is none."""
        own = jnp.arange(len(self.ends_of))[:, None]
        return jnp.asarray(self.ends_of)[own, jnp.maximum(face - 1, 0)]

    def of_pieces(
        self,
        function: Callable[..., Any],
        face: Int[Array, "pads pieces"] | None,
        path: Int[Array, "pads pieces"],
        *of_pieces: Any,
    ) -> Any:
        """A function of the surface by which a piece is seen, and of what belongs to the piece.

        Args:
            function: of one surface, of what is let through behind it, of the path's index, and
                of one entry of what follows.
            face: the surface of every piece, as `Pieces.face` has it.
            path: the path of every piece.
            of_pieces: trees of arrays of shape (pads, pieces, ...).
        """
        by, given = jnp.arange(len(path))[:, None], (path, *of_pieces)
        if self.ends is None or face is None:
            of_pad = jax.vmap(function, (None, *[0] * (1 + len(given))))
            return jax.vmap(of_pad)(self.seen, self.windows[path, by], *given)
        by = jnp.where(face > 0, len(path) + self.end_of(face), by)
        seen = jax.tree.map(lambda leaf: leaf[by], self.seen)
        return jax.vmap(jax.vmap(function))(seen, self.windows[path, by], *given)

    def through(
        self,
        function: Callable[..., Any],
        face: Int[Array, "pads pieces"] | None,
        entries: Float[Array, "pads pieces _"],
        *more: Any,
    ) -> Any:
        """As `of_pieces`, a function of the layers behind the surface, if any, and of its ends."""
        of_pieces = entries, *more
        count, each = len(entries), [0] * len(of_pieces)
        faces = jax.vmap(Pad.ends)(self.seen)
        front = jax.tree.map(lambda leaf: leaf[:count], faces)
        of_pad = jax.vmap(function, (None, None, *each))
        by_front = jax.vmap(of_pad)(self.fronts, front, *of_pieces)
        if self.ends is None or face is None:
            return by_front
        end = self.end_of(face)
        ends = self.ends, jax.tree.map(lambda leaf: leaf[count:], faces)
        own = jax.tree.map(lambda leaf: leaf[end], ends)
        by_end = jax.vmap(jax.vmap(function))(*own, *of_pieces)

        def chosen(front: Shaped[Array, "..."], end: Shaped[Array, "..."]) -> Shaped[Array, "..."]:
            return jnp.where(face.reshape(*face.shape, *[1] * (front.ndim - 2)) > 0, end, front)

        return jax.tree.map(chosen, by_front, by_end)

    def widest(self, margins: Float[Array, "paths faces"]) -> Float[Array, "paths pads"]:
        """Of every pad the widest view, by its outermost surface or a clear end face."""
        if self.ends is None:
            return margins
        own = np.array(self.ends_of)
        by_end = jnp.where(own >= 0, margins[:, len(own) + own], -jnp.inf)
        return jnp.maximum(margins[:, : len(own)], jnp.max(by_end, axis=-1))


def windows_of(paths: Unfolded, cover: Cover | None, pads: Pad) -> Windows:
    """Of every path and pad what its layers let through."""
    if cover is None:
        return jnp.zeros((*paths.source.x.shape, *pads.side.shape, 0, 2), pads.side.dtype)

    def passed(path: Unfolded, cover: Cover, pad: Pad) -> Float[Array, "rows 2"]:
        return windows(path, cover, pad.ends())

    return jax.vmap(jax.vmap(passed, (None, 0, 0)), (0, None, None))(paths, cover, pads)
