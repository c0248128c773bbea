"""What the finger's structure makes unnecessary."""

from __future__ import annotations

import jax.numpy as jnp

from designopt.study.left_out import count_operations
from designopt.study.results import LeftOutRow
from optics.scene.scene import Scene
from optics.visibility.coverage import find_coverage


def operations(scene: Scene) -> list[LeftOutRow]:
    """Operation counts of programs that leave something out, beside those that need it."""
    poses = jnp.zeros((1, 2))

    def coverage(bounces: int) -> int:
        return count_operations(
            lambda scene, poses: find_coverage(scene, poses, bounces=bounces).value, scene, poses
        )

    return [
        LeftOutRow(
            "coverage of all pads by one reflection",
            "paths over both mirrors: outer pads show in their own mirror, the middle one directly",
            coverage(1),
            coverage(2),
        ),
    ]
