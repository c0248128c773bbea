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
from optics.visibility.clear_ends import EndCover
from optics.visibility.lines_of_sight import windows
from optics.visibility.refraction import Cover, FrontCover
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
        cover: the layers behind; ``None`` where no pad of the scene has any.
    """

    index: Int[Array, "*pads"]
    start: Vector
    end: Vector
    side: Float[Array, "*pads"]
    grazing: Float[Array, "*pads"]
    cover: Cover | None = None

    @classmethod
    def all_of(cls, scene: Scene, placed: Placed) -> Pad:
        """All pads of a placed scene by their outermost surfaces, along one axis."""
        index = len(scene.layout.mirrors) + np.arange(len(scene.layout.pads))
        start, end = placed.segment(index)
        sides = jnp.asarray(scene.layout.sides[index], start.x.dtype)
        pads = cls(jnp.asarray(index), start, end, sides, scene.grazing)
        if (layers := scene.own_layers) is None:
            return pads
        along, lips = unit(end - start), layers.lip / placed.size
        start, end = start + along.scaled(lips[:, 0]), end - along.scaled(lips[:, 1])
        cover = FrontCover.of(scene, layers, placed.size)
        return cls(pads.index, start, end, sides, cover.grazing, cover)

    @classmethod
    def clear_ends(cls, scene: Scene, placed: Placed, fronts: FrontCover, clear: list[int]) -> Pad:
        """The clear end faces, by their indices among the faces of all bodies."""
        layout = scene.layout
        surface = len(layout.surfaces) - len(layout.bodies) + np.array(clear)
        pad = np.array([layout.bodies[i].pad for i in clear])
        start, end = placed.segment(surface)
        cover = EndCover.of(scene, placed, fronts, surface)
        # The camera is outside of the body: on the sensing side's left at the first end.
        side = jnp.asarray(-layout.sides[len(layout.mirrors) + pad], start.x.dtype) * cover.outward
        return cls(jnp.asarray(surface), start, end, side, scene.grazing[pad], cover)

    def ends(self) -> Vector:
        """Both ends of one pad, along one axis."""
        return stack(self.start, self.end)

    @property
    def behind(self) -> Cover:
        """The layers behind, where there are any."""
        assert self.cover is not None
        return self.cover

    def own(self, surfaces: int) -> Bool[Array, " surfaces"]:
        """Which of so many surfaces hide nothing of one pad, as they are itself or of its body."""
        return jnp.arange(surfaces) == self.index if self.cover is None else self.cover.own


Windows = Float[Array, "*views rows 2"] | None
"""Entries of the rays to both ends of what may be passed behind the surface seen; none in air."""


class Faces(eqx.Module):
    """All surfaces of a scene in a pose by which pads are seen.

    Attributes:
        fronts: the pads themselves, or the outermost surfaces of their layers.
        ends: clear end faces; ``None`` if there are none.
        front_windows: what the layers behind the outermost surfaces let through, of every path.
        end_windows: the same behind the clear end faces.
        ends_of: of every pad, which of the clear end faces are its, filled up with −1.
    """

    fronts: Pad
    ends: Pad | None
    front_windows: Windows
    end_windows: Float[Array, "*faces windows 2"] | None
    ends_of: tuple[tuple[int, ...], ...] = eqx.field(static=True)

    @classmethod
    def all_of(cls, scene: Scene, placed: Placed, paths: Unfolded) -> Faces:
        """Those of a placed scene, and what each lets through by given paths."""
        layout, fronts = scene.layout, Pad.all_of(scene, placed)
        passed = windows_of(paths, fronts)
        clear = [i for i, face in enumerate(layout.bodies) if face.kind == "clear"]
        if not isinstance(fronts.cover, FrontCover) or not clear:
            return cls(fronts, None, passed, None, ())
        pads = [layout.bodies[i].pad for i in clear]
        of = [[i for i, mine in enumerate(pads) if mine == pad] for pad in range(len(layout.pads))]
        most = max(map(len, of))
        ends_of = tuple(tuple(own + [-1] * (most - len(own))) for own in of)
        ends = Pad.clear_ends(scene, placed, fronts.cover, clear)
        return cls(fronts, ends, passed, windows_of(paths, ends), ends_of)

    def all(self) -> list[tuple[Pad, Windows]]:
        """Both kinds with their windows, if there are both."""
        fronts = self.fronts, self.front_windows
        return [fronts] if self.ends is None else [fronts, (self.ends, self.end_windows)]

    def end_of(self, face: Int[Array, "pads pieces"]) -> Int[Array, "pads pieces"]:
        """Which clear end face shows every piece; any where it is none."""
        own = jnp.arange(len(self.ends_of))[:, None]
        return jnp.asarray(self.ends_of)[own, jnp.maximum(face - 1, 0)]

    def of_pieces(
        self,
        function: Callable[..., Any],
        face: Int[Array, "pads pieces"] | None,
        path: Int[Array, "pads pieces"],
        *of_pieces: Shaped[Array, "..."],
    ) -> Any:
        """A function of the surface by which a piece is seen, and of what belongs to the piece.

        Args:
            function: of one surface, of what is let through behind it, of the path's index, and
                of one entry of what follows.
            face: the surface of every piece, as `Pieces.face` has it.
            path: the path of every piece.
            of_pieces: arrays of shape (pads, pieces, ...).
        """
        given = (path, *of_pieces)
        of_pad = jax.vmap(function, (None, *[0] * (1 + len(given))))
        inner = None
        if self.front_windows is not None:
            inner = self.front_windows[path, jnp.arange(len(path))[:, None]]
        by_front = jax.vmap(of_pad)(self.fronts, inner, *given)
        if self.ends is None or self.end_windows is None or face is None:
            return by_front
        end = self.end_of(face)
        ends = jax.tree.map(lambda leaf: leaf[end], self.ends)
        by_end = jax.vmap(jax.vmap(function))(ends, self.end_windows[path, end], *given)

        def chosen(front: Shaped[Array, "..."], end: Shaped[Array, "..."]) -> Shaped[Array, "..."]:
            return jnp.where(face.reshape(*face.shape, *[1] * (front.ndim - 2)) > 0, end, front)

        return jax.tree.map(chosen, by_front, by_end)

    def widest(self, margins: list[Float[Array, "paths _"]]) -> Float[Array, "paths pads"]:
        """Of every pad the widest view, by its outermost surface or a clear end face."""
        best = margins[0]
        if self.ends is not None:
            own = np.array(self.ends_of)
            of_ends = jnp.where(own >= 0, margins[1][:, own], -jnp.inf)
            best = jnp.maximum(best, jnp.max(of_ends, axis=-1))
        return best


def windows_of(paths: Unfolded, pads: Pad) -> Windows:
    """Of every path and pad what its layers let through."""

    def passed(path: Unfolded, pad: Pad) -> Float[Array, "rows 2"]:
        return windows(path, pad.behind, pad.ends())

    of_path = jax.vmap(passed, (None, 0))
    return None if pads.cover is None else jax.vmap(of_path, (0, None))(paths, pads)
