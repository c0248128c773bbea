"""Where the outlines of pads are in the image, by every path, wherever they are hidden or not."""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from designopt.numerics import safe_arctan2
from designopt.vectors import Vector, stack
from optics.scene.imaging import Imaging
from optics.scene.scene import Scene, place
from optics.visibility.pads import Pad
from optics.visibility.refraction import FrontCover, Stack
from optics.visibility.sliding import Slide, settle
from optics.visibility.unfolding import VirtualCamera, paths_of, unit, virtual_cameras

TOUCHING = 1e-9
"""mm: nearer places along a pad are one, so that a line of sight along its normal has a slope."""

CORNERS = ((0, -1), (1, -1), (1, 1), (0, 1))
"""Corners of a pad in their order: at which end of it, and on which side across the section."""


class Behind(eqx.Module):
    """How membranes lie behind their layers, unfolded; lengths in mm.

    Attributes:
        along: unit vectors along the pads, in the camera's own axes (forward, up).
        into: unit vectors from the camera's side towards the pads, in the same.
        stack: the (virtual) cameras over the layers.
        offset: along the pads, from the foot of their heights to both ends of the membrane.
    """

    along: Vector
    into: Vector
    stack: Stack
    offset: Float[Array, "*views 2"]


class Outlines(eqx.Module):
    """The ends of pads as the camera sees them, unfolded; axes are (paths, pads, ends).

    Paths are in the order of `name_paths`. Layered pads are seen through their outermost surface.

    Attributes:
        angle: section angle, rad, counter-clockwise from the optical axis.
        distance: length of the path, mm; under layers of the path to the outermost surface.
        behind: how pads lie behind their layers; ``None`` if no pad has layers.
        sliding: from where rays come, and both ends, in the camera's own axes, mm; ``None`` if all
            rays come from the camera.
    """

    angle: Float[Array, "*batch paths pads 2"]
    distance: Float[Array, "*batch paths pads 2"]
    behind: Behind | None = None
    sliding: tuple[Slide, Vector] | None = None

    def ends(self) -> Float[Array, "*batch paths pads 2 2"]:
        """The ends as plane points in the camera's own axes (forward, up), mm.

        Under layers, the points where lines of sight to them enter. If the entrance pupil moves,
        each is counted from where its ray comes from.
        """
        return self.distance[..., None] * jnp.stack(
            [jnp.cos(self.angle), jnp.sin(self.angle)], axis=-1
        )


def find_outlines(
    scene: Scene, angles: Float[Array, " joints"], *, bounces: int | None = None
) -> Outlines:
    """The ends of all pads by all paths, in closed form by the method of images; differentiable.

    Args:
        scene: the scene, its mirrors straight.
        angles: joint angles in the order of ``scene.angle_names``, rad.
        bounces: most reflections of a path; the scene's own number by default.

    Raises:
        ValueError: a mirror is curved.

    Example:
        >>> from importlib.resources import files
        >>> from optics import read_scene
        >>> scene = read_scene(files("studies") / "gallery/scenes/periscope.toml")
        >>> jax.jit(find_outlines)(scene, jnp.zeros(0)).angle.shape  # paths, pads, both ends
        (5, 1, 2)
    """
    if scene.layout.curved:
        raise ValueError("an outline in a curved mirror has no corners; make the mirrors straight")
    words = paths_of(scene.layout, scene.layout.bounces if bounces is None else bounces)
    placed = place(scene, angles)
    pads, layers = Pad.all_of(scene, placed), scene.own_layers
    covers = None if layers is None else FrontCover.of(scene, layers, placed.size)
    cameras = virtual_cameras(scene.layout, placed, words)

    if cameras.slide is not None:
        of_path = jax.vmap(jax.vmap(_sliding, (None, 0, 0, None)), (0, None, None, None))
        return Outlines(*of_path(cameras, pads, covers, placed.size))
    if covers is not None:
        behind = jax.vmap(jax.vmap(behind_layers, (None, 0, 0, None)), (0, None, None, None))
        return _through_layers(behind(cameras, pads, covers, placed.size))

    def ends(camera: VirtualCamera, pad: Pad) -> tuple[Array, Array]:
        arrow = pad.ends() - camera.source
        angle = safe_arctan2(camera.axis.cross(arrow), camera.axis.dot(arrow))
        return camera.handedness * angle, arrow.length() * placed.size

    angle, distance = jax.vmap(jax.vmap(ends, (None, 0)), (0, None))(cameras, pads)
    return Outlines(angle, distance)


def _own(camera: VirtualCamera, arrow: Vector) -> Vector:
    """An arrow in the camera's own axes."""
    return Vector(camera.axis.dot(arrow), camera.handedness * camera.axis.cross(arrow))


def behind_layers(
    camera: VirtualCamera, pad: Pad, cover: FrontCover, size: Float[Array, ""]
) -> Behind:
    """How the membrane of a pad lies behind its layers, seen from one virtual camera."""
    step, toward = pad.end - pad.start, camera.source - pad.start
    along = unit(step)
    above = along.cross(toward)
    normal = along.perpendicular().scaled(jnp.where(above < 0, -1.0, 1.0))

    height = jnp.abs(above)
    height = jnp.where(height > 0, height, 1.0) * size
    stack = Stack(height, cover.thickness * size, cover.index)
    offset = (cover.places[-1] - along.dot(toward)) * size
    return Behind(_own(camera, along), _own(camera, -normal), stack, offset)


def _entries(
    behind: Behind, beside: Float[Array, ""] | float, end: int
) -> tuple[Float[Array, "*batch paths pads"], Float[Array, "*batch paths pads"], Any]:
    """Section angle and distance (mm) at which the line of sight to a place enters the layers.

    And its lateral slope.
    """
    entry, aside = _entry(behind, beside, end)
    distance = entry.length()
    return safe_arctan2(entry.y, entry.x), distance, aside / distance


def _entry(behind: Behind, beside: Float[Array, ""] | float, end: int) -> tuple[Vector, Any]:
    """Where the line of sight to a place enters the layers: in the section, and beside it, mm.

    The place is at an end of the membrane and so many mm beside the camera's section: the ray stays
    in the plane through it and the pad's normal, where `optics.visibility.refraction` holds.
    """
    offset, stack = behind.offset[..., end], behind.stack
    radius = jnp.sqrt(offset**2 + beside**2 + TOUCHING**2)
    to_radius = Stack.slope_to
    for _ in radius.shape:
        to_radius = jax.vmap(to_radius)
    part = stack.height * to_radius(stack, radius) / radius
    along, into = behind.along.scaled(offset * part), behind.into.scaled(stack.height)
    return along + into, beside * part


def _through_layers(behind: Behind) -> Outlines:
    angle, distance = zip(*(_entries(behind, 0.0, end)[:2] for end in range(2)), strict=True)
    return Outlines(jnp.stack(angle, axis=-1), jnp.stack(distance, axis=-1), behind)


def _sliding(
    camera: VirtualCamera, pad: Pad, cover: FrontCover | None, size: Float[Array, ""]
) -> tuple[Array, Array, Behind | None, tuple[Slide, Vector]]:
    """The ends of one pad by one path, where rays slide."""
    slide = camera.slide
    assert slide is not None
    zero, one = jnp.zeros_like(size), jnp.ones_like(size)
    # The image reaches beyond the section's field of view, and so does the formula of the pupil.
    pupil = None if slide.pupil is None else (slide.pupil[0] * size, jnp.pi * one)
    normals = None if slide.normals is None else _own(camera, slide.normals)
    thickness = None if slide.thickness is None else slide.thickness * size
    eye = Vector(zero, zero), Vector(one, zero)
    own = Slide(*eye, pupil, normals, thickness, slide.index)
    ends = _own(camera, pad.ends() - camera.source).scaled(size)
    behind = None if cover is None else behind_layers(camera, pad, cover, size)
    arrow = [_toward(own, ends, behind, end, zero)[0] for end in range(2)]
    arrows = stack(*arrow)
    distances = arrows.length() + own.longer(arrows)
    return arrows.angle(), distances, behind, (own, ends)


def _toward(
    slide: Slide, ends: Vector, behind: Behind | None, end: int, beside: Float[Array, ""]
) -> tuple[Vector, Float[Array, ""]]:
    """From where its ray comes to an end of a pad, or where the ray enters its layers.

    In the section, and beside it, mm.
    """
    if behind is None:
        return slide.rays_to(ends[end], beside).arrow, beside

    def entry(given: tuple[Slide, Behind, Array], at: Vector) -> tuple[Vector, Array]:
        _, behind, beside = given
        height = behind.stack.height - behind.into.dot(at)
        offset = behind.offset - behind.along.dot(at)
        lower = eqx.tree_at(lambda b: (b.stack.height, b.offset), behind, (height, offset))
        return _entry(lower, beside, end)

    def move(given: tuple[Slide, Behind, Array], at: Vector) -> Vector:
        return given[0].source(*entry(given, at))

    given = slide, behind, beside
    return entry(given, settle(move, given, move(given, slide.start)))


def find_corners(
    imaging: Imaging,
    outlines: Outlines,
    width: Float[Array, ""] | float,
    lateral: Float[Array, ""] | float = 0.0,
) -> Float[Array, "*batch paths pads 4 2"]:
    """Where the corners of all pads are imaged: column and row, in the order of `CORNERS`.

    Args:
        imaging: the camera with its image.
        outlines: ends of the pads.
        width: of the pads across the section, mm.
        lateral: how far the camera is from the middle of the pads, towards greater columns, mm.

    Example:
        >>> from importlib.resources import files
        >>> from optics import Imaging, read_scene
        >>> scene = read_scene(files("studies") / "gallery/scenes/periscope.toml")
        >>> outlines = jax.jit(find_outlines)(scene, jnp.zeros(0))
        >>> find_corners(Imaging.of(scene.camera), outlines, 20.0).shape
        (5, 1, 4, 2)
    """
    if outlines.sliding is not None:
        return _sliding_corners(imaging, outlines, width, lateral)
    if outlines.behind is not None:
        rays = [_entries(outlines.behind, side * width / 2 - lateral, end) for end, side in CORNERS]
        angles, _, slopes = zip(*rays, strict=True)
        return imaging.place(jnp.stack(angles, axis=-1), jnp.stack(slopes, axis=-1))
    at = [end for end, _ in CORNERS]
    beside = jnp.asarray([side for _, side in CORNERS], outlines.angle.dtype) * width / 2 - lateral
    beside = beside.reshape((1,) * (outlines.angle.ndim - 1) + (4,))
    distance = outlines.distance[..., jnp.array(at)]
    return imaging.place(outlines.angle[..., jnp.array(at)], beside / distance)


def _sliding_corners(
    imaging: Imaging,
    outlines: Outlines,
    width: Float[Array, ""] | float,
    lateral: Float[Array, ""] | float,
) -> Float[Array, "*batch paths pads 4 2"]:
    def of_pad(outlines: Outlines) -> Float[Array, "4 2"]:
        assert outlines.sliding is not None
        places = []
        for end, side in CORNERS:
            beside = jnp.asarray(side * width / 2 - lateral, outlines.angle.dtype)
            arrow, aside = _toward(*outlines.sliding, outlines.behind, end, beside)
            places.append(imaging.place(arrow.angle(), aside / arrow.length()))
        return jnp.stack(places)

    for _ in outlines.angle.shape[:-1]:
        of_pad = jax.vmap(of_pad)
    return of_pad(outlines)
