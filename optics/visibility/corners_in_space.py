"""Corners of pads in the image of a finger whose parts are not all square to the section.

A camera that is yawed or rolled, mirrors that lean or bow and pads that lean leave no plane in
which all rays to a place lie, but the method of images holds in space as well: the camera is
mirrored in the planes of a path's mirrors, one after the other, and sees the pad from there. Where
mirrors bow, each plane is the one that touches its mirror where the ray meets it; where the
entrance pupil moves, the camera is where the pupil is for the ray's angle. Both follow from the
ray, and the ray from them: these few unknowns are found by Newton's method.

Behind layers, corners are those of the outline that is seen (`optics.visibility.outline_edges`):
the membrane's, or where they hide it those of the outermost surface or of the bezel. A clear wall
mirrors the membrane up to the wall's upper edge, which then bounds the outline.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from designopt.numerics import safe_arctan2, safe_divide, safe_sqrt
from designopt.vectors import Vector
from optics.scene.fabrication import Fabrication
from optics.scene.imaging import CENTER, Imaging
from optics.scene.layers import GREEN, Layers
from optics.scene.scene import Layout, Placed, Scene, place
from optics.visibility.outline_edges import FAR, Box
from optics.visibility.outlines import CORNERS, TOUCHING
from optics.visibility.refraction import Stack, profile_of
from optics.visibility.unfolding import padded, unit

Point = Float[Array, "3"]

STEPS = 5
"""Newton steps from where rays would meet flat mirrors to where they meet bowed ones."""

OUTWARD = np.array([-1.0, 1.0])
"""Sense in which places grow beyond the first and the second edge."""

SIDES = np.array([[1, 0], [0, 1], [1, 1], [0, 0]])
"""Of the sides of an outline, as `EDGES` has them: axis on which they bound it (0 along the pad, 1
across), and at which of its two ends."""


class SpatialCamera(eqx.Module):
    """The camera in space, mm; its axes are unit vectors.

    Attributes:
        position: of the pinhole, or of the entrance pupil for rays along the axis.
        axis: optical axis.
        up: towards lesser rows.
        across: towards greater columns.
        pupil: coefficients of the pupil's shift; ``None`` if it stays.
    """

    position: Float[Array, "*views 3"]
    axis: Float[Array, "*views 3"]
    up: Float[Array, "*views 3"]
    across: Float[Array, "*views 3"]
    pupil: Float[Array, "*views 2"] | None

    @classmethod
    def of(cls, scene: Scene, placed: Placed, errors: Fabrication) -> SpatialCamera:
        """That of a placed scene, with the errors that turn it out of the section."""
        axis, up = _in_space(placed.axis), _in_space(placed.axis.perpendicular())
        axis, across = _turned(axis, jnp.zeros(3).at[2].set(1.0), errors.yaw)
        up, across = _turned(up, across, errors.roll)
        position = _in_space(placed.camera.scaled(placed.size))
        return cls(position.at[2].add(errors.lateral), axis, up, across, scene.camera.pupil_shift)

    def angle(self, ray: Point) -> Float[Array, ""]:
        """Of a ray from the optical axis, rad."""
        aside = safe_sqrt((ray @ self.up) ** 2 + (ray @ self.across) ** 2)
        return safe_arctan2(aside, ray @ self.axis)

    def start(self, angle: Float[Array, ""]) -> Point:
        """From where rays come that are at an angle from the axis."""
        if self.pupil is None:
            return self.position
        square = angle * angle
        return self.position + square * (self.pupil[0] + square * self.pupil[1]) * self.axis

    def image(self, imaging: Imaging, ray: Point) -> Float[Array, "2"]:
        """Column and row of a ray."""
        ahead, above = ray @ self.axis, ray @ self.up
        slope = ray @ self.across / jnp.hypot(ahead, above)
        return imaging.place(safe_arctan2(above, ahead), slope)


class SpatialMirror(eqx.Module):
    """A mirror in space, or several along a first axis, mm.

    Attributes:
        middle: of its chord, in the section.
        along: unit vector from its first end to its second.
        normal: unit vector to the left of that, leaning.
        half: half its length.
        bow: of its middle along the normal; ``None`` if all are flat.
    """

    middle: Float[Array, "*mirrors 3"]
    along: Float[Array, "*mirrors 3"]
    normal: Float[Array, "*mirrors 3"]
    half: Float[Array, "*mirrors"]
    bow: Float[Array, "*mirrors"] | None

    @classmethod
    def all_of(cls, layout: Layout, placed: Placed, errors: Fabrication) -> SpatialMirror:
        """All mirrors of a placed scene."""
        start, end = placed.segment(np.arange(len(layout.mirrors)))
        middle = (start + end).scaled(placed.size / 2)
        half, along = (end - start).length() * placed.size / 2, unit(end - start)
        normal, _ = _leaning(along.perpendicular(), errors.mirror_lean)
        return cls(_in_space(middle), _in_space(along), normal, half, errors.mirror_bow)

    def plane(self, place: Float[Array, ""]) -> tuple[Point, Point]:
        """A point and the normal of the plane that touches it at a place along it, mm."""
        if self.bow is None:
            return self.middle, self.normal
        share = place / self.half
        point = self.middle + place * self.along + self.bow * (1 - share**2) * self.normal
        normal = self.normal + 2 * self.bow * share / self.half * self.along
        return point, normal / jnp.linalg.norm(normal)


class SpatialPad(eqx.Module):
    """A pad in space with what lies on it, or several along a first axis, mm.

    Attributes:
        start: first end of the membrane, in the section.
        along: unit vector to its second end.
        across: unit vector across it, leaning.
        normal: unit vector to the sensing side, leaning.
        size: of the membrane, along and across.
        layers: its layers; ``None`` if no pad has any.
    """

    start: Float[Array, "*pads 3"]
    along: Float[Array, "*pads 3"]
    across: Float[Array, "*pads 3"]
    normal: Float[Array, "*pads 3"]
    size: Float[Array, "*pads 2"]
    layers: SpatialLayers | None

    @classmethod
    def all_of(
        cls, scene: Scene, placed: Placed, errors: Fabrication, width: Array, channel: int
    ) -> SpatialPad:
        """All pads of a scene that is placed without layers."""
        count, first = len(scene.layout.pads), len(scene.layout.mirrors)
        start, end = placed.segment(first + np.arange(count))
        along, length = unit(end - start), (end - start).length() * placed.size
        left, across = _leaning(along.perpendicular(), errors.pad_lean)
        sides = np.where(scene.layout.sides[first : first + count] < 0, -1.0, 1.0)
        size = jnp.stack([length, jnp.broadcast_to(width, length.shape)], axis=-1)
        layers = scene.own_layers
        covered = None if layers is None else SpatialLayers.all_of(scene, layers, width, channel)
        start = _in_space(start.scaled(placed.size))
        normal = jnp.asarray(sides)[:, None] * left
        return cls(start, _in_space(along), across, normal, size, covered)

    def place(self, along: Array, across: Array, height: Array | float = 0.0) -> Point:
        """A place on the membrane, from its first end and its middle, or above it, mm."""
        return self.start + along * self.along + across * self.across + height * self.normal

    def foot(self, source: Point) -> Float[Array, "2"]:
        """The place below a source: along the pad from its first end, across from its middle."""
        toward = source - self.start
        return jnp.stack([toward @ self.along, toward @ self.across])


class SpatialLayers(eqx.Module):
    """The layers of a pad as what rays must pass, level by level, as `Box` has them, mm.

    Attributes:
        thickness: of the layers, the outermost first.
        index: of refraction, for one color.
        bezel: height of the bezel.
        edges: along the pad from the membrane's first end and across from its middle, at every
            level, first and second edge.
        open: which of these edges bound nothing, as the wall down to them is clear and mirrors.
    """

    thickness: Float[Array, "*pads layers"]
    index: Float[Array, "*pads layers"]
    bezel: Float[Array, "*pads"]
    edges: Float[Array, "*pads 2 levels 2"]
    open: Bool[np.ndarray | Array, "*pads 2 levels 2"]

    @classmethod
    def all_of(cls, scene: Scene, layers: Layers, width: Array, channel: int) -> SpatialLayers:
        """Those of all pads of a scene."""
        profile = profile_of(scene, layers)
        face = profile.face() - OUTWARD[None] * layers.lip
        along = jnp.concatenate([face[:, None], face[:, None], profile.windows()], axis=1)
        lip = jnp.max(layers.lip, axis=-1, keepdims=True)
        narrower = jnp.pad(jnp.repeat(lip, 2, axis=1), ((0, 0), (0, along.shape[1] - 2)))
        across = (width / 2 - narrower)[..., None] * OUTWARD[None, None]
        kinds = scene.layout.layers
        opened = np.zeros((*along.shape[:1], 2, *along.shape[1:]), bool)
        for pad, of_pad in enumerate(kinds):
            for layer, of in enumerate(of_pad):
                ends = [kind == "clear" for kind in of]
                opened[pad, :, 2 + layer] = ends[:2], [ends[2]] * 2
        return cls(
            layers.thickness,
            layers.index[..., channel],
            layers.height,
            jnp.stack([along, across], axis=1),
            opened,
        )


class OutlinePoint(eqx.Module):
    """A place on an outline: where one of its sides meets the one before it, or a line across it.

    Attributes:
        side: index of the side among `EDGES`; its first corner has the same index among `CORNERS`.
        share: part of the way along the side; 0 is its first corner.
        across: of layers, the line across the side: a place on the membrane, along it from its
            first end or across it from its middle, mm; NaN for the side before.
    """

    side: Int[Array, "*points"]
    share: Float[Array, "*points"]
    across: Float[Array, "*points"]

    def place(self, pad: SpatialPad) -> Point:
        """Of a pad without layers: on the membrane's own outline."""
        corners = jnp.asarray(CORNERS, pad.size.dtype)
        first, last = corners[self.side], corners[(self.side + 1) % 4]
        end, side = first + self.share * (last - first)
        return pad.place(end * pad.size[0], side / 2 * pad.size[1])

    def meets(self, pad: SpatialPad, source: Point) -> tuple[Box, Array, Array, Array]:
        """Behind layers: what rays must pass, how far each of the two lines is at every level.

        And along which axis (0 along the pad, 1 across) and in which sense that is.
        """
        assert pad.layers is not None
        layers, foot = pad.layers, pad.foot(source)
        # The source's height is positive also behind the surface, from where nothing is seen.
        above = (source - pad.start) @ pad.normal - jnp.sum(layers.thickness)
        height = jnp.maximum(jnp.abs(above), TOUCHING)
        box = Box(
            Stack(height, layers.thickness, layers.index),
            layers.bezel,
            layers.edges - foot[:, None, None],
        )
        own = jnp.stack([self.side, self.side - 1]) % 4
        axis, which = jnp.asarray(SIDES)[own].T
        away = jnp.asarray(OUTWARD)[which]
        lines = away[:, None] * box.edges[axis, :, which]
        lines = jnp.where(layers.open[axis, :, which], FAR, lines)
        membrane = jnp.arange(lines.shape[1]) == lines.shape[1] - 1
        cut = jnp.where(membrane, away[1] * (self.across - foot[axis[1]]), FAR)
        second = jnp.where(jnp.isnan(self.across), lines[1], cut)
        return box, jnp.stack([lines[0], second]), axis, away

    def guess(self, pad: SpatialPad, source: Point) -> tuple[Float[Array, ""], Int[Array, "2"]]:
        """Logarithm of the ray's slope in air, and the levels that bound the two lines."""
        box, lines, *_ = self.meets(pad, source)
        slope, *_ = box.meet(lines[0], lines[1])
        return jnp.log(slope), jnp.stack([box.nearest(line, slope) for line in lines])

    def entry(
        self, pad: SpatialPad, source: Point, log: Float[Array, ""], levels: Int[Array, "2"]
    ) -> tuple[Point, Float[Array, ""], Float[Array, "2"]]:
        """Where a ray of a slope enters a pad, and how far it is from meeting both lines.

        And where it meets the membrane, along it and across, from below the source.
        """
        box, lines, axis, away = self.meets(pad, source)
        slope = jnp.exp(log)
        reach = box.reach(slope)
        parts = jnp.take_along_axis(lines, levels[:, None], axis=1)[:, 0] / reach[levels]
        off = jnp.sum(parts**2) + (TOUCHING / reach[-1]) ** 2 - 1
        way = jnp.stack([jnp.sum(jnp.where(axis == own, away * parts, 0.0)) for own in range(2)])
        aside = slope * (way[0] * pad.along + way[1] * pad.across)
        return source + box.stack.height * (aside - pad.normal), off, reach[-1] * way


class MembranePoint(eqx.Module):
    """A place on the membrane, or lifted from it towards the sensing side.

    Attributes:
        at: along the membrane from its first end, across from its middle, and its height, mm.
    """

    at: Float[Array, "*points 3"]

    def place(self, pad: SpatialPad) -> Point:
        """Where it is."""
        along, across, height = self.at
        return pad.place(along, across, height)

    def over(self, pad: SpatialPad, source: Point) -> tuple[Stack, Float[Array, "2"]]:
        """Behind layers: what is over it, and how far it is from below a source."""
        assert pad.layers is not None
        above = (source - pad.start) @ pad.normal - jnp.sum(pad.layers.thickness)
        height = jnp.maximum(jnp.abs(above), TOUCHING)
        # The membrane takes the room of the layer that it lies on.
        thickness = pad.layers.thickness.at[-1].add(-self.at[2])
        return Stack(height, thickness, pad.layers.index), self.at[:2] - pad.foot(source)

    def guess(self, pad: SpatialPad, source: Point) -> tuple[Float[Array, ""], Int[Array, "2"]]:
        """Logarithm of the ray's slope in air; the levels of its line are none."""
        stack, away = self.over(pad, source)
        reach = safe_sqrt(jnp.sum(away**2) + TOUCHING**2)
        return jnp.log(stack.slope_to(reach)), jnp.zeros(2, int)

    def entry(
        self, pad: SpatialPad, source: Point, log: Float[Array, ""], levels: Int[Array, "2"]
    ) -> tuple[Point, Float[Array, ""], Float[Array, "2"]]:
        """Where a ray of a slope enters a pad, and by which part of its way it misses the place.

        And where the place is, along the pad and across, from below the source.
        """
        stack, away = self.over(pad, source)
        slope, reach = jnp.exp(log), safe_sqrt(jnp.sum(away**2) + TOUCHING**2)
        aside = slope / reach * (away[0] * pad.along + away[1] * pad.across)
        off = 1 - stack.along(slope) / reach
        return source + stack.height * (aside - pad.normal), off, away


Goal = OutlinePoint | MembranePoint
"""What the camera may be asked where it sees it."""


class _View(eqx.Module):
    """A pad seen over mirrors, of which those that are not ``there`` fill the path up.

    The unknowns of a ray are, as far as there are any: its angle from the optical axis, where it
    meets each mirror along it (mm), and for layers the logarithm of its slope over these.
    """

    camera: SpatialCamera
    mirrors: SpatialMirror
    there: Bool[Array, "*views reflections"]
    pad: SpatialPad

    @property
    def parts(self) -> list[int]:
        """How many unknowns of each kind there are."""
        bowed = 0 if self.mirrors.bow is None else len(self.there)
        return [int(self.camera.pupil is not None), bowed, int(self.pad.layers is not None)]

    def planes(self, places: Float[Array, " places"]) -> list[tuple[Point, Point]]:
        """The planes in which the mirrors reflect a ray that meets them at these places."""
        if not len(places):
            places = jnp.zeros(len(self.there))
        mirrors = [
            jax.tree.map(lambda leaf, i=i: leaf[i], self.mirrors) for i in range(len(places))
        ]
        return [mirror.plane(at) for mirror, at in zip(mirrors, places, strict=True)]

    def sources(self, start: Point, planes: list[tuple[Point, Point]]) -> list[Point]:
        """A place before the first mirror, and its images behind one mirror after the other."""
        found = [start]
        for (point, normal), there in zip(planes, self.there, strict=True):
            image = found[-1] - 2 * ((found[-1] - point) @ normal) * normal
            found.append(jnp.where(there, image, found[-1]))
        return found

    def guess(self, goal: Goal) -> tuple[Float[Array, " unknowns"], Int[Array, "2"]]:
        """The unknowns if mirrors were flat and the pupil stayed, and the levels that bound."""
        [*others, layered] = self.parts
        zeros = jnp.zeros(sum(others))
        if not layered:
            return zeros, jnp.zeros(2, int)
        source = self.sources(self.camera.position, self.planes(jnp.zeros(0)))[-1]
        slope, levels = goal.guess(self.pad, source)
        return jnp.append(zeros, slope), levels

    def follow(
        self, unknowns: Float[Array, " unknowns"], goal: Goal, levels: Int[Array, "2"]
    ) -> tuple[Point, Float[Array, " unknowns"]]:
        """The direction of the ray that unknowns give, and by how much it gives others."""
        angle, places, slope = jnp.split(unknowns, np.cumsum(self.parts)[:2].tolist())
        planes = self.planes(places)
        start = self.camera.start(jnp.sum(angle))
        sources = self.sources(start, planes)
        if self.pad.layers is None:
            target, own = goal.place(self.pad), slope
        else:
            target, off, _ = goal.entry(self.pad, sources[-1], jnp.sum(slope), levels)
            own = off[None]
        met = []
        for i in reversed(range(len(planes))):
            point, normal = planes[i]
            ray = target - sources[i + 1]
            part, _ = safe_divide((point - sources[i + 1]) @ normal, ray @ normal)
            target = jnp.where(self.there[i], sources[i + 1] + part * ray, target)
            place = (target - self.mirrors.middle[i]) @ self.mirrors.along[i]
            met.insert(0, jnp.where(self.there[i], place, 0.0))
        ray = target - start
        angles = self.camera.angle(ray)[None][: len(angle)]
        met = jnp.stack(met)[: len(places)] if met else places
        return ray, jnp.concatenate([angles - angle, met - places, own])

    def ray_to(self, goal: Goal) -> Point:
        """The direction in which the camera sees a place, of any length."""
        still = jax.lax.stop_gradient(self)
        root, levels = still.guess(goal)
        if not len(root):
            return self.follow(root, goal, levels)[0]

        def miss(unknowns: Float[Array, " unknowns"]) -> tuple[Array, Array]:
            off = still.follow(unknowns, goal, levels)[1]
            return off, off

        def step(_: Any, state: tuple[Array, Array]) -> tuple[Array, Array]:
            root, inverse = state
            slopes, off = jax.jacfwd(miss, has_aux=True)(root)
            newer = jnp.linalg.inv(slopes)
            # No ray leads to what lies behind a mirror or a surface: it must be finite, no more.
            fine = jnp.all(jnp.isfinite(newer)) & jnp.all(jnp.isfinite(off))
            inverse = jnp.where(fine, newer, inverse)
            return root - jnp.where(fine, inverse @ off, 0.0), inverse

        root, inverse = jax.lax.fori_loop(0, STEPS, step, (root, jnp.eye(len(root))))
        # One more step with all derivatives: those of the root, by the theorem of implicit
        # functions.
        return self.follow(root - inverse @ self.follow(root, goal, levels)[1], goal, levels)[0]

    def along_sides(self, shares: Float[np.ndarray, " points"]) -> OutlinePoint:
        """Places along all sides, at parts of the way from corner to corner on the membrane."""
        sides = jnp.arange(4)
        points = OutlinePoint(sides, jnp.zeros(4), jnp.full(4, jnp.nan))
        if self.pad.layers is None:
            across = jnp.full((4, len(shares)), jnp.nan)
        else:
            source = self.sources(self.camera.position, self.planes(jnp.zeros(0)))[-1]

            def corner(goal: OutlinePoint) -> Float[Array, "2"]:
                guess = goal.guess(self.pad, source)
                return goal.entry(self.pad, source, *guess)[2]

            places = jax.vmap(corner)(points) + self.pad.foot(source)[None]
            axis = 1 - SIDES[:, 0]
            first, last = (jnp.roll(places, -i, axis=0)[sides, axis] for i in range(2))
            across = first[:, None] + shares[None] * (last - first)[:, None]
        shape = across.shape
        return OutlinePoint(
            jnp.broadcast_to(sides[:, None], shape), jnp.broadcast_to(shares[None], shape), across
        )


def _views_of(
    scene: Scene,
    angles: Float[Array, " joints"],
    errors: Fabrication,
    width: Float[Array, ""] | float,
    views: Sequence[tuple[tuple[int, ...], int]],
    channel: int,
) -> _View:
    """All views that are asked for, along a first axis.

    Raises:
        ValueError: a mirror is curved or has layers.
    """
    if scene.layout.curved or scene.mirror_layers is not None:
        raise ValueError("corners in space are those of flat mirrors without layers")
    layout = replace(scene.layout, layers=(), bezels=())
    placed = place(replace(scene, layers=None, layout=layout), angles)
    camera = SpatialCamera.of(scene, placed, errors)
    mirrors = SpatialMirror.all_of(layout, placed, errors)
    pads = SpatialPad.all_of(scene, placed, errors, jnp.asarray(width), channel)
    words, indices = zip(*views, strict=True)
    word, index = padded(words), np.array(indices)
    return _View(
        jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (len(views), *leaf.shape)), camera),
        jax.tree.map(lambda leaf: leaf[word], mirrors),
        jnp.asarray(word >= 0),
        jax.tree.map(lambda leaf: jnp.asarray(leaf)[index], pads),
    )


def find_corners_in_space(
    scene: Scene,
    angles: Float[Array, " joints"],
    errors: Fabrication,
    imaging: Imaging,
    width: Float[Array, ""] | float,
    views: Sequence[tuple[tuple[int, ...], int]],
    *,
    channel: int = GREEN,
) -> Float[Array, "views 4 2"]:
    """Where corners are imaged: column and row, in the order of `CORNERS`; differentiable.

    Wherever other surfaces hide them or not. In a finger without errors out of the section corners
    without layers are those of `find_corners`.

    Args:
        scene: as it was made in the section, by `perturb`; its mirrors straight, without layers.
        angles: joint angles in the order of ``scene.angle_names``, rad.
        errors: of the finger, of which those out of the section matter here.
        imaging: the camera as it was made, with its image.
        width: of the pads across the section, mm.
        views: mirrors along the path, and index of the pad, of every view that is asked for.
        channel: the color, by its index among `CHANNELS`.

    Raises:
        ValueError: a mirror is curved or has layers.

    Example:
        >>> from importlib.resources import files
        >>> from optics import Imaging, read_scene
        >>> scene = read_scene(files("studies") / "gallery/scenes/periscope.toml")
        >>> errors = replace(Fabrication.none(scene.layout), roll=0.1)
        >>> imaging = Imaging.of(scene.camera)
        >>> corners = find_corners_in_space(
        ...     scene, jnp.zeros(0), errors, imaging, 20.0, [((0, 1), 0)]
        ... )
        >>> corners.shape
        (1, 4, 2)
    """
    seen = _views_of(scene, angles, errors, width, views, channel)
    corners = OutlinePoint(jnp.arange(4), jnp.zeros(4), jnp.full(4, jnp.nan))

    def view(view: _View) -> Float[Array, "4 2"]:
        return jax.vmap(lambda goal: view.camera.image(imaging, view.ray_to(goal)))(corners)

    places = jax.vmap(view)(seen)
    if errors.lateral_color is None or channel == GREEN:
        return places
    larger = errors.lateral_color[int(channel > GREEN)]
    middle = jnp.stack([imaging.columns, imaging.rows]) / 2 - CENTER
    return places + larger * (places - middle[None, None])


def find_sides_in_space(
    scene: Scene,
    angles: Float[Array, " joints"],
    errors: Fabrication,
    imaging: Imaging,
    width: Float[Array, ""] | float,
    views: Sequence[tuple[tuple[int, ...], int]],
    shares: Float[np.ndarray, " points"],
) -> Float[Array, "views 4 points 2"]:
    """Where places along the sides of outlines are imaged, from corner to corner; as their corners.

    Args:
        scene: as in `find_corners_in_space`.
        angles: likewise.
        errors: likewise.
        imaging: likewise.
        width: likewise.
        views: likewise.
        shares: parts of the way along each side, in the order of `EDGES`.

    Raises:
        ValueError: a mirror is curved or has layers.

    Example:
        >>> from importlib.resources import files
        >>> from optics import Imaging, read_scene
        >>> scene = read_scene(files("studies") / "gallery/scenes/periscope.toml")
        >>> given = Fabrication.none(scene.layout), Imaging.of(scene.camera), 20.0, [((), 0)]
        >>> find_sides_in_space(scene, jnp.zeros(0), *given, np.linspace(0.1, 0.9, 5)).shape
        (1, 4, 5, 2)
    """
    seen = _views_of(scene, angles, errors, width, views, GREEN)

    def view(view: _View) -> Float[Array, "4 points 2"]:
        points = view.along_sides(shares)
        return jax.vmap(jax.vmap(lambda goal: view.camera.image(imaging, view.ray_to(goal))))(
            points
        )

    return jax.vmap(view)(seen)


def find_places_in_space(
    scene: Scene,
    angles: Float[Array, " joints"],
    errors: Fabrication,
    imaging: Imaging,
    width: Float[Array, ""] | float,
    views: Sequence[tuple[tuple[int, ...], int]],
    places: Float[Array, "views places 3"],
) -> Float[Array, "views places 2"]:
    """Where places of membranes are imaged, flat or lifted: column and row; differentiable.

    Wherever other surfaces hide them or not, in green light. Behind layers it is the light that
    comes in by the outermost surface and meets no wall.

    Args:
        scene: as in `find_corners_in_space`.
        angles: likewise.
        errors: likewise.
        imaging: likewise.
        width: likewise.
        views: likewise.
        places: of the pad of each view: along the membrane from its first end, across from its
            middle towards greater columns, and above it towards its sensing side, there less than
            the innermost layer is thick, mm.

    Raises:
        ValueError: a mirror is curved or has layers.

    Example:
        >>> from importlib.resources import files
        >>> from optics import Imaging, read_scene
        >>> scene = read_scene(files("studies") / "gallery/scenes/periscope.toml")
        >>> given = Fabrication.none(scene.layout), Imaging.of(scene.camera), 20.0, [((0, 1), 0)]
        >>> find_places_in_space(scene, jnp.zeros(0), *given, jnp.zeros((1, 4, 3))).shape
        (1, 4, 2)
    """
    seen = _views_of(scene, angles, errors, width, views, GREEN)

    def view(view: _View, places: Float[Array, "places 3"]) -> Float[Array, "places 2"]:
        rays = jax.vmap(lambda at: view.ray_to(MembranePoint(at)))(places)
        return jax.vmap(lambda ray: view.camera.image(imaging, ray))(rays)

    return jax.vmap(view)(seen, places)


def _in_space(arrow: Vector) -> Float[Array, "*batch 3"]:
    return jnp.stack([arrow.x, arrow.y, jnp.zeros_like(arrow.x)], axis=-1)


def _turned(
    first: Float[Array, "*parts 3"], second: Float[Array, "*parts 3"], angle: Array | None
) -> tuple[Array, Array]:
    """Two axes at right angles, the first one turned towards the second."""
    if angle is None:
        return first, second
    cosine, sine = jnp.cos(angle)[..., None], jnp.sin(angle)[..., None]
    return cosine * first + sine * second, cosine * second - sine * first


def _leaning(left: Vector, lean: Float[Array, " parts"] | None) -> tuple[Array, Array]:
    """Unit normals, leaning, and unit vectors across."""
    normal = _in_space(left)
    return _turned(normal, jnp.zeros_like(normal).at[..., 2].set(1.0), lean)
