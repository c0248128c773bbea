"""Any one dimension of a chamber from the imaging ratio η and all the others."""

from __future__ import annotations

import dataclasses
from typing import Literal, get_args

import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Bool, Float, Int

from designopt.numerics import as_float, safe_divide, safe_quadratic_roots
from designopt.roots import RootMethod, find_root
from designopt.solution import Solution
from optics.chamber.chamber import Chamber, ChamberResult, ring_residual, ring_terms

Dimension = Literal[
    "length_ab",
    "length_bc",
    "length_cd",
    "offset_b",
    "wall_angle_bc",
    "offset_d",
    "reference_height",
    "pinhole_offset",
]
"""The dimensions on which η depends."""


SolveMethod = Literal["closed form"] | RootMethod

_LENGTHS = tuple(name for name in get_args(Dimension) if name != "wall_angle_bc")
_QUADRATIC = ("length_ab", "length_bc", "pinhole_offset")  # the equation is linear in the others


def solve_dimension_for_ratio(
    chamber: Chamber,
    dimension: Dimension,
    ratio: ArrayLike,
    *,
    method: SolveMethod = "closed form",
    bracket: tuple[ArrayLike, ArrayLike] | None = None,
    tolerance: ArrayLike = 1e-12,
) -> Solution[Float[Array, ""]]:
    """The value of one dimension at which the chamber's imaging ratio is ``ratio``.

    η depends neither on Δl_A nor on f and v, unless they are tied to h and δ: with the constants
    as printed, solve for ``reference_height`` and read it as Δl_A, or for ``pinhole_offset`` and
    read it as f. θ_CD follows from ``offset_d`` (`Chamber.wall_angle_cd`).

    Δd_c = η Δd_b, cleared of its divisions, is a polynomial of degree 2 at most in every dimension
    (of degree 1 in tan θ_BC for the wall angle), so its roots stand in closed form. Of two roots
    the one that can be built counts, and of two such the one nearer to the chamber's present value.

    Args:
        chamber: all dimensions; that of ``dimension`` chooses between two answers, and is where
            an iteration starts.
        dimension: which one to solve for, a field of `Chamber`.
        ratio: η wanted, without unit.
        method: ``"closed form"``, or an iteration of `designopt.find_root`.
        bracket: for the bisections: two values of the dimension with the answer between them.
        tolerance: of an iteration, on the residual of Δd_c = η Δd_b scaled to order one and on
            the dimension relative to the longest length.

    Returns:
        The dimension's value, mm or radians, differentiable in every other dimension and in η.
        ``margin`` is that of the resulting chamber's `Chamber.imaging_ratio` (mm). Where no real
        root exists it measures something else: the discriminant, scaled to −1…0, times the
        longest length (0 if η does not depend on the dimension at all).

    Raises:
        ValueError: η does not depend on a dimension of that name.

    Example:
        >>> chamber = Chamber(40, 30, 30, 4.1, 2.0, 0.035, 2.5, 4.0, 3.5, 8.6, 0.84)
        >>> found = solve_dimension_for_ratio(chamber, "offset_d", 0.5)
        >>> bool(found.ok), round(float(found.value), 2)  # mm
        (True, 1.3)
    """
    if dimension not in get_args(Dimension):
        raise ValueError(
            f"the imaging ratio does not depend on {dimension!r}; solve for one of "
            + ", ".join(get_args(Dimension))
        )
    ratio = as_float(ratio).astype(chamber.length_ab.dtype)
    # Lengths in units of the longest, so that no product leaves the range of the float type.
    lengths = {name: getattr(chamber, name) for name in _LENGTHS}
    longest = jnp.max(jnp.abs(jnp.stack(list(lengths.values()))))
    unit = jax.lax.stop_gradient(jnp.where(longest > 0, longest, 1.0))
    scaled = dataclasses.replace(chamber, **{name: x / unit for name, x in lengths.items()})
    unknown_unit = jnp.ones_like(unit) if dimension == "wall_angle_bc" else unit
    if method == "closed form":
        solved = _closed_form(scaled, dimension, ratio)
    else:
        if bracket is not None:
            bracket = (bracket[0] / unknown_unit, bracket[1] / unknown_unit)
        solved = _iterated(scaled, dimension, ratio, method, bracket, tolerance)
    value, margin = solved.value * unknown_unit, solved.margin * unit
    fits = jnp.isfinite(value) & jnp.isfinite(margin)
    return Solution(
        jnp.where(fits, value, jnp.zeros_like(value)),
        jnp.where(fits, margin, jnp.zeros_like(margin)),
        solved.residual,
        ChamberResult.where(fits, solved.result, ChamberResult.out_of_range),
    )


def _closed_form(
    chamber: Chamber, dimension: Dimension, ratio: Float[Array, ""]
) -> Solution[Float[Array, ""]]:
    def equation(unknown: Float[Array, ""]) -> Float[Array, ""]:
        wanted, found = ring_terms(_with(chamber, dimension, unknown), ratio)
        return wanted - found

    # Taylor's coefficients at 0 are the polynomial's own. In the wall angle the equation is
    # p cos θ + q sin θ = 0, that is p + q tan θ = 0, and the first two are p and q.
    slope = jax.jacfwd(equation)
    origin = jnp.zeros_like(ratio)
    if dimension in _QUADRATIC:
        roots, exist, discriminant = safe_quadratic_roots(
            jax.jacfwd(slope)(origin) / 2, slope(origin), equation(origin)
        )
        best = _preferred(chamber, dimension, roots, exist)
        root, exists = roots[best], exist[best]
    else:
        root, exists = safe_divide(-equation(origin), slope(origin))
        discriminant = origin
    answer = _with(chamber, dimension, root)
    image = answer.imaging_ratio()
    return Solution(
        jnp.arctan(root) if dimension == "wall_angle_bc" else root,
        jnp.where(exists, image.margin, discriminant),
        ring_residual(answer, ratio),
        ChamberResult.where(exists, image.result, ChamberResult.no_solution),
    )


def _preferred(
    chamber: Chamber, dimension: Dimension, roots: Float[Array, "2"], exist: Bool[Array, "2"]
) -> Int[Array, ""]:
    # A root that exists, of those one that can be built, of those the nearer one.
    margins = jax.vmap(lambda root: _with(chamber, dimension, root).imaging_ratio().margin)(roots)
    standing = jnp.where(exist, jnp.where(margins > 0, 0, 1), 2)
    distance = jnp.abs(roots - getattr(chamber, dimension))
    return jnp.argmin(jnp.where(standing == jnp.min(standing), distance, jnp.inf))


def _iterated(
    chamber: Chamber,
    dimension: Dimension,
    ratio: Float[Array, ""],
    method: RootMethod,
    bracket: tuple[ArrayLike, ArrayLike] | None,
    tolerance: ArrayLike,
) -> Solution[Float[Array, ""]]:
    def equation(value: Float[Array, ""], args: tuple[Chamber, Array, Array]) -> Float[Array, ""]:
        base, ratio, scale = args
        wanted, found = ring_terms(dataclasses.replace(base, **{dimension: value}), ratio)
        return (wanted - found) / scale

    wanted, found = ring_terms(chamber, ratio)
    size = jnp.abs(wanted) + jnp.abs(found)
    scale = jax.lax.stop_gradient(jnp.where(size > 0, size, 1.0))
    solved = find_root(
        equation,
        getattr(chamber, dimension),
        (chamber, ratio, scale),
        method=method,
        bracket=bracket,
        tolerance=tolerance,
    )
    image = dataclasses.replace(chamber, **{dimension: solved.value}).imaging_ratio()
    return Solution(
        solved.value,
        image.margin,
        solved.residual,
        ChamberResult.where(solved.ok, image.result, ChamberResult.not_converged),
    )


def _with(chamber: Chamber, dimension: Dimension, unknown: Float[Array, ""]) -> Chamber:
    # The unknown of the wall angle is its tangent.
    value = jnp.arctan(unknown) if dimension == "wall_angle_bc" else unknown
    return dataclasses.replace(chamber, **{dimension: value})
