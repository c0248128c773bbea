"""All scenes of the study as rows of numbers of one layout, and the library's answers for them.

One layout for all means one program for all: what a scene lacks is in it with zero length.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from designopt.batching import map_blocks
from optics.scene.camera import Camera, Equidistant
from optics.scene.scene import WORLD, Layout, Scene, Surface
from optics.visibility.coverage import find_views
from studies.oracles.extreme_scenes import STRUCTURE

MIRRORS, PADS, SURFACES = STRUCTURE.mirrors, STRUCTURE.pads, len(STRUCTURE.sides)
CAMERA = STRUCTURE.camera

PIXELS = 1000.0
"""Along the image line of every camera."""

BLOCK = 500
"""Scenes that are solved in one call: batches of any size are filled up to whole blocks."""

OF_PIECES = ("pixels", "px_per_mm", "distance", "spans")
NUMBERS: tuple[str, ...] = ("coverage", "seen", "margin", *OF_PIECES)
"""The answers in numbers, the last of them for each piece."""

Weights = Mapping[str, Any]
"""What multiplies the numbers of a name in the sum whose gradient is asked for: those of coverage,
seen and margin singly, by arrays that broadcast to (scenes, ...); the others together."""


def random_rows(count: int, seed: int) -> np.ndarray:
    """Scenes of size 2 with segments 0.2 to 1.6 long, any field of view up to a full turn."""
    random = np.random.default_rng(seed)
    middle = random.uniform(-1, 1, (count, SURFACES, 1, 2))
    turn = random.uniform(-np.pi, np.pi, (count, SURFACES, 1))
    half = random.uniform(0.1, 0.8, (count, SURFACES, 1, 1)) * np.stack(
        [np.cos(turn), np.sin(turn)], axis=-1
    )
    ends = np.concatenate([middle - half, middle + half], axis=2)
    camera = (
        random.uniform(-1, 1, (count, 2)),
        random.uniform(-np.pi, np.pi, (count, 1)),
        random.uniform(0.5, 2 * np.pi, (count, 1)),
        random.uniform(0.01, 0.2, (count, PADS)),
    )
    return np.concatenate([ends.reshape(count, -1), *camera], axis=1)


def scene_of(row: Float[Array, " inputs"], bounces: int) -> Scene:
    """The scene that a row describes."""
    parts = tuple(map(Surface, STRUCTURE.names, STRUCTURE.sides))
    mirrors, pads, blockers = parts[:MIRRORS], parts[MIRRORS:][:PADS], parts[MIRRORS + PADS :]
    layout = Layout("random", mirrors, (), pads, blockers, (), (), WORLD, bounces)
    ends, none = row[: CAMERA.start].reshape(SURFACES, 2, 2), row[:0]
    position, direction, field_of_view = row[CAMERA], row[CAMERA.stop], row[CAMERA.stop + 1]
    pixels = jnp.full_like(row[0], PIXELS)
    return Scene(
        camera=Camera(position, direction, field_of_view, pixels, Equidistant()),
        mirrors=ends[:MIRRORS],
        radii=none,
        conics=none,
        pads=ends[MIRRORS:][:PADS],
        grazing=row[CAMERA.stop + 2 :],
        blockers=ends[MIRRORS + PADS :],
        hinges=none.reshape(0, 2),
        layout=layout,
    )


class Answers(NamedTuple):
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

    def part(self, scenes: Any) -> Answers:
        """Some of the scenes."""
        return jax.tree.map(lambda array: array[scenes], self)

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


def ask(bounces: int, rows: np.ndarray, weights: Weights | None = None) -> Answers:
    """Solve a batch of scenes.

    Args:
        bounces: most reflections of a path.
        rows: shape (scenes, inputs), float32 or float64; decides the float type.
        weights: of the sum whose gradient is asked for; by default 1 for all numbers.
    """
    given = dict.fromkeys(NUMBERS, 1.0) if weights is None else weights
    views, count = (len(STRUCTURE.words(bounces)), PADS), len(rows)
    shapes = {"coverage": (PADS,), "seen": views, "margin": views}
    filled = {
        name: np.broadcast_to(
            np.asarray(given.get(name, 0.0), rows.dtype), (count, *shapes.get(name, ()))
        )
        for name in NUMBERS
    }
    with jax.enable_x64(rows.dtype == np.float64):
        return map_blocks(_program(bounces), BLOCK, rows, filled)


@functools.cache
def _program(bounces: int) -> Callable[..., Answers]:
    paths = len(STRUCTURE.words(bounces))

    def total(row: Float[Array, " inputs"], weights: dict[str, Array]) -> tuple[Array, Any]:
        found = find_views(scene_of(row, bounces), row[:0])
        pieces = found.value
        seen = jnp.stack([pieces.seen(path) for path in range(paths)])
        numbers = {"coverage": pieces.coverage(), "seen": seen, "margin": found.margin}
        numbers |= {name: getattr(pieces, name) for name in OF_PIECES}
        sums = [
            jnp.sum(weights[name] * jnp.asarray(uneven(name, part.shape), row.dtype) * part)
            for name, part in numbers.items()
        ]
        parts = (numbers, pieces.start, pieces.end, pieces.path, pieces.present, found.ok)
        return jnp.sum(jnp.stack(sums)), parts

    def answers(row: Float[Array, " inputs"], weights: dict[str, Array]) -> Any:
        gradient, parts = jax.grad(total, has_aux=True)(row, weights)
        return Answers._make((*parts, gradient))

    return jax.jit(jax.vmap(answers))
