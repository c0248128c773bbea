"""What several test modules need."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import jax
import numpy as np
import pytest

DATA = Path(__file__).parent / "data"
GALLERY = DATA.parents[1] / "studies/gallery"
SCENES = GALLERY / "scenes"


def marked(mark: str, *cases: Any) -> list[Any]:
    """Cases of a test that run where tests with a mark are selected."""
    return [pytest.param(case, marks=getattr(pytest.mark, mark)) for case in cases]


nightly = partial(marked, "nightly")
"""Cases that repeat others which run by default."""


def load_json(name: str) -> Any:
    return json.loads((DATA / name).read_text(encoding="utf-8"))


def load_toml(name: str) -> dict[str, Any]:
    return tomllib.loads((DATA / name).read_text(encoding="utf-8"))


def published_cases(name: str) -> dict[str, tuple[dict[str, Any], dict[str, Any], Any]]:
    """Inputs, expected numbers and tolerance of every published case in a file, by its id."""
    return {
        case["id"]: (case["inputs"], case["expected"], case["tolerance"])
        for case in load_json(name)["cases"]
    }


def close(found: Any, wanted: Any, tolerance: float) -> None:
    np.testing.assert_allclose(np.asarray(found), np.asarray(wanted), rtol=0, atol=tolerance)


def assert_same(found: Any, wanted: Any, rtol: float = 1e-13, atol: float = 1e-12) -> None:
    """Two pytrees of one structure: their numbers within rounding."""
    assert jax.tree.structure(found) == jax.tree.structure(wanted)
    for one, other in zip(jax.tree.leaves(found), jax.tree.leaves(wanted), strict=True):
        np.testing.assert_allclose(one, other, rtol=rtol, atol=atol)


def central_differences(function: Callable[..., Any], design: Any) -> list[float]:
    """Slope of a scalar function with respect to every leaf of a design, in the leaves' order.

    The step, the cube root of rounding times the leaf's size, balances truncation and rounding;
    what is left is a few 1e-10 of the function's scale.
    """
    leaves, structure = jax.tree.flatten(design)
    slopes = []
    for i, leaf in enumerate(leaves):
        step = np.finfo(float).eps ** (1 / 3) * max(1.0, abs(float(leaf)))
        moved = [[*leaves[:i], leaf + move, *leaves[i + 1 :]] for move in (step, -step)]
        ends = [float(function(jax.tree.unflatten(structure, one))) for one in moved]
        slopes.append((ends[0] - ends[1]) / (2 * step))
    return slopes


def check_gradients(
    function: Callable[..., Any], designs: Any, *, of_largest: float = 0.0, **tolerance: Any
) -> None:
    """Gradients of a scalar function, compiled and batched, are its central differences.

    Args:
        function: of a design.
        designs: a batch of them: all leaves have a first axis more.
        of_largest: what may be between the two, over the largest slope of a design.
        tolerance: or ``rtol`` and ``atol`` of `numpy.testing.assert_allclose`.
    """
    found = jax.tree.leaves(jax.jit(jax.vmap(jax.grad(function)))(designs))
    compiled = jax.jit(function)
    for index in range(len(found[0])):
        design = jax.tree.map(lambda leaf, index=index: leaf[index], designs)
        wanted = central_differences(compiled, design)
        if of_largest:
            tolerance["atol"] = of_largest * float(np.max(np.abs(wanted)))
        np.testing.assert_allclose([leaf[index] for leaf in found], wanted, **tolerance)
