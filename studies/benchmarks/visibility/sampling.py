"""Coverage by points on the pads, each tested over every path: hard, or softened by a sigmoid.

Every test is a number that is positive where it is passed: along a leg or a surface, from 0 to 1,
the coordinates t and 1 − t; of an angle, what is left of it over its limit. A point is seen by a
path if the least of these is positive, and by the camera if it is seen by any path. Softened, the
step at 0 becomes the sigmoid 1 / (1 + exp(−α margin)), with the minimum for *and* and the maximum
for *or*, as in differentiable ray tracing (J. Eertmans et al., DiffeRT2d). As a sigmoid rises, it
may be taken last, once for each point: the cheapest way to write it.

Which side of a mirror or a pad the camera is on is not softened: it does not change along a pad.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Callable
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from designopt.numerics import safe_divide
from designopt.vectors import Vector
from optics.scene.scene import Placed, Scene, place
from optics.visibility.unfolding import paths_of, unit
from studies.benchmarks.visibility.cases import Parts, with_parts

NEVER = -8.0
"""Margin of what is not seen in any case."""

BLOCK = 256
"""Points of a pad that are tested at a time: so many stay in the cache, in the gradient as well."""

Step = Callable[[Array, Array], Array]


def hard(margin: Float[Array, "*points"], _: Float[Array, ""]) -> Float[Array, "*points"]:
    """1 where a point is seen, else 0."""
    return (margin > 0).astype(margin.dtype)


def soft(margin: Float[Array, "*points"], steepness: Float[Array, ""]) -> Float[Array, "*points"]:
    """The sigmoid of a margin."""
    return jax.nn.sigmoid(steepness * margin)


def block_of(samples: int) -> int:
    """How many points are tested at a time; it divides their number, a power of two."""
    return min(samples, BLOCK)


def coverage(
    step: Step,
    block: int,
    scene: Scene,
    poses: Float[Array, "poses joints"],
    blocks: Int[Array, ""],
    steepness: Float[Array, ""],
) -> Float[Array, "poses pads"]:
    """Part of each pad that is seen, from the middles of equal parts of it.

    Args:
        step: `hard` or `soft`.
        block: points that are tested at a time.
        scene: the scene.
        poses: joint angles, rad.
        blocks: number of blocks; traced, so that one program serves every number of points.
        steepness: α.
    """

    def mean(pose: Array, at: Float[Array, " points"]) -> Float[Array, " pads"]:
        return jnp.mean(step(margins(scene, pose, at), steepness), axis=1)

    return _mean_of_blocks(mean, block, poses, blocks)


def gradient(
    step: Step,
    block: int,
    parts: Parts,
    scene: Scene,
    poses: Float[Array, "poses joints"],
    blocks: Int[Array, ""],
    steepness: Float[Array, ""],
) -> tuple[Float[Array, ""], Parts]:
    """Mean coverage and its derivatives, summed up block by block; otherwise as `coverage`.

    Going backwards through one block at a time keeps all of it in the cache: five times as fast
    as all points at once.
    """

    def mean(parts: Parts, pose: Array, at: Float[Array, " points"]) -> Float[Array, ""]:
        return jnp.mean(step(margins(with_parts(scene, parts), pose, at), steepness))

    found = _mean_of_blocks(partial(jax.value_and_grad(mean), parts), block, poses, blocks)
    return jax.tree.map(lambda leaf: jnp.mean(leaf, axis=0), found)


def _mean_of_blocks(
    function: Callable[..., Any], block: int, poses: Array, blocks: Int[Array, ""]
) -> Any:
    """In each pose the mean over blocks of what is found of the middles of equal parts of a pad."""

    def of_pose(pose: Float[Array, " joints"]) -> Any:
        def add(part: Int[Array, ""], total: Any) -> Any:
            middles = (2 * (part * block + jnp.arange(block)) + 1) / (2 * block * blocks)
            return jax.tree.map(jnp.add, total, function(pose, middles))

        shape = jax.eval_shape(function, pose, jnp.zeros(block))
        total = jax.lax.fori_loop(0, blocks, add, jax.tree.map(jnp.zeros_like, shape))
        return jax.tree.map(lambda leaf: leaf / blocks.astype(leaf.dtype), total)

    return jax.lax.map(of_pose, poses)


def margins(
    scene: Scene, angles: Float[Array, " joints"], coordinates: Float[Array, " points"]
) -> Float[Array, "pads points"]:
    """How well points of each pad are seen by the path that shows them best.

    Args:
        scene: the scene, its mirrors straight.
        angles: joint angles, rad.
        coordinates: of the points along every pad.
    """
    placed = place(scene, angles)
    paths = paths_of(scene.layout, scene.layout.bounces)
    words = [jnp.asarray(list(part), int) for _, part in itertools.groupby(paths, len)]

    def best(pad: Int[Array, ""]) -> Float[Array, " points"]:
        by_path = jax.vmap(lambda word: _by_path(scene, placed, word, pad, coordinates))
        return jnp.max(jnp.concatenate([by_path(part) for part in words]), axis=0)

    return jax.vmap(best)(jnp.arange(len(scene.layout.pads)))


def _by_path(
    scene: Scene,
    placed: Placed,
    word: Int[Array, " reflections"],
    pad: Int[Array, ""],
    coordinates: Float[Array, " points"],
) -> Float[Array, " points"]:
    """The least margin of all tests, by the path over some mirrors."""
    sides = jnp.asarray(scene.layout.sides, placed.size.dtype)
    way = [*word, len(scene.layout.mirrors) + pad]
    images, faces, height = [placed.camera], [], jnp.zeros_like(placed.size)
    for surface in way:  # the camera's image in each, and whether that is on the surface's side
        start, end = placed.segment(surface)
        normal = unit(end - start).perpendicular()
        height = normal.dot(images[-1] - start)
        faces.append((height != 0) & (sides[surface] * height >= 0))
        images.append(images[-1] - normal.scaled(2 * height))

    at = _between(*placed.segment(way[-1]), coordinates)
    limit = jnp.sin(scene.grazing[pad])
    sine = jnp.abs(height) / (at - images[-2]).length()
    tests = [jnp.where(limit > 0, sine / jnp.where(limit > 0, limit, 1.0) - 1, 1.0)]
    # From the pad back to the camera, mirror after mirror.
    for image, mirror, following in reversed(list(zip(images[1:], way, way[1:], strict=False))):
        segment = placed.segment(mirror)
        along_ray, along, _ = _crossing(image, at, *segment)
        bounce = _between(*segment, along)
        clear = _clear(scene, placed, bounce, at, (mirror, following))
        tests += [_inside(along_ray), _inside(along), clear]
        at = bounce
    tests.append(_clear(scene, placed, placed.camera, at, (way[0],)))
    ray = at - placed.camera
    off = jnp.arctan2(jnp.abs(placed.axis.cross(ray)), placed.axis.dot(ray))
    tests.append(1 - off / (scene.camera.field_of_view / 2))
    seen = functools.reduce(jnp.logical_and, faces)
    return jnp.where(seen, functools.reduce(jnp.minimum, tests), NEVER)


def _clear(
    scene: Scene, placed: Placed, start: Vector, end: Vector, ends: tuple[Int[Array, ""], ...]
) -> Float[Array, " points"]:
    """How clear the way is from one place to others, of all but the surfaces at its ends."""
    layout = scene.layout
    leg = jax.tree.map(jnp.atleast_2d, (start, end))
    surfaces = jax.tree.map(lambda leaf: leaf[:, None], (placed.starts, placed.ends))
    along_leg, along, cross = _crossing(*leg, *surfaces)
    inside = jnp.minimum(_inside(along_leg), _inside(along))
    sides = jnp.asarray(layout.sides, cross.dtype)[:, None]
    passes = jnp.asarray(layout.one_way)[:, None] & (sides * cross <= 0)
    for surface in ends:
        passes |= (jnp.arange(len(layout.surfaces)) == surface)[:, None]
    return -jnp.max(jnp.where(passes, NEVER, inside), axis=0)


def _between(start: Vector, end: Vector, coordinate: Float[Array, " points"]) -> Vector:
    step = end - start
    return Vector(start.x + coordinate * step.x, start.y + coordinate * step.y)


def _inside(coordinate: Float[Array, "*points"]) -> Float[Array, "*points"]:
    return jnp.minimum(coordinate, 1 - coordinate)


def _crossing(
    start: Vector, end: Vector, first: Vector, last: Vector
) -> tuple[Array, Array, Array]:
    """Where two lines cross: coordinate on each of them, and the cross product of both."""
    ray, step, toward = end - start, last - first, first - start
    cross = ray.cross(step)
    inverse, _ = safe_divide(jnp.ones_like(cross), cross)
    return toward.cross(step) * inverse, toward.cross(ray) * inverse, cross
