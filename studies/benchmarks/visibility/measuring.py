"""Everything that is measured, on one core unless said otherwise."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Array

from designopt.study.benchmark import Ratio, benchmark, one_core
from designopt.study.results import PrecisionRow
from designopt.study.study import Context
from optics.scene.scene import Scene
from optics.visibility.coverage import find_views
from optics.visibility.edge_refined import trace_views
from studies.benchmarks.visibility import exact, finger_grid, tracers
from studies.benchmarks.visibility.cases import (
    CURVED,
    STRAIGHT,
    bent,
    flexion,
    gallery,
    spoilt_finger,
)
from studies.benchmarks.visibility.contenders import BEST, EDGES, OURS, SOFT, Workload, contenders
from studies.benchmarks.visibility.finger_grid import Grid
from studies.benchmarks.visibility.spec import VisibilityPrecisionSpec
from studies.oracles import tracer as numpy_rays
from studies.oracles.scenes import rounded

ACCURACY = 5e-4
"""Gradient error at which run times are compared."""

LEGS = (tracers.MIRRORS, 1)
"""Of the rays: over all mirrors, and to the first of them."""


class Deviation(NamedTuple):
    """How far a scene's coverage is from that by the reference's rays.

    Attributes:
        scene: its name in the gallery.
        method: how the coverage was found.
        coverage: of all pads, the worst deviation.
        redundancy: the same of the number of paths that see a point.
    """

    scene: str
    method: str
    coverage: float
    redundancy: float


class Rival(NamedTuple):
    """The fastest sigmoid sampling that is accurate enough, beside the exact intervals.

    Attributes:
        row: its method and setting.
        ratio: its run time over that of the exact intervals.
    """

    row: PrecisionRow
    ratio: Ratio


class Measurements(NamedTuple):
    """All that was found.

    Attributes:
        rows: every method at every setting on every workload.
        rivals: of each gradient that a sigmoid finds accurately enough.
        fan_error: deviation of the reference's rays from 50 digits, for the spoilt finger.
        deviations: of every scene of the gallery.
        grid: the finger over a grid of poses.
        traced: legs and run time of every tracer.
        over_tracers: by legs and tracer, its run time over that of `trace_rays`.
        pinned: whether all of that ran on one core.
    """

    rows: list[PrecisionRow]
    rivals: list[Rival]
    fan_error: float
    deviations: list[Deviation]
    grid: Grid | None
    traced: list[tuple[int, PrecisionRow]]
    over_tracers: dict[tuple[int, str], Ratio]
    pinned: bool


def measure_all(spec: VisibilityPrecisionSpec, context: Context) -> Measurements:
    """Measure everything the spec asks for."""
    rows, rivals, cores = [], [], []
    for work in workloads(spec):
        with context.step(work.panel):
            entered = list(contenders(work, spec.samples, edge_refined=spec.edge_refined))
            with one_core() as pinned:
                mine = benchmark(entered, repeats=spec.repeats)
            if work.gradient:
                rivals += fastest_sigmoid(mine)
            rows += mine
            cores.append(pinned)
    with context.step("Reference in 50 digits"):
        fan_error = fan_deviation(spec.reference_rays)
    deviations = []
    for name in gallery_of(spec):
        with context.step(f"Gallery: {name}"):
            deviations.append(deviation(name, spec.reference_rays))
    grid = None
    if spec.grid:
        with context.step("The finger over a grid of poses"):
            grid = finger_grid.measure_grid(spec.repeats)
    traced, over_tracers = [], {}
    for legs in LEGS if spec.tracers else ():
        with context.step(f"Ray tracers, {legs} legs"):
            tracing = list(tracers.contenders(legs, context.seed, peers=spec.peers))
            ours, *others = benchmark(tracing, repeats=spec.repeats)
            traced += [(legs, row) for row in (ours, *others)]
            over_tracers |= {(legs, row.method): Ratio.of(row, ours) for row in others}
    return Measurements(rows, rivals, fan_error, deviations, grid, traced, over_tracers, all(cores))


def workloads(spec: VisibilityPrecisionSpec) -> list[Workload]:
    """One pose and, if asked for, a sweep of them: coverage and gradient."""
    scene = spoilt_finger()
    poses = [bent(scene)[None], *([flexion(scene)] if spec.flexion else [])]
    return [
        Workload(scene, some, gradient, spec.reference_rays)
        for some in poses
        for gradient in (False, True)
    ]


def gallery_of(spec: VisibilityPrecisionSpec) -> list[str]:
    """The scenes of the gallery that a spec asks for."""
    if not spec.gallery:
        return []
    return [*STRAIGHT, *(CURVED if spec.edge_refined else ())]


def deviation(name: str, rays: int) -> Deviation:
    """How far the library is from the reference's rays, for a scene of the gallery."""
    scene = gallery(name)
    method, find = (EDGES, trace_views) if scene.layout.curved else (OURS, find_views)

    @jax.jit
    def found(scene: Scene) -> tuple[Array, Array]:
        pieces = find(scene, scene.pose()).value
        return pieces.coverage(), pieces.redundancy()

    fan = numpy_rays.seen_by_fan(rounded(scene, scene.pose()), rays)
    off = [float(np.max(np.abs(a - b))) for a, b in zip(found(scene), fan, strict=True)]
    return Deviation(name, method, *off)


def fan_deviation(rays: int) -> float:
    """How far the reference's rays are from 50 digits, for the spoilt finger."""
    scene = spoilt_finger()
    fan = numpy_rays.seen_by_fan(rounded(scene, bent(scene)), rays)
    return float(np.max(np.abs(fan.coverage - exact.coverage(scene, bent(scene)))))


def fastest_sigmoid(rows: Sequence[PrecisionRow]) -> Iterator[Rival]:
    """The fastest sigmoid that is accurate enough, if there is one, beside the first method."""
    close = [row for row in rows if row.method in (*SOFT.values(), BEST) and row.error <= ACCURACY]
    if close:
        row = min(close, key=lambda row: row.seconds)
        yield Rival(row, Ratio.of(row, rows[0]))
