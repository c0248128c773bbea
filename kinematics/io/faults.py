"""Faults of a sketch that follow from its names alone, all of them at once."""

from __future__ import annotations

import difflib
import itertools
import math
from collections import Counter
from collections.abc import Iterable, Iterator

from kinematics.io.sketch import BodyTable, Sketch
from kinematics.model.topology import WORLD, connected_parts

COLUMNS = ("ok", "margin", "closure")
"""Columns of the table of ``designopt solve`` that every linkage has."""

OF_A_JOINT = ("x", "y", "vx", "vy", "ax", "ay", "mu_deg")
OF_A_BODY = ("angle_deg", "omega", "alpha")


def name_faults(sketch: Sketch) -> list[str]:
    """What is wrong with the names in a sketch, each fault with its key and its cure."""
    faults = [*_missing_faults(sketch), *_body_faults(sketch), *_slider_faults(sketch)]
    faults += [*_input_faults(sketch), *_spring_faults(sketch)]
    return faults or [*_loose_faults(sketch)]


def _unknown(kind: str, name: str, known: Iterable[str]) -> str:
    known = list(known)
    if not known:
        return f"no {kind} is named '{name}', for there is none; add it"
    close = difflib.get_close_matches(name, known, n=1)
    hint = f"did you mean '{close[0]}'?" if close else f"there are: {', '.join(known)}"
    return f"no {kind} is named '{name}'; {hint}"


def _missing_faults(sketch: Sketch) -> Iterator[str]:
    fixed = [body.fixed for body in sketch.bodies.values()]
    if not sketch.bodies:
        yield 'bodies: there is none; add [bodies.ground] with joints = ["O"] and fixed = true'
    elif not any(fixed):
        yield "bodies: none is fixed; give one of them fixed = true"
    elif all(fixed):
        yield "bodies: none can move; add a body without fixed = true"


def _body_faults(sketch: Sketch) -> Iterator[str]:
    for name, body in sketch.bodies.items():
        where = f"bodies.{name}"
        if name == WORLD:
            yield f"{where}: '{WORLD}' means the fixed axes; choose another name"
        for joint in body.joints:
            if joint not in sketch.joints:
                yield f"{where}.joints: {_unknown('joint', joint, sketch.joints)}"
        for joint, times in Counter(body.joints).items():
            if times > 1:
                yield f"{where}.joints: '{joint}' stands there {times} times; once is enough"
        if not body.fixed and len(body.joints) < 2:
            yield f"{where}.joints: a moving body needs two joints; add one, or fix the body"
        if all(joint in sketch.joints for joint in body.joints):
            yield from _length_faults(f"{where}.lengths", body)


def _length_faults(where: str, body: BodyTable) -> Iterator[str]:
    joints = list(dict.fromkeys(body.joints))
    pairs = ["-".join(pair) for pair in itertools.permutations(joints, 2)]
    for key in body.lengths:
        if key not in pairs:
            cure = (
                f"write two of them with a hyphen, as in {pairs[0]}"
                if pairs
                else "a single joint has no length; remove it"
            )
            yield f"{where}: '{key}' names no two joints of the body; {cure}"
        elif pairs.count(key) > 1:
            yield f"{where}: '{key}' can be read as several pairs of joints; rename one of them"
    for a, b in itertools.combinations(joints, 2):
        both = [body.lengths.get(f"{a}-{b}"), body.lengths.get(f"{b}-{a}")]
        if None not in both and both[0] != both[1]:
            yield f"{where}: {a}-{b} and {b}-{a} contradict each other; keep one"


def _slider_faults(sketch: Sketch) -> Iterator[str]:
    fixed = {joint for body in sketch.bodies.values() if body.fixed for joint in body.joints}
    for i, slider in enumerate(sketch.sliders):
        where = f"sliders.{i}"
        if slider in sketch.sliders[:i]:
            yield f"{where}: it repeats sliders.{sketch.sliders.index(slider)}; remove one of them"
        if slider.joint not in sketch.joints:
            yield f"{where}.joint: {_unknown('joint', slider.joint, sketch.joints)}"
        if slider.on not in sketch.bodies:
            yield f"{where}.on: {_unknown('body', slider.on, sketch.bodies)}"
        elif slider.joint in sketch.bodies[slider.on].joints:
            yield (
                f"{where}: '{slider.joint}' is pinned to '{slider.on}' and cannot slide on it; "
                "remove it from that body's joints, or let it slide on another"
            )
        elif sketch.bodies[slider.on].fixed and slider.joint in fixed:
            yield (
                f"{where}: '{slider.joint}' and '{slider.on}' are both fixed, so it cannot slide; "
                "remove it from its fixed body, or let it slide on a moving one"
            )
        if math.dist(*slider.line) == 0:
            yield f"{where}.line: its two points coincide; move one to give it a direction"
        if slider.keeps is not None:
            if slider.keeps not in sketch.bodies:
                yield f"{where}.keeps: {_unknown('body', slider.keeps, sketch.bodies)}"
            elif slider.joint not in sketch.bodies[slider.keeps].joints:
                yield (
                    f"{where}.keeps: '{slider.keeps}' does not hold '{slider.joint}'; "
                    "name one that does"
                )
            elif sketch.bodies[slider.keeps].fixed:
                yield f"{where}.keeps: '{slider.keeps}' is fixed; name a moving body"


def _input_faults(sketch: Sketch) -> Iterator[str]:
    columns = {*COLUMNS, *(f"{joint}.{part}" for joint in sketch.joints for part in OF_A_JOINT)}
    columns |= {f"{body}.{part}" for body in sketch.bodies for part in OF_A_BODY}
    for name, times in Counter(part.name for part in sketch.inputs).items():
        if times > 1:
            yield f"inputs: {times} are named '{name}'; give each its own name"
        if name in columns:
            yield f"inputs: '{name}' is the name of another column of the table; choose another"
    for i, part in enumerate(sketch.inputs):
        where = f"inputs.{i}"
        if (part.body is None) == (part.slider is None):
            yield f"{where}: an input drives either a body or a slider; give one of the two"
        base = part.relative_to
        if base is not None and base != WORLD and base not in sketch.bodies:
            yield f"{where}.relative_to: {_unknown('body', base, [*sketch.bodies, WORLD])}"
        elif part.slider is not None:
            yield from _driven_slider_faults(sketch, where, part.slider, base)
        if part.body is None:
            continue
        if part.body not in sketch.bodies:
            yield f"{where}.body: {_unknown('body', part.body, sketch.bodies)}"
        elif sketch.bodies[part.body].fixed:
            yield f"{where}.body: '{part.body}' is fixed and cannot be driven; name a moving body"
        elif base == part.body:
            yield f"{where}.relative_to: a body has no angle relative to itself; name another"


def _driven_slider_faults(
    sketch: Sketch, where: str, joint: str, base: str | None
) -> Iterator[str]:
    def node(body: str) -> str:
        return WORLD if body in sketch.bodies and sketch.bodies[body].fixed else body

    lines = [slider.on for slider in sketch.sliders if slider.joint == joint]
    if not lines:
        sliding = dict.fromkeys(slider.joint for slider in sketch.sliders)
        yield f"{where}.slider: {_unknown('slider', joint, sliding)}"
    elif base is None and len(lines) > 1:
        yield (
            f"{where}.slider: '{joint}' slides on {' and '.join(lines)}; "
            "say on which with relative_to"
        )
    elif base is not None and node(base) not in map(node, lines):
        yield f"{where}.relative_to: '{joint}' slides on {' and '.join(lines)}; name that"


def _spring_faults(sketch: Sketch) -> Iterator[str]:
    for i, spring in enumerate(sketch.springs):
        for name in spring.between:
            if name not in sketch.bodies:
                yield f"springs.{i}.between: {_unknown('body', name, sketch.bodies)}"
        if spring.between[0] == spring.between[1]:
            yield f"springs.{i}.between: a spring needs two different bodies; name another"


def _loose_faults(sketch: Sketch) -> Iterator[str]:
    nodes = {name: ("body", WORLD if body.fixed else name) for name, body in sketch.bodies.items()}
    pairs = {
        (nodes[name], ("joint", joint))
        for name, body in sketch.bodies.items()
        for joint in body.joints
    }
    pairs |= {(nodes[slider.on], ("joint", slider.joint)) for slider in sketch.sliders}
    fixed = ("body", WORLD)
    tied = next((part for part in connected_parts(pairs) if fixed in part), {fixed})
    for name, body in sketch.bodies.items():
        if not body.fixed and ("body", name) not in tied:
            yield (
                f"bodies.{name}: it hangs loose; give it a joint of a body that is tied to a "
                "fixed one"
            )
    for joint in sketch.joints:
        used = sum(pair[1] == ("joint", joint) for pair in pairs)
        if used == 0:
            yield f"joints.{joint}: it is on no body; add it to one, or remove it"
