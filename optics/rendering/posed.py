"""What the image of a finger in one pose follows from: what is seen, and where all parts are."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from optics.rendering.limits import shown_beside, surfaces_of
from optics.rendering.ways import Leg, Rays
from optics.scene.fabrication import Fabrication
from optics.scene.imaging import Imaging
from optics.scene.layers import GREEN
from optics.scene.scene import Scene, place
from optics.visibility.boundary_codes import is_own_end
from optics.visibility.corners_in_space import (
    SpatialCamera,
    SpatialMirror,
    SpatialPad,
    find_corners_in_space,
)
from optics.visibility.coverage import find_views
from optics.visibility.unfolding import paths_of
from optics.visibility.views import Pieces


class Geometry(NamedTuple):
    """What the image of one pose follows from.

    Attributes:
        pieces: what is seen of pads, or of their outermost surfaces.
        limits: section angles of the pieces' ends, rad.
        corners: where corners are imaged.
        whole: whether one piece shows all of a pad, no flatter and no darker than a design counts;
            ``None`` where no pad has layers.
        surfaces: ends of all surfaces as they are seen from outside, mm.
        camera: the camera.
        ahead: its axis in the section.
        mirrors: the mirrors.
        bodies: the pads.
    """

    pieces: Pieces
    limits: Float[Array, "pads pieces 2"]
    corners: Float[Array, "paths pads 4 2"]
    whole: Bool[Array, "paths pads"] | None
    surfaces: Float[Array, "surfaces 2 2"]
    camera: SpatialCamera
    ahead: Float[Array, "2"]
    mirrors: SpatialMirror
    bodies: SpatialPad


@eqx.filter_jit
def find_geometry(
    scene: Scene,
    outside: Scene,
    imaging: Imaging,
    angles: Float[Array, " joints"],
    width: float,
    errors: Fabrication,
) -> Geometry:
    """What is seen in a pose, and where all parts are.

    Args:
        scene: as it was made.
        outside: the same as it is seen from outside, with the limits of the image.
        imaging: the camera with its image.
        angles: joint angles, rad.
        width: of the pads, mm.
        errors: of the finger, of which those out of the section matter here.
    """
    layout, pads = scene.layout, len(scene.layout.pads)
    words = paths_of(layout, layout.bounces)
    pieces = find_views(outside, angles).value
    views = tuple((word, pad) for word in words for pad in range(pads))
    corners = find_corners_in_space(scene, angles, errors, imaging, width, views)
    bare = replace(scene, layers=None, layout=replace(layout, layers=(), bezels=()))
    placed = place(bare, angles)
    whole = None
    if scene.layers is not None:
        # With its own least grazing angles and transmissions.
        camera = outside.camera
        whole = _whole(
            find_views(eqx.tree_at(lambda s: s.camera, scene, camera), angles).value, len(words)
        )
    return Geometry(
        pieces,
        outside.camera.angle(pieces.pixels),
        corners.reshape(len(words), pads, 4, 2),
        whole,
        surfaces_of(outside, angles),
        SpatialCamera.of(bare, placed, errors),
        jnp.stack([placed.axis.x, placed.axis.y]),
        SpatialMirror.all_of(bare.layout, placed, errors),
        SpatialPad.all_of(bare, placed, errors, jnp.asarray(width), GREEN),
    )


def _whole(pieces: Pieces, paths: int) -> Bool[Array, "paths pads"]:
    """Which views show all of a pad between its own ends, or those of its layers, in one piece."""
    own = is_own_end(pieces.start_label, 0) & is_own_end(pieces.end_label, 1)
    by_end = jnp.zeros_like(own) if pieces.face is None else pieces.face > 0
    found = []
    for path in range(paths):
        there = pieces.present & (pieces.path == path)
        # A view through a clear end adjoins the one through the top: together they have no corners.
        found.append(jnp.any(there & own, axis=-1) & ~jnp.any(there & by_end, axis=-1))
    return jnp.stack(found)


def free_of(
    geometry: Geometry, pad: int, parts: np.ndarray, legs: list[Leg], rays: Rays
) -> Float[np.ndarray, "rows columns"]:
    """Part of each pixel that nothing else hides."""
    pieces, free = geometry.pieces, np.zeros_like(rays.ahead)
    surfaces, ahead = np.asarray(geometry.surfaces), np.asarray(geometry.ahead)
    for part in parts:
        first, last = geometry.limits[pad, part]
        sense, here = float(np.sign(last - first)), np.ones_like(free)
        for labels, angle, side in (
            (pieces.start_label, first, sense), (pieces.end_label, last, -sense)
        ):  # fmt: skip
            label = int(labels[pad, part])
            edge = shown_beside(label, float(angle), side, legs, rays, surfaces, ahead)
            here = here if edge is None else here * edge
        free = np.maximum(free, here)
    return free
