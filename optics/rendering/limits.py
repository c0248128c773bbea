"""What hides pads in an image: edges of other things, beside which rays pass on one of their legs.

Which edges bound a view is found in the section, among all surfaces from outside: a layered pad is
its outermost surface there, between the lips of a bezel, and what happens behind that is followed
ray by ray. Everything is extruded across the section, so an edge is a line across it, also in a
finger with errors out of the section. There the edges that count are still those of the section,
and a mirror that leans does not lean its own edges: both are of second order.
"""

from __future__ import annotations

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from optics.rendering.ways import Leg, Rays
from optics.scene.scene import Scene, Surface, place
from optics.visibility.boundary_codes import FIRST_END, SECOND_END, parts_of

AWAY = 10.0
"""mm: how far before the camera the line of sight is that stands for what is no end of a surface,
such as where two surfaces cross."""


def seen_from_outside(scene: Scene) -> Scene:
    """A scene of which no pad has layers: these are opaque, and the pads their outermost surfaces.

    Example:
        >>> from importlib.resources import files
        >>> from optics import read_scene
        >>> scene = read_scene(files("studies") / "gallery/scenes/layered-pad.toml")
        >>> seen_from_outside(scene).pads[0].tolist()  # its membrane is at y = 0
        [[7.0, 5.0], [32.0, 5.0]]
    """
    layers, layout = scene.own_layers, scene.layout
    if layers is None:
        return scene
    placed = place(scene, jnp.zeros(len(layout.angles)))
    corners = placed.absolute(placed.corners)
    ends = jnp.stack([corners.x, corners.y], axis=-1)
    first, bodies = len(layout.mirrors), len(layout.bodies)
    faces = ends[first : first + len(layout.pads)]
    along = faces[:, 1] - faces[:, 0]
    along = along / jnp.linalg.norm(along, axis=-1, keepdims=True)
    inward = jnp.stack([along, -along], axis=1) * layers.lip[..., None]
    pads = faces + inward
    held = np.flatnonzero(layout.bezels)
    covered = jnp.stack([faces, pads], axis=2)[held].reshape(-1, 2, 2)
    names = [Surface(f"{layout.pads[i].name}: bezel", 0, layout.pads[i].frame) for i in held]
    walls = layout.surfaces[len(layout.surfaces) - bodies :]
    opaque = replace(
        layout,
        layers=(),
        bezels=(),
        blockers=(*layout.blockers, *walls, *(name for name in names for _ in range(2))),
    )
    blockers = jnp.concatenate([scene.blockers, ends[len(ends) - bodies :], covered])
    return replace(scene, layout=opaque, layers=None, pads=pads, blockers=blockers)


def surfaces_of(scene: Scene, angles: Float[Array, " joints"]) -> Float[Array, "surfaces 2 2"]:
    """Ends of all surfaces in a pose, from the camera in the reference pose, mm."""
    placed = place(scene, angles)
    return jnp.stack([placed.corners.x, placed.corners.y], axis=-1) * placed.size


def shown_beside(
    label: int,
    angle: float,
    sense: float,
    legs: list[Leg],
    rays: Rays,
    surfaces: Float[np.ndarray, "surfaces 2 2"],
    ahead: Float[np.ndarray, "2"],
) -> Float[np.ndarray, "rows columns"] | None:
    """Part of each pixel that an edge leaves free; ``None`` if it is no edge of another thing.

    Args:
        label: of the edge.
        angle: section angle at which it is seen, rad.
        sense: 1 if what is seen lies counter-clockwise of it as the camera sees it, else −1.
        legs: the rays.
        rays: the same, as they leave the camera.
        surfaces: of the scene as it is seen from outside, in the pose.
        ahead: optical axis in the section.
    """
    if label < 0:
        return None
    number, surface, kind = parts_of(label)
    if kind in (FIRST_END, SECOND_END):
        edge = surfaces[surface, int(kind == SECOND_END)]
    else:
        number = 0
        away = complex(*ahead) * np.exp(1j * angle) * AWAY
        edge = legs[0].shift[:2] + np.array([away.real, away.imag])
    leg = legs[number]
    distance = np.hypot(*(edge - leg.shift[:2]))
    sense *= (-1) ** number
    past = leg.past(edge) * np.float32(sense / max(distance, 1e-6))
    return np.clip(0.5 + past / rays.per_pixel, 0, 1)
