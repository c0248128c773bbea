"""Two joints of one body on the same line: it slides without turning, as with ``keeps``.

Written as two pins in one slot, such a yoke would need its angle solved for, which the line
already determines.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping

import numpy as np

from kinematics.io.sketch import Sketch, SliderTable
from kinematics.model.topology import WORLD

STRAIGHT = 1e-9
"""How far, relative to their size, lines and joints may be apart and still count as one line."""


def merge_prismatic(
    sketch: Sketch, shapes: Mapping[str, np.ndarray]
) -> tuple[Sketch, dict[int, float], list[str]]:
    """Merge pairs of sliders that keep a body from turning into one slider with ``keeps``.

    Args:
        sketch: the file's content.
        shapes: coordinates of every body's joints in its own frame.

    Returns:
        The sketch with such pairs merged (other joints of the body that lie on the same line need
        no slider either), for each merged slider the body's angle relative to the line, and
        faults.
    """
    driven = {part.slider for part in sketch.inputs}
    sliders = dict(enumerate(sketch.sliders))
    angles: dict[int, float] = {}
    faults: list[str] = []
    for i, j in itertools.combinations(range(len(sliders)), 2):
        if i not in sliders or j not in sliders:
            continue
        first, second = sliders[i], sliders[j]
        body = _common_body(sketch, first, second)
        if (
            body is None
            or second.keeps is not None
            or {first.joint, second.joint} <= driven
            or not _same_line(sketch, first, second)
        ):
            continue
        step = _step(sketch, shapes[body], body, first, second)
        if first.keeps is None:
            keep, drop = (j, i) if second.joint in driven else (i, j)
            angle = _angle_to_line(sketch, step, first, second, sliders[keep])
            if angle is None:
                faults.append(
                    f"sliders.{j}: the sketch does not say in which order '{first.joint}' and "
                    f"'{second.joint}' are on their line; move one of them along it"
                )
                continue
            sliders[keep], angles[keep] = sliders[keep].model_copy(update={"keeps": body}), angle
            del sliders[drop]
        elif i in angles and _on_line(step, angles[i]):
            del sliders[j]
    merged = sketch.model_copy(update={"sliders": list(sliders.values())})
    return merged, {list(sliders).index(i): angle for i, angle in angles.items()}, faults


def _same_line(sketch: Sketch, first: SliderTable, second: SliderTable) -> bool:
    nodes = [WORLD if sketch.bodies[slider.on].fixed else slider.on for slider in (first, second)]
    start, end = (np.array(point) for point in first.line)
    along = (end - start) / math.hypot(*(end - start))
    steps = [np.array(point) - start for point in second.line]
    return nodes[0] == nodes[1] and all(
        abs(along[0] * step[1] - along[1] * step[0]) <= STRAIGHT * math.hypot(*step)
        for step in steps
    )


def _common_body(sketch: Sketch, first: SliderTable, second: SliderTable) -> str | None:
    """The moving body that holds the joints of both sliders, at different places."""
    for name, body in sketch.bodies.items():
        held = {first.joint, second.joint} <= set(body.joints)
        if held and not body.fixed and first.joint != second.joint:
            return name
    return None


def _step(
    sketch: Sketch, shape: np.ndarray, body: str, first: SliderTable, second: SliderTable
) -> np.ndarray:
    """From the first slider's joint to the second's, in the body's frame."""
    joints = sketch.bodies[body].joints
    return shape[joints.index(second.joint)] - shape[joints.index(first.joint)]


def _angle_to_line(
    sketch: Sketch, step: np.ndarray, first: SliderTable, second: SliderTable, on: SliderTable
) -> float | None:
    """Angle of the body relative to a slider's line; none if the sketch leaves it open."""
    drawn = np.subtract(sketch.joints[second.joint], sketch.joints[first.joint])
    line = np.subtract(on.line[1], on.line[0])
    ahead = float(drawn @ line)
    if abs(ahead) <= STRAIGHT * math.hypot(*drawn) * math.hypot(*line) or not step.any():
        return None
    sign = math.copysign(1.0, ahead)
    return -math.atan2(sign * step[1], sign * step[0])


def _on_line(step: np.ndarray, angle: float) -> bool:
    """Whether a step in the body's frame lies along the line to which the body has this angle."""
    across = float(math.sin(angle) * step[0] + math.cos(angle) * step[1])
    return abs(across) <= STRAIGHT * math.hypot(*step)
