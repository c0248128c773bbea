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

from designopt.vectors import Vector, stack, vector
from optics.scene.layers import CHANNELS, Layers, Profile
from optics.scene.scene import Placed, Scene
from optics.visibility import boundary_codes as codes
from optics.visibility.clear_ends import EndCover
from optics.visibility.lines_of_sight import windows
from optics.visibility.refraction import FrontCover, least_grazing
from optics.visibility.unfolding import Unfolded, unit

LIMITS = (codes.LEFT_LIMIT, codes.RIGHT_LIMIT, codes.LOW_GRAZING, codes.HIGH_GRAZING)
"""Labels of what bounds every view: the field of view, and the flattest rays."""

PAD_ENDS = (codes.FIRST_PAD_END, codes.SECOND_PAD_END)
WALLS, BEZELS = (codes.FIRST_WALL, codes.SECOND_WALL), (codes.FIRST_BEZEL, codes.SECOND_BEZEL)
DARK = (codes.LOW_TRANSMISSION, codes.HIGH_TRANSMISSION)
"""Labels at both ends of a pad."""


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
    cover: FrontCover | EndCover | None = None

    @classmethod
    def all_of(cls, scene: Scene, placed: Placed) -> Pad:
        """All pads of a placed scene by their outermost surfaces, along one axis."""
        index = len(scene.layout.mirrors) + np.arange(len(scene.layout.pads))
        start, end = placed.segment(index)
        sides = jnp.asarray(scene.layout.sides[index], start.x.dtype)
        pads = cls(jnp.asarray(index), start, end, sides, scene.grazing)
        return pads if scene.layers is None else _covered(scene, scene.layers, placed, pads)

    def ends(self) -> Vector:
        """Both ends of one pad, along one axis."""
        return stack(self.start, self.end)

    @property
    def behind(self) -> FrontCover | EndCover:
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
        passed = _windows(paths, fronts)
        clear = [i for i, face in enumerate(layout.bodies) if face.kind == "clear"]
        if scene.layers is None or not clear:
            return cls(fronts, None, passed, None, ())
        pads = [layout.bodies[i].pad for i in clear]
        of = [[i for i, mine in enumerate(pads) if mine == pad] for pad in range(len(layout.pads))]
        most = max(map(len, of))
        ends_of = tuple(tuple(own + [-1] * (most - len(own))) for own in of)
        ends = _clear_ends(scene, scene.layers, placed, fronts, clear)
        return cls(fronts, ends, passed, _windows(paths, ends), ends_of)

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
        *of_pieces: Shaped[Array, "..."],
    ) -> Any:
        """A function of the surface by which a piece is seen, and of what belongs to the piece.

        Args:
            function: of one surface, and of one entry of what follows.
            face: the surface of every piece, as `Pieces.face` has it.
            of_pieces: arrays of shape (pads, pieces, ...).
        """
        of_pad = jax.vmap(function, (None, *[0] * len(of_pieces)))
        by_front = jax.vmap(of_pad)(self.fronts, *of_pieces)
        if self.ends is None or face is None:
            return by_front
        ends = jax.tree.map(lambda leaf: leaf[self.end_of(face)], self.ends)
        by_end = jax.vmap(jax.vmap(function))(ends, *of_pieces)

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


def _windows(paths: Unfolded, pads: Pad) -> Windows:
    def passed(path: Unfolded, pad: Pad) -> Float[Array, "rows 2"]:
        return windows(path, pad.behind, pad.ends())

    of_path = jax.vmap(passed, (None, 0))
    return None if pads.cover is None else jax.vmap(of_path, (0, None))(paths, pads)


def _covered(scene: Scene, layers: Layers, placed: Placed, faces: Pad) -> Pad:
    """Pads under their layers, from their outermost surfaces."""
    layout, size = scene.layout, placed.size
    profile = _profile(scene, layers)
    along = unit(faces.end - faces.start)
    start = faces.start + along.scaled(layers.lip[:, 0] / size)
    end = faces.end - along.scaled(layers.lip[:, 1] / size)
    first = profile.face()[:, 0] + layers.lip[:, 0]
    windows = (profile.windows() - first[:, None, None]) / size
    index = _index(layers)
    grazing = jax.vmap(least_grazing)(index, layers.transmission)
    bezels, bare = np.array(layout.bezels), np.array([not kinds for kinds in layout.layers])
    edge = np.where(bezels[:, None], BEZELS, np.where(bare[:, None], PAD_ENDS, WALLS))
    dark = (grazing > faces.grazing)[:, None]
    cover = FrontCover(
        own=jnp.asarray(layout.behind_face == np.arange(len(layout.pads))[:, None]),
        edges=jnp.asarray(edge),
        flattest=jnp.where(dark, jnp.array(DARK), jnp.array(LIMITS[2:])),
        labels=jnp.asarray(np.repeat(_window_labels(index.shape[1])[None], len(edge), axis=0)),
        thickness=layers.thickness / size,
        index=index,
        places=windows,
    )
    return Pad(faces.index, start, end, faces.side, jnp.maximum(grazing, faces.grazing), cover)


def _clear_ends(scene: Scene, layers: Layers, placed: Placed, fronts: Pad, clear: list[int]) -> Pad:
    """The clear end faces, by their indices among the faces of all bodies."""
    layout, size = scene.layout, placed.size
    faces = [layout.bodies[i] for i in clear]
    pad, layer, end = (np.array([getattr(f, of) for f in faces]) for of in ("pad", "layer", "end"))
    surface = len(layout.surfaces) - len(layout.bodies) + np.array(clear)
    start, last = placed.segment(surface)
    profile = _profile(scene, layers)
    along = unit(fronts.end - fronts.start)[pad]
    normal = along.perpendicular().scaled(fronts.side[pad])
    corners = profile.upper[pad, 0, 0] / size, profile.levels[pad, 0] / size
    origin = placed.segment(fronts.index)[0][pad]
    origin = origin - along.scaled(corners[0]) - normal.scaled(corners[1])
    count = layers.thickness.shape[1]
    labels = _window_labels(count)
    second = (end == 1)[:, None, None]
    # Rays through the second end face go backwards: they pass second ends first.
    places, labels = profile.windows()[pad] / size, np.repeat(labels[None], len(pad), axis=0)
    places = jnp.where(second, places[..., ::-1], places)
    labels = np.where(second, labels[..., ::-1], labels)
    dark = np.repeat(np.array([[DARK]]), len(pad), axis=0)
    # The side of the camera lies outside of the body, on the sensing side's left at the first end.
    cover = EndCover(
        own=jnp.asarray(np.arange(len(layout.surfaces)) == surface[:, None]),
        edges=jnp.asarray(np.array(WALLS)[end][:, None] - 2 * (layer[:, None] + [[1, 0]])),
        flattest=jnp.asarray(np.repeat([LIMITS[2:]], len(pad), axis=0)),
        labels=jnp.asarray(np.concatenate([labels, dark], axis=1)),
        origin=origin,
        along=along,
        normal=normal,
        lower=Vector(profile.lower[pad, layer, end] / size, profile.levels[pad, layer + 1] / size),
        upper=Vector(profile.upper[pad, layer, end] / size, profile.levels[pad, layer] / size),
        outward=jnp.asarray(2.0 * end - 1, along.x.dtype),
        layer=jnp.asarray(layer),
        thickness=layers.thickness[pad] / size,
        index=_index(layers)[pad],
        places=places,
        membrane=jnp.stack([jnp.zeros_like(origin.x), profile.membrane[pad, 1] / size], -1),
        transmission=layers.transmission[pad],
    )
    side = fronts.side[pad] * jnp.asarray(1.0 - 2 * end, along.x.dtype)
    return Pad(jnp.asarray(surface), start, last, side, scene.grazing[pad], cover)


def _profile(scene: Scene, layers: Layers) -> Profile:
    ends = vector(scene.pads)
    return Profile.of(layers, (ends[:, 1] - ends[:, 0]).length())


def _index(layers: Layers) -> Float[Array, "pads layers"]:
    return layers.index[..., CHANNELS.index("green")]


def _window_labels(layers: int) -> np.ndarray:
    """Labels of both ends of what may be passed at the lower side of every layer."""
    inner = codes.FIRST_WALL - 2 - np.arange(2 * (layers - 1)).reshape(-1, 2)
    return np.concatenate([inner, [PAD_ENDS]])
