"""What an engine says of a batch of scenes: every number of it, and gradients."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from designopt.solution import Solution
from optics.visibility.views import Pieces
from studies.stability.visibility.scenes import PADS, STRUCTURE, scene_of

Engine = Callable[..., Solution[Pieces]]
"""`optics.visibility.coverage.find_views`, or another that answers the same questions."""

BLOCK = 500
"""Scenes that are solved in one call: batches of any size are filled up to whole blocks."""

NUMBERS: tuple[str, ...] = (
    "coverage",
    "seen",
    "margin",
    "pixels",
    "px_per_mm",
    "distance",
    "spans",
)
OF_PIECES = NUMBERS[3:]
"""What an engine answers in numbers, the last of them for each piece."""

Weights = Mapping[str, float | np.ndarray]
"""What multiplies the numbers of a name in the sum whose gradient is asked for: those of coverage,
seen and margin singly, by arrays that broadcast to (scenes, ...); the others together."""


class Asked(NamedTuple):
    """An engine and the most reflections of a path: one compiled program."""

    engine: Engine
    bounces: int

    @property
    def shapes(self) -> dict[str, tuple[int, ...]]:
        """Shapes of the weights of one scene."""
        views = len(STRUCTURE.words(self.bounces)), PADS
        single = {"coverage": (PADS,), "seen": views, "margin": views}
        return {name: single.get(name, ()) for name in NUMBERS}


@dataclass(frozen=True)
class Answers:
    """The answers for a batch of scenes, as NumPy arrays.

    Attributes:
        numbers: by name, of shape (scenes, ...); ``seen`` and ``margin`` are (scenes, paths, pads),
            those of pieces (scenes, pads, pieces, ...).
        start: pad coordinates where the pieces begin, shape (scenes, pads, pieces).
        end: where they end.
        path: the paths that show them.
        present: which of them there are.
        ok: verdicts, shape (scenes, paths, pads).
        gradient: of the weighted sum, shape (scenes, inputs).
    """

    numbers: dict[str, np.ndarray]
    start: np.ndarray
    end: np.ndarray
    path: np.ndarray
    present: np.ndarray
    ok: np.ndarray
    gradient: np.ndarray

    @property
    def non_finite(self) -> np.ndarray:
        """How many numbers are not finite, those of the gradient included, shape (scenes,)."""
        arrays = (*self.numbers.values(), self.start, self.end, self.gradient)
        flaws = [np.sum(~np.isfinite(array.reshape(len(array), -1)), axis=1) for array in arrays]
        return np.sum(flaws, axis=0)

    def part(self, scenes: slice | np.ndarray) -> Answers:
        """Some of the scenes."""
        parts = {name: array[scenes] for name, array in self.numbers.items()}
        rest = (getattr(self, field.name)[scenes] for field in fields(self)[1:])
        return Answers(parts, *rest)

    def summed(self, weights: Weights) -> np.ndarray:
        """The weighted sum whose gradient was asked for, shape (scenes,)."""
        total = np.zeros(len(self.ok))
        for name, weight in weights.items():
            part = self.numbers[name]
            product = weight * uneven(name, part.shape[1:]) * part
            total += np.sum(product.reshape(len(total), -1), axis=1)
        return total


def uneven(name: str, shape: tuple[int, ...]) -> np.ndarray:
    """Factors by which the numbers of a scene go into a sum, so that no two faults cancel.

    All pieces of a pad count alike: two may begin at one point, and their order is rounding.
    """
    counted = (shape[0], 1, *shape[2:]) if name in OF_PIECES else shape
    return 1 + np.cos(np.arange(np.prod(counted))).reshape(counted) / 2


def ask(asked: Asked, rows: np.ndarray, weights: Weights | None = None) -> Answers:
    """Solve a batch of scenes.

    Args:
        asked: what is asked of which engine.
        rows: shape (scenes, inputs), float32 or float64; decides the float type.
        weights: of the sum whose gradient is asked for; by default 1 for all numbers.
    """
    given = dict.fromkeys(NUMBERS, 1.0) if weights is None else weights
    count = len(rows)
    filled = {
        name: np.broadcast_to(np.asarray(given.get(name, 0.0), rows.dtype), (count, *shape))
        for name, shape in asked.shapes.items()
    }
    blocks = []
    with jax.enable_x64(rows.dtype == np.float64):
        for start in range(0, count, BLOCK):
            # The last block is filled up with its last scene.
            chosen = np.minimum(np.arange(start, start + BLOCK), count - 1)
            block = jax.tree.map(lambda array, chosen=chosen: array[chosen], (rows, filled))
            blocks.append(jax.tree.map(np.asarray, _program(asked)(*block)))
    whole = jax.tree.map(lambda *parts: np.concatenate(parts)[:count], *blocks)
    return Answers(*whole)


@functools.cache
def _program(asked: Asked) -> Callable[..., tuple[Any, ...]]:
    paths = len(STRUCTURE.words(asked.bounces))

    def total(row: Float[Array, " inputs"], weights: dict[str, Array]) -> tuple[Array, Any]:
        found = asked.engine(scene_of(row, asked.bounces), row[:0])
        pieces = found.value
        numbers = {
            "coverage": pieces.coverage(),
            "seen": jnp.stack([pieces.seen(path) for path in range(paths)]),
            "margin": found.margin,
        }
        numbers |= {name: getattr(pieces, name) for name in OF_PIECES}
        sums = [
            jnp.sum(weights[name] * jnp.asarray(uneven(name, part.shape), row.dtype) * part)
            for name, part in numbers.items()
        ]
        return jnp.sum(jnp.stack(sums)), (numbers, pieces, found.ok)

    def answers(row: Float[Array, " inputs"], weights: dict[str, Array]) -> tuple[Any, ...]:
        gradient, (numbers, pieces, ok) = jax.grad(total, has_aux=True)(row, weights)
        return numbers, pieces.start, pieces.end, pieces.path, pieces.present, ok, gradient

    return jax.jit(jax.vmap(answers))
