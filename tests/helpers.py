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
