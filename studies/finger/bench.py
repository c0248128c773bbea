"""The whole finger with its knobs: linkage and scene side by side, moving together."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import jax
import jax.numpy as jnp
from designopt.explore.bench import Bench, Knob, Reading, Shown, Step, Values
from jaxtyping import Array, Float
from kinematics.explore.bench import LinkageBench
from optics.explore.scene_bench import SceneBench

from designopt.errors import UserError
from designopt.io.spec import SpecFile
from kinematics.model.linkage import Linkage
from kinematics.solve.poses import solve_poses
from studies.models.designed import designed_linkage, designed_scene
from studies.models.finger import Finger
from studies.models.finger_parts import PHALANGES
from studies.models.mirror_design.spec import FLOOR

if TYPE_CHECKING:
    from matplotlib.figure import SubFigure

MOST = 12
"""Most knobs of camera and mirrors."""

STRAIGHT = -90.0
"""Direction of a camera that looks straight at the palmar face, degrees."""

SIDE = "linkage: "
"""What the linkage's readings begin with."""


class FingerBench(Bench):
    """Linkage and scene of one finger, turned by the same joint angles; flexion is positive.

    The lengths of the phalanges have no knobs: they are the body's, which both share. Nor has DIP
    where a coupling bar makes it follow.
    """

    def __init__(self, finger: Finger, floor: float = FLOOR) -> None:
        """Make both benches.

        Args:
            finger: with pins and a camera.
            floor: resolution that is asked for, px/mm.
        """
        linkage = designed_linkage(finger)
        self._scene = SceneBench(
            designed_scene(finger),
            joint=(0.0, finger.body.range_deg),
            most=MOST,
            floor=floor,
            straight_deg=STRAIGHT,
        )
        joints = [knob for knob in self._scene.knobs if knob.kind == "joint"]
        bodies = linkage.sketch.bodies
        self._linkage = LinkageBench(
            linkage,
            ranges={knob.name: (knob.low, knob.high) for knob in joints},
            held=[f"{name} {'-'.join(bodies[name].joints[:2])}" for name in PHALANGES],
            opposite=True,
        )
        self._shown: dict[Bench, tuple[object, Shown]] = {}
        self._joints = tuple(knob.name for knob in joints)
        driven = linkage.linkage.input_names
        self._follows = len(driven) < len(joints)
        self.title = finger.name
        others = [*self._linkage.knobs, *self._scene.knobs]
        self.knobs: tuple[Knob, ...] = (
            *(knob for knob in joints if knob.name in driven),
            *(knob for knob in others if knob.kind == "dimension"),
        )
        aims = (("linkage first", self._linkage.aim), ("then camera and mirrors", self._scene.aim))
        self.aim = "; ".join(f"{what}: {aim}" for what, aim in aims if aim)

    def draw(self, area: SubFigure) -> None:
        """The linkage on the left, the scene on the right."""
        self._area = area
        halves: Any = area.subfigures(1, 2)
        left, right = halves
        self._linkage.draw(left)
        self._scene.draw(right)

    def show(self, values: Values) -> Shown:
        """Both in one pose."""
        values = self._posed(values)
        linkage = self._side(self._linkage, values)
        scene = self._side(self._scene, values)
        readings = [
            dataclasses.replace(reading, name=SIDE + reading.name)
            for reading in linkage.readings
            if reading.name not in self._joints
        ]
        angles = [Reading(name, values[name], "°") for name in self._joints]
        return Shown(
            [*angles, *readings, *scene.readings],
            [*linkage.artists, *scene.artists],
            "; ".join(message for message in (linkage.message, scene.message) if message),
        )

    def _side(self, bench: Bench, values: Values) -> Shown:
        """One of both; what has not been turned is shown already, in an area of this size."""
        own, size = _own(bench, values), tuple(self._area.bbox.bounds)
        before = self._shown.get(bench)
        if before is not None and before[0] == (own, size):
            return before[1]
        shown = bench.show(own)
        self._shown[bench] = (own, size), shown
        return shown

    def specs(self, values: Values) -> Sequence[SpecFile]:
        """The linkage file, of the straight finger, and the scene file."""
        straight = {**values, **dict.fromkeys(self._joints, 0.0)}
        linkage = self._linkage.specs(_own(self._linkage, straight))
        return [*linkage, *self._scene.specs(self._posed(values))]

    def optimise(self, values: Values) -> Iterator[Step]:
        """The linkage's steps, then those of camera and mirrors.

        Raises:
            UserError: neither of them can be improved from here, and why.
        """
        faults = []
        own = {knob.name for knob in self.knobs}
        for part, bench in (("linkage", self._linkage), ("camera and mirrors", self._scene)):
            try:
                for step in bench.optimise(_own(bench, self._posed(values))):
                    found = {name: step.values[name] for name in own & {*step.values}}
                    values = {**values, **found}
                    yield Step(values, f"{part}: {step.message}")
            except UserError as error:
                faults.append(f"{part}: {error}")
                if len(faults) > 1:
                    raise UserError("; ".join(faults)) from error
                yield Step(values, faults[0])

    def _posed(self, values: Values) -> Values:
        """The values with DIP where the linkage holds it; straight where it has no pose."""
        if not self._follows:
            return values
        pip = -math.radians(values["pip"])
        bent, ok = _find_dip(self._linkage.linkage(values), jnp.array([pip]))
        return {**values, "dip": math.degrees(float(bent)) if bool(ok) else 0.0}


@jax.jit
def _find_dip(linkage: Linkage, inputs: Float[Array, "1"]) -> tuple[Array, Array]:
    """Flexion of DIP, rad, and whether there is such a pose."""
    pose = solve_poses(linkage, inputs)
    turns = pose.value.bodies
    return -turns["distal"].turned(turns["intermediate"].conjugate()).angle(), pose.ok


def _own(bench: Bench, values: Values) -> dict[str, float]:
    return {knob.name: values[knob.name] for knob in bench.knobs}
