"""Paper B's finger over a grid of poses, and over the two sweeps that say the same.

The outer phalanges carry their own pads and mirrors, so the coverage of a pad, what is seen of it
directly, and what is seen of it in its own mirror depend on no other joint than its own.
"""

from __future__ import annotations

import os
import subprocess
import sys
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from designopt.study.benchmark import BenchmarkMethod, benchmark, compile_timed
from designopt.study.results import PrecisionRow
from optics.scene.scene import WORLD, Layout, Scene
from optics.visibility.coverage import find_views
from optics.visibility.unfolding import paths_of
from studies.benchmarks.visibility.cases import gallery, spoilt_finger
from studies.benchmarks.visibility.contenders import exact_coverage

STEPS = 91
"""Angles of each joint, from 0 to 90 degrees."""

FRESH_PROCESSES = 3

VALUE, GRADIENT = "coverage", "mean coverage and its gradient"


class Grid(NamedTuple):
    """What was found.

    Attributes:
        rows: run times of `VALUE` and `GRADIENT`, over the grid and over the sweeps; their panels
            are "grid" and "sweeps".
        compile_seconds: tracing, lowering and compiling `GRADIENT` over the grid, in fresh
            processes.
        disagreement: largest deviation of a view over the grid from the sweeps'.
    """

    rows: list[PrecisionRow]
    compile_seconds: list[float]
    disagreement: float

    def seconds(self, asked: str, panel: str) -> float:
        """Run time of what was asked."""
        (row,) = (row for row in self.rows if (row.method, row.panel) == (asked, panel))
        return row.seconds


def measure_grid(repeats: int) -> Grid:
    """Time the grid and its sweeps, and compare the two."""
    scene = gallery("finger")
    asked = {VALUE: exact_coverage, GRADIENT: jax.value_and_grad(mean_coverage, argnums=(0, 1))}
    panels = {"grid": grid_of(scene, STEPS), "sweeps": sweeps_of(scene, STEPS)}
    entered = []
    for panel, poses in panels.items():
        for method, function in asked.items():
            run, seconds = compile_timed(function, scene, poses)
            setting = f"{len(poses):,} poses"
            call = partial(run, scene, poses)
            entered.append(BenchmarkMethod(method, setting, panel, call, _no_error, seconds))
    rows = benchmark(entered, repeats=repeats)
    return Grid(
        rows,
        [compiled_in_fresh_process() for _ in range(FRESH_PROCESSES)],
        max(disagreement(finger, STEPS) for finger in (scene, spoilt_finger())),
    )


def mean_coverage(scene: Scene, poses: Float[Array, "poses joints"]) -> Float[Array, ""]:
    """Coverage of all pads in all poses, on average."""
    return jnp.mean(exact_coverage(scene, poses))


def grid_of(scene: Scene, steps: int) -> Float[Array, "poses joints"]:
    """Every angle of every joint with every one of the others, rad."""
    angles = [_angles(steps)] * len(scene.angle_names)
    mesh = jnp.stack(jnp.meshgrid(*angles, indexing="ij"), axis=-1)
    return mesh.reshape(-1, len(angles))


def sweeps_of(scene: Scene, steps: int) -> Float[Array, "poses joints"]:
    """Every angle of one joint after the other while the others are 0, rad."""
    joints = jnp.eye(len(scene.angle_names))
    return jnp.concatenate([_angles(steps)[:, None] * joint[None] for joint in joints])


def _angles(steps: int) -> Float[Array, " steps"]:
    return jnp.deg2rad(jnp.linspace(0.0, 90.0, steps))


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
    worst = 0.0
    for pad, surface in enumerate(layout.pads):
        for view, word in enumerate([(), *words]):
            moving = _joints(layout, [surface.frame, *(layout.mirrors[i].frame for i in word)])
            if len(moving) == 1:
                (axis,) = moving
                off = np.moveaxis(grid[..., pad, view], axis, -1) - sweeps[axis, :, pad, view]
                worst = max(worst, float(np.max(np.abs(off))))
    return worst


def _joints(layout: Layout, frames: list[int]) -> set[int]:
    """The joints that move any of some frames."""
    found = set()
    for frame in frames:
        while frame != WORLD:
            found.add(layout.frames[frame].angle)
            frame = layout.frames[frame].parent
    return found


def compiled_in_fresh_process() -> float:
    """Seconds of tracing, lowering and compiling `GRADIENT` over the grid, for all leaves.

    Starting Python, importing and reading the file do not count.
    """
    program = f"""
import time
import jax
jax.config.update("jax_enable_x64", True)
from studies.benchmarks.visibility.cases import gallery
from studies.benchmarks.visibility.finger_grid import grid_of, mean_coverage
scene = gallery("finger")
poses = jax.block_until_ready(grid_of(scene, {STEPS}))
start = time.perf_counter()
jax.jit(jax.value_and_grad(mean_coverage, argnums=(0, 1))).lower(scene, poses).compile()
print(time.perf_counter() - start)
"""
    # A program that was kept on disk would not be compiled.
    environment = os.environ | {"JAX_ENABLE_COMPILATION_CACHE": "false"}
    done = subprocess.run(
        [sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True
    )
    return float(done.stdout)


def _no_error(_: object) -> float:
    return 0.0
