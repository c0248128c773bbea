"""Paper B's finger over a grid of poses, and over the two sweeps that suffice.

The outer phalanges carry their own pads and mirrors, so the coverage of a pad, what is seen of it
directly, and what is seen of it in its own mirror depend on no other joint than its own.
"""

from __future__ import annotations

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from designopt.study.benchmark import BenchmarkMethod, compile_timed
from designopt.study.records import Records
from optics.scene.scene import WORLD, Scene
from optics.visibility.coverage import find_views
from optics.visibility.unfolding import paths_of
from studies.benchmarks.measuring import in_fresh_processes, measure
from studies.benchmarks.visibility.cases import flexion, gallery
from studies.benchmarks.visibility.methods import exact_coverage

STEPS = 91
"""Angles of each joint, from 0 to 90 degrees."""

VALUE, GRADIENT = "coverage", "mean coverage and its gradient"


def measure_grid(repeats: int) -> Records:
    """Run times of `VALUE` and `GRADIENT` over the grid and over the sweeps, its panels."""
    scene = gallery("finger")
    asked = {VALUE: exact_coverage, GRADIENT: jax.value_and_grad(mean_coverage, argnums=(0, 1))}
    entered = []
    for panel, poses_of in (("grid", grid_of), ("sweeps", sweeps_of)):
        for method, function in asked.items():
            poses = poses_of(scene, STEPS)
            run, seconds = compile_timed(function, scene, poses)
            call, setting = partial(run, scene, poses), f"{len(poses):,} poses"
            entered.append(BenchmarkMethod(method, setting, panel, call, lambda _: 0.0, seconds))
    return measure(entered, repeats)


def compile_in_fresh_processes() -> list[float]:
    """Seconds of tracing, lowering and compiling `GRADIENT` over the grid, for all leaves."""
    prepare = (
        "from studies.benchmarks.visibility.grid import gallery, grid_of, mean_coverage\n"
        f"scene = gallery('finger')\nposes = jax.block_until_ready(grid_of(scene, {STEPS}))"
    )
    function = "jax.jit(jax.value_and_grad(mean_coverage, argnums=(0, 1)))"
    return in_fresh_processes(prepare, f"{function}.lower(scene, poses).compile()")


def mean_coverage(scene: Scene, poses: Float[Array, "poses joints"]) -> Float[Array, ""]:
    """Coverage of all pads in all poses, on average."""
    return jnp.mean(exact_coverage(scene, poses))


def grid_of(scene: Scene, steps: int) -> Float[Array, "poses joints"]:
    """Every angle of every joint with every one of the others, rad."""
    mesh = jnp.meshgrid(*flexion(scene, steps).T, indexing="ij")
    return jnp.stack(mesh, axis=-1).reshape(-1, len(mesh))


def sweeps_of(scene: Scene, steps: int) -> Float[Array, "poses joints"]:
    """Every angle of one joint after the other while the others are 0, rad."""
    joints = jnp.eye(len(scene.angle_names))
    return jnp.concatenate([flexion(scene, steps) * joint[None] for joint in joints])


def disagreement(scene: Scene, steps: int) -> float:
    """Largest deviation of a view over the grid from that of the sweep of its own joint.

    Of every pad's coverage, and of what each path shows of it, unless several joints move them.
    """
    layout, joints, pads = scene.layout, len(scene.angle_names), len(scene.layout.pads)
    words = paths_of(layout, layout.bounces)

    @jax.jit
    def views(
        scene: Scene, poses: Float[Array, "poses joints"]
    ) -> Float[Array, "poses pads views"]:
        pieces = find_views(scene, poses).value
        by_path = [pieces.seen(path) for path in range(len(words))]
        return jnp.stack([pieces.coverage(), *by_path], axis=-1)

    poses = jnp.concatenate([grid_of(scene, steps), sweeps_of(scene, steps)])
    grid, sweeps = np.split(np.asarray(views(scene, poses)), [steps**joints])
    grid = grid.reshape(*[steps] * joints, pads, -1)
    sweeps = sweeps.reshape(joints, steps, pads, -1)
    moved: dict[int, set[int]] = {WORLD: set()}  # of each frame the joints that move it
    for index, frame in enumerate(layout.frames):
        moved[index] = moved[frame.parent] | {frame.angle}
    worst = 0.0
    for pad, surface in enumerate(layout.pads):
        for view, word in enumerate([(), *words]):
            moving = moved[surface.frame].union(*(moved[layout.mirrors[i].frame] for i in word))
            if len(moving) == 1:
                (axis,) = moving
                off = np.moveaxis(grid[..., pad, view], axis, -1) - sweeps[axis, :, pad, view]
                worst = max(worst, float(np.max(np.abs(off))))
    return worst
