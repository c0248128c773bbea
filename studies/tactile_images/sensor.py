"""The finger as its image analysis must know it: what the optics predict, handed to perception."""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from optics.imaging import Imaging
from optics.outlines import find_corners, find_outlines
from optics.scene import Scene
from optics.unfolding import paths_of
from optics.views import Pieces, path_names
from optics.visibility import find_views
from perception.lens import Lens, Places, Rays
from perception.matching import Catalogue, Family

ANGLES = np.deg2rad(np.linspace(-5.0, 95.0, 101))
"""Values of every joint in the catalogue: every degree of the range, and a little beyond."""

WHOLE = 1e-6
"""What is seen but for this part of a pad is all of it: rounding."""


def lens_of(imaging: Imaging) -> Lens:
    """The camera's rays for the analysis of its images."""

    @eqx.filter_jit
    def place(rays: Float[Array, "_ 2"]) -> Float[Array, "_ 2"]:
        return imaging.place(rays[:, 0], rays[:, 1])

    def project(rays: Rays) -> Places:
        return np.asarray(place(jnp.asarray(rays)))

    return Lens(np.ascontiguousarray(imaging.ray_map()), project)


def catalogue_of(scene: Scene, imaging: Imaging, width: float) -> Catalogue:
    """Every view that the finger can show, for all values of the joint that moves it.

    Wanted are those of every pad that moves against the camera, directly and in the mirror of its
    own phalanx, and those of other pads directly.
    """
    layout, joints = scene.layout, len(scene.angle_names)
    poses = np.zeros((joints, len(ANGLES), joints))
    for joint in range(joints):
        poses[joint, :, joint] = ANGLES
    corners, seen = _looked_at(scene, imaging, jnp.asarray(poses), width)
    families = []
    names, words = path_names(layout), paths_of(layout, layout.bounces)
    for path, word in enumerate(words):
        for pad, surface in enumerate(layout.pads):
            if not (seen[..., path, pad] > 0).any():
                continue
            moved = [j for j in range(joints) if np.ptp(corners[j, :, path, pad], axis=0).max() > 1e-6]
            own = all(layout.mirrors[mirror].frame == surface.frame for mirror in word)
            if len(moved) > 1 and own:
                raise ValueError(
                    f"the view of pad '{surface.name}' by {names[path]} moves with several joints; "
                    "a catalogue holds views that one joint moves"
                )
            if len(moved) > 1:
                continue
            joint = moved[0] if moved else 0
            values = slice(None) if moved else slice(0, 1)
            share = seen[joint, values, path, pad]
            families.append(
                Family(
                    surface.name,
                    names[path],
                    len(word),
                    joint if moved else None,
                    ANGLES[values],
                    corners[joint, values, path, pad],
                    share > 0,
                    share >= 1 - WHOLE,
                    own,
                )
            )
    ends = np.asarray(scene.pads)
    lengths = np.hypot(*(ends[:, 1] - ends[:, 0]).T)
    by_name = {pad.name: float(n) for pad, n in zip(layout.pads, lengths, strict=True)}
    return Catalogue(families, by_name, width, joints)


def _looked_at(
    scene: Scene, imaging: Imaging, poses: Float[Array, "joints values joints"], width: float
) -> tuple[np.ndarray, np.ndarray]:
    """Corners, and the part of the pad that is seen, of every pose, path and pad."""
    corners = eqx.filter_jit(
        jax.vmap(jax.vmap(lambda pose: find_corners(imaging, find_outlines(scene, pose), width)))
    )(poses)
    pieces: Pieces = find_views(scene, poses).value
    paths = range(len(paths_of(scene.layout, scene.layout.bounces)))
    seen = np.stack([np.asarray(pieces.seen(path)) for path in paths], axis=-2)
    return np.asarray(corners), seen
