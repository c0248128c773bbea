"""What several test modules need."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import numpy as np

DATA = Path(__file__).parent / "data"


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


def readings(shown: Any) -> dict[str, Any]:
    """Values that a bench shows, by name."""
    return {reading.name: reading.value for reading in shown.readings}


def central_differences(function: Callable[..., Any], design: Any) -> list[float]:
    """Slope of a scalar function with respect to every leaf of a design, in the leaves' order.

    The step, the cube root of rounding times the leaf's size, balances truncation and rounding;
    what is left is a few 1e-10 of the function's scale.
    """
    leaves, structure = jax.tree.flatten(design)
    slopes = []
    for i, leaf in enumerate(leaves):
        step = np.finfo(float).eps ** (1 / 3) * max(1.0, abs(float(leaf)))
        ends = [
            float(
                function(
                    jax.tree.unflatten(structure, [*leaves[:i], leaf + move, *leaves[i + 1 :]])
                )
            )
            for move in (step, -step)
        ]
        slopes.append((ends[0] - ends[1]) / (2 * step))
    return slopes


def slopes_and_differences(function: Callable[..., Any], designs: Any) -> tuple[Any, Any]:
    """Slopes of a scalar function of several designs with respect to every leaf, found twice.

    Args:
        function: of one design.
        designs: the designs along the leaves' only axis.

    Returns:
        Derivatives, and `central_differences` from values of the same program: compiling it is
        most of the time. Both are of the shape (designs, leaves).
    """
    leaves, structure = jax.tree.flatten(designs)
    at = np.stack([np.asarray(leaf, float) for leaf in leaves], axis=-1)
    steps = np.finfo(float).eps ** (1 / 3) * np.maximum(1.0, np.abs(at))
    moves = steps[:, None] * np.eye(len(leaves))
    beside = np.concatenate([np.zeros_like(steps)[:, None], moves, -moves], axis=1)

    def both(numbers: jax.Array) -> tuple[jax.Array, Any]:
        return jax.value_and_grad(function)(jax.tree.unflatten(structure, [*numbers]))

    rows = at[:, None] + beside
    values, slopes = jax.jit(jax.vmap(both))(rows.reshape(-1, len(leaves)))
    ahead, behind = np.split(np.reshape(values, rows.shape[:2])[:, 1:], 2, axis=1)
    found = np.stack(jax.tree.leaves(slopes), axis=-1).reshape(rows.shape)[:, 0]
    return found, (ahead - behind) / (2 * steps)
