"""A finger as named numbers that can be optimized, with the requirements of its studies."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property, partial

from jaxtyping import Array, Float

from designopt.errors import UserError
from designopt.io.spec import SpecFile
from designopt.optimize.parametric import Measure, MeasureBound, ParametricDesign, Values
from studies.models.finger import Finger
from studies.models.finger_file import finger_tables, parse_finger
from studies.models.finger_parametric.asking import Aspect, joined
from studies.models.finger_parametric.compiled import CompiledFunctions
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
        self._limits, self._motor = limits, motor
        self._mirrors = own_mirrors(finger) if mirrors is None else mirrors
        self._of = FingerParameters(finger, self._mirrors)
        self.parameters = self._of.parameters
        names = [one.name for one in self.parameters]
        self.free = tuple(name for name in names if name.startswith(FREE))
        self._compiled: dict[frozenset[str], CompiledFunctions] = {}

    @cached_property
    def _aspects(self) -> list[Aspect]:
        """Linkage and optics, as far as there are; made when something is measured."""
        finger, found = self.designed, list[Aspect]()
        if finger.pins is not None:
            from studies.models.finger_parametric.links import LinkageAspect, own_limits

            limits = own_limits(finger) if self._limits is None else self._limits
            found.append(LinkageAspect(finger, limits, self._motor or MotorSpec()))
        if finger.camera is not None:
            found.append(OpticsAspect(finger, self._mirrors))
        return found

    @cached_property
    def measures(self) -> tuple[Measure, ...]:  # pyright: ignore[reportIncompatibleVariableOverride]
        """See `ParametricDesign`."""
        between = Measure(CLEARANCE, "mm", "least of all clearances", scale=LENGTH)
        return (*(one.measure for aspect in self._aspects for one in aspect.asked), between)

    @cached_property
    def requirements(self) -> tuple[MeasureBound, ...]:  # pyright: ignore[reportIncompatibleVariableOverride]
        """See `ParametricDesign`."""
        bounds = (one.bound for aspect in self._aspects for one in aspect.asked)
        return tuple(bound for bound in bounds if bound is not None)

    @property
    def _gaps(self) -> dict[str, float]:
        return {name: taken for aspect in self._aspects for name, taken in aspect.gaps.items()}

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
        gaps = self._gaps if CLEARANCE in of else {}
        wanted = frozenset((*of, *gaps)) - {CLEARANCE}
        if wanted not in self._compiled:
            self._compiled[wanted] = self._compile(wanted)
        found = self._compiled[wanted](values)
        if gaps:
            found[CLEARANCE] = joined(found[name] - taken for name, taken in gaps.items())
        return {name: found[name] for name in of}

    def _compile(self, wanted: frozenset[str]) -> CompiledFunctions:
        functions, columns = [], []
        for aspect in self._aspects:
            own = wanted & {one.measure.name for one in aspect.asked}
            if own:
                functions.append(partial(self._measured, aspect, own))
                names = enumerate(one.name for one in self.parameters)
                columns.append([i for i, name in names if name.startswith(aspect.concerned)])
        return CompiledFunctions(functions, columns, len(self.parameters))

    def _measured(
        self, aspect: Aspect, own: frozenset[str], values: Float[Array, " parameters"]
    ) -> dict[str, Float[Array, "..."]]:
        found = aspect.evaluate(self.traced(values), own)
        return {name: found[name] for name in own}

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
