"""From a sketch to a linkage: names, shapes, mobility, assembly, with every fault explained."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np

from designopt.errors import UserError
from kinematics.io.assembling import Configuration, Dimensions, Equations
from kinematics.io.assembly_diagnosis import explain_open_linkage, find_open_loop
from kinematics.io.assembly_mode import explain_undecided, group_sines, same_assembly_mode
from kinematics.io.faults import name_faults
from kinematics.io.mobility import Mobility
from kinematics.io.sketch import Sketch, load_sketch, parse_sketch
from kinematics.io.sketch_geometry import SketchGeometry, measure_sketch
from kinematics.model.linkage import Line, Link, Linkage, ReferenceConfiguration, Spring
from kinematics.model.topology import WORLD
from kinematics.solve.plan import make_plan
from kinematics.solve.steps import Plan, PlanError


def read_linkage(path: str | Path) -> Linkage:
    """The linkage that a file describes.

    Args:
        path: a TOML file of joints, bodies, sliders, inputs and springs (see the README).

    Returns:
        The linkage, with exact lengths and the sketch's assembly. Arrays have JAX's default
        float type.

    Raises:
        UserError: the file cannot be read or describes no mechanism that these inputs drive; one
            line names the place and the cure.

    Example:
        >>> from importlib.resources import files
        >>> linkage = read_linkage(files("studies") / "gallery/linkages/four-bar.toml")
        >>> linkage.structure.name, float(linkage.links["crank"].length)
        ('four-bar', 40.0)
    """
    return build_linkage(load_sketch(path), str(path))


def parse_linkage(data: Mapping[str, Any], source: str = "sketch") -> Linkage:
    """The linkage that the tables of a linkage file describe; otherwise as `read_linkage`.

    Example:
        >>> import tomllib
        >>> from importlib.resources import files
        >>> text = (files("studies") / "gallery/linkages/four-bar.toml").read_text()
        >>> parse_linkage(tomllib.loads(text)).structure.name
        'four-bar'
    """
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
    drawn = measure_sketch(sketch, source)
    try:
        home, assembly = _assembled(drawn)
    except UserError as error:
        raise UserError(f"{source}: {error}") from error
    structure, dimensions = drawn.structure, drawn.dimensions
    return Linkage(
        anchors=jnp.asarray(
            np.array([dimensions.places[WORLD, joint] for joint in structure.fixed_joints]),
            float,
        ),
        links={
            body.name: Link(
                jnp.asarray(drawn.shapes[body.name][1, 0], float),
                jnp.asarray(drawn.shapes[body.name][2:], float),
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
        reference=ReferenceConfiguration(
            jnp.asarray(_home_inputs(dimensions, home), float),
            jnp.asarray([home.angles[body.name] for body in structure.moving], float),
            jnp.asarray(home.slides, float),
        ),
        assembly=assembly,
    )


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
