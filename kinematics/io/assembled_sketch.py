"""From a sketch to what a linkage is made of: names, shapes, mobility, assembly, faults explained.

Nothing here loads JAX: a command that NumPy answers reads its file so.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from designopt.errors import UserError
from kinematics.io.assembling import Configuration, Dimensions, Equations
from kinematics.io.assembly_diagnosis import explain_open_linkage, find_open_loop
from kinematics.io.assembly_mode import explain_undecided, group_sines, same_assembly_mode
from kinematics.io.faults import name_faults
from kinematics.io.mobility import Mobility
from kinematics.io.sketch import Sketch
from kinematics.io.sketch_geometry import SketchGeometry, measure_sketch
from kinematics.model.topology import WORLD, Structure
from kinematics.solve.plan import make_plan
from kinematics.solve.steps import Plan, PlanError


@dataclass(frozen=True)
class AssembledSketch:
    """What a linkage is made of.

    Attributes:
        structure: who is joined to whom.
        assembly: one sign per group of the plan; see `Linkage`.
        numbers: NumPy arrays by the names of `Linkage`, nested as there.
    """

    structure: Structure
    assembly: tuple[int, ...]
    numbers: dict[str, Any]


def assemble_sketch(sketch: Sketch, source: str) -> AssembledSketch:
    """A sketch put together, with exact lengths.

    Args:
        sketch: the file's content.
        source: its name, for messages.

    Raises:
        UserError: as `read_linkage`.
    """
    faults = name_faults(sketch)
    if faults:
        raise UserError(f"{source}: " + "; ".join(faults))
    drawn = measure_sketch(sketch, source)
    try:
        home, assembly = _assembled(drawn)
    except UserError as error:
        raise UserError(f"{source}: {error}") from error
    structure, dimensions = drawn.structure, drawn.dimensions
    fixed = [dimensions.places[WORLD, joint] for joint in structure.fixed_joints]
    numbers = {
        "anchors": np.array(fixed, float),
        "links": {
            body.name: {
                "length": np.array(drawn.shapes[body.name][1, 0], float),
                "places": np.array(drawn.shapes[body.name][2:], float),
            }
            for body in structure.moving
        },
        "lines": tuple(
            {
                "point": np.array(dimensions.points[i], float),
                "angle": np.array(dimensions.angles[i], float),
                "turn": None if slider.keeps is None else np.array(dimensions.turns[i], float),
            }
            for i, slider in enumerate(structure.sliders)
        ),
        "springs": tuple(
            {"stiffness": np.array(one.stiffness, float), "preload": np.array(one.preload, float)}
            for one in sketch.springs
        ),
        "reference": {
            "inputs": np.array(_home_inputs(dimensions, home), float),
            "angles": np.array([home.angles[body.name] for body in structure.moving], float),
            "slides": np.array(home.slides, float),
        },
    }
    return AssembledSketch(structure, assembly, numbers)


def _assembled(drawn: SketchGeometry) -> tuple[Configuration, tuple[int, ...]]:
    """The assembled sketch, and the side of each group of the plan."""
    equations = Equations(drawn.dimensions)
    plan = _plan(drawn, equations)
    impossible = find_open_loop(drawn.dimensions)
    if impossible is not None:
        raise UserError(impossible)
    sines = group_sines(plan, drawn.dimensions, drawn.configuration)

    def fits(found: Configuration) -> bool:
        return same_assembly_mode(sines, group_sines(plan, drawn.dimensions, found))

    assembled = equations.assemble(drawn.configuration, fits)
    if not assembled.closed:
        raise UserError(explain_open_linkage(assembled))
    fault = Mobility(equations, assembled.configuration).fault(None) or explain_undecided(
        plan, sines
    )
    if fault is not None:
        raise UserError(fault)
    if not assembled.fits:
        raise UserError(
            "joints: the linkage can be assembled, but not on the side where it is sketched; "
            "sketch it nearer to the wanted assembly, or change its lengths"
        )
    signs = (0 if sine is None else int(math.copysign(1, sine)) for sine in sines)
    return assembled.configuration, tuple(signs)


def _plan(drawn: SketchGeometry, equations: Equations) -> Plan:
    error = None
    try:
        plan = make_plan(drawn.structure)
        if drawn.structure.inputs:
            return plan
    except PlanError as raised:
        error = raised
    # Bodies that are redundant are so where they fit together.
    assembled = equations.assemble(drawn.configuration)
    at = assembled.configuration if assembled.closed else drawn.configuration
    raise UserError(Mobility(equations, at).fault(error) or "inputs: there is none") from error


def _home_inputs(dimensions: Dimensions, home: Configuration) -> tuple[float, ...]:
    values = []
    for part in dimensions.structure.inputs:
        if part.slider is not None:
            values.append(home.slides[part.slider])
            continue
        assert part.body is not None
        angle = home.angles[part.body] - _angle_of(dimensions, home, part.relative_to)
        values.append(math.remainder(angle, 2 * math.pi) + 0.0)  # no −0
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
