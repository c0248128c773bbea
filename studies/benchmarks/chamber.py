"""Error against run time of solving for η from θ_CD: the closed form beside every iteration."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import partial
from typing import Any, NamedTuple, get_args

import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import scipy.optimize
from jaxtyping import Array, Float

from designopt.roots import RootMethod, find_root
from designopt.study.benchmark import BenchmarkMethod, benchmark, compile_methods
from designopt.study.results import PrecisionRow
from designopt.study.stability import DIGITS
from optics.chamber.chamber import Chamber
from studies.oracles import chamber as exact

FIELDS = (
    *("length_ab", "length_bc", "length_cd", "offset_b", "wall_angle_bc"),
    *("reference_height", "pinhole_offset"),
)
"""The chamber's fields on which η depends, beside Δl_D."""

TOLERANCES = (1e-2, 1e-5, 1e-8, 1e-11, 1e-14)
CLOSED_FORM = "closed form"
REFERENCE = f"Eqs. 1-3 as printed, in {DIGITS} digits, for θ_CD and dimensions in double precision"
CHECKED = 300
"""At most so many problems of a batch are compared with the reference, evenly spaced through it."""
BRENTQ = "SciPy brentq"
BRENTQ_SHARE = 50
"""SciPy has no batched brentq: it solves one problem in so many of a batch; the time is scaled."""


def method_name(method: str) -> str:
    """What a root-finding method is called: its package, then its own name."""
    name = method.removeprefix("jaxopt-")
    return f"{'Optimistix' if name == method else 'jaxopt'} {name.title()}"


class Workload(NamedTuple):
    """Problems to solve: one θ_CD each.

    Attributes:
        fields: the chamber's `FIELDS` by name.
        panel: its name in figures and tables.
        dtype: float type to solve in.
        angles: θ_CD in radians.
        bracket: two η with every answer between them; the upper one is every iteration's guess.
        checked: indices of the problems compared with the reference.
        exact: their η in many digits.
    """

    fields: dict[str, float]
    panel: str
    dtype: str
    angles: np.ndarray
    bracket: tuple[float, float]
    checked: np.ndarray
    exact: list[Any]

    def error(self, found: Any) -> float:
        """Largest relative error of the η found."""
        with mpmath.workdps(DIGITS):
            pairs = zip(np.asarray(found)[self.checked].tolist(), self.exact, strict=True)
            return max(float(abs(ratio / reference - 1)) for ratio, reference in pairs)


def workloads(chamber: Chamber, problems: int, seed: int) -> Iterator[Workload]:
    """One problem and a batch, in float64 and float32.

    Args:
        chamber: gives the constants.
        problems: size of the batch.
        seed: draws the batch's θ_CD, uniform over Table I's range of 4° to 16°.
    """
    fields = {name: float(getattr(chamber, name)) for name in FIELDS}
    limits = np.deg2rad([4, 16])
    batch = np.random.default_rng(seed).uniform(limits[0], limits[1], problems)
    ends = sorted(float(ratio) for ratio in _exact_ratios(fields, limits))
    bracket = (ends[0] - 0.7, ends[1] + 0.4)  # not centred on anything
    for name, angles in (("one problem", np.deg2rad([6.659])), (f"{problems:,} problems", batch)):
        checked = np.unique(np.linspace(0, len(angles) - 1, CHECKED).astype(int))
        ratios = _exact_ratios(fields, angles[checked])
        for dtype in ("float64", "float32"):
            panel = f"{name}, {dtype}"
            yield Workload(fields, panel, dtype, angles, bracket, checked, ratios)


def measure(chamber: Chamber, problems: int, repeats: int, seed: int) -> list[PrecisionRow]:
    """Error against run time of solving for η from θ_CD, with this chamber's constants."""
    rows = []
    for work in workloads(chamber, problems, seed):
        # Optimistix mixes float types in Levenberg-Marquardt and Dogleg when 64-bit floats are on.
        with jax.enable_x64(work.dtype == "float64"):
            rows += benchmark(methods(work), repeats=repeats)
    return rows


def methods(work: Workload) -> list[BenchmarkMethod]:
    """Every method at every tolerance on one workload, compiled in JAX's present float type."""
    others = dict.fromkeys(("offset_a", "offset_d", "focal_length", "image_distance"), 0.0)
    chamber = Chamber(**work.fields, **others)
    angles = jnp.asarray(work.angles, work.dtype)
    closed = jax.vmap(_closed_form, (None, 0))
    made = compile_methods(CLOSED_FORM, work.panel, work.error, closed, chamber, angles)
    settings = {f"tolerance {value:.0e}": jnp.asarray(value, work.dtype) for value in TOLERANCES}
    for method in get_args(RootMethod):
        solve = jax.vmap(partial(_iterate, method, work.bracket), (None, 0, None))
        shared = (method_name(method), work.panel, work.error, solve, chamber, angles)
        made += compile_methods(*shared, settings=settings)
    return made + (_brentq(work) if work.dtype == "float64" else [])


def _closed_form(chamber: Chamber, angle: Float[Array, ""]) -> Float[Array, ""]:
    return chamber.with_wall_angle_cd(angle).imaging_ratio().value


def _iterate(
    method: RootMethod,
    bracket: tuple[float, float],
    chamber: Chamber,
    angle: Float[Array, ""],
    tolerance: Float[Array, ""],
) -> Float[Array, ""]:
    return find_root(
        lambda ratio, of: _printed_angle(jnp, ratio, *of[0]) - of[1],
        jnp.full_like(angle, bracket[1]),
        ([getattr(chamber, name) for name in FIELDS], angle),
        method=method,
        bracket=bracket,
        tolerance=tolerance,
        max_steps=64 if "bisection" in method else 32,
    ).value


def _printed_angle(
    xp: Any, ratio: Any, a: Any, b: Any, c: Any, offset_b: Any, theta_bc: Any, h: Any, delta: Any
) -> Any:
    # θ_CD as Eqs. 1 to 3 give it, written out by hand without any factoring; of `FIELDS`.
    offset_c, depth_b = offset_b - b * xp.tan(theta_bc), a + delta
    image_c, image_b = (h + offset_c) / (depth_b + b), (h + offset_b) / depth_b
    offset_d = h - (depth_b + b + c) * ((1 + ratio) * image_c - ratio * image_b)
    return xp.atan2(offset_c + offset_d, c)


def _brentq(work: Workload) -> list[BenchmarkMethod]:
    share = min(BRENTQ_SHARE, len(work.angles))
    part = work.angles[::share].tolist()
    ratios, numbers = _exact_ratios(work.fields, np.array(part[:CHECKED])), work.fields.values()
    checked = work._replace(checked=np.arange(len(ratios)), exact=ratios)

    def residual(ratio: float, angle: float) -> float:
        return _printed_angle(math, ratio, *numbers) - angle

    def call(tolerance: float) -> np.ndarray:
        relative = np.float64(max(tolerance, 4 * np.finfo(float).eps))
        settings = {"xtol": tolerance, "rtol": relative}
        solve = partial(scipy.optimize.brentq, residual, *work.bracket, **settings)
        return np.array([solve(args=(angle,)) for angle in part])

    scaled = f", 1 problem in {share} solved and the time scaled" if share > 1 else ""
    entered = partial(BenchmarkMethod, BRENTQ, panel=work.panel, error=checked.error)
    scale = len(work.angles) / len(part)
    return [
        entered(f"tolerance {value:.0e}{scaled}", call=partial(call, value), scale=scale)
        for value in TOLERANCES
    ]


def _exact_ratios(fields: dict[str, float], angles: np.ndarray) -> list[Any]:
    with mpmath.workdps(DIGITS):
        chamber = {name: mpmath.mpf(value) for name, value in fields.items()}
        offsets = (exact.offset_d_from_angle(mpmath.mpf(angle), **chamber) for angle in angles)
        return [exact.imaging_ratio(offset_d=offset, **chamber) for offset in offsets]
