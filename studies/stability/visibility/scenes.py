"""All scenes of the study as rows of numbers of one layout, and the library's answers for them.

One layout for all means one program for all: what a scene lacks is in it with zero length.
"""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from optics.scene.camera import Camera, Equidistant
from optics.scene.scene import WORLD, Layout, Scene, Surface
from studies.oracles.rays import Fans, Structure

STRUCTURE = Structure(mirrors=3, pads=2, sides=(1, 0, -1, 1, 0, 0, 1, -1, 0))
MIRRORS, PADS, SURFACES = STRUCTURE.mirrors, STRUCTURE.pads, len(STRUCTURE.sides)
NAMES: tuple[str, ...] = ("m0", "m1", "m2", "p0", "p1", "b0", "b1", "b2", "b3")
"""The surfaces, in their order."""

CAMERA = slice(4 * SURFACES, 4 * SURFACES + 2)
DIRECTION, FIELD_OF_VIEW = CAMERA.stop, CAMERA.stop + 1
GRAZING = slice(FIELD_OF_VIEW + 1, FIELD_OF_VIEW + 1 + PADS)
INPUTS = GRAZING.stop
"""A row: ends of all surfaces, camera position, direction, field of view, least grazing angles."""

PIXELS = 1000.0
"""Along the image line of every camera."""


def layout(bounces: int) -> Layout:
    """The layout of every scene."""
    parts = tuple(map(Surface, NAMES, STRUCTURE.sides))
    after = MIRRORS + PADS
    return Layout(
        "random", parts[:MIRRORS], (), parts[MIRRORS:after], parts[after:], (), (), WORLD, bounces
    )


def scene_of(row: Float[Array, " inputs"], bounces: int) -> Scene:
    """The scene that a row describes."""
    ends, none = row[: CAMERA.start].reshape(SURFACES, 2, 2), row[:0]
    camera = Camera(
        row[CAMERA],
        row[DIRECTION],
        row[FIELD_OF_VIEW],
        jnp.full_like(row[0], PIXELS),
        Equidistant(),
    )
    return Scene(
        camera=camera,
        mirrors=ends[:MIRRORS],
        radii=none,
        conics=none,
        pads=ends[MIRRORS : MIRRORS + PADS],
        grazing=row[GRAZING],
        blockers=ends[MIRRORS + PADS :],
        hinges=none.reshape(0, 2),
        layout=layout(bounces),
    )


def fans_of(rows: np.ndarray) -> Fans:
    """The same scenes for the brute force."""
    return Fans(
        rows[:, : CAMERA.start].reshape(-1, SURFACES, 2, 2),
        rows[:, CAMERA],
        rows[:, DIRECTION],
        rows[:, FIELD_OF_VIEW],
        rows[:, GRAZING],
    )


def random_rows(count: int, seed: int) -> np.ndarray:
    """Scenes of size 2 with segments 0.2 to 1.6 long, any field of view up to a full turn."""
    random = np.random.default_rng(seed)
    middle = random.uniform(-1, 1, (count, SURFACES, 1, 2))
    turn = random.uniform(-np.pi, np.pi, (count, SURFACES, 1))
    half = random.uniform(0.1, 0.8, (count, SURFACES, 1, 1)) * np.stack(
        [np.cos(turn), np.sin(turn)], axis=-1
    )
    ends = np.concatenate([middle - half, middle + half], axis=2)
    return np.concatenate(
        [
            ends.reshape(count, -1),
            random.uniform(-1, 1, (count, 2)),
            random.uniform(-np.pi, np.pi, (count, 1)),
            random.uniform(0.5, 2 * np.pi, (count, 1)),
            random.uniform(0.01, 0.2, (count, PADS)),
        ],
        axis=1,
    )
