"""Who takes part: every way of finding what is seen, ready to be timed."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from designopt.study.benchmark import BenchmarkMethod, compile_timed
from optics.scene.scene import Scene
from optics.visibility.coverage import find_coverage
from optics.visibility.edge_refined import trace_views
from studies.benchmarks.visibility import camera_rays, exact, sampling
from studies.benchmarks.visibility.cases import REACH_MM, Parts, parts_of, with_parts
from studies.oracles import tracer as numpy_rays
from studies.oracles.scenes import rounded

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

Finder = Callable[[Scene, Array], Array]
"""From scene and poses to the coverage of every pad in every pose."""


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
    def sweep(self) -> bool:
        """Whether there are several poses."""
        return len(self.poses) > 1

    @property
    def panel(self) -> str:
        """Its name in figures and tables."""
        asked = "gradient" if self.gradient else "coverage"
        return f"{asked}, {len(self.poses)} poses" if self.sweep else f"{asked}, 1 pose"


def contenders(work: Workload, samples: int, *, edge_refined: bool) -> Iterator[BenchmarkMethod]:
    """Every method at its settings, with at most so many points or rays."""
    error = gradient_error(work) if work.gradient else coverage_error(work)
    points = [size for size in (SWEEP_POINTS if work.sweep else POINTS) if size <= samples]
    rays = [size for size in (SWEEP_RAYS if work.sweep else RAYS) if size <= samples]
    yield _whole(work, OURS, "", exact_coverage, error)
    yield from _by_points(work, points, error)
    by_rays = {CAMERA: _by_camera_rays} | ({EDGES: _by_refined_rays} if edge_refined else {})
    for method, find in by_rays.items():
        for size in rays:
            yield _whole(work, method, f"{size:,} rays", partial(find, rays=size), error)


def exact_coverage(
    scene: Scene, poses: Float[Array, "*poses joints"]
) -> Float[Array, "*poses pads"]:
    """The library's own call."""
    return find_coverage(scene, poses).value


def _by_refined_rays(
    scene: Scene, poses: Float[Array, "poses joints"], rays: int
) -> Float[Array, "poses pads"]:
    return trace_views(scene, poses, rays=rays).value.coverage()


def _by_camera_rays(
    scene: Scene, poses: Float[Array, "poses joints"], rays: int
) -> Float[Array, "poses pads"]:
    return jax.lax.map(lambda pose: camera_rays.coverage(scene, pose, rays), poses)


def _whole(
    work: Workload, method: str, setting: str, finder: Finder, error: Callable[[Any], float]
) -> BenchmarkMethod:
    """A method that is one call for all poses and all points, and whose gradient is JAX's."""
    if not work.gradient:
        run, seconds = compile_timed(finder, work.scene, work.poses)
        call = partial(run, work.scene, work.poses)
        return BenchmarkMethod(method, setting, work.panel, call, error, seconds)

    def mean(parts: Parts, scene: Scene, poses: Array) -> Float[Array, ""]:
        return jnp.mean(finder(with_parts(scene, parts), poses))

    args = parts_of(work.scene), work.scene, work.poses
    run, seconds = compile_timed(jax.value_and_grad(mean), *args)
    return BenchmarkMethod(method, setting, work.panel, partial(run, *args), error, seconds)


def _by_points(
    work: Workload, sizes: Sequence[int], error: Callable[[Any], float]
) -> Iterator[BenchmarkMethod]:
    """Pad points; one program serves all numbers of points of one block size, and all α."""
    function = sampling.gradient if work.gradient else sampling.coverage
    given = (parts_of(work.scene),) if work.gradient else ()
    programs: dict[Any, tuple[Callable[..., Any], float]] = {}

    def entered(method: str, step: sampling.Step, size: int, alpha: float) -> BenchmarkMethod:
        block = sampling.block_of(size)
        args = *given, work.scene, work.poses, jnp.asarray(size // block), jnp.asarray(float(alpha))
        if (step, block) not in programs:
            programs[step, block] = compile_timed(partial(function, step, block), *args)
        run, seconds = programs[step, block]
        setting = f"{size:,} points" + (f", α = {alpha:.0f}" if method == BEST else "")
        return BenchmarkMethod(method, setting, work.panel, partial(run, *args), error, seconds)

    for size in sizes[-1:] if work.gradient else sizes:  # its gradient is 0, however many there are
        yield entered(HARD, sampling.hard, size, 1.0)
    for alpha, method in list(SOFT.items())[-1:] if work.sweep else SOFT.items():
        for size in sizes:
            yield entered(method, sampling.soft, size, alpha)
    if work.gradient:
        for size in sizes:
            steepness = [*SOFT, *(size * 2 ** (-k / 3) for k in range(10))]
            tried = [entered(BEST, sampling.soft, size, alpha) for alpha in steepness]
            yield min(tried, key=lambda contender: contender.error(contender.call()))


def coverage_error(work: Workload) -> Callable[[Any], float]:
    """Worst deviation of a pad's coverage: in one pose from that by the NumPy rays."""
    if work.sweep:
        expected = np.stack([exact.coverage(work.scene, pose) for pose in work.poses])
    else:
        fan = rounded(work.scene, work.poses[0])
        expected = numpy_rays.seen_by_fan(fan, work.reference_rays).coverage
    return lambda found: float(np.max(np.abs(np.asarray(found) - expected)))


def gradient_error(work: Workload) -> Callable[[Any], float]:
    """Worst entry's deviation over the largest entry; an angle counts as the arc it moves."""
    expected = np.mean([exact.gradient(work.scene, pose) for pose in work.poses], axis=0)
    *lengths, angle = (np.size(part) for part in parts_of(work.scene))
    weights = np.concatenate([np.ones(sum(lengths)), np.full(angle, 1 / REACH_MM)])

    def error(found: Any) -> float:
        entries = np.concatenate([np.ravel(part) for part in found[1]])
        off = np.abs(entries - expected) * weights
        return float(np.max(off) / np.max(np.abs(expected) * weights))

    return error
