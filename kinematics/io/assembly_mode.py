"""Assembly modes: on which side each closed-form group of a plan is assembled."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from kinematics.io.assembling import Configuration, Dimensions
from kinematics.model.topology import WORLD
from kinematics.solve.steps import Group, Plan

UNDECIDED = 1e-6
"""A sketch whose sine of the angle between two links is smaller does not choose an assembly."""

ONE_WAY = ("iterated",)
"""Kinds of groups without sides: they are followed from the sketch."""


def group_sines(
    plan: Plan, dimensions: Dimensions, configuration: Configuration
) -> list[float | None]:
    """For each group the sine whose sign is its side; none for a group without sides."""
    return [
        None if group.kind in ONE_WAY else _sine(group, dimensions, configuration)
        for group in plan.groups
    ]


def same_assembly_mode(drawn: Sequence[float | None], found: Sequence[float | None]) -> bool:
    """Whether no group has left the side it is drawn on; on the border it has not."""
    return all(
        was is None
        or now is None
        or abs(was) < UNDECIDED
        or math.copysign(1.0, was) * now > -UNDECIDED
        for was, now in zip(drawn, found, strict=True)
    )


def explain_undecided(plan: Plan, drawn: Sequence[float | None]) -> str | None:
    """Message for a sketch that chooses no assembly mode; none if it chooses one."""
    for group, sine in zip(plan.groups, drawn, strict=True):
        if sine is not None and abs(sine) < UNDECIDED:
            links = "they are square to the line" if group.sliders else "they are in one line"
            return (
                f"joints: the sketch does not say on which side {' and '.join(group.bodies)} are "
                f"assembled: at {group.pin or 'their pin'} {links}; move the joint to the side "
                "where it belongs"
            )
    return None


def _sine(group: Group, dimensions: Dimensions, configuration: Configuration) -> float:
    """Sine of the angle between a loop's derivatives by its two unknowns."""
    structure = dimensions.structure
    columns = {unknown: np.zeros(2) for unknown in (*group.angles, *group.sliders)}
    for leg in group.loops[0].legs:
        step = configuration.joints[leg.end.joint] - configuration.joints[leg.start.joint]
        for root, bodies in zip(group.angles, group.turning, strict=True):
            if leg.body in bodies:
                columns[root] = columns[root] + np.array([-step[1], step[0]])
        for incidence, sign in ((leg.end, 1), (leg.start, -1)):
            if incidence.slider in columns:
                on = structure.node(structure.sliders[incidence.slider].on)
                angle = dimensions.angles[incidence.slider]
                angle += 0.0 if on == WORLD else configuration.angles[on]
                along = np.array([math.cos(angle), math.sin(angle)])
                columns[incidence.slider] = columns[incidence.slider] + sign * along
    first, second = columns.values()
    size = math.hypot(*first) * math.hypot(*second)
    return float(second[0] * first[1] - second[1] * first[0]) / size if size else 0.0
