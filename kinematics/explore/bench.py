"""A linkage with knobs: its pose, traced curves, margin and transmission angles as they turn."""

from __future__ import annotations

import functools
import math
import tomllib
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from designopt.errors import UserError
from designopt.explore.bench import Bench, Knob, Reading, Shown, Step, Values
from designopt.io.spec import SpecFile
from kinematics.explore.dimensions import Dimensions
from kinematics.explore.survey import InputSweep, SweepEvaluator
from kinematics.explore.working_range import INSIDE, WorkingRange
from kinematics.io.designed import DesignedLinkage
from kinematics.io.reading import parse_linkage
from kinematics.model.assembled import zeroed
from kinematics.model.linkage import Linkage
from kinematics.model.topology import InputPart

if TYPE_CHECKING:
    from matplotlib.figure import SubFigure

    from kinematics.explore.optimising import LocalOptimizer
    from kinematics.explore.picture import Picture

MOST_DIMENSIONS = 18
"""More knobs than these fit no window; a link's own length comes before other distances."""

SHORTEST, LONGEST = 0.5, 1.7
"""Range of a dimension, as parts of what it is."""

SAME = 1e-9
"""Rad or mm by which an input has not moved."""

BEYOND = 0.12
"""How far an input's knob goes beyond its limits, as a part of its range, so that one runs into
lock-up."""


class LinkageBench(Bench):
    """Inputs and lengths of a linkage as knobs."""

    def __init__(
        self,
        design: DesignedLinkage,
        *,
        ranges: Mapping[str, tuple[float, float]] | None = None,
        held: Collection[str] = (),
        opposite: bool = False,
    ) -> None:
        """The bench of a linkage, without a picture yet.

        Args:
            design: the linkage.
            ranges: least and greatest values of inputs by name, degrees or mm as they are shown:
                nothing beyond is drawn, judged or optimised. The others go beyond their limits.
            held: names of distances without a knob, such as ``"coupler A-B"``.
            opposite: whether inputs are shown with the opposite of the linkage's sign.
        """
        self._design = design
        self._structure = design.linkage.structure
        self._sign = -1.0 if opposite else 1.0
        self._dimensions, self._distances = Dimensions.of(design)
        self._surveyor = SweepEvaluator(design.linkage, self._dimensions, self._sign)
        self._home = np.asarray(design.linkage.reference.inputs, float)
        names = [distance.name for distance in self._dimensions.distances]
        free = [number for number in self._dimensions.free if names[number] not in held]
        self._free = free[:MOST_DIMENSIONS]
        inputs = [self._input_knob(column, ranges or {}) for column in range(len(self._home))]
        self.title = design.name
        self.knobs = (*inputs, *map(self._length_knob, self._free))
        self.aim = self._aim()
        self._spans = [
            (self._inside(part, knob.low), self._inside(part, knob.high))
            for part, knob in zip(self._structure.inputs, inputs, strict=True)
        ]
        self._working = WorkingRange(self._surveyor, self._spans)
        self._swept = 0
        self._last = self._inputs({knob.name: knob.value for knob in self.knobs})
        self._picture: Picture | None = None

    def draw(self, area: SubFigure) -> None:
        """See `Bench`."""
        from kinematics.explore.picture import Picture

        surveys = [
            self._surveyor.survey(self._distances, self._home, column, span)
            for column, span in enumerate(self._spans)
        ]
        self._picture = Picture(area, self._structure, self._surveyor.pins, surveys)
        # What only some moves run compiles now, so that the first one is as fast.
        self._surveyor.warm_up(self._distances, self._home)
        surveys[0].message()
        self._least(self._distances, self._home, surveys[0])

    def show(self, values: Values) -> Shown:
        """See `Bench`; the input that moved last is the abscissa of margin and angles."""
        assert self._picture is not None, "draw first"
        inputs, distances = self._inputs(values), self.distances(values)
        moved = np.flatnonzero(np.abs(inputs - self._last) > SAME)
        if moved.size:
            self._swept = int(moved[0])
        self._last = inputs
        broken = self._dimensions.broken(distances.tolist())
        survey, least = None, None
        if not broken:
            span = self._spans[self._swept]
            survey = self._surveyor.survey(distances, inputs, self._swept, span)
            least = self._least(distances, inputs, survey)
        artists = self._picture.show(survey)
        message = broken if survey is None else _matter(survey)
        return Shown(self._readings(inputs, survey, least), artists, message)

    def specs(self, values: Values) -> Sequence[SpecFile]:
        """See `Bench`: the linkage as it is shown, or where it has no pose there, as sketched."""
        from kinematics.explore.spec_text import spec_text

        distances = self._made(values)
        linkage, fault = self._surveyor.shaped(distances), ""
        poses = {"as it stands": self._inputs(values), "in its first pose": self._home}
        for pose, inputs in poses.items():
            survey = self._surveyor.survey(distances, inputs, 0, self._spans[0])
            fault = survey.message()
            if not survey.ok:
                continue
            text = spec_text(linkage, self._dimensions, inputs)
            try:
                parse_linkage(tomllib.loads(text), self.title)
            except UserError as error:  # such as a pose in which an assembly is not decided
                fault = str(error)
                continue
            title = f"the linkage {pose}, for designopt solve, explore and export"
            return [SpecFile("linkage.toml", title, text)]
        raise UserError(
            f"'{self.title}' as it stands cannot be sketched in a file, neither in this pose nor "
            f"in the first one: {fault}"
        )

    def optimise(self, values: Values) -> Iterator[Step]:
        """See `Bench`."""
        if not self.aim:
            raise UserError(
                f"'{self.title}' has no pin with a transmission angle: nothing to optimise"
            )
        distances = self._made(values)
        return (
            Step({**values, **self._named(found)}, message)
            for found, message in self._improver.steps(distances, self._inputs(values))
        )

    @functools.cached_property
    def _improver(self) -> LocalOptimizer:
        from kinematics.explore.optimising import LocalOptimizer

        ranges = {
            number: (knob.low, knob.high)
            for number, knob in zip(self._free, self.knobs[len(self._home) :], strict=True)
        }
        return LocalOptimizer(self._surveyor, self._distances, self._working, ranges)

    def distances(self, values: Values) -> np.ndarray:
        """All distances of the linkage's dimensions, mm, those without a knob among them."""
        distances = self._distances.copy()
        for number in self._free:
            distances[number] = values[self._dimensions.distances[number].name]
        return distances

    def _made(self, values: Values) -> np.ndarray:
        distances = self.distances(values)
        broken = self._dimensions.broken(distances.tolist())
        if broken:
            raise UserError(broken)
        return distances

    def linkage(self, values: Values) -> Linkage:
        """The linkage as it stands."""
        return self._surveyor.shaped(self.distances(values))

    def _named(self, distances: np.ndarray) -> dict[str, float]:
        return {
            self._dimensions.distances[number].name: float(distances[number])
            for number in self._free
        }

    def _inputs(self, values: Values) -> np.ndarray:
        return np.array(
            [self._inside(part, values[part.name]) for part in self._structure.inputs], float
        )

    def _inside(self, part: InputPart, value: float) -> float:
        """An input in rad or mm, of what its knob shows."""
        return self._sign * (math.radians(value) if part.slider is None else float(value))

    def _outside(self, part: InputPart, value: float) -> float:
        """What an input's knob shows, of rad or mm."""
        return zeroed(self._sign * (math.degrees(value) if part.slider is None else value))

    def _length_knob(self, number: int) -> Knob:
        value = float(self._distances[number])
        name = self._dimensions.distances[number].name
        return Knob(name, value, SHORTEST * value, LONGEST * value, "mm", "dimension")

    def _input_knob(self, column: int, ranges: Mapping[str, tuple[float, float]]) -> Knob:
        part = self._structure.inputs[column]
        turns = part.slider is None
        unit = "°" if turns else "mm"
        home = float(self._home[column])
        value = self._outside(part, home)
        if part.name in ranges:
            low, high = ranges[part.name]
            return Knob(part.name, min(max(value, low), high), low, high, unit, "joint")
        far = math.pi if turns else float(np.sum(self._distances))
        survey = self._surveyor.survey(
            self._distances, self._home, column, (home - far, home + far)
        )
        below = [edge.value for edge in survey.edges if edge.value <= home]
        above = [edge.value for edge in survey.edges if edge.value > home]
        if turns and not below and not above:
            low, high = (0.0, 360.0) if value > 1e-9 else (-180.0, 180.0)
            return Knob(part.name, value, low, high, unit, "joint")
        ends = max(below, default=home - far), min(above, default=home + far)
        low, high = sorted(self._outside(part, end) for end in ends)
        spare = BEYOND * (high - low)
        low, high = math.floor(low - spare), math.ceil(high + spare)
        return Knob(part.name, value, float(low), float(high), unit, "joint")

    def _aim(self) -> str:
        if not self._surveyor.pins:
            return ""
        names = " and ".join(self._design.linkage.input_names)
        if len(self._home) > 1:
            over = f"over a grid of all poses that the knobs of {names} give"
        else:
            over = f"over the range of {names} in which it works, {INSIDE:.0%} short of its limits"
        return f"least μ, the least transmission angle {over}, as large as it gets"

    def _least(self, distances: np.ndarray, inputs: np.ndarray, survey: InputSweep) -> float | None:
        return self._working.least(distances, inputs, survey) if self._surveyor.pins else None

    def _readings(
        self, inputs: np.ndarray, survey: InputSweep | None, least: float | None
    ) -> list[Reading]:
        readings = [
            Reading(part.name, self._outside(part, value), "°" if part.slider is None else "mm")
            for part, value in zip(self._structure.inputs, inputs.tolist(), strict=True)
        ]
        good = survey if survey is not None and survey.ok else None
        readings.append(Reading("margin", None if survey is None else survey.margin_here, "mm"))
        angles = {} if good is None else good.angles_here()
        for pin in self._surveyor.pins:
            angle = angles.get(pin)
            readings.append(Reading(f"μ at {pin}", _degrees(angle), "°"))
        if self._surveyor.pins:
            readings.append(Reading("least μ", least, "°"))
        if self._surveyor.iterated:
            readings.append(Reading("closure", None if good is None else good.closure_here, "mm"))
        return readings


def _degrees(angle: float | None) -> float | None:
    return None if angle is None else math.degrees(angle)


def _matter(survey: InputSweep) -> str:
    """Why there is no pose, and where there is one; empty if there is."""
    if survey.ok:
        return ""
    if not survey.edges:
        return f"{survey.message()} No {survey.swept.name} in its range gives a pose."
    nearest = min(survey.edges, key=lambda edge: abs(edge.value - survey.here))
    return f"{survey.message()} {survey.swept.name} locks at {survey.told(nearest.value)}."
