"""Who takes part: every way of solving one workload, ready to be timed."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import mpmath
import numpy as np
from jaxtyping import Array, Float

from designopt.study.benchmark import BenchmarkMethod, compile_timed
from designopt.study.stability import DIGITS
from kinematics import Linkage, solve_poses
from studies.benchmarks.linkage import exact
from studies.benchmarks.linkage.cases import (
    Case,
    dimensions,
    drawn,
    linkage_of,
    size_of,
    with_dimensions,
)
from studies.benchmarks.linkage.iterations import (
    OPTIMISTIX,
    Advance,
    fixed_steps,
    newton,
    solve_by_optimistix,
    until,
)
from studies.benchmarks.linkage.peers import (
    installed,
    mechanism_walk,
    pylinkage_fast_walk,
    pylinkage_walk,
)
from studies.benchmarks.linkage.sequential import Walk, fsolve_walk, gradient_by_differences

OURS = "closed form"
VALUE = "value without gradient"
FLOOR = "sin and cos alone"
FIXED = "Newton, fixed steps"
ADAPTIVE = "Newton, adaptive steps"
FSOLVE = "SciPy fsolve"
MECHANISM = "mechanism"
PYLINKAGE = "pylinkage"
PYLINKAGE_FAST = "pylinkage, fast steps (numba)"

STEPS = (3, 6)
TOLERANCES = (1e-4, 1e-12)
FSOLVE_TOLERANCES = (1e-4, 1.49012e-8, 1e-12)
"""The middle one is SciPy's own."""

VECTORISED_PART = 10_000
"""Poses of a longer sweep that Optimistix solves."""
PART = {FSOLVE: 2000, MECHANISM: 1000, PYLINKAGE: 20_000}
"""Poses of a longer sweep, its first ones, that a slow solver goes through."""
GRADIENT_PART = {FSOLVE: 72, MECHANISM: 72, PYLINKAGE_FAST: 10_000}
"""Poses over the whole range of a longer sweep for which a slow solver finds the gradient."""


class Workload(NamedTuple):
    """A sweep of a linkage.

    Attributes:
        case: which linkage.
        poses: how many.
        dtype: float type to solve in.
        gradient: whether the gradient is asked for instead of the poses.
        every: whether every setting of every method takes part, or the finest of the main ones.
    """

    case: Case
    poses: int
    dtype: str = "float64"
    gradient: bool = False
    every: bool = True

    @property
    def panel(self) -> str:
        """Its name in figures and tables."""
        asked = "gradient over " if self.gradient else ""
        poses = "1 pose" if self.poses == 1 else f"{self.poses:,} poses"
        return f"{self.case.name}, {asked}{poses}" + (
            ", float32" if self.dtype == "float32" else ""
        )


def contenders(work: Workload, *, peers: bool, optimistix: bool) -> Iterator[BenchmarkMethod]:
    """Every method at its settings on one workload.

    Keep the surrounding `jax.enable_x64` as the workload's float type wants it until the
    contenders are timed (`studies.benchmarks.linkage.iterations.solve_by_optimistix`).
    """
    if work.gradient:
        yield from _gradients(work, peers, optimistix)
        return
    linkage, angles = linkage_of(work.case, work.dtype), work.case.angles(work.poses)
    inputs = jnp.asarray(angles, work.dtype)
    error = _position_error(work, work.poses)
    ours, seconds = compile_timed(partial(poses_of, work.case), linkage, inputs[:, None])
    column = inputs[:, None]
    yield BenchmarkMethod(
        OURS, "", work.panel, partial(ours, linkage, column), lambda a: error(a[0]), seconds
    )
    if work.dtype == "float64":
        floor, seconds = compile_timed(lambda u: (jnp.sin(u), jnp.cos(u)), inputs)
        yield BenchmarkMethod(
            FLOOR, "", work.panel, partial(floor, inputs), partial(_sine_error, angles), seconds
        )
    for method, advance, settings in NEWTON:
        run, seconds = compile_timed(
            partial(newton, work.case, advance), linkage, inputs, _setting(settings[0], work)
        )
        for setting in settings if work.every else settings[-1:]:
            call = partial(run, linkage, inputs, _setting(setting, work))
            yield BenchmarkMethod(method, _named(setting), work.panel, call, error, seconds)
    if optimistix:
        yield from _optimistix_poses(work, linkage)
    if work.dtype == "float64":  # the others compute in nothing else
        yield from _walks(work, linkage, peers)


def poses_of(case: Case, linkage: Linkage, inputs: Float[Array, "poses 1"]) -> tuple:
    """The library's own call: moving joints, which poses are ok, and their margins."""
    solved = solve_poses(linkage, inputs, of=case.joints)
    places = [solved.value.joints[name] for name in case.joints]
    return [(place.x, place.y) for place in places], solved.ok, solved.margin


def path_square(case: Case, linkage: Linkage, inputs: Float[Array, "poses 1"]) -> Array:
    """The scalar whose gradient is asked for: the last joint's mean square distance, mm²."""
    place = solve_poses(linkage, inputs, of=case.joints[-1:]).value.joints[case.joints[-1]]
    return jnp.mean(place.squared())


NEWTON: tuple[tuple[str, Callable[[Any], Advance], tuple[float, ...]], ...] = (
    (FIXED, fixed_steps, STEPS),
    (ADAPTIVE, until, TOLERANCES),
)


def _optimistix_poses(work: Workload, linkage: Linkage) -> Iterator[BenchmarkMethod]:
    part = min(work.poses, VECTORISED_PART)
    inputs = jnp.asarray(work.case.angles(part), work.dtype)
    error = _position_error(work._replace(poses=part), part)
    # All of them where the report's figure is; each compiles for a second or two.
    main = work.every and work.dtype == "float64"
    for method in OPTIMISTIX if main else list(OPTIMISTIX)[:1]:
        run, seconds = compile_timed(
            partial(solve_by_optimistix, work.case, method),
            linkage,
            inputs,
            _setting(TOLERANCES[0], work),
        )
        for setting in TOLERANCES if work.every else TOLERANCES[-1:]:
            yield BenchmarkMethod(
                method,
                _named(setting) + _share(part, work.poses, "evenly spaced "),
                work.panel,
                partial(run, linkage, inputs, _setting(setting, work)),
                error,
                seconds,
                work.poses / part,
            )


def _walks(work: Workload, linkage: Linkage, peers: bool) -> Iterator[BenchmarkMethod]:
    tolerances = FSOLVE_TOLERANCES if work.every else FSOLVE_TOLERANCES[1:2]
    walks: list[tuple[str, str, Walk]] = [
        (FSOLVE, f"tolerance {tolerance:.0e}", fsolve_walk(tolerance)) for tolerance in tolerances
    ]
    if peers and installed("mechanism"):
        walks.append((MECHANISM, "", mechanism_walk))
    if peers and installed("pylinkage"):
        walks += [(PYLINKAGE, "", pylinkage_walk), (PYLINKAGE_FAST, "", pylinkage_fast_walk)]
    for method, setting, walk in walks:
        part = min(work.poses, PART.get(method, work.poses))
        walker = walk(work.case, linkage, work.case.angles(work.poses)[:part])
        walker.call()  # what compiles itself has done so
        share = _share(part, work.poses, "first ")
        error = _position_error(work, part)
        yield BenchmarkMethod(
            method,
            setting + share if setting else share.removeprefix(", "),
            work.panel,
            walker.call,
            lambda answer, error=error, read=walker.read: error(read(answer)),
            scale=work.poses / part,
        )


def _gradients(work: Workload, peers: bool, optimistix: bool) -> Iterator[BenchmarkMethod]:
    case = work.case
    linkage, inputs = linkage_of(case, work.dtype), jnp.asarray(case.angles(work.poses), work.dtype)
    parts, column = dimensions(linkage), inputs[:, None]
    error = _gradient_error(work, work.poses)

    def ours(parts: Any, linkage: Linkage, inputs: Array) -> Array:
        return path_square(case, with_dimensions(linkage, parts), inputs)

    run, seconds = compile_timed(ours, parts, linkage, column)
    call = partial(run, parts, linkage, column)
    yield BenchmarkMethod(VALUE, "", work.panel, call, _value_error(work), seconds)
    run, seconds = compile_timed(jax.value_and_grad(ours), parts, linkage, column)
    call = partial(run, parts, linkage, column)
    yield BenchmarkMethod(OURS, "", work.panel, call, lambda found: error(found[1]), seconds)

    if work.dtype == "float32":
        return

    def iterated(solve: Callable[..., Any]) -> Callable[..., Array]:
        def square(parts: Any, linkage: Linkage, inputs: Array, setting: Array) -> Array:
            x, y = solve(with_dimensions(linkage, parts), inputs, setting)[-1]
            return jnp.mean(x * x + y * y)

        return jax.grad(square)

    for method, advance, settings in NEWTON[1:]:
        setting = _setting(settings[-1], work)
        function = iterated(partial(newton, case, advance))
        run, seconds = compile_timed(function, parts, linkage, inputs, setting)
        call = partial(run, parts, linkage, inputs, setting)
        yield BenchmarkMethod(method, _named(settings[-1]), work.panel, call, error, seconds)
    part = min(work.poses, VECTORISED_PART)
    few, setting = jnp.asarray(case.angles(part)), jnp.asarray(TOLERANCES[-1])
    for method in list(OPTIMISTIX)[:1] if optimistix else ():
        function = iterated(partial(solve_by_optimistix, case, method))
        run, seconds = compile_timed(function, parts, linkage, few, setting)
        yield BenchmarkMethod(
            method,
            _named(TOLERANCES[-1]) + _share(part, work.poses, "evenly spaced "),
            work.panel,
            partial(run, parts, linkage, few, setting),
            _gradient_error(work, part),
            seconds,
            work.poses / part,
        )
    yield from _differences(work, linkage, peers)


def _differences(work: Workload, linkage: Linkage, peers: bool) -> Iterator[BenchmarkMethod]:
    walks: list[tuple[str, Walk]] = [(FSOLVE, fsolve_walk(FSOLVE_TOLERANCES[-1]))]
    if peers and installed("mechanism"):
        walks.append((MECHANISM, mechanism_walk))
    if peers and installed("pylinkage"):
        walks.append((PYLINKAGE_FAST, pylinkage_fast_walk))
    for method, walk in walks:
        part = min(work.poses, GRADIENT_PART[method])
        angles = work.case.angles(part)
        yield BenchmarkMethod(
            method,
            "central differences" + _share(part, work.poses, "evenly spaced "),
            work.panel,
            partial(gradient_by_differences, walk, work.case, linkage, angles),
            _gradient_error(work, part),
            scale=work.poses / part,
        )


def _setting(value: float, work: Workload) -> Array:
    return jnp.asarray(value) if isinstance(value, int) else jnp.asarray(value, work.dtype)


def _named(setting: float) -> str:
    return f"{setting} steps" if isinstance(setting, int) else f"tolerance {setting:.0e}"


def _share(part: int, poses: int, which: str) -> str:
    return f", {which}{part:,} poses solved and the time scaled" if part < poses else ""


def _position_error(work: Workload, part: int) -> Callable[[Any], float]:
    """Worst distance of a checked joint over the size, for the first ``part`` of the sweep."""
    reference = exact.positions(work.case, work.poses, part)

    def error(found: Any) -> float:
        if isinstance(found, np.ndarray):
            return reference.error(found)
        return reference.error(np.stack([np.stack(pair, -1) for pair in found], 1))

    return error


def _gradient_error(work: Workload, poses: int) -> Callable[[Any], float]:
    """Worst entry's deviation over the largest entry; an angle's entry counts per size."""
    linkage = drawn(work.case)
    reference = exact.gradient(work.case, poses)
    anchors, links, lines = jax.tree.map(np.ones_like, dimensions(linkage))
    lines = jax.tree.map(lambda part: part if part.ndim else part / size_of(linkage), lines)
    weights = np.concatenate([np.ravel(part) for part in jax.tree.leaves((anchors, links, lines))])

    def error(found: Any) -> float:
        parts = [np.ravel(part) for part in jax.tree.leaves(found)]
        off = np.abs(np.concatenate(parts).astype(float) - reference) * weights
        return float(np.max(off) / np.max(np.abs(reference) * weights))

    return error


def _value_error(work: Workload) -> Callable[[Any], float]:
    reference = exact.value(work.case, work.poses)

    def error(found: Any) -> float:
        with mpmath.workdps(DIGITS):
            return float(abs(mpmath.mpf(float(found)) / reference - 1))

    return error


def _sine_error(angles: np.ndarray, found: tuple[Array, Array]) -> float:
    checked = np.unique(np.linspace(0, len(angles) - 1, exact.CHECKED).astype(int))
    computed = [np.asarray(part) for part in found]
    with mpmath.workdps(DIGITS):
        return max(
            float(abs(function(mpmath.mpf(float(angles[i]))) - mpmath.mpf(float(values[i]))))
            for function, values in zip((mpmath.sin, mpmath.cos), computed, strict=True)
            for i in checked
        )
