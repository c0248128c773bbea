"""What the finger's structure makes unnecessary."""

from __future__ import annotations

import jax.numpy as jnp

from designopt.left_out import count_operations
from designopt.results import LeftOutRow
from optics.scene import Scene
from optics.visibility import find_coverage, find_views


def operations(scene: Scene) -> list[LeftOutRow]:
    """Operation counts of programs that leave something out, beside those that need it."""
    poses = jnp.zeros((1, 2))

    def coverage(bounces: int) -> int:
        return count_operations(
            lambda scene, poses: find_coverage(scene, poses, bounces=bounces).value, scene, poses
        )

    once = coverage(1)
    views = count_operations(lambda scene, poses: find_views(scene, poses), scene, poses)
    return [
        LeftOutRow(
            "coverage of all pads by one reflection",
            "paths over both mirrors: outer pads show in their own mirror, the middle one directly",
            once,
            coverage(2),
        ),
        LeftOutRow(
            "coverage of the copies with errors",
            "places, pixels and margins of views: only the arrangement without errors needs them",
            once,
            views,
        ),
    ]
