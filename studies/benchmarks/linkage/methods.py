"""Every way of solving one workload, ready to be timed."""

from __future__ import annotations

import functools
import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import optimistix as optx
from jaxtyping import Array

from designopt.study.benchmark import BenchmarkMethod, compile_methods
from designopt.study.stability import DIGITS
from kinematics import Linkage, PackedPoses, compile_poses
from studies.benchmarks.linkage import cases, walks
from studies.benchmarks.linkage.cases import drawn, linkage_of, numbers_of
from studies.benchmarks.linkage.iterations import closed_form, find_roots, newton
from studies.benchmarks.measuring import gradient_error, installed
from studies.oracles import linkages as exact
from studies.oracles.linkages import Case

OURS = "closed form"
PACKED = "closed form, packed"
VALUE = "value without gradient"
FLOOR = "sin and cos alone"
FIXED = "Newton, fixed steps"
ADAPTIVE = "Newton, adaptive steps"
FSOLVE = "SciPy fsolve"
MECHANISM = "mechanism"
PYLINKAGE = "pylinkage"
PYLINKAGE_FAST = "pylinkage, fast steps (numba)"

TOLERANCES = {f"tolerance {value:.0e}": value for value in (1e-4, 1e-12)}
STEPS = {f"{steps} steps": steps for steps in (3, 6)}
SCIPY = 1.49012e-8
"""SciPy's own tolerance."""

VECTORISED_PART = 10_000
"""Poses of a longer sweep that Optimistix solves."""

PACKED_POSES = 1000
"""Sweeps of no more poses are solved as a control loop solves them, too: in one array."""

CHECKED = 200
"""Poses of a sweep that are compared with the reference, evenly spaced."""

OPTIMISTIX = {
    "Optimistix Newton": partial(find_roots, optx.Newton),
    "Optimistix Chord": partial(find_roots, optx.Chord),
    "Optimistix Dogleg": partial(find_roots, optx.Dogleg),
    "Optimistix Levenberg-Marquardt": partial(find_roots, optx.LevenbergMarquardt),
}
BATCHED: dict[str, tuple[Callable[..., Any], Mapping[str, float]]] = {
    OURS: (closed_form, {}),
    FIXED: (partial(newton, False), STEPS),
    ADAPTIVE: (partial(newton, True), TOLERANCES),
    **{name: (solve, TOLERANCES) for name, solve in OPTIMISTIX.items()},
}
"""By name what solves a batch of poses, and its settings, the finest last."""


class Sequential(NamedTuple):
    """What solves pose after pose.

    Attributes:
        walk: the solver.
        package: what must be installed.
        part: poses of a longer sweep, its first ones, that it goes through.
        gradient_part: poses over the whole range of a longer sweep for which it finds the gradient
            by differences; 0 for none.
        tolerances: its settings: for all sweeps but short ones, for short ones, for gradients.
    """

    walk: walks.Walk
    package: str
    part: int
    gradient_part: int
    tolerances: tuple[tuple[float, ...], ...] = ((0.0,),) * 3


FSOLVE_TOLERANCES = (1e-4, SCIPY, 1e-12), (SCIPY,), (1e-12,)
SEQUENTIAL = {
    FSOLVE: Sequential(walks.fsolve_walk, "scipy", 2000, 72, FSOLVE_TOLERANCES),
    MECHANISM: Sequential(walks.mechanism_walk, "mechanism", 1000, 72),
    PYLINKAGE: Sequential(partial(walks.pylinkage_walk, False), "pylinkage", 20_000, 0),
    PYLINKAGE_FAST: Sequential(partial(walks.pylinkage_walk, True), "pylinkage", 4_000_000, 10_000),
}


class Workload(NamedTuple):
    """A sweep of a linkage.

    Attributes:
        case: which linkage.
        poses: how many.
        dtype: float type to solve in.
        gradient: whether the gradient is asked for instead of the poses.
        longest: whether every setting of every method takes part, or the finest of the main ones.
    """

    case: Case
    poses: int
    dtype: str = "float64"
    gradient: bool = False
    longest: bool = True

    @property
    def panel(self) -> str:
        """Its name in figures and tables."""
        asked = "gradient over " if self.gradient else ""
        poses = "1 pose" if self.poses == 1 else f"{self.poses:,} poses"
        return f"{self.case.name}, {asked}{poses}{', float32' * (self.dtype == 'float32')}"


def methods(work: Workload, *, peers: bool, optimistix: bool) -> Iterator[BenchmarkMethod]:
    """Every method at its settings on one workload.

    Keep the surrounding `jax.enable_x64` as the workload's float type needs it until the methods
    are timed (`studies.benchmarks.linkage.iterations.find_roots`).
    """
    double = work.dtype == "float64"
    linkage, angles = linkage_of(work.case, work.dtype), work.case.angles(work.poses)
    inputs = jnp.asarray(angles, work.dtype)
    if work.gradient:
        error, args = partial(_value_error, work), (cases.dimensions(linkage), linkage, inputs)
        yield from compile_methods(VALUE, work.panel, error, mean_square(work, OURS), *args)
    elif double:
        error = partial(_sine_error, angles)
        yield from compile_methods(FLOOR, work.panel, error, _sines, inputs)
    names = [OURS]
    if double or not work.gradient:
        names += [ADAPTIVE] if work.gradient else [FIXED, ADAPTIVE]
        # All of Optimistix where the report's figure is; each compiles for a second or two.
        main = double and work.longest and not work.gradient
        names += list(OPTIMISTIX)[: len(OPTIMISTIX) if main else 1] if optimistix else []
    for name in names:
        yield from _batched(work, name, linkage)
    if double and not work.gradient and work.poses <= PACKED_POSES:
        yield _packed(work, linkage)
    if double:  # the others compute in nothing else
        for name, tool in SEQUENTIAL.items():
            if tool.package == "scipy" or (peers and installed(tool.package)):
                yield from _sequential(work, name, tool)


def _batched(work: Workload, name: str, linkage: Linkage) -> Iterator[BenchmarkMethod]:
    """A method in JAX at its settings; one program serves them all."""
    solve, settings = BATCHED[name]
    part = min(work.poses, VECTORISED_PART) if name in OPTIMISTIX else work.poses
    inputs = jnp.asarray(work.case.angles(part), work.dtype)
    if work.gradient:
        error, function = partial(_slopes_error, work.case, part), mean_square(work, name)
        function, args = jax.value_and_grad(function), (cases.dimensions(linkage), linkage, inputs)
    else:
        error = partial(position_error, work.case, part, part, stacked)
        function, args = partial(solve, work.case, work.case.joints), (linkage, inputs)
    chosen = list(settings.items())[0 if work.longest and not work.gradient else -1 :]
    dtype = None if name == FIXED else work.dtype
    values = {word: jnp.asarray(value, dtype) for word, value in chosen}
    for method in compile_methods(name, work.panel, error, function, *args, settings=values):
        setting = method.setting + _share(part, work.poses, "evenly spaced ")
        yield replace(method, setting=setting, scale=work.poses / part)


def _packed(work: Workload, linkage: Linkage) -> BenchmarkMethod:
    """`kinematics.compile_poses`, its dimensions fixed as those of the peers are."""
    solve, inputs = compile_poses(linkage, of=work.case.joints), work.case.angles(work.poses)

    def places(found: PackedPoses) -> np.ndarray:
        return np.stack([np.asarray(found.position(name)).T for name in work.case.joints], axis=1)

    def call() -> PackedPoses:
        found = solve(inputs[:, None])
        np.asarray(found.array)  # as NumPy's, which `step_fast` returns
        return found

    start = time.perf_counter()
    call()
    seconds = time.perf_counter() - start
    error = partial(position_error, work.case, work.poses, work.poses, places)
    return BenchmarkMethod(PACKED, "", work.panel, call, error, seconds)


def _sequential(work: Workload, name: str, tool: Sequential) -> Iterator[BenchmarkMethod]:
    part = min(work.poses, tool.gradient_part if work.gradient else tool.part)
    longest, short, finest = tool.tolerances if part else ((), (), ())
    for tolerance in finest if work.gradient else longest if work.longest else short:
        if work.gradient:
            words = "central differences" + _share(part, work.poses, "evenly spaced ")
            angles, error = work.case.angles(part), partial(_slopes_error, work.case, part)
            call = partial(walks.gradient_by_differences, tool.walk, work.case, angles, tolerance)
        else:
            words = f"tolerance {tolerance:.0e}" if tolerance else ""
            words = (words + _share(part, work.poses, "first ")).removeprefix(", ")
            angles = work.case.angles(work.poses)[:part]
            call, read = tool.walk(work.case, numbers_of(work.case), angles, tolerance)
            call()  # what compiles itself has done so
            error = partial(position_error, work.case, work.poses, part, read)
        yield BenchmarkMethod(name, words, work.panel, call, error, scale=work.poses / part)


def mean_square(work: Workload, name: str) -> Callable[..., Array]:
    """The scalar whose gradient is asked for: the last joint's mean square distance, mm²."""
    solve = partial(BATCHED[name][0], work.case, work.case.joints[-1:])

    def of_parts(parts: Any, linkage: Linkage, angles: Array, *setting: Array) -> Array:
        [(x, y)], _ = solve(cases.with_dimensions(linkage, parts), angles, *setting)
        return jnp.mean(x * x + y * y)

    return of_parts


def _sines(angles: Array) -> tuple[Array, Array]:
    return jnp.sin(angles), jnp.cos(angles)


def _share(part: int, poses: int, which: str) -> str:
    return f", {which}{part:,} poses solved and the time scaled" if part < poses else ""


def checked(poses: int) -> np.ndarray:
    """Indices of the poses of a sweep that are compared with the reference."""
    return np.unique(np.linspace(0, poses - 1, CHECKED).astype(int))


@functools.cache
def exact_places(case: Case, poses: int, part: int) -> np.ndarray:
    """Moving joints at the `checked` of the first ``part`` poses of a sweep, as mpmath numbers.

    Returns:
        Shape (checked, joints, 2), mm.
    """
    with mpmath.workdps(DIGITS):
        angles = exact.digits(case.angles(poses)[checked(part)])
        return exact.poses(case, numbers_of(case, mpmath.mpf), angles)


@functools.cache
def exact_gradient(case: Case, poses: int) -> np.ndarray:
    """Derivative of the last joint's mean square over a sweep, for each of the case's sizes."""
    with mpmath.workdps(DIGITS):
        mean, step = partial(exact.mean_square, case, poses), mpmath.mpf(10) ** (-DIGITS // 3)
        return cases.central_differences(mean, numbers_of(case, mpmath.mpf), lambda _: step)


def position_error(
    case: Case, poses: int, part: int, read: Callable[[Any], np.ndarray], found: Any
) -> float:
    """Worst distance of a checked joint over the size, for the first ``part`` of a sweep.

    Args:
        case: which linkage.
        poses: of the sweep.
        part: how many of them were solved.
        read: from the answer to the joints in these, mm, shape (part, joints, 2).
        found: the answer.
    """
    places = read(found)[checked(part)].astype(float)
    if not np.all(np.isfinite(places)):
        return math.inf
    with mpmath.workdps(DIGITS):
        off = places.astype(object) - exact_places(case, poses, part)
        size = float(cases.size_of(numbers_of(case)))
        return float(mpmath.sqrt(np.max(np.sum(off * off, axis=-1))) / size)


def stacked(found: tuple[Sequence[tuple[Array, Array]], Any]) -> np.ndarray:
    """The joints that a batched method returns, shape (poses, joints, 2), mm."""
    return np.stack([np.stack(pair, -1) for pair in found[0]], 1)


def _slopes_error(case: Case, poses: int, found: Any) -> float:
    """Worst entry's deviation over the largest entry; an angle's entry counts per size."""
    if not isinstance(found, np.ndarray):
        found = cases.sizes_of(cases.with_dimensions(drawn(case), found[1]))
    expected, sizes = exact_gradient(case, poses), numbers_of(case)
    weights = np.ones(len(expected))
    if sizes.line:
        weights[-1] = 1 / float(cases.size_of(sizes))
    return gradient_error(expected, weights, found)


def _value_error(work: Workload, found: Any) -> float:
    with mpmath.workdps(DIGITS):
        mean = exact.mean_square(work.case, work.poses, numbers_of(work.case, mpmath.mpf))
        return float(abs(mpmath.mpf(float(found)) / mean - 1))


def _sine_error(angles: np.ndarray, found: tuple[Array, Array]) -> float:
    rows = checked(len(angles))
    with mpmath.workdps(DIGITS):
        cosine, sine = exact.direction(exact.digits(angles[rows]))
        return float(np.max(abs(np.asarray(found)[:, rows].astype(object) - [sine, cosine])))
