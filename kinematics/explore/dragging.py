"""A joint dragged in the picture: the linkage measured anew with that joint in another place."""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable, Mapping, Sequence

from designopt.explore.explorer import Handle
from designopt.export.drawing import Place
from designopt.optimize.parametric import Parameter, Values
from kinematics.model.topology import WORLD
from kinematics.parametric.dimensions import Distance, Frame
from kinematics.parametric.linkage_design import LinkageDesign
from kinematics.plot.scene import Scene

ROUNDS = 40
"""Of projections, one after the other, onto all that a place has to satisfy."""

FLAT = 1e-6
"""Least height of a body's corner over the line of its first two joints, as a part of that."""

PREFIX = "pin "
"""Before the joint's name in that of its handle."""

Joints = Mapping[str, complex]


class Dragging:
    """Which joints of a linkage can be dragged, and what that changes.

    Not the first fixed joint, as everything is placed from there, nor joints of a body whose shape
    cannot change because it keeps another body from turning.
    """

    def __init__(self, design: LinkageDesign) -> None:
        self._design = design
        self._structure = design.poses.structure
        self._distances = [design.dimensions.distances[number] for number in design.dimensions.free]
        frames = design.dimensions.frames
        self._frames = {frame.body: frame for frame in frames}
        # A body with a slider's line is turned by the joint on that line, and one that is kept from
        # turning by another body, not by its own joints.
        sliders = self._structure.sliders
        self._lined = {self._structure.node(part.on) for part in sliders} - {WORLD}
        self._guided = self._lined | {part.keeps for part in sliders}
        parameters = {joint: self._parameters(joint) for joint in self._structure.joints}
        self._movable = {joint: names for joint, names in parameters.items() if names}

    def joint(self, handle: str) -> str | None:
        """The joint of a handle; none if it is no handle's."""
        joint = handle.removeprefix(PREFIX)
        return joint if handle.startswith(PREFIX) and joint in self._movable else None

    def handles(self, joints: Mapping[str, Place]) -> list[Handle]:
        """All handles of a pose."""
        return [
            Handle(f"{PREFIX}{joint}", joints[joint], names)
            for joint, names in self._movable.items()
        ]

    def values(
        self,
        values: Values,
        inputs: Sequence[Parameter],
        scene: Scene,
        joint: str,
        place: Place,
    ) -> dict[str, float]:
        """What changes when a joint goes to a place, or as near as ranges and lines let it.

        Args:
            values: of all inputs and distances, as shown.
            inputs: with their ranges.
            scene: the pose that is shown.
            joint: which can be dragged.
            place: where to, mm.
        """
        joints = {name: complex(*at.tolist()) for name, at in scene.joints.items()}
        moved = {**joints, joint: self._nearest(joints, scene, joint, complex(*place))}
        found = {}
        for distance, parameter in self._own(joint):
            length = abs(_between(distance, moved))
            found[parameter.name] = min(max(length, parameter.low), parameter.high)
        for column, parameter in enumerate(inputs):
            if parameter.name in self._movable[joint]:
                change = self._measured(column, moved, scene) - self._measured(
                    column, joints, scene
                )
                if self._design.poses.turning[column]:
                    change = math.remainder(change, 2 * math.pi)
                value = values[parameter.name] + self._design.shown(column, change)
                found[parameter.name] = _inside(parameter, value)
        return found

    def _own(self, joint: str) -> list[tuple[Distance, Parameter]]:
        pairs = zip(self._distances, self._design.parameters, strict=True)
        return [(one, parameter) for one, parameter in pairs if joint in one.ends]

    def _parameters(self, joint: str) -> tuple[str, ...]:
        structure = self._structure
        owners = [part for part in structure.bodies if joint in part.joints]
        changing = {distance.body for distance in self._distances}
        shapes = [WORLD if part.fixed else part.name for part in owners if len(part.joints) > 1]
        names = {frame.body: self._name(frame) for frame in self._frames.values()}
        held = any(names.get(body) not in changing for body in shapes)
        origin = joint == next(iter(structure.fixed_joints), None)
        pivots = any(part.name in self._lined and part.joints[0] == joint for part in owners)
        if not owners or held or origin or (pivots and joint not in structure.fixed_joints):
            return ()
        inputs = [part.name for part in structure.inputs if self._turned(part.name, joint)]
        return (*inputs, *(parameter.name for _, parameter in self._own(joint)))

    def _name(self, frame: Frame) -> str:
        return self._design.dimensions.distances[frame.base].body

    def _turned(self, name: str, joint: str) -> bool:
        """Whether an input's value is measured at a joint."""
        part = next(part for part in self._structure.inputs if part.name == name)
        if part.slider is not None:
            return self._structure.sliders[part.slider].joint == joint
        assert part.body is not None  # it is the one or the other
        bodies = {part.body, part.relative_to} - {WORLD}
        return any(joint in self._structure.body(body).joints[:2] for body in bodies)

    def _measured(self, column: int, joints: Joints, scene: Scene) -> float:
        """The value of an input, rad or mm, but for a constant."""
        part = self._structure.inputs[column]
        if part.slider is not None:
            along = complex(*scene.directions[part.slider].tolist())
            return (joints[self._structure.sliders[part.slider].joint] / along).real
        assert part.body is not None  # it is the one or the other
        return self._direction(part.body, joints) - self._direction(part.relative_to, joints)

    def _direction(self, body: str, joints: Joints) -> float:
        ends = () if body == WORLD else self._structure.body(body).joints[:2]
        return cmath.phase(joints[ends[1]] - joints[ends[0]]) if len(ends) == 2 else 0.0

    def _nearest(self, joints: Joints, scene: Scene, joint: str, target: complex) -> complex:
        """The place nearest to a target at which everything else may stay."""
        projections = [*self._rings(joints, joint), *self._lines(joints, scene, joint)]
        for _ in range(ROUNDS):
            for project in projections:
                target = project(target)
        return target

    def _rings(self, joints: Joints, joint: str) -> list[Callable[[complex], complex]]:
        """That the distances keep their ranges."""

        def ring(center: complex, parameter: Parameter) -> Callable[[complex], complex]:
            def project(place: complex) -> complex:
                step = place - center
                length = min(max(abs(step), parameter.low), parameter.high)
                return center + length * (step / abs(step) if step else 1.0)

            return project

        return [
            ring(joints[next(end for end in distance.ends if end != joint)], parameter)
            for distance, parameter in self._own(joint)
        ]

    def _lines(
        self, joints: Joints, scene: Scene, joint: str
    ) -> list[Callable[[complex], complex]]:
        """That a joint stays on its line, and a body's corner on its side."""
        structure, found = self._structure, []
        for part, along in zip(structure.sliders, scene.directions, strict=True):
            if part.joint == joint and structure.node(part.on) == WORLD:
                found.append(_on_line(joints[joint], complex(*along.tolist())))
        for part in structure.moving:
            if part.name in self._guided and joint in part.joints[1:]:
                first = joints[part.joints[0]]
                found.append(_on_line(first, joints[joint] - first))
        for frame in self._frames.values():
            if joint not in frame.joints:
                continue
            first, second = (joints[name] for name in frame.joints[:2])
            number = frame.joints.index(joint)
            corner = frame.corners[number - 2] if number > 1 else None
            if corner is not None and corner.to_second is not None:
                found.append(_on_side(first, second - first, corner.side))
            elif corner is not None or (number == 1 and frame.body == WORLD):
                found.append(_on_line(first, second - first))
        return found


def _between(distance: Distance, joints: Joints) -> complex:
    first, second = distance.ends
    return joints[second] - joints[first]


def _on_line(point: complex, along: complex) -> Callable[[complex], complex]:
    def project(place: complex) -> complex:
        return point + along * ((place - point) / along).real

    return project


def _on_side(point: complex, along: complex, side: float) -> Callable[[complex], complex]:
    def project(place: complex) -> complex:
        step = (place - point) / along
        return point + along * complex(step.real, side * max(side * step.imag, FLAT))

    return project


def _inside(parameter: Parameter, value: float) -> float:
    """A value within a range, of a full turn by whole turns."""
    if parameter.unit == "°" and parameter.high - parameter.low >= 360.0:
        value = parameter.low + (value - parameter.low) % 360.0
    return min(max(value, parameter.low), parameter.high)
