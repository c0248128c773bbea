"""The plan of a linkage: which few unknowns are solved together, in which order, and how.

The loop equations are taken apart into the smallest groups that can be solved one after the
other (`blocks.find_blocks`). In mechanisms these blocks are the Assur groups (L. V. Assur, 1914).
A group that a loop of three moving bodies closes is taken apart further, in the frame of one.
"""

from __future__ import annotations

import functools
from collections.abc import Iterable
from typing import Any

from designopt.kept import kept
from kinematics.model.loops import Leg, Loop, find_loops
from kinematics.model.topology import WORLD, Incidence, Structure
from kinematics.solve.blocks import find_blocks, tie_angles
from kinematics.solve.steps import Group, Orientation, Placement, Plan, PlanError, Turn


@functools.lru_cache(maxsize=256)
def make_plan(structure: Structure, targets: frozenset[str] | None = None) -> Plan:
    """The plan for a linkage's pose, or for what some of its joints and bodies need.

    Args:
        structure: the linkage's.
        targets: names of joints and bodies that are asked for; all by default.

    Raises:
        PlanError: the inputs do not determine the pose, or determine it more than once.
    """
    plan = _whole_plan(structure.untitled)
    return plan if targets is None else _upstream(structure, plan, targets)


@functools.lru_cache(maxsize=256)
@kept
def _whole_plan(structure: Structure) -> Plan:
    orientations = tie_angles(structure)
    relative: list[Group] = []
    dropped: set[Incidence] = set()
    while True:
        blocks = find_blocks(structure, orientations, dropped)
        steps = _steps(structure, orientations, blocks, dropped, len(relative))
        found = _floating_group(structure, orientations, steps, len(relative))
        if found is None:
            break
        # What it ties together is as one body from here on, and its loop is closed.
        relative.append(found)
        orientations = _merged(orientations, found)
        dropped.add(found.loops[0].legs[-1].end)
    return Plan(orientations, (*relative, *steps))


def _steps(
    structure: Structure,
    orientations: dict[str, Orientation],
    blocks: list[set[Any]],
    dropped: set[Incidence],
    groups: int,
) -> tuple[Group | Placement, ...]:
    """The steps that solve the blocks in order; ``groups`` groups have been found before."""
    incidences = structure.incidences
    angles = {WORLD} | {body for body, o in orientations.items() if o.root == WORLD}
    free_slides = {variable[1] for block in blocks for variable in block if variable[0] == "slide"}
    slides = set(range(len(structure.sliders))) - free_slides
    placed = dict.fromkeys(structure.fixed_joints)
    steps: list[Group | Placement] = []

    def reference(body: str) -> Incidence | None:
        """A placed joint on a body whose angle is known."""
        if body not in angles:
            return None
        mine = (i for i in incidences if i.body == body and i.joint in placed)
        return next((i for i in mine if i.slider is None or i.slider in slides), None)

    def place_what_is_known() -> None:
        again = True
        while again:
            again = False
            for incidence in incidences:
                base = reference(incidence.body)
                known = incidence.slider is None or incidence.slider in slides
                if base and known and incidence.joint not in placed:
                    placed[incidence.joint] = None
                    steps.append(Placement(incidence, base))
                    again = True

    place_what_is_known()
    for block in blocks:
        roots = tuple(b.name for b in structure.moving if ("angle", b.name) in block)
        free = tuple(i for i in range(len(structure.sliders)) if ("slide", i) in block)
        if not roots and not free:
            continue
        mine = [i for n, i in enumerate(incidences) if ("equation", n, "x") in block]
        bodies = {incidence.body for incidence in mine}
        mine += [  # what ties its bodies to joints that are placed already
            i
            for i in incidences
            if i.body in bodies - angles
            and i.joint in placed
            and i not in {*mine, *dropped}
            and (i.slider is None or i.slider in slides)
        ]
        references = {i.body: base for i in mine if (base := reference(i.body)) is not None}
        loops = find_loops(mine, tuple(placed), references)
        steps.append(_group(structure, orientations, groups, roots, free, loops))
        groups += 1
        angles |= {body for body, o in orientations.items() if o.root in roots}
        slides |= set(free)
        place_what_is_known()
    return tuple(steps)


def _group(
    structure: Structure,
    orientations: dict[str, Orientation],
    index: int,
    roots: tuple[str, ...],
    free: tuple[int, ...],
    loops: list[Loop],
    base: str | None = None,
) -> Group:
    legs = [leg for loop in loops for leg in loop.legs]
    bodies = tuple(dict.fromkeys(leg.body for leg in legs if leg.body != WORLD))
    turning = tuple(tuple(b for b, o in orientations.items() if o.root == root) for root in roots)
    kind, pin = "iterated", None
    if len(loops) == 1:
        on = [structure.node(structure.sliders[slider].on) for slider in free]
        kept = any(structure.sliders[slider].keeps is not None for slider in free)
        match len(roots), len(free):
            case 2, 0:
                kind, pin = "RRR", _inner_pin(legs, turning)
            case 1, 1:
                kind = "RPR" if on[0] in turning[0] else "RRP"
                pin = structure.sliders[free[0]].joint
            case 0, 2:
                kind = "RPP" if kept else "PRP"
                pin = structure.sliders[free[0]].joint
    return Group(index, kind, roots, turning, free, tuple(loops), pin, bodies, base)


def _floating_group(
    structure: Structure,
    orientations: dict[str, Orientation],
    steps: Iterable[Group | Placement],
    index: int,
) -> Group | None:
    """A loop within an iterated group that has a closed form in the frame of one of its bodies.

    Such a loop passes through nothing that is known and has three unknowns: with one body at
    rest, two are left.
    """
    for group in steps:
        if not isinstance(group, Group) or group.kind != "iterated":
            continue
        mine = [i for i in structure.incidences if i.body in group.bodies]
        for loop in find_loops(mine):
            roots = tuple(dict.fromkeys(orientations[leg.body].root for leg in loop.legs))
            ends = [i for leg in loop.legs for i in (leg.start, leg.end)]
            free = tuple(dict.fromkeys(i.slider for i in ends if i.slider in group.sliders))
            if WORLD in roots or len(roots) + len(free) != 3:
                continue
            # The last leg ends in a pin, so that its end can be dropped without losing a slide.
            turned = [(*loop.legs[k:], *loop.legs[:k]) for k in range(len(loop.legs))]
            legs = next((legs for legs in turned if legs[-1].end.slider is None), None)
            if legs is None:
                continue
            # At rest: the one that most joints depend on, so that angles are those people mean.
            base = max(roots, key=lambda root: len(structure.body(root).joints))
            others = tuple(root for root in roots if root != base)
            return _group(structure, orientations, index, others, free, [Loop(legs)], base)
    return None


def _merged(orientations: dict[str, Orientation], group: Group) -> dict[str, Orientation]:
    """Angles after a floating group is solved: those of its base and known turns."""
    assert group.base is not None
    merged = dict(orientations)
    for number, bodies in enumerate(group.turning):
        turn = Turn(solved=(group.index, number))
        for body in bodies:
            merged[body] = Orientation(group.base, (turn, *orientations[body].turns))
    return merged


def _inner_pin(legs: list[Leg], turning: tuple[tuple[str, ...], ...]) -> str | None:
    """The joint at which a loop passes from the bodies of one unknown angle to the other's."""
    first, second = turning
    for before, after in zip(legs, [*legs[1:], legs[0]], strict=True):
        for one, other in ((first, second), (second, first)):
            if before.body in one and after.body in other:
                return after.start.joint
    return None


def _upstream(structure: Structure, plan: Plan, targets: frozenset[str]) -> Plan:
    """The steps that the targets need, found by walking backwards."""
    names = set(structure.joints) | {body.name for body in structure.bodies}
    unknown = sorted(targets - names)
    if unknown:
        raise PlanError(f"the linkage has no joint or body named {', '.join(unknown)}")
    joints = set(targets) & set(structure.joints)
    bodies = set(targets) & set(plan.orientations)
    sliders: set[int] = set()
    kept: list[Group | Placement] = []
    for step in reversed(plan.steps):
        orientations = [plan.orientations[body] for body in bodies]
        roots = {orientation.root for orientation in orientations}
        solved = {turn.solved[0] for o in orientations for turn in o.turns if turn.solved}
        if isinstance(step, Placement):
            if step.at.joint not in joints:
                continue
            used = [step.at, step.reference]
            joints.add(step.reference.joint)
        else:
            asked = roots & set(step.angles) if step.base is None else {step.index} & solved
            if not (asked or sliders & set(step.sliders)):
                continue
            used = [i for loop in step.loops for leg in loop.legs for i in (leg.start, leg.end)]
            joints |= {n for loop in step.loops for n in (loop.start, loop.end) if n is not None}
        kept.append(step)
        bodies |= {i.body for i in used}
        sliders |= {i.slider for i in used if i.slider is not None}
    return Plan(plan.orientations, tuple(reversed(kept)))


def describe_plan(structure: Structure, targets: frozenset[str] | None = None) -> list[str]:
    """The plan in words, one line per step.

    Example:
        >>> from importlib.resources import files
        >>> from kinematics import read_linkage
        >>> linkage = read_linkage(files("studies") / "gallery/linkages/four-bar.toml")
        >>> describe_plan(linkage.structure)[0]
        'place A by crank, from O2'
    """
    plan = make_plan(structure, targets)
    lines = []
    for step in plan.steps:
        if isinstance(step, Placement):
            on = "the fixed body" if step.at.body == WORLD else step.at.body
            lines.append(f"place {step.at.joint} by {on}, from {step.reference.joint}")
            continue
        unknowns = [f"angle of {body}" for body in step.angles]
        unknowns += [f"slide of {structure.sliders[slider].joint}" for slider in step.sliders]
        how = "iteration, followed from the sketch" if step.kind == "iterated" else "closed form"
        lines.append(
            f"solve {step.kind if step.kind != 'iterated' else f'{len(step.loops)} loops together'}"
            f" in {how}: {', '.join(unknowns)}{f', relative to {step.base}' if step.base else ''}"
        )
        lines += [f"  loop {loop}" for loop in step.loops]
    return lines
