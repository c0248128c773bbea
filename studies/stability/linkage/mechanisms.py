"""The linkages under test as batches of designs: every dimension and input an array."""

from __future__ import annotations

import functools
import tomllib
from collections.abc import Callable
from dataclasses import dataclass
from importlib.resources import files
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from kinematics import Linkage, parse_linkage, solve_poses
from studies.oracles import linkages as exact
from studies.oracles.six_bar import SixBar


@dataclass(frozen=True, eq=False)  # compared by identity, as arrays have no hash
class Mechanism:
    """A kind of linkage whose dimensions and input form one row of numbers.

    Attributes:
        name: in words.
        linkage: its structure; dimensions are replaced.
        leaves: the linkage's dimensions in the order of a row, whose last entry is the input.
        pins: the crank's pin, and the joint whose position is judged.
        formula: the independent answer.
        left: the library's sign of the assembly that the formula calls +1; 0 where it has none.
    """

    name: str
    linkage: Linkage
    leaves: Callable[[Linkage], tuple[Any, ...]]
    pins: tuple[str, str]
    formula: exact.Formula
    left: int

    def with_dimensions(self, linkage: Linkage, row: Float[Array, " inputs"]) -> Linkage:
        """The linkage with the dimensions of a row."""
        leaves = self.leaves(linkage)
        parts = jnp.split(row[:-1], np.cumsum([leaf.size for leaf in leaves[:-1]]))
        sized = [part.reshape(leaf.shape) for part, leaf in zip(parts, leaves, strict=True)]
        return eqx.tree_at(self.leaves, linkage, tuple(sized))

    def sketched_row(self) -> np.ndarray:
        """The row of the linkage as it was read."""
        leaves = (*self.leaves(self.linkage), self.linkage.reference.inputs)
        return np.concatenate([np.ravel(leaf) for leaf in leaves]).astype(float)


class Solved(NamedTuple):
    """The library's answers for a batch of cases, as NumPy arrays.

    Attributes:
        value: the judged pin, shape (cases, 2), mm.
        crank_pin: the crank's pin, shape (cases, 2), mm.
        residual: closure as the library has it, in units of size, shape (cases,).
        ok: verdicts.
        non_finite: how many numbers of the whole solution are not finite, gradient included.
        gradient: derivatives of the pin with respect to the whole row, shape (cases, 2, inputs).
    """

    value: np.ndarray
    crank_pin: np.ndarray
    residual: np.ndarray
    ok: np.ndarray
    non_finite: np.ndarray
    gradient: np.ndarray


def solve(mechanism: Mechanism, inputs: np.ndarray, sides: np.ndarray) -> Solved:
    """Solve a batch of designs, with gradients with respect to every dimension and the input.

    Args:
        mechanism: which.
        inputs: shape (cases, inputs), float32 or float64; decides the float type.
        sides: assembly of each case as the formula counts it, ±1, shape (cases,).
    """
    with jax.enable_x64(inputs.dtype == np.float64):
        gradient, parts = _program(mechanism)(inputs, sides.astype(inputs.dtype))
        solved = Solved._make(map(np.asarray, (*parts, gradient)))
    in_gradient = np.sum(~np.isfinite(solved.gradient), axis=(1, 2))
    return solved._replace(non_finite=solved.non_finite + in_gradient)


@functools.cache
def _program(mechanism: Mechanism) -> Callable[[Any, Any], Any]:
    # NumPy leaves take the float type of the row they meet.
    template = jax.tree.map(np.asarray, mechanism.linkage)
    crank_pin, last = mechanism.pins

    def position(row: Float[Array, " inputs"], side: Float[Array, ""]) -> tuple[Array, Any]:
        typed = jax.tree.map(lambda leaf: jnp.asarray(leaf, row.dtype), template)
        linkage = mechanism.with_dimensions(typed, row)
        # A triad is followed from its sketch: no sign chooses its assembly.
        signs = (mechanism.left * side)[None]
        solved = solve_poses(linkage, row[-1:], of=mechanism.pins, signs=signs)
        value = solved.value.position(last)
        numbers = jax.tree.leaves((solved.value, solved.margin, solved.residual))
        flaws = jnp.stack([jnp.sum(~jnp.isfinite(leaf)) for leaf in numbers]).sum()
        pin = solved.value.position(crank_pin)
        return value, (value, pin, solved.residual, solved.ok, flaws)

    return jax.jit(jax.vmap(jax.jacrev(position, has_aux=True)))


def _sketch(name: str) -> dict[str, Any]:
    path = files("studies") / "gallery" / "linkages" / f"{name}.toml"
    # Every crank is driven against the fixed axes.
    return tomllib.loads(path.read_text("utf-8")) | {"inputs": [{"name": "crank", "body": "crank"}]}


def _lengths(linkage: Linkage, *names: str) -> tuple[Any, ...]:
    return tuple(linkage.links[name].length for name in names)


@functools.cache
def four_bar() -> Mechanism:
    """A four-bar that is driven at its crank; its sketch has B to the left of A → O4."""
    linkage = parse_linkage(_sketch("four-bar"))

    def leaves(linkage: Linkage) -> tuple[Any, ...]:
        return (linkage.anchors, *_lengths(linkage, "crank", "coupler", "rocker"))

    pins, left = ("A", "B"), linkage.assembly[0]
    return Mechanism("four-bar", linkage, leaves, pins, exact.FOUR_BAR, left)


@functools.cache
def slider_crank() -> Mechanism:
    """A slider-crank on a fixed line; its sketch has C ahead of A along the line."""
    linkage = parse_linkage(_sketch("slider-crank"))

    def leaves(linkage: Linkage) -> tuple[Any, ...]:
        line = linkage.lines[0]
        return (linkage.anchors, *_lengths(linkage, "crank", "rod"), line.point, line.angle)

    pins, left = ("A", "C"), linkage.assembly[0]
    return Mechanism("slider-crank", linkage, leaves, pins, exact.SLIDER_CRANK, left)


@functools.cache
def six_bar() -> tuple[Mechanism, SixBar]:
    """The gallery's Stephenson six-bar, and its oracle."""
    data = _sketch("stephenson")
    linkage = parse_linkage(data)
    sketch = np.array([*data["joints"]["A"], *data["joints"]["B"]], float)
    oracle = SixBar(float(linkage.reference.inputs[0]), sketch)

    def leaves(linkage: Linkage) -> tuple[Any, ...]:
        lengths = _lengths(linkage, "left", "coupler", "right", "rod", "crank")
        return (linkage.anchors, *lengths[:2], linkage.links["coupler"].places, *lengths[2:])

    return Mechanism("six-bar triad", linkage, leaves, ("D", "P"), oracle.formula, 0), oracle
