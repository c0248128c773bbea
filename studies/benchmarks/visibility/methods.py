"""Every way of finding what is seen, ready to be timed."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from designopt.study.benchmark import BenchmarkMethod, compile_methods, compile_timed
from optics.scene.scene import Scene, place
from optics.visibility.coverage import find_coverage
from optics.visibility.edge_refined import trace_views
from optics.visibility.tracing import trace_rays
from studies.benchmarks.measuring import gradient_error
from studies.benchmarks.visibility import sampling
from studies.benchmarks.visibility.cases import REACH_MM, Parts, parts_of, with_parts
from studies.oracles import coverage as exact
from studies.oracles.scenes import rounded, seen_by_fan

OURS = "exact intervals"
HARD = "pad points, hard test"
SOFT = {alpha: f"pad points, sigmoid α = {alpha}" for alpha in (10, 100, 1000)}
BEST = "pad points, sigmoid of the best α"
CAMERA = "camera rays"
EDGES = "edge-refined rays"

POINTS = (64, 256, 1024, 4096, 16384, 65536)
RAYS = (64, 1024, 65536)
"""Each of the latter is compiled anew, which takes seconds."""

SWEEP_POINTS = (1024, 4096, 16384)
SWEEP_RAYS = (1024,)
"""The same for a sweep of poses."""

Error = Callable[[Any], float]


class Workload(NamedTuple):
    """What is asked for.

    Attributes:
        scene: the scene.
        poses: joint angles, rad; a sweep has fewer settings.
        gradient: whether the gradient of the mean coverage is asked for, or each pad's coverage.
        reference_rays: rays of the reference for the coverage in one pose.
    """

    scene: Scene
    poses: Float[Array, "poses joints"]
    gradient: bool
    reference_rays: int

    @property
    def panel(self) -> str:
        """Its name in figures and tables."""
        poses = f"{len(self.poses)} poses" if len(self.poses) > 1 else "1 pose"
        return f"{'gradient' if self.gradient else 'coverage'}, {poses}"


def methods(work: Workload, samples: int, *, edge_refined: bool) -> Iterator[BenchmarkMethod]:
    """Every method at its settings, with at most so many points or rays."""
    one = len(work.poses) == 1
    error = (slopes_error if work.gradient else coverage_error)(work)
    by_rays = {CAMERA: by_camera_rays} | ({EDGES: by_refined_rays} if edge_refined else {})
    yield from _whole(work, OURS, "", exact_coverage, error)
    points = [n for n in (POINTS if one else SWEEP_POINTS) if n <= samples]
    yield from _by_points(work, points, error)
    for method, find in by_rays.items():
        for count in (n for n in (RAYS if one else SWEEP_RAYS) if n <= samples):
            yield from _whole(work, method, f"{count:,} rays", partial(find, count), error)


def exact_coverage(
    scene: Scene, poses: Float[Array, "*poses joints"]
) -> Float[Array, "*poses pads"]:
    """The library's own call."""
    return find_coverage(scene, poses).value


def by_refined_rays(
    rays: int, scene: Scene, poses: Float[Array, "poses joints"]
) -> Float[Array, "poses pads"]:
    """Coverage by the library's rays, whose edges are refined."""
    return trace_views(scene, poses, rays=rays).value.coverage()


def by_camera_rays(
    rays: int, scene: Scene, poses: Float[Array, "poses joints"]
) -> Float[Array, "poses pads"]:
    """Coverage by rays from the camera: between neighbours that see the same, all is seen.

    The rays keep their angles, so the derivative is that of the places where they end: not of the
    edges of what is seen, which lie between one ray and the next.
    """
    pads, fan = len(scene.layout.pads), (2 * np.arange(rays) + 1) / rays - 1

    def of_pose(angles: Float[Array, " joints"]) -> Float[Array, " pads"]:
        placed = place(scene, angles)
        directions = placed.axis.angle() + scene.camera.field_of_view / 2 * jnp.asarray(fan)
        starts = jnp.broadcast_to(placed.absolute(placed.camera).stacked(), (rays, 2))
        hits = trace_rays(scene, angles, starts, directions, bounces=scene.layout.bounces)
        index = hits.surface - len(scene.layout.mirrors)
        on_pad = (index >= 0) & (index < pads) & hits.active
        seen = on_pad & (hits.sine >= jnp.sin(scene.grazing)[jnp.where(on_pad, index, 0)])
        pad = jnp.max(jnp.where(seen, index, -1), axis=-1)
        along = jnp.sum(jnp.where(seen, hits.coordinate, 0.0), axis=-1)  # one pad at most
        alike = jnp.all(hits.surface[1:] == hits.surface[:-1], axis=-1) & (pad[1:] == pad[:-1])

        def of_pad(number: Int[Array, ""]) -> Float[Array, ""]:
            mine = alike & (pad[1:] == number)
            low = jnp.where(mine, jnp.minimum(along[1:], along[:-1]), 1.0)
            high = jnp.where(mine, jnp.maximum(along[1:], along[:-1]), 1.0)
            low, high = jax.lax.sort((low, high), num_keys=1)
            reached = jnp.pad(jax.lax.cummax(high)[:-1], (1, 0))
            return jnp.sum(jnp.maximum(high - jnp.maximum(low, reached), 0.0))

        return jax.vmap(of_pad)(jnp.arange(pads))

    return jax.lax.map(of_pose, poses)


def _whole(
    work: Workload, method: str, setting: str, finder: Callable[..., Any], error: Error
) -> Iterator[BenchmarkMethod]:
    """A method that is one call for all poses and all points, and whose gradient is JAX's."""

    def mean(parts: Parts, scene: Scene, poses: Array) -> Float[Array, ""]:
        return jnp.mean(finder(with_parts(scene, parts), poses))

    function, args = finder, (work.scene, work.poses)
    if work.gradient:
        function, args = jax.value_and_grad(mean), (parts_of(work.scene), *args)
    [entered] = compile_methods(method, work.panel, error, function, *args)
    yield replace(entered, setting=setting)


def _by_points(work: Workload, sizes: Sequence[int], error: Error) -> Iterator[BenchmarkMethod]:
    """Pad points; one program serves all numbers of points of one block size, and all α."""
    function, args = sampling.coverage, (work.scene, work.poses)
    if work.gradient:
        function, args = sampling.gradient, (parts_of(work.scene), *args)

    @functools.cache
    def compiled(step: sampling.Step, block: int) -> tuple[Callable[..., Any], float]:
        program = partial(function, step, block)
        return compile_timed(program, *args, jnp.asarray(1), jnp.asarray(1.0))

    def entered(method: str, step: sampling.Step, size: int, alpha: float) -> BenchmarkMethod:
        block = sampling.block_of(size)
        run, seconds = compiled(step, block)
        call = partial(run, *args, jnp.asarray(size // block), jnp.asarray(float(alpha)))
        setting = f"{size:,} points" + (f", α = {alpha:.0f}" if method == BEST else "")
        return BenchmarkMethod(method, setting, work.panel, call, error, seconds)

    for size in sizes[-1:] if work.gradient else sizes:  # its gradient is 0, however many there are
        yield entered(HARD, sampling.hard, size, 1.0)
    for alpha, method in list(SOFT.items())[0 if len(work.poses) == 1 else -1 :]:
        yield from (entered(method, sampling.soft, size, alpha) for size in sizes)
    for size in sizes if work.gradient else ():
        steepness = [*SOFT, *(size * 2 ** (-k / 3) for k in range(10))]
        tried = [entered(BEST, sampling.soft, size, alpha) for alpha in steepness]
        yield min(tried, key=lambda method: method.error(method.call()))


def coverage_error(work: Workload) -> Error:
    """Worst deviation of a pad's coverage: in one pose from that by the oracle's rays."""
    if len(work.poses) > 1:
        expected = np.stack([exact.coverage(work.scene, pose) for pose in work.poses])
    else:
        expected = seen_by_fan(rounded(work.scene, work.poses[0]), work.reference_rays).coverage
    return lambda found: float(np.max(np.abs(np.asarray(found) - expected)))


def slopes_error(work: Workload) -> Error:
    """Worst entry's deviation over the largest entry; an angle counts as the arc it moves."""
    expected = np.mean([exact.gradient(work.scene, pose) for pose in work.poses], axis=0)
    weights = np.append(np.ones(len(expected) - 1), 1 / REACH_MM)
    return lambda found: gradient_error(expected, weights, found[1])
