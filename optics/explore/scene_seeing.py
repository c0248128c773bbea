"""What of a scene's pads is seen as it stands, fast enough to follow a slider."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from designopt.solution import Solution
from optics.explore.scene_knobs import Dimensions, apply_parameters
from optics.scene.scene import Scene
from optics.visibility.coverage import find_coverage, find_views
from optics.visibility.edge_refined import trace_views
from optics.visibility.remarks import ROUNDING as WHOLE
from optics.visibility.remarks import remarks_on
from optics.visibility.scene_trace import SceneTrace, Views
from optics.visibility.sharpness import ROUNDING, Sharpness, find_sharpness
from optics.visibility.unfolding import paths_of
from optics.visibility.views import Pieces, name_paths

QUICK = {"xla_cpu_use_fusion_emitters": False}
"""Has XLA make code for the CPU in another way, which takes a fraction of the time and runs as
fast."""

ROOM = 8
"""Pieces of a pad of which resolution is asked; more only where there are more."""


@dataclass(frozen=True)
class Seen:
    """What is seen in one pose.

    Attributes:
        views: the pieces, unbatched.
        coverage: part of each pad that is seen.
        px_per_mm: least, median and greatest resolution of what is seen of each pad; 0 where
            nothing is.
        missed_by: angle (rad) by which each hidden pad is missed; NaN of pads that are seen, and
            where rays do not tell.
        remarks: of every pad that is not all seen, with the worst one first: what is missing, and
            why.
    """

    views: Solution[Pieces]
    coverage: Float[np.ndarray, " pads"]
    px_per_mm: Float[np.ndarray, "pads 3"]
    missed_by: Float[np.ndarray, " pads"]
    remarks: tuple[tuple[str, str], ...]


def look_at(scene: Scene, angles: Float[np.ndarray, " joints"]) -> Seen:
    """What is seen of a scene with pads at joint angles in rad."""
    found, coverage, redundancy = _quickly(_views)(scene, angles)
    views, coverage, redundancy = jax.tree.map(np.asarray, (found, coverage, redundancy))
    several = jax.tree.map(lambda leaf: leaf[None], views)
    bounces = scene.layout.bounces
    sharpness = sharpness_of(scene, angles[None], several.value)
    codes = jax.tree.leaves(several.result)[0]
    sight = SceneTrace(
        scene,
        bounces,
        name_paths(scene.layout, bounces),
        paths_of(scene.layout, bounces),
        np.degrees(angles)[None],
        Views(several, codes, coverage[None], redundancy[None], sharpness, None),
        None,
        np.zeros((0, 3)),
        None,
    )
    hidden = (coverage == 0) & (len(scene.layout.curved) == 0)
    missed_by = np.where(hidden, -np.max(views.margin, axis=0), np.nan)
    return Seen(views, coverage, sharpness.px_per_mm[0], missed_by, _remarks(sight, coverage))


def sharpness_of(
    scene: Scene, angles: Float[np.ndarray, "poses joints"], pieces: Pieces
) -> Sharpness:
    """Resolution of what is seen in several poses, at joint angles in rad."""
    room = pieces.present.shape[-1]
    # All pieces that there are come first.
    most = int(np.max(np.sum(np.asarray(pieces.present), axis=-1), initial=0))
    room = min(ROOM, room) if most <= ROOM else room
    pieces = jax.tree.map(lambda leaf: np.asarray(leaf)[:, :, :room], pieces)
    return find_sharpness(scene, angles, pieces, bounces=scene.layout.bounces)


def coverage_over(
    scene: Scene, dimensions: Dimensions, angles: Float[np.ndarray, "states joints"]
) -> Float[np.ndarray, "states pads"]:
    """Part of each pad that is seen in several states of a scene of straight mirrors.

    Args:
        scene: the scene.
        dimensions: of every state, along a first axis.
        angles: joint angles of every state, rad.
    """
    return np.asarray(_quickly(_coverage)(scene, dimensions, angles))


def _views(
    scene: Scene, angles: Float[Array, " joints"]
) -> tuple[Solution[Pieces], Float[Array, " pads"], Float[Array, " pads"]]:
    found = (trace_views if scene.layout.curved else find_views)(scene, angles)
    coverage = found.value.coverage()
    return found, jnp.where(coverage > ROUNDING, coverage, 0.0), found.value.redundancy()


def _coverage(
    scene: Scene, dimensions: Dimensions, angles: Float[Array, "states joints"]
) -> Float[Array, "states pads"]:
    def one(state: tuple[Dimensions, Float[Array, " joints"]]) -> Float[Array, " pads"]:
        return find_coverage(apply_parameters(scene, state[0]), state[1]).value

    # One state after the other: all together would leave the cache.
    return jax.lax.map(one, (dimensions, angles))


def _remarks(
    sight: SceneTrace, coverage: Float[np.ndarray, " pads"]
) -> tuple[tuple[str, str], ...]:
    """Pairs of lines from `remarks_on`, of the least covered pad first."""
    lines = remarks_on(sight)
    pairs = [(what, why.strip()) for what, why in pairwise(lines) if why.startswith(" ")]
    order = np.argsort(coverage[coverage < 1 - WHOLE], kind="stable")
    return tuple(pairs[index] for index in order)


@functools.cache
def _quickly(function: Callable[..., Any]) -> Callable[..., Any]:
    """A function, compiled once for every structure of its arguments."""
    return jax.jit(function, compiler_options=_known_options())


@functools.cache
def _known_options() -> dict[str, Any]:
    """`QUICK`, unless this version of XLA does not know it."""
    try:
        jax.jit(jnp.negative, compiler_options=QUICK)(0.0)
    except jax.errors.JaxRuntimeError:
        return {}
    return QUICK
