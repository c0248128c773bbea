"""The bare finger and its views; by plain NumPy its camera, images and rays in space."""

import dataclasses
import functools
from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from designopt.solution import Solution
from optics.scene.scene import Scene
from optics.visibility.coverage import find_views
from optics.visibility.unfolding import paths_of
from optics.visibility.views import Pieces, ViewResult, name_paths
from studies.models import bare_finger
from tests.optics.scenes import Posed, mirrored, pairs

Lens = Callable[[Any], Any]
"""Heights in focal lengths of rays at angles (rad) from the axis."""


@functools.cache
def finger() -> Scene:
    """The bare finger of the package."""
    return bare_finger().scene()


@functools.cache
def finned() -> Scene:
    """The same with a fin in place of the intermediate phalanx's shell, that hides a little."""
    fin = finger().blockers.at[2].set(jnp.array([[9.0, 0.0], [11.0, 2.0]]))
    return dataclasses.replace(finger(), blockers=fin)


POSES = np.radians([[0, 0], [45, 30], [90, 90], [60, 45], [20, 70]])
"""Poses of the finger; straight, bent and curled, whole and cut views by mirrors among them."""


LAYOUT = finger().layout
WORDS = dict(zip(name_paths(LAYOUT), paths_of(LAYOUT, LAYOUT.bounces), strict=True))
"""The mirrors along every path, by its name."""

MOST = 6


@functools.cache
def _compiled() -> Callable[..., Pieces]:
    # Without margins, which take most of the time to compile.
    return jax.jit(lambda scene, poses: find_views(scene, poses).value)


def views_at(poses: np.ndarray, scene: Scene | None = None) -> Solution[Pieces]:
    """What the finger's camera sees in up to `MOST` poses; margins and results mean nothing."""
    count = len(poses)
    # Always of one shape, so that it is compiled once.
    padded = np.concatenate([poses, np.zeros((MOST - count, 2))])
    found = _compiled()(scene or finger(), jnp.asarray(padded))
    pieces, none = jax.tree.map(lambda leaf: np.asarray(leaf)[:count], found), jnp.zeros(count)
    result = jax.tree.map(lambda code: jnp.full(count, code), ViewResult.successful)
    return Solution(pieces, none, none, result)


@functools.cache
def views_at_poses(*, fin: bool = False) -> Solution[Pieces]:
    """What is seen in `POSES`."""
    return views_at(POSES, finned() if fin else None)


def pieces_of(pieces: Pieces, pad: int, path: int | None = None) -> np.ndarray:
    """Where the pieces of a pad in one pose begin and end, by any path or by one."""
    chosen = pieces.present[pad]
    if path is not None:
        chosen = chosen & (pieces.path[pad] == path)
    return np.stack([pieces.start[pad], pieces.end[pad]], axis=-1)[chosen]


def direction_of(angle: Any, slope: Any) -> np.ndarray:
    """Unit vectors (forward, up, across) of rays of section angles and lateral slopes."""
    angle, slope = np.broadcast_arrays(angle, slope)
    arrows = np.stack([np.cos(angle), np.sin(angle), slope], axis=-1)
    return arrows / np.linalg.norm(arrows, axis=-1, keepdims=True)


def imaged(
    angle: Any, slope: Any, lens: Lens, half_view: float, rows: int, columns: int
) -> np.ndarray:
    """Column and row at which rays are imaged: the angle from the axis, and the way it leaves it.

    The middle of the image is the corner of four pixels whose own middles are whole numbers.
    """
    forward, up, across = np.moveaxis(direction_of(angle, slope), -1, 0)
    radius = rows / 2 / lens(half_view) * lens(np.arccos(forward))
    about = np.arctan2(up, across)
    return np.stack(
        [(columns - 1) / 2 + radius * np.cos(about), (rows - 1) / 2 - radius * np.sin(about)],
        axis=-1,
    )


def looked(places: np.ndarray, half_view: float, rows: int, columns: int) -> np.ndarray:
    """Section angle and lateral slope of what an equidistant lens images at places."""
    across = places[..., 0] - (columns - 1) / 2
    up = (rows - 1) / 2 - places[..., 1]
    theta = np.hypot(across, up) * 2 * half_view / rows
    about = np.arctan2(up, across)
    above, beside = np.sin(theta) * np.sin(about), np.sin(theta) * np.cos(about)
    forward = np.cos(theta)
    return np.stack([np.arctan2(above, forward), beside / np.hypot(forward, above)], axis=-1)


def unfolded(posed: Posed, word: Sequence[int], places: np.ndarray) -> np.ndarray:
    """Places behind the mirrors of a path as the camera sees them; all are complex numbers.

    The real axis is the camera's optical axis, the imaginary one is to the left of it.
    """
    for mirror in reversed(word):
        places = mirrored(places, posed.ends[mirror])
    return (places - posed.position) * np.exp(-1j * posed.direction)


def followed(
    posed: Posed, word: Sequence[int], pad: int, angle: float, slope: float, beside: float = 0.0
) -> np.ndarray:
    """Where a ray meets the plane of a pad, after the planes of mirrors: x, y and z, mm.

    The section is extruded along z; mirrors and pads go on beyond their ends.

    Args:
        posed: the section in a pose.
        word: the mirrors.
        pad: index of the pad among the pads.
        angle: of the ray in the section, from the optical axis, rad.
        slope: way along z per way in the section.
        beside: z of the camera, mm.
    """
    place = np.array([*pairs(posed.position), beside])
    ahead = direction_of(angle + posed.direction, slope)
    for surface in [*word, len(LAYOUT.mirrors) + pad]:
        (x0, y0), (x1, y1) = pairs(posed.ends[surface])
        normal = np.cross([x1 - x0, y1 - y0, 0.0], [0.0, 0.0, 1.0])
        normal /= np.linalg.norm(normal)
        place = place + ahead * ((np.array([x0, y0, 0.0]) - place) @ normal / (ahead @ normal))
        ahead = ahead - 2 * (ahead @ normal) * normal
    return place
