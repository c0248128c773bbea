"""The geometry of a sketch: shapes of bodies, places of joints and lines, the sketched pose."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from designopt.errors import UserError
from kinematics.io.assembling import Configuration, Dimensions
from kinematics.io.prismatic import merge_prismatic
from kinematics.io.shapes import ImpossibleShapeError, body_shape, body_steps
from kinematics.io.sketch import BodyTable, Sketch
from kinematics.model.topology import (
    WORLD,
    BodyPart,
    InputPart,
    SliderPart,
    Structure,
    connected_parts,
)

Places = dict[tuple[str, str], np.ndarray]


@dataclass(frozen=True)
class SketchGeometry:
    """A sketch, measured.

    Attributes:
        sketch: the file's content, pairs of sliders that keep a body from turning merged.
        structure: who is joined to whom.
        shapes: coordinates of every body's joints in its own frame, mm, exact.
        dimensions: the same with fixed joints and sliders' lines, exact.
        configuration: where everything is in the sketch, which need not be exact.
    """

    sketch: Sketch
    structure: Structure
    shapes: Mapping[str, np.ndarray]
    dimensions: Dimensions
    configuration: Configuration


def measure_sketch(sketch: Sketch, source: str) -> SketchGeometry:
    """Measure a sketch in which all names are right.

    Raises:
        UserError: the lengths of bodies cannot be; all of these at once.
    """
    shapes: dict[str, np.ndarray] = {}
    faults: list[str] = []
    for name, body in sketch.bodies.items():
        try:
            shapes[name] = body_shape(sketch.joints, body.joints, _lengths(body))
        except ImpossibleShapeError as error:
            faults.append(f"bodies.{name}: {error}")
    fixed: dict[str, np.ndarray] = {}
    for names in _fixed_parts(sketch):
        try:
            fixed |= _fixed_places(sketch, names)
        except ImpossibleShapeError as error:
            if len(names) > 1:  # that of a single body has been said
                faults.append(f"bodies.{' and bodies.'.join(names)}: {error}")
    angles: dict[int, float] = {}
    if not faults:
        sketch, angles, faults = merge_prismatic(sketch, shapes)
    if faults:
        raise UserError(f"{source}: " + "; ".join(faults))
    structure = _structure(sketch)
    places = {(WORLD, joint): fixed[joint] for joint in structure.fixed_joints}
    for body in structure.moving:
        places |= {
            (body.name, joint): place
            for joint, place in zip(body.joints, shapes[body.name], strict=True)
        }
    dimensions = _dimensions(sketch, structure, places, angles)
    return SketchGeometry(sketch, structure, shapes, dimensions, _configuration(sketch, dimensions))


def _lengths(body: BodyTable) -> dict[tuple[str, str], float]:
    return {
        pair: body.lengths[key]
        for pair in itertools.permutations(body.joints, 2)
        if (key := "-".join(pair)) in body.lengths
    }


def _fixed_parts(sketch: Sketch) -> Iterator[list[str]]:
    """Fixed bodies that share joints, directly or not, and so have one shape together."""
    pairs = (
        (("body", name), ("joint", joint))
        for name, body in sketch.bodies.items()
        if body.fixed
        for joint in body.joints
    )
    for part in connected_parts(pairs):
        yield [name for name in sketch.bodies if ("body", name) in part]


def _fixed_places(sketch: Sketch, names: list[str]) -> dict[str, np.ndarray]:
    """Where the joints of such bodies are: the first as sketched, the others at their lengths."""
    joints = list(dict.fromkeys(joint for name in names for joint in sketch.bodies[name].joints))
    lengths: dict[tuple[str, str], float] = {}
    for name in names:
        for pair, length in _lengths(sketch.bodies[name]).items():
            known = lengths.get(pair, lengths.get((pair[1], pair[0]), length))
            if known != length:
                raise ImpossibleShapeError(
                    f"{'-'.join(pair)} is both {known:.6g} and {length:.6g}; keep one"
                )
            lengths.setdefault(pair, length)
    if not lengths:
        return {joint: np.array(sketch.joints[joint], float) for joint in joints}
    origin = np.array(sketch.joints[joints[0]], float)
    steps = body_steps(sketch.joints, joints, lengths)
    return {joint: origin + step for joint, step in steps.items()}


def _structure(sketch: Sketch) -> Structure:
    bodies = tuple(
        BodyPart(name, tuple(body.joints), body.fixed) for name, body in sketch.bodies.items()
    )
    nodes = {body.name: WORLD if body.fixed else body.name for body in bodies} | {WORLD: WORLD}
    sliders = [SliderPart(slider.joint, slider.on, slider.keeps) for slider in sketch.sliders]
    inputs = []
    for part in sketch.inputs:
        index = None
        if part.slider is not None:
            index = next(
                i
                for i, slider in enumerate(sketch.sliders)
                if slider.joint == part.slider
                and (part.relative_to is None or nodes[part.relative_to] == nodes[slider.on])
            )
        inputs.append(InputPart(part.name, part.body, index, part.relative_to or WORLD))
    springs = tuple(spring.between for spring in sketch.springs)
    return Structure(
        sketch.linkage.name, tuple(sketch.joints), bodies, tuple(sliders), tuple(inputs), springs
    )


def _dimensions(
    sketch: Sketch, structure: Structure, places: Places, known: Mapping[int, float]
) -> Dimensions:
    """``known``: for some sliders the angle of the kept body relative to their line."""
    frames = {body.name: _frame(sketch, body) for body in structure.moving}
    frames[WORLD] = (np.zeros(2), 0.0)
    points, angles, turns = [], [], []
    for i, (slider, part) in enumerate(zip(sketch.sliders, structure.sliders, strict=True)):
        node = structure.node(part.on)
        origin, angle = frames[node]
        # What is drawn at a joint of the body goes where exact lengths have that joint.
        joints = {sketch.joints[joint]: joint for joint in reversed(structure.body(part.on).joints)}
        start, end = (
            places[node, joints[point]]
            if point in joints
            else _turned(np.array(point) - origin, -angle)
            for point in slider.line
        )
        points.append(start)
        angles.append(math.atan2(*(end - start)[::-1]))
        if part.keeps is None:
            turns.append(np.nan)
        else:
            turns.append(known[i] + angles[-1] if i in known else frames[part.keeps][1] - angle)
    return Dimensions(
        structure, places, np.array(points).reshape(-1, 2), np.array(angles), np.array(turns)
    )


def _frame(sketch: Sketch, body: BodyPart) -> tuple[np.ndarray, float]:
    """Origin and angle of a moving body's frame in the sketch."""
    first, second = (np.array(sketch.joints[joint], float) for joint in body.joints[:2])
    step = second - first
    return first, math.atan2(step[1], step[0])


def _turned(vector: np.ndarray, angle: float) -> np.ndarray:
    cosine, sine = math.cos(angle), math.sin(angle)
    return np.array([cosine * vector[0] - sine * vector[1], sine * vector[0] + cosine * vector[1]])


def _configuration(sketch: Sketch, dimensions: Dimensions) -> Configuration:
    """The sketch as it was drawn, its fixed joints in their exact places."""
    structure = dimensions.structure
    joints = {name: np.array(place, float) for name, place in sketch.joints.items()}
    joints |= {joint: dimensions.places[WORLD, joint] for joint in structure.fixed_joints}
    angles = {body.name: _frame(sketch, body)[1] for body in structure.moving}
    slides = []
    for slider in sketch.sliders:
        start, end = (np.array(point) for point in slider.line)
        along = (end - start) / math.hypot(*(end - start))
        slides.append(float((joints[slider.joint] - start) @ along))
    return Configuration(joints, angles, tuple(slides))
