"""Where joints are in the assembled sketch, without solving anything."""

from __future__ import annotations

import math

import numpy as np

from kinematics.model.linkage import Linkage
from kinematics.model.topology import WORLD, BodyPart

NOISE = 1e-12
"""A computed coordinate (mm, m or rad) below this is a zero that was rounded."""


def assembled_joints(linkage: Linkage) -> dict[str, complex]:
    """The places of all joints in the world, x + iy, mm.

    Angles and slides are known, so that body after body follows from any joint of it.

    Args:
        linkage: one that is not batched.
    """
    structure = linkage.structure
    joints: dict[str, complex] = own_places(linkage, WORLD)
    origins = {WORLD: 0j}
    slides = np.asarray(linkage.reference.slides, float).tolist()
    turns = {name: unit(angle) for name, angle in assembled_angles(linkage).items()}
    turns[WORLD] = 1 + 0j
    for _ in structure.incidences:  # each pass finds a joint or a body at least, if any is left
        for part, line, slide in zip(structure.sliders, linkage.lines, slides, strict=True):
            node = structure.node(part.on)
            x, y = np.asarray(line.point, float).tolist()
            along = turns[node] * (complex(x, y) + slide * unit(float(line.angle)))
            if node in origins:
                joints.setdefault(part.joint, origins[node] + along)
            elif part.joint in joints:
                origins[node] = joints[part.joint] - along
        for part in structure.moving:
            steps = {
                joint: turns[part.name] * place
                for joint, place in own_places(linkage, part).items()
            }
            known = next((joint for joint in part.joints if joint in joints), None)
            if part.name not in origins and known is not None:
                origins[part.name] = joints[known] - steps[known]
            if part.name in origins:
                for joint, step in steps.items():
                    joints.setdefault(joint, origins[part.name] + step)
    return {joint: complex(zeroed(at.real), zeroed(at.imag)) for joint, at in joints.items()}


def assembled_angles(linkage: Linkage) -> dict[str, float]:
    """The angles of the moving bodies, rad."""
    angles = np.asarray(linkage.reference.angles, float).tolist()
    return dict(zip([part.name for part in linkage.structure.moving], angles, strict=True))


def assembled_size(linkage: Linkage) -> float:
    """What `Linkage.size` computes, mm, without compiling anything."""
    fixed = [*own_places(linkage, WORLD).values()]
    lengths = [abs(float(link.length)) for link in linkage.links.values()]
    lengths += [abs(place - fixed[0]) for place in fixed]
    for part, line in zip(linkage.structure.sliders, linkage.lines, strict=True):
        if linkage.structure.node(part.on) == WORLD:
            step = complex(*np.asarray(line.point, float).tolist()) - fixed[0]
            lengths.append(abs((step / unit(float(line.angle))).imag))
    return max(lengths) or 1.0


def own_places(linkage: Linkage, part: BodyPart | str) -> dict[str, complex]:
    """The joints of a body in its own frame; those of fixed ones, or of `WORLD`, in the world."""
    if isinstance(part, str) or part.fixed:
        anchors = np.asarray(linkage.anchors, float).tolist()
        names = linkage.structure.fixed_joints
        fixed = {joint: complex(x, y) for joint, (x, y) in zip(names, anchors, strict=True)}
        return fixed if isinstance(part, str) else {joint: fixed[joint] for joint in part.joints}
    link = linkage.links[part.name]
    rest = [complex(x, y) for x, y in np.asarray(link.places, float).tolist()]
    return dict(zip(part.joints, [0j, complex(float(link.length)), *rest], strict=True))


def unit(angle: float) -> complex:
    """The unit vector in a direction, rad."""
    return complex(math.cos(angle), math.sin(angle))


def zeroed(value: float) -> float:
    """A coordinate, without the noise of a zero."""
    return 0.0 if abs(value) < NOISE else value
