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
from designopt.study.benchmark import BenchmarkMethod, benchmark, compile_methods, find_undominated
from designopt.study.report import Report
from designopt.study.stability import DIGITS
from optics.chamber.chamber import Chamber
from studies.oracles import chamber as exact
from studies.table1 import Table1Spec

FIELDS = (
    "length_ab",
    "length_bc",
    "length_cd",
    "offset_b",
    "wall_angle_bc",
    "reference_height",
    "pinhole_offset",
)
"""The chamber's fields on which η depends, beside Δl_D."""

TOLERANCES = (1e-2, 1e-5, 1e-8, 1e-11, 1e-14)
CLOSED_FORM = "closed form"
CHECKED = 300
"""At most so many problems of a batch are compared with the reference, evenly spaced through it."""
BRENTQ_SHARE = 50
"""SciPy has no batched brentq: it solves one problem in so many of a batch; the time is scaled."""

METHOD_NAMES = {
    "newton": "Optimistix Newton",
    "chord": "Optimistix Chord",
    "bisection": "Optimistix Bisection",
    "dogleg": "Optimistix Dogleg",
    "levenberg-marquardt": "Optimistix Levenberg-Marquardt",
    "jaxopt-bisection": "jaxopt Bisection",
    "jaxopt-gauss-newton": "jaxopt Gauss-Newton",
}


class Workload(NamedTuple):
    """Problems to solve: one θ_CD each.

    Attributes:
        panel: its name in figures and tables.
        dtype: float type to solve in.
        angles: θ_CD in radians.
        bracket: two η with every answer between them; the upper one is every iteration's guess.
        checked: indices of the problems compared with the reference.
        exact: their η in many digits.
    """

    panel: str
    dtype: str
    angles: np.ndarray
    bracket: tuple[float, float]
    checked: np.ndarray
    exact: list[Any]


def workloads(fields: dict[str, float], problems: int, seed: int) -> Iterator[Workload]:
    """One problem and a batch, in float64 and float32.

    Args:
        fields: the chamber's `FIELDS` by name.
        problems: size of the batch.
        seed: draws the batch's θ_CD, uniform over Table I's range of 4° to 16°.
    """
    limits = np.deg2rad([4, 16])
    batch = np.random.default_rng(seed).uniform(limits[0], limits[1], problems)
    one = np.deg2rad([6.659])
    for name, angles in (("one problem", one), (f"{problems:,} problems", batch)):
        checked = np.unique(np.linspace(0, len(angles) - 1, CHECKED).astype(int))
        with mpmath.workdps(DIGITS):
            chamber = {name: mpmath.mpf(value) for name, value in fields.items()}
            ratios = [_exact_ratio(chamber, mpmath.mpf(angle)) for angle in angles[checked]]
            ends = sorted(float(_exact_ratio(chamber, mpmath.mpf(angle))) for angle in limits)
        bracket = (ends[0] - 0.7, ends[1] + 0.4)  # not centred on anything
        for dtype in ("float64", "float32"):
            yield Workload(f"{name}, {dtype}", dtype, angles, bracket, checked, ratios)


def measure(out: Report, chamber: Chamber, spec: Table1Spec, seed: int) -> None:
    """Error against run time of solving for η from θ_CD, with this chamber's constants."""
    fields = {name: float(getattr(chamber, name)) for name in FIELDS}
    rows = []
    for work in workloads(fields, spec.precision_problems, seed):
        # Optimistix mixes float types in Levenberg-Marquardt and Dogleg when 64-bit floats are on.
        with jax.enable_x64(work.dtype == "float64"):
            rows += benchmark(methods(fields, work), repeats=spec.precision_repeats)
    out.precision(
        rows,
        "worst relative error of η",
        f"Eqs. 1-3 as printed, in {DIGITS} digits, for θ_CD and dimensions in double precision "
        "(so float32 answers for the rounding of its inputs, too)",
        out.claim("closed-form", *find_undominated(rows, CLOSED_FORM)),
    )


def methods(fields: dict[str, float], work: Workload) -> list[BenchmarkMethod]:
    """Every method at every tolerance on one workload, compiled in JAX's present float type."""
    chamber = Chamber(**fields, offset_a=0.0, offset_d=0.0, focal_length=0.0, image_distance=0.0)
    angles, error = jnp.asarray(work.angles, work.dtype), partial(_worst_error, work)
    closed = jax.vmap(_closed_form, (None, 0))
    made = compile_methods(CLOSED_FORM, work.panel, error, closed, chamber, angles)
    settings = {f"tolerance {value:.0e}": jnp.asarray(value, work.dtype) for value in TOLERANCES}
    for method in get_args(RootMethod):
        solve = jax.vmap(partial(_iterate, method, work.bracket), (None, 0, None))
        name = METHOD_NAMES[method]
        made += compile_methods(name, work.panel, error, solve, chamber, angles, settings=settings)
    return made + (_brentq(fields, work) if work.dtype == "float64" else [])


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
        _residual,
        jnp.full_like(angle, bracket[1]),
        (chamber, angle),
        method=method,
        bracket=bracket,
        tolerance=tolerance,
        max_steps=64 if "bisection" in method else 32,
    ).value


def _residual(ratio: Float[Array, ""], args: tuple[Chamber, Float[Array, ""]]) -> Float[Array, ""]:
    chamber, angle = args
    offset_c, offset_d = _printed_offsets(
        ratio,
        chamber.length_ab + chamber.pinhole_offset,
        chamber.length_bc,
        chamber.length_cd,
        chamber.offset_b,
        jnp.tan(chamber.wall_angle_bc),
        chamber.reference_height,
    )
    return jnp.arctan2(offset_c + offset_d, chamber.length_cd) - angle


def _printed_offsets(
    ratio: Any, depth_b: Any, b: Any, c: Any, offset_b: Any, slope: Any, h: Any
) -> tuple[Any, Any]:
    # Δl_C and Δl_D as Eqs. 1 to 3 give them, written out by hand without any factoring.
    offset_c = offset_b - b * slope
    image_c, image_b = (h + offset_c) / (depth_b + b), (h + offset_b) / depth_b
    return offset_c, h - (depth_b + b + c) * ((1 + ratio) * image_c - ratio * image_b)


def _brentq(fields: dict[str, float], work: Workload) -> list[BenchmarkMethod]:
    slope = math.tan(fields["wall_angle_bc"])
    depth_b = fields["length_ab"] + fields["pinhole_offset"]
    c = fields["length_cd"]
    numbers = depth_b, fields["length_bc"], c, fields["offset_b"], slope, fields["reference_height"]

    def residual(ratio: float, angle: float) -> float:
        offset_c, offset_d = _printed_offsets(ratio, *numbers)
        return math.atan2(offset_c + offset_d, c) - angle

    share = min(BRENTQ_SHARE, len(work.angles))
    part = work.angles[::share].tolist()
    with mpmath.workdps(DIGITS):
        chamber = {name: mpmath.mpf(value) for name, value in fields.items()}
        first = part[:CHECKED]
        checked = work._replace(
            checked=np.arange(len(first)),
            exact=[_exact_ratio(chamber, mpmath.mpf(angle)) for angle in first],
        )

    def call(tolerance: float) -> np.ndarray:
        relative = np.float64(max(tolerance, 4 * np.finfo(float).eps))
        return np.array(
            [
                scipy.optimize.brentq(
                    residual, *work.bracket, args=(angle,), xtol=tolerance, rtol=relative
                )
                for angle in part
            ]
        )

    scaled = f", 1 problem in {share} solved and the time scaled" if share > 1 else ""
    error, scale = partial(_worst_error, checked), len(work.angles) / len(part)
    return [
        BenchmarkMethod(
            "SciPy brentq",
            f"tolerance {tolerance:.0e}{scaled}",
            work.panel,
            partial(call, tolerance),
            error,
            scale=scale,
        )
        for tolerance in TOLERANCES
    ]


def _exact_ratio(chamber: dict[str, Any], angle: Any) -> Any:
    return exact.imaging_ratio(offset_d=exact.offset_d_from_angle(angle, **chamber), **chamber)


def _worst_error(work: Workload, found: Any) -> float:
    with mpmath.workdps(DIGITS):
        return max(
            float(abs(mpmath.mpf(float(ratio)) / reference - 1))
            for ratio, reference in zip(np.asarray(found)[work.checked], work.exact, strict=True)
        )
