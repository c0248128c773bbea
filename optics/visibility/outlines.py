"""Where the outlines of pads are in the image, by every path, wherever they are hidden or not."""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from designopt.numerics import safe_arctan2
from optics.scene.imaging import Imaging
from optics.scene.scene import Scene, place
from optics.visibility.pads import Pad
from optics.visibility.unfolding import VirtualCamera, paths_of, virtual_cameras

CORNERS = ((0, -1), (1, -1), (1, 1), (0, 1))
"""Corners of a pad in their order: at which end of it, and on which side across the section."""


class Outlines(eqx.Module):
    """The ends of pads as the camera sees them, unfolded; axes are (paths, pads, ends).

    Paths are in the order of `name_paths`.

    Attributes:
        angle: section angle, rad, counter-clockwise from the optical axis.
        distance: length of the path, mm.
    """

    angle: Float[Array, "*batch paths pads 2"]
    distance: Float[Array, "*batch paths pads 2"]

    def ends(self) -> Float[Array, "*batch paths pads 2 2"]:
        """The ends as plane points in the camera's own axes (forward, up), mm."""
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
    pads = Pad.all_of(scene, placed)
    cameras = virtual_cameras(placed, words)

    def ends(camera: VirtualCamera, pad: Pad) -> tuple[Array, Array]:
        arrow = pad.ends() - camera.source
        angle = safe_arctan2(camera.axis.cross(arrow), camera.axis.dot(arrow))
        return camera.handedness * angle, arrow.length() * placed.size

    angle, distance = jax.vmap(jax.vmap(ends, (None, 0)), (0, None))(cameras, pads)
    return Outlines(angle, distance)


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
    at = [end for end, _ in CORNERS]
    beside = jnp.asarray([side for _, side in CORNERS], outlines.angle.dtype) * width / 2 - lateral
    beside = beside.reshape((1,) * (outlines.angle.ndim - 1) + (4,))
    distance = outlines.distance[..., jnp.array(at)]
    return imaging.place(outlines.angle[..., jnp.array(at)], beside / distance)
