"""Paper B's finger with a fin that hides a little, and by hand where its parts are."""

from __future__ import annotations

import functools

import jax
import jax.numpy as jnp
import numpy as np

from designopt.solution import Solution
from optics.scene.camera import Camera, Equidistant
from optics.scene.scene import Frame, Layout, Scene, Surface
from optics.visibility.coverage import find_views
from optics.visibility.views import Pieces, ViewResult

POSES = np.radians([[0.0, 0.0], [30.0, 20.0], [60.0, 45.0], [90.0, 90.0]])

MOST = 6

LAYOUT = Layout(
    name="finger",
    mirrors=(Surface("distal", -1, 1), Surface("proximal", 1, 0)),
    curved=(),
    pads=(Surface("proximal", 1, 0), Surface("intermediate", 1), Surface("distal", 1, 1)),
    blockers=(Surface("camera body", 0), Surface("fin", 0)),
    frames=(Frame("proximal", -1, 0, 1), Frame("distal", -1, 1, -1)),
    angles=("pip", "dip"),
    camera_frame=-1,
    bounces=1,
)
WORDS = {"direct": (), "mirror:distal": (0,), "mirror:proximal": (1,)}


def finger() -> Scene:
    return Scene(
        camera=Camera(
            jnp.array([15.75, 16.99]), np.radians(-96.3), np.radians(160), 1080.0, Equidistant()
        ),
        mirrors=jnp.array([[[23.24, 19.04], [53.81, 0.34]], [[4.16, 18.5], [-28.35, 9.3]]]),
        radii=jnp.zeros(0),
        conics=jnp.zeros(0),
        pads=jnp.array(
            [
                [[-33.5, -4.0], [-4.0, -4.0]],
                [[4.0, -4.0], [19.0, -4.0]],
                [[27.0, -4.0], [53.5, -4.0]],
            ]
        ),
        grazing=jnp.full(3, np.radians(2)),
        blockers=jnp.array([[[11.8, 17.9], [19.7, 17.0]], [[9.0, 0.0], [11.0, 2.0]]]),
        hinges=jnp.array([[0.0, 0.0], [23.0, 0.0]]),
        layout=LAYOUT,
    )


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
