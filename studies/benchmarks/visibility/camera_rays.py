"""Coverage by rays from the camera: where neighbouring rays see the same, all between them is seen.

The rays keep their angles, so the derivative is that of the places where they end: not of the edges
of what is seen, which lie between one ray and the next.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from optics.scene.scene import Scene, place
from optics.visibility.tracing import trace_rays


def coverage(scene: Scene, angles: Float[Array, " joints"], rays: int) -> Float[Array, " pads"]:
    """Part of each pad between neighbouring rays that reach it by the same path.

    Args:
        scene: the scene.
        angles: joint angles, rad.
        rays: number of rays, even over the field of view.
    """
    mirrors, pads = len(scene.layout.mirrors), len(scene.layout.pads)
    placed = place(scene, angles)
    half = scene.camera.field_of_view / 2
    directions = placed.axis.angle() + half * jnp.asarray((2 * np.arange(rays) + 1) / rays - 1)
    camera = placed.absolute(placed.camera).stacked()
    starts = jnp.broadcast_to(camera, (rays, 2))
    hits = trace_rays(scene, angles, starts, directions, bounces=scene.layout.bounces)
    index = hits.surface - mirrors
    on_pad = (index >= 0) & (index < pads) & hits.active
    steep = hits.sine >= jnp.sin(scene.grazing)[jnp.where(on_pad, index, 0)]
    seen = on_pad & steep
    pad = jnp.max(jnp.where(seen, index, -1), axis=-1)
    along = jnp.sum(jnp.where(seen, hits.coordinate, 0.0), axis=-1)  # a ray sees one pad at most
    alike = jnp.all(hits.surface[1:] == hits.surface[:-1], axis=-1) & (pad[1:] == pad[:-1])

    def of_pad(number: Int[Array, ""]) -> Float[Array, ""]:
        mine = alike & (pad[1:] == number)
        low = jnp.where(mine, jnp.minimum(along[1:], along[:-1]), 1.0)
        high = jnp.where(mine, jnp.maximum(along[1:], along[:-1]), 1.0)
        low, high = jax.lax.sort((low, high), num_keys=1)
        reached = jnp.pad(jax.lax.cummax(high)[:-1], (1, 0))
        return jnp.sum(jnp.maximum(high - jnp.maximum(low, reached), 0.0))

    return jax.vmap(of_pad)(jnp.arange(pads))
