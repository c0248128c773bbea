"""Paper B's finger with a fin that hides a little, and by hand where its parts are."""

from __future__ import annotations

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np

from designopt.solution import Solution
from optics.scene.scene import Scene, Surface
from optics.visibility.coverage import find_views
from optics.visibility.views import Pieces, ViewResult
from tests.optics import scenes

POSES = np.radians([[0.0, 0.0], [30.0, 20.0], [60.0, 45.0], [90.0, 90.0]])

MOST = 6

WORDS = {"direct": (), "mirror:distal": (0,), "mirror:proximal": (1,)}


def finger() -> Scene:
    """That of ``tests.optics.scenes`` with a fin for its shells and walls."""
    scene = scenes.finger()
    layout = dataclasses.replace(
        scene.layout, blockers=(Surface("camera body", 0), Surface("fin", 0))
    )
    blockers = jnp.stack([scene.blockers[0], jnp.array([[9.0, 0.0], [11.0, 2.0]])])
    return dataclasses.replace(scene, blockers=blockers, layout=layout)


LAYOUT = finger().layout


def surfaces(pip: float, dip: float) -> np.ndarray:
    """Ends of mirrors, then pads, as complex numbers, at joint angles in rad."""
    scene = finger()
    ends = np.concatenate([scene.mirrors, scene.pads])
    ends = ends[..., 0] + 1j * ends[..., 1]
    for part in (1, 2):
        ends[part] = ends[part] * np.exp(1j * pip)
    for part in (0, 4):
        ends[part] = 23 + (ends[part] - 23) * np.exp(-1j * dip)
    return ends


@functools.cache
def _compiled():
    # Without margins, which take most of the time to compile.
    return jax.jit(lambda scene, poses: find_views(scene, poses).value)


def views_at(poses: np.ndarray) -> Solution[Pieces]:
    """What is seen in poses; margins and results mean nothing."""
    count = len(poses)
    # Always of one shape, so that it is compiled once.
    padded = np.concatenate([poses, np.zeros((MOST - count, 2))])
    found = _compiled()(finger(), jnp.asarray(padded))
    pieces, none = jax.tree.map(lambda leaf: leaf[:count], found), jnp.zeros(count)
    result = jax.tree.map(lambda code: jnp.full(count, code), ViewResult.successful)
    return Solution(pieces, none, none, result)


@functools.cache
def finger_views() -> Solution[Pieces]:
    """What is seen in `POSES`."""
    return views_at(POSES)


def at(views: Solution[Pieces], index: int) -> Solution[Pieces]:
    return jax.tree.map(lambda leaf: leaf[index], views)


def intervals(views: Solution[Pieces], pad: int, path: int | None = None) -> np.ndarray:
    """Pieces of a pad in one pose, by any path or by one, shape (pieces, 2)."""
    view = views.value
    chosen = np.asarray(view.present)[pad]
    if path is not None:
        chosen = chosen & (np.asarray(view.path)[pad] == path)
    return np.stack([np.asarray(view.start)[pad], np.asarray(view.end)[pad]], axis=-1)[chosen]
