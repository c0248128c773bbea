"""From a sketch to a linkage: names, shapes, mobility, assembly, with every fault explained."""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import networkx as nx
import numpy as np

from designopt.errors import UserError
from kinematics.assembling import CLOSED, Configuration, Dimensions, Equations
from kinematics.faults import name_faults
from kinematics.linkage import Home, Line, Link, Linkage, Spring
from kinematics.loops import vector_loops
from kinematics.plan import Group, PlanError, make_plan
from kinematics.shapes import ImpossibleShapeError, body_shape
from kinematics.sketch import Sketch, load_sketch, parse_sketch
from kinematics.structure import WORLD, BodyPart, InputPart, SliderPart, Structure

UNDECIDED = 1e-6
"""A sketch whose sine of the angle between two links is smaller does not choose an assembly."""


def read_linkage(path: str | Path) -> Linkage:
    """The linkage that a file describes.

    Args:
        path: a TOML file of joints, bodies, sliders, inputs and springs (see the README).

    Returns:
        The linkage, with exact lengths and the sketch's assembly. Arrays have JAX's default
        float type.

    Raises:
        UserError: the file cannot be read or describes no mechanism that these inputs drive; one
            line says where and what to change.
    """
    return build_linkage(load_sketch(path), str(path))


def linkage_from(data: Mapping[str, Any], source: str = "sketch") -> Linkage:
    """The linkage that the tables of a linkage file describe; otherwise as `read_linkage`."""
    return build_linkage(parse_sketch(dict(data), source), source)


def build_linkage(sketch: Sketch, source: str) -> Linkage:
    """The linkage of a sketch; otherwise as `read_linkage`.

    Args:
        sketch: the file's content.
        source: its name, for messages.
    """
    faults = name_faults(sketch)
    if faults:
        raise UserError(f"{source}: " + "; ".join(faults))
    structure = _structure(sketch)
    shapes = _shapes(sketch, source)
    dimensions = _dimensions(sketch, structure, shapes)
    equations = Equations(dimensions)
    drawn = _drawn(sketch, dimensions)
    _check_mobility(structure, equations, drawn, source)
    home, gap = equations.assemble(drawn)
    if gap > CLOSED * equations.size:
        raise UserError(f"{source}: {_cannot_close(dimensions, gap)}")
    if equations.driven_rank(home) < equations.unknowns:
        raise UserError(
            f"{source}: inputs: as sketched they do not determine the pose (Jacobian of rank "
            f"{equations.driven_rank(home)} for {equations.unknowns} unknowns): the sketch is at a "
            "turning or change point; sketch it elsewhere, or drive another body"
        )
    return Linkage(
        anchors=jnp.asarray(
            np.array([dimensions.places[WORLD, joint] for joint in structure.fixed_joints]),
            float,
        ),
        links={
            body.name: Link(
                jnp.asarray(shapes[body.name][1, 0], float), jnp.asarray(shapes[body.name][2:], float)
            )
            for body in structure.moving
        },
        lines=tuple(
            Line(
                jnp.asarray(dimensions.points[i], float),
                jnp.asarray(dimensions.angles[i], float),
                None if slider.keeps is None else jnp.asarray(dimensions.turns[i], float),
            )
            for i, slider in enumerate(structure.sliders)
        ),
        springs=tuple(
            Spring(jnp.asarray(spring.stiffness, float), jnp.asarray(spring.preload, float))
            for spring in sketch.springs
        ),
        structure=structure,
        home=Home(_home_inputs(dimensions, home), dict(home.angles), home.slides),
        assembly=_assembly(structure, dimensions, drawn, source),
    )


def _structure(sketch: Sketch) -> Structure:
    bodies = tuple(
        BodyPart(name, tuple(body.joints), body.fixed) for name, body in sketch.bodies.items()
    )
    sliders = [SliderPart(slider.joint, slider.on, slider.keeps) for slider in sketch.sliders]
    inputs = []
    for part in sketch.inputs:
        index = None
        if part.slider is not None:
            index = next(
                i
                for i, slider in enumerate(sketch.sliders)
                if slider.joint == part.slider and part.relative_to in (None, slider.on)
            )
        inputs.append(InputPart(part.name, part.body, index, part.relative_to or WORLD))
    springs = tuple(spring.between for spring in sketch.springs)
    return Structure(
        sketch.linkage.name, tuple(sketch.joints), bodies, tuple(sliders), tuple(inputs), springs
    )


def _shapes(sketch: Sketch, source: str) -> dict[str, np.ndarray]:
    """Coordinates of every body's joints in its own frame."""
    shapes, faults = {}, []
    for name, body in sketch.bodies.items():
        lengths = {
            pair: body.lengths[key]
            for pair in itertools.permutations(body.joints, 2)
            if (key := "-".join(pair)) in body.lengths
        }
        try:
            shapes[name] = body_shape(sketch.joints, body.joints, lengths)
        except ImpossibleShapeError as error:
            faults.append(f"bodies.{name}: {error}")
    if faults:
        raise UserError(f"{source}: " + "; ".join(faults))
    return shapes


def _dimensions(
    sketch: Sketch, structure: Structure, shapes: Mapping[str, np.ndarray]
) -> Dimensions:
    places: dict[tuple[str, str], np.ndarray] = {}
    frames: dict[str, tuple[np.ndarray, float]] = {WORLD: (np.zeros(2), 0.0)}
    for body in structure.bodies:
        frame = _frame(sketch, body)
        if not body.fixed:
            frames[body.name] = frame
        for joint, place in zip(body.joints, shapes[body.name], strict=True):
            if body.fixed:
                # A joint of several fixed bodies is where the first of them has it.
                places.setdefault((WORLD, joint), frame[0] + _turned(place, frame[1]))
            else:
                places[body.name, joint] = place
    points, angles, turns = [], [], []
    for slider, part in zip(sketch.sliders, structure.sliders, strict=True):
        origin, angle = frames[structure.node(part.on)]
        start, end = (_turned(np.array(point) - origin, -angle) for point in slider.line)
        points.append(start)
        angles.append(math.atan2(*(end - start)[::-1]))
        turns.append(np.nan if part.keeps is None else frames[part.keeps][1] - angle)
    return Dimensions(
        structure, places, np.array(points).reshape(-1, 2), np.array(angles), np.array(turns)
    )


def _frame(sketch: Sketch, body: BodyPart) -> tuple[np.ndarray, float]:
    """Origin and angle of a body's frame in the sketch."""
    first = np.array(sketch.joints[body.joints[0]])
    if len(body.joints) == 1:
        return first, 0.0
    step = np.array(sketch.joints[body.joints[1]]) - first
    return first, math.atan2(step[1], step[0])


def _turned(vector: np.ndarray, angle: float) -> np.ndarray:
    cosine, sine = math.cos(angle), math.sin(angle)
    return np.array([cosine * vector[0] - sine * vector[1], sine * vector[0] + cosine * vector[1]])


def _drawn(sketch: Sketch, dimensions: Dimensions) -> Configuration:
    """The sketch as it was drawn, its fixed joints in their exact places."""
    structure = dimensions.structure
    joints = {name: np.array(place) for name, place in sketch.joints.items()}
    joints |= {joint: dimensions.places[WORLD, joint] for joint in structure.fixed_joints}
    angles = {body.name: _frame(sketch, body)[1] for body in structure.moving}
    slides = []
    for slider in sketch.sliders:
        start, end = (np.array(point) for point in slider.line)
        along = (end - start) / math.hypot(*(end - start))
        slides.append(float((joints[slider.joint] - start) @ along))
    return Configuration(joints, angles, tuple(slides))


def _home_inputs(dimensions: Dimensions, home: Configuration) -> tuple[float, ...]:
    values = []
    for part in dimensions.structure.inputs:
        if part.slider is not None:
            values.append(home.slides[part.slider])
            continue
        assert part.body is not None
        angle = home.angles[part.body] - _angle_of(dimensions, home, part.relative_to)
        values.append(math.remainder(angle, 2 * math.pi))
    return tuple(values)


def _angle_of(dimensions: Dimensions, home: Configuration, body: str) -> float:
    if body == WORLD:
        return 0.0
    part = dimensions.structure.body(body)
    if not part.fixed:
        return home.angles[body]
    if len(part.joints) == 1:
        return 0.0
    first, second = (dimensions.places[WORLD, joint] for joint in part.joints[:2])
    return math.atan2(*(second - first)[::-1])


def _assembly(
    structure: Structure, dimensions: Dimensions, drawn: Configuration, source: str
) -> tuple[int, ...]:
    """The side on which each closed-form group is sketched."""
    plan = make_plan(structure)
    signs = []
    for group in plan.groups:
        if group.kind in ("iterated", "PRP", "RPP"):
            signs.append(0)
            continue
        sine = _sketched_sine(dimensions, drawn, group)
        if abs(sine) < UNDECIDED:
            names = ", ".join(group.bodies)
            raise UserError(
                f"{source}: joints: the sketch does not say on which side {names} are assembled "
                f"(at {group.pin or 'their pin'} they are in one line, or square to it for a "
                "slider); move the joint to the side where it belongs"
            )
        signs.append(1 if sine > 0 else -1)
    return tuple(signs)


def _sketched_sine(
    dimensions: Dimensions, drawn: Configuration, group: Group
) -> float:
    """Sine of the angle between a loop's derivatives by its two unknowns, in the sketch."""
    structure = dimensions.structure
    columns = {unknown: np.zeros(2) for unknown in (*group.angles, *group.sliders)}
    for leg in group.loops[0].legs:
        step = drawn.joints[leg.end.joint] - drawn.joints[leg.start.joint]
        for root, bodies in zip(group.angles, group.turning, strict=True):
            if leg.body in bodies:
                columns[root] = columns[root] + np.array([-step[1], step[0]])
        for incidence, sign in ((leg.end, 1), (leg.start, -1)):
            if incidence.slider in columns:
                on = structure.node(structure.sliders[incidence.slider].on)
                angle = dimensions.angles[incidence.slider]
                angle += 0.0 if on == WORLD else drawn.angles[on]
                along = np.array([math.cos(angle), math.sin(angle)])
                columns[incidence.slider] = columns[incidence.slider] + sign * along
    first, second = columns.values()
    size = math.hypot(*first) * math.hypot(*second)
    return float(second[0] * first[1] - second[1] * first[0]) / size if size else 0.0


def _check_mobility(
    structure: Structure, equations: Equations, drawn: Configuration, source: str
) -> None:
    count, inputs = equations.kutzbach, len(structure.inputs)
    free = equations.mobility(drawn)
    figures = f"mobility {count} by Kutzbach's count, {free} by the Jacobian's rank at the sketch"
    driven = f"{inputs} input{'' if inputs == 1 else 's'}"
    try:
        make_plan(structure)
    except PlanError as error:
        who = f" ({', '.join(error.bodies)})" if error.bodies else ""
        advice = _advice(structure, equations, drawn, count, inputs)
        raise UserError(f"{source}: {figures}, {driven}: {error}{who}{advice}") from error


def _advice(
    structure: Structure, equations: Equations, drawn: Configuration, count: int, inputs: int
) -> str:
    if inputs < count:
        return f"; add {count - inputs} input{'' if count - inputs == 1 else 's'}"
    redundant = [
        part.name
        for part, kept in zip(structure.inputs, range(inputs), strict=True)
        if inputs > count and _rank_without(equations, drawn, kept) == equations.driven_rank(drawn)
    ]
    if redundant:
        return f"; redundant: input {' or '.join(redundant)}; remove one"
    spare = [body for body in structure.moving if _spare(structure, equations, drawn, body)]
    if spare:
        return f"; redundant: body {' or '.join(body.name for body in spare)}; remove one"
    return "; drive other bodies"


def _rank_without(equations: Equations, drawn: Configuration, left_out: int) -> int:
    from kinematics.assembling import rank

    _, jacobian = equations.residual_and_jacobian(equations.pack(drawn))
    return rank(np.vstack([jacobian, np.delete(equations.input_rows(), left_out, axis=0)]))


def _spare(
    structure: Structure, equations: Equations, drawn: Configuration, body: BodyPart
) -> bool:
    """Whether a body's constraints follow from those of the others."""
    _, jacobian = equations.residual_and_jacobian(equations.pack(drawn))
    from kinematics.assembling import rank

    rows = [n for n, i in enumerate(equations.rows) if i.body == body.name]
    lines = [row for n in rows for row in (2 * n, 2 * n + 1)]
    left = np.delete(jacobian, lines, axis=0)
    at = 3 * equations.moving.index(body.name)
    left = np.delete(left, slice(at, at + 3), axis=1)
    gone = jacobian.shape[1] - rank(jacobian)
    return len(lines) > 3 and left.shape[1] - rank(left) == gone


def _cannot_close(dimensions: Dimensions, gap: float) -> str:
    """Why a linkage cannot be assembled: a loop with a leg longer than all others together."""
    for loop in vector_loops(dimensions.structure):
        if any(i.slider is not None for leg in loop.legs for i in (leg.start, leg.end)):
            continue
        lengths = [
            math.dist(*(dimensions.places[leg.body, i.joint] for i in (leg.start, leg.end)))
            for leg in loop.legs
        ]
        longest = int(np.argmax(lengths))
        others = sum(lengths) - lengths[longest]
        if lengths[longest] > others:
            leg = loop.legs[longest]
            return (
                f"the loop {loop} cannot close: its other links reach {others:.6g} mm, but "
                f"{leg.start.joint} and {leg.end.joint} are {lengths[longest]:.6g} mm apart on "
                f"'{leg.body}' (margin {others - lengths[longest]:.3g} mm); change these lengths"
            )
    return (
        f"the linkage cannot be assembled: some joint stays {gap:.3g} mm apart at best; sketch it "
        "nearer to the wanted assembly, or change its lengths"
    )
