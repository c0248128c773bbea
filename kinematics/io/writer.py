"""A linkage as a sketch in its assembled configuration, which it could have been read from."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from designopt.errors import UserError
from designopt.io.files import replaced_when_complete
from designopt.io.spec_files import FORMAT
from designopt.io.toml_writing import format_toml
from kinematics.io.shapes import CONSISTENT
from kinematics.model.assembled import own_places
from kinematics.model.linkage import Linkage, Spring
from kinematics.model.topology import WORLD, BodyPart, Structure
from kinematics.solve.poses import solve_poses
from kinematics.solve.solver import Pose

HEADING = "A linkage in its assembled configuration: mm."

ENOUGH = 2
"""Joints of a body to which a further one needs exact lengths; the sketch gives its side."""


def linkage_tables(linkage: Linkage) -> dict[str, Any]:
    """The tables of a linkage's file; `kinematics.parse_linkage` makes the same linkage of them.

    Args:
        linkage: a single one. Its numbers come back to rounding, for a sketch states distances.

    Raises:
        UserError: the linkage cannot be assembled in its reference configuration.
    """
    with jax.enable_x64(True):
        found = solve_poses(linkage, linkage.reference.inputs)
        if not bool(found.ok):
            name = linkage.structure.name
            raise UserError(f"{name}: it cannot be written: {found.messages()[0]}")
    return pose_tables(linkage, found.value)


def pose_tables(linkage: Linkage, pose: Pose) -> dict[str, Any]:
    """The tables of a linkage's file, sketched in a pose of it.

    Args:
        linkage: a single one; springs are written with the preload that they have here.
        pose: a single one, which was found.
    """
    structure = linkage.structure
    anchors = np.asarray(linkage.anchors, float)
    joints = {name: np.array([at.x, at.y], float) for name, at in pose.joints.items()}
    joints |= dict(zip(structure.fixed_joints, anchors, strict=True))
    bodies = {body.name: _body(linkage, body) for body in structure.bodies}
    sliders = [
        _slider(linkage, index, joints, pose.bodies) for index in range(len(structure.sliders))
    ]
    return sketch_tables(structure, joints, bodies, linkage.springs, sliders)


def sketch_tables(
    structure: Structure,
    joints: Mapping[str, Any],
    bodies: Mapping[str, Any],
    springs: Sequence[Spring],
    sliders: Sequence[Any] = (),
) -> dict[str, Any]:
    """The tables of a linkage's file.

    Args:
        structure: who is joined to whom.
        joints: place of every joint, mm; plain numbers.
        bodies: their tables by name.
        springs: one for every pair of bodies in the structure.
        sliders: their tables.
    """
    tables: dict[str, Any] = {
        "linkage": {"name": structure.name, "format": FORMAT},
        "joints": {name: np.asarray(joints[name], float).tolist() for name in structure.joints},
        "bodies": bodies,
        "sliders": list(sliders),
        "inputs": _input_tables(structure),
        "springs": [
            {
                "between": list(between),
                "stiffness": float(spring.stiffness),
                "preload": float(spring.preload),
            }
            for between, spring in zip(structure.springs, springs, strict=True)
        ],
    }
    return {name: table for name, table in tables.items() if table}


def _input_tables(structure: Structure) -> list[dict[str, Any]]:
    tables: list[dict[str, Any]] = []
    joints: list[str | None] = [slider.joint for slider in structure.sliders]
    for part in structure.inputs:
        joint = None if part.slider is None else structure.sliders[part.slider].joint
        table = {"name": part.name, **({"body": part.body} if joint is None else {"slider": joint})}
        # A joint on several lines is driven along that of the body which is named.
        if part.relative_to != WORLD or joints.count(joint) > 1:
            table["relative_to"] = part.relative_to
        tables.append(table)
    return tables


def format_linkage(linkage: Linkage) -> str:
    """The text of a linkage's file; `kinematics.read_linkage` reads the same back to rounding.

    Example:
        >>> from importlib.resources import files
        >>> from kinematics import read_linkage
        >>> linkage = read_linkage(files("studies") / "gallery/linkages/four-bar.toml")
        >>> format_linkage(linkage).splitlines()[:2]
        ['# A linkage in its assembled configuration: mm.', '']
    """
    return format_toml(linkage_tables(linkage), HEADING)


def write_linkage(linkage: Linkage, path: str | Path) -> None:
    """Write a linkage's file; an existing one is replaced when the new one is complete.

    Args:
        linkage: a single one.
        path: of the file.

    Raises:
        UserError: the linkage cannot be assembled in its reference configuration.

    Example:
        >>> import tempfile
        >>> from importlib.resources import files
        >>> from kinematics import read_linkage
        >>> linkage = read_linkage(files("studies") / "gallery/linkages/four-bar.toml")
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     write_linkage(linkage, f"{folder}/copy.toml")
        ...     copy = read_linkage(f"{folder}/copy.toml")
        >>> copy.structure == linkage.structure
        True
    """
    text = format_linkage(linkage)
    with replaced_when_complete(Path(path)) as partial:
        partial.write_text(text, encoding="utf-8")


def _body(linkage: Linkage, body: BodyPart) -> dict[str, Any]:
    table: dict[str, Any] = {"joints": list(body.joints)}
    if body.fixed:
        return table | {"fixed": True}
    places = own_places(linkage, body)
    # Joints in one place have no length between them; the sketch keeps them together.
    together = CONSISTENT * max(abs(place) for place in places.values())
    lengths = {
        f"{first}-{second}": abs(end - start)
        for (first, start), (second, end) in itertools.combinations(places.items(), 2)
        if first in body.joints[:ENOUGH] and abs(end - start) > together
    }
    return table | {"lengths": lengths}


def _slider(
    linkage: Linkage, index: int, joints: Mapping[str, np.ndarray], bodies: Mapping[str, Any]
) -> dict[str, Any]:
    part, line = linkage.structure.sliders[index], linkage.lines[index]
    point, angle = complex(*np.asarray(line.point, float)), float(line.angle)
    ends = [point, point + complex(jnp.cos(angle), jnp.sin(angle))]
    if linkage.structure.node(part.on) != WORLD:
        body = linkage.structure.body(part.on)
        turn = complex(float(bodies[part.on].x), float(bodies[part.on].y))
        ends = [complex(*joints[body.joints[0]]) + turn * end for end in ends]
    table = {"joint": part.joint, "on": part.on, "line": [[end.real, end.imag] for end in ends]}
    return table | ({} if part.keeps is None else {"keeps": part.keeps})
