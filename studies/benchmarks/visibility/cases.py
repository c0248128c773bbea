"""What is looked at: a finger that sees only parts of its pads, and the scenes of the gallery."""

from __future__ import annotations

import functools
import math
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from optics import parse_scene, read_scene
from optics.scene.scene import Scene

GALLERY = Path(__file__).parents[2] / "gallery" / "scenes"
NAMES = tuple(sorted(path.stem for path in GALLERY.glob("*.toml")))

FOV_DEG = 110.0
MIRROR_PART = 0.6
CABLE = {"name": "cable", "from": [9.0, 1.0], "to": [11.0, 1.5]}
POSE_DEG = {"pip": 75.0, "dip": 75.0}
FLEXION_POSES = 19
REACH_MM = 55.0
"""From the PIP axis to the finger's tip: an angle counts as the arc that it moves there."""


@functools.cache
def gallery(name: str) -> Scene:
    """A scene of the gallery."""
    return read_scene(GALLERY / f"{name}.toml")


def changed_finger(change: Callable[[dict[str, Any]], Any]) -> Scene:
    """Paper B's finger with a change to its file."""
    data = tomllib.loads((GALLERY / "finger.toml").read_text(encoding="utf-8"))
    change(data)
    return parse_scene(data, "finger")


@functools.cache
def spoilt_finger() -> Scene:
    """Paper B's finger, spoilt so that no pad is seen whole and every kind of edge occurs.

    Its lens is narrower, its mirrors are 60 % as long, and a cable hangs in the view.
    """

    def spoil(data: dict[str, Any]) -> None:
        data["camera"]["fov_deg"] = FOV_DEG
        for mirror in data["mirrors"]:
            ends = np.array([mirror["from"], mirror["to"]])
            middle = ends.mean(axis=0)
            mirror["from"], mirror["to"] = (middle + MIRROR_PART * (ends - middle)).tolist()
        data["blockers"].append(CABLE)

    return changed_finger(spoil)


def bent(scene: Scene) -> Float[Array, " joints"]:
    """The pose in which the spoilt finger is looked at, rad."""
    return scene.pose({name: math.radians(degrees) for name, degrees in POSE_DEG.items()})


def flexion(scene: Scene, poses: int = FLEXION_POSES) -> Float[Array, "poses joints"]:
    """Poses from straight to bent by a right angle in all joints, rad."""
    steps = jnp.deg2rad(jnp.linspace(0.0, 90.0, poses))
    return jnp.stack([steps] * len(scene.angle_names), axis=-1)


Parts = tuple[Array, Array, Array]
"""The mirrors' ends, and position and direction of the camera."""


def parts_of(scene: Scene) -> Any:  # `eqx.tree_at` calls it for no `Parts`
    """What gradients are taken with respect to."""
    return scene.mirrors, scene.camera.position, scene.camera.direction


def with_parts(scene: Scene, parts: Parts) -> Scene:
    """The scene with other `parts_of`."""
    return eqx.tree_at(parts_of, scene, parts)
