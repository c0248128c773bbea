"""A finger as named numbers that can be optimized, with the requirements of its studies."""

from __future__ import annotations

from collections.abc import Sequence

from jaxtyping import Array, Float

from designopt.errors import UserError
from designopt.io.spec import SpecFile
from designopt.optimize.parametric import Measure, ParametricDesign, Values
from studies.models.finger import Finger
from studies.models.finger_file import finger_tables, parse_finger
from studies.models.finger_parametric.asking import Asked, Aspect, joined
from studies.models.finger_parametric.links import LinkageAspect, own_limits
from studies.models.finger_parametric.optics import OpticsAspect, own_mirrors
from studies.models.finger_parametric.parameters import FREE, FingerParameters
from studies.models.linkage_design.problem import LENGTH
from studies.models.linkage_design.spec import LimitsSpec, MotorSpec
from studies.models.mirror_design.spec import MirrorSpec
from studies.models.spec_files import finger_files

CLEARANCE = "clearance"
"""Name of the least of all clearances: of bars, pins, mirrors and camera."""


class FingerParametric(ParametricDesign):
    """A finger, six-bar or coupled, whose linkage and optics must meet what their studies ask for.

    Where a finger has no links or spring its linkage is judged with the usual ones.

    Attributes:
        designed: the finger as designed.

    Example:
        >>> from studies.models.finger_file import packaged_finger
        >>> design = FingerParametric(packaged_finger())
        >>> design.values()["pins.F.x"], design.measures[0].name
        (-9.13, 'min_transmission')
    """

    def __init__(
        self,
        finger: Finger,
        limits: LimitsSpec | None = None,
        motor: MotorSpec | None = None,
        mirrors: MirrorSpec | None = None,
    ) -> None:
        """The design.

        Args:
            finger: with pins, a camera or both.
            limits: what the linkage must leave in every posture. By default that of the settings,
                with a width that the finger has.
            motor: what turns the crank; by default that of the settings.
            mirrors: what is asked of the optics. By default that of the settings, with the blur
                that the finger's camera accepts, and membranes as long as the finger's.

        Raises:
            UserError: the finger has neither pins nor a camera.
        """
        if finger.pins is None and finger.camera is None:
            raise UserError(
                f"{finger.name}: it has neither a linkage nor a camera; add [pins] or [camera]"
            )
        self.title, self.designed = finger.name, finger
        mirrors = own_mirrors(finger) if mirrors is None else mirrors
        self._of = FingerParameters(finger, mirrors)
        self.parameters = self._of.parameters
        names = [one.name for one in self.parameters]
        self.free = tuple(name for name in names if name.startswith(FREE))
        aspects: list[Aspect] = []
        if finger.pins is not None:
            limits = own_limits(finger) if limits is None else limits
            aspects.append(LinkageAspect(finger, limits, motor or MotorSpec()))
        if finger.camera is not None:
            aspects.append(OpticsAspect(finger, mirrors))
        self._aspects = aspects
        self._gaps = {name: taken for aspect in aspects for name, taken in aspect.gaps.items()}
        asked = [one for aspect in aspects for one in aspect.asked]
        between = Measure(CLEARANCE, "mm", "least of all clearances", scale=LENGTH)
        asked.append(Asked(between, None, CLEARANCE))
        self.measures = tuple(one.measure for one in asked)
        self.requirements = tuple(one.bound for one in asked if one.bound is not None)

    def finger(self, values: Values) -> Finger:
        """The finger of other values, as its file describes it.

        Raises:
            UserError: there is no such finger, and why.
        """
        moved = self._of.finger(self.vector(values))
        return parse_finger(finger_tables(moved), self.title)

    def traced(self, values: Float[Array, " parameters"]) -> Finger:
        """The finger of other values, in the parameters' order; assembled as designed."""
        return self._of.finger(values)

    def evaluate(
        self, values: Float[Array, " parameters"], of: tuple[str, ...]
    ) -> dict[str, Float[Array, "..."]]:
        """See `ParametricDesign.evaluate`."""
        finger, found = self.traced(values), {}
        gaps = self._gaps if CLEARANCE in of else {}
        wanted = frozenset((*of, *gaps))
        for aspect in self._aspects:
            if wanted & {one.measure.name for one in aspect.asked}:
                found |= aspect.evaluate(finger, wanted)
        if gaps:
            found[CLEARANCE] = joined(found[name] - taken for name, taken in gaps.items())
        return {name: found[name] for name in of}

    def judge(self, values: Values) -> dict[str, float]:
        """See `ParametricDesign.judge`; all but the yield with errors of assembly."""
        finger = self.finger(values)
        found = {
            name: value for aspect in self._aspects for name, value in aspect.judge(finger).items()
        }
        found[CLEARANCE] = min(found[name] - taken for name, taken in self._gaps.items())
        return {one.name: found[one.name] for one in self.measures}

    def files(self, values: Values) -> Sequence[SpecFile]:
        """The finger's file, and those of its linkage and its scene."""
        return finger_files(self.finger(values))
