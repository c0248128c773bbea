"""The file of a linkage with other distances: joints in a pose of it, exact lengths."""

from __future__ import annotations

from dataclasses import replace

import jax.numpy as jnp
import numpy as np

from designopt.io.toml_writing import format_toml
from kinematics.io.writer import HEADING, pose_tables
from kinematics.model.linkage import Linkage
from kinematics.parametric.dimensions import Dimensions
from kinematics.solve.poses import solve_poses
from kinematics.solve.statics import spring_turns

SAME = 1e-12
"""A spring that is turned by less, rad, is as it was sketched."""


def spec_text(linkage: Linkage, dimensions: Dimensions, inputs: np.ndarray) -> str:
    """The text of a linkage file that is read as this linkage, sketched in this pose.

    Springs are as taut as they were: what the pose turns them by goes into their preload. Lines
    that go through joints of their body still do.

    Args:
        linkage: with its distances as they are now.
        dimensions: which these are.
        inputs: of the pose, which is one, rad or mm.
    """
    pose = solve_poses(linkage, jnp.asarray(inputs, float)).value
    springs = tuple(
        replace(spring, preload=spring.preload + jnp.where(abs(turn) > SAME, turn, 0.0))
        for spring, turn in zip(linkage.springs, spring_turns(linkage, pose), strict=True)
    )
    tables = pose_tables(replace(linkage, springs=springs), pose)
    for tie in dimensions.ties:
        line = tables["sliders"][tie.slider]["line"]
        for number, joint in enumerate((tie.start, tie.end)):
            if joint is not None:
                line[number] = tables["joints"][joint]
    return format_toml(tables, HEADING)
