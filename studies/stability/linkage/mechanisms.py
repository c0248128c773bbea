"""The linkages under test as batches of designs: every dimension and input an array."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from kinematics import Linkage, parse_linkage, solve_poses
from studies.oracles import linkages as exact


@dataclass(frozen=True, eq=False)  # compared by identity, as arrays have no hash
class Mechanism:
    """A kind of linkage whose dimensions and input form one row of numbers.

    Attributes:
        name: in words.
        inputs: names of the entries of a row; the last is the driven one.
        linkage: its structure; dimensions are replaced.
        dimensioned: the linkage with the dimensions of a row.
        pins: the joints of interest; the last is the one whose position is judged.
        formula: the independent answer.
        gaps: how far given pins miss the dimensions, independently.
        left: the library's sign of the assembly that the formula calls +1; 0 where it has none.
        coordinates: where in a row the x and y of fixed points are, the first fixed joint first.
        closed_form: whether the formula works in any arithmetic; otherwise in mpmath numbers only.
    """

    name: str
    inputs: tuple[str, ...]
    linkage: Linkage
    dimensioned: Callable[[Linkage, Any], Linkage]
    pins: tuple[str, str]
    formula: Callable[[exact.Arithmetic, np.ndarray, np.ndarray], exact.Exact]
    gaps: Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]
    left: int
    coordinates: tuple[list[int], ...]
    closed_form: bool = True

    def own_sizes(self, rows: np.ndarray) -> np.ndarray:
        """What every entry of a row amounts to, coordinates counted from the first fixed joint.

        Args:
            rows: shape (cases, inputs).
        """
        own = rows.copy()
        for pair in self.coordinates:
            own[:, pair] = rows[:, pair] - rows[:, self.coordinates[0]]
        return abs(own)


class Solved(NamedTuple):
    """The library's answers for a batch of cases, as NumPy arrays.

    Attributes:
        value: the judged pin, shape (cases, 2), mm.
        gradient: its derivatives with respect to the whole row, shape (cases, 2, inputs).
        crank_pin: the crank's pin, shape (cases, 2), mm.
        residual: closure as the library has it, in units of size, shape (cases,).
        ok: verdicts.
        non_finite: how many numbers of the whole solution are not finite, gradient included.
    """

    value: np.ndarray
    gradient: np.ndarray
    crank_pin: np.ndarray
    residual: np.ndarray
    ok: np.ndarray
    non_finite: np.ndarray


def solve(mechanism: Mechanism, inputs: np.ndarray, sides: np.ndarray) -> Solved:
    """Solve a batch of designs, with gradients with respect to every dimension and the input.

    Args:
        mechanism: which.
        inputs: shape (cases, inputs), float32 or float64; decides the float type.
        sides: assembly of each case as the formula counts it, ±1, shape (cases,).
    """
    with jax.enable_x64(inputs.dtype == np.float64):
        gradient, rest = _program(mechanism)(inputs, sides.astype(inputs.dtype))
        value, crank_pin, residual, ok, non_finite = map(np.asarray, rest)
        gradient = np.asarray(gradient)
    in_gradient = np.sum(~np.isfinite(gradient), axis=(1, 2))
    return Solved(value, gradient, crank_pin, residual, ok, non_finite + in_gradient)


@functools.cache
def _program(mechanism: Mechanism) -> Callable[[Any, Any], Any]:
    # NumPy leaves take the float type of the row they meet.
    template = jax.tree.map(np.asarray, mechanism.linkage)
    crank_pin, last = mechanism.pins

    def position(row: Float[Array, " inputs"], side: Float[Array, ""]) -> tuple[Array, Any]:
        typed = jax.tree.map(lambda leaf: jnp.asarray(leaf, row.dtype), template)
        linkage = mechanism.dimensioned(typed, row)
        # A triad is followed from its sketch: no sign chooses its assembly.
        signs = (mechanism.left * side)[None]
        solved = solve_poses(linkage, row[-1:], of=mechanism.pins, signs=signs)
        value = solved.value.position(last)
        numbers = jax.tree.leaves((solved.value, solved.margin, solved.residual))
        flaws = jnp.stack([jnp.sum(~jnp.isfinite(leaf)) for leaf in numbers]).sum()
        pin = solved.value.position(crank_pin)
        return value, (value, pin, solved.residual, solved.ok, flaws)

    return jax.jit(jax.vmap(jax.jacrev(position, has_aux=True)))


def four_bar() -> Mechanism:
    """A four-bar that is driven at its crank, against the fixed axes."""
    linkage = parse_linkage(
        {
            "joints": {"O2": (0, 0), "A": (30, 26), "B": (143, 67), "O4": (100, 0)},
            "bodies": {
                "ground": {"joints": ["O2", "O4"], "fixed": True},
                "crank": {"joints": ["O2", "A"]},
                "coupler": {"joints": ["A", "B"]},
                "rocker": {"joints": ["O4", "B"]},
            },
            "inputs": [{"name": "crank", "body": "crank"}],
        }
    )

    def dimensioned(linkage: Linkage, row: Float[Array, " inputs"]) -> Linkage:
        return eqx.tree_at(
            lambda linkage: (
                linkage.anchors,
                *(linkage.links[name].length for name in ("crank", "coupler", "rocker")),
            ),
            linkage,
            (row[:4].reshape(2, 2), row[4], row[5], row[6]),
        )

    # The sketch has B to the left of A → O4.
    return Mechanism(
        "four-bar",
        exact.FOUR_BAR,
        linkage,
        dimensioned,
        ("A", "B"),
        exact.four_bar,
        exact.four_bar_gaps,
        linkage.assembly[0],
        ([0, 1], [2, 3]),
    )


def slider_crank() -> Mechanism:
    """A slider-crank whose end slides along a fixed line, driven at its crank."""
    linkage = parse_linkage(
        {
            "joints": {"O2": (0, 0), "A": (20, 35), "C": (127, -20)},
            "bodies": {
                "ground": {"joints": ["O2"], "fixed": True},
                "crank": {"joints": ["O2", "A"]},
                "rod": {"joints": ["A", "C"]},
            },
            "sliders": [{"joint": "C", "on": "ground", "line": ((0, -20), (1, -20))}],
            "inputs": [{"name": "crank", "body": "crank"}],
        }
    )

    def dimensioned(linkage: Linkage, row: Float[Array, " inputs"]) -> Linkage:
        return eqx.tree_at(
            lambda linkage: (
                linkage.anchors,
                linkage.links["crank"].length,
                linkage.links["rod"].length,
                linkage.lines[0].point,
                linkage.lines[0].angle,
            ),
            linkage,
            (row[None, :2], row[2], row[3], row[4:6], row[6]),
        )

    # The sketch has C ahead of A along the line.
    return Mechanism(
        "slider-crank",
        exact.SLIDER_CRANK,
        linkage,
        dimensioned,
        ("A", "C"),
        exact.slider_crank,
        exact.slider_crank_gaps,
        linkage.assembly[0],
        ([0, 1], [4, 5]),
    )
