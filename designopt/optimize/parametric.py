"""A design as named numbers: parameters that may change, and measures that follow from them.

What ``designopt optimise`` searches, and what ``designopt explore`` turns; it does not depend on
either.
"""

from __future__ import annotations

import abc
import difflib
import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from designopt.errors import UserError
from designopt.io.spec import SpecFile

Values = Mapping[str, float]
"""A number for every parameter, by its name, in its unit."""


@dataclass(frozen=True)
class Parameter:
    """One number that may be changed.

    Attributes:
        name: unique in its design; parts joined by dots, as in the JSON export:
            ``bodies.coupler.A-B``, ``mirrors.distal.from.x``, ``camera.direction``.
        value: as designed.
        low: its least value.
        high: its greatest value.
        unit: of all three: ``"mm"``, ``"°"``, ``"N mm/rad"`` or empty.
        label: as people read it, such as "coupler A–B"; the name if empty.
        limits: between which it makes sense, itself not among them, such as a length above 0.
    """

    name: str
    value: float
    low: float
    high: float
    unit: str = "mm"
    label: str = ""
    limits: tuple[float, float] = (-math.inf, math.inf)


@dataclass(frozen=True)
class Measure:
    """A quantity by which a design is judged, over all its postures.

    Attributes:
        name: unique in its design, such as ``min_transmission`` or ``coverage.distal``.
        unit: of its values: ``"°"``, ``"mm"``, ``"px/mm"`` or empty.
        description: what it is, for people: a noun phrase.
        worst: which of the elements of its array counts.
        scale: a change that matters as much as a parameter's whole range does.
        limits: least and greatest value that it can have.
        where: from the index of an element to words, such as "at PIP 30°"; empty words for one
            number.
    """

    name: str
    unit: str
    description: str
    worst: Literal["least", "greatest"] = "least"
    scale: float = 1.0
    limits: tuple[float, float] = (-math.inf, math.inf)
    where: Callable[[tuple[int, ...]], str] = lambda index: ""


Relation = Literal[">=", "<="]


@dataclass(frozen=True)
class MeasureBound:
    """A requirement: a measure that must be at least, or at most, some value.

    Attributes:
        measure: its name.
        relation: of the measure to the value.
        value: in the measure's unit.
        label: what is asked for, for people; the three others if empty.
    """

    measure: str
    relation: Relation
    value: float
    label: str = ""

    @classmethod
    def parse(cls, text: str) -> MeasureBound:
        """The requirement that a person writes, such as ``mu.B>=40``.

        Args:
            text: a measure's name, ``>=`` or ``<=``, and a number.

        Raises:
            UserError: it is not of that form.

        Example:
            >>> MeasureBound.parse("mu.B >= 40").value
            40.0
        """
        found = re.fullmatch(r"\s*(\S|\S.*?\S)\s*(>=|<=|≥|≤)\s*(\S+)\s*", text)
        try:
            assert found is not None
            name, relation, number = found.groups()
            value = float(number)
        except (AssertionError, ValueError):
            raise UserError(
                f"--keep {text!r}: write a measure, >= or <=, and a number, such as 'mu.B>=40'"
            ) from None
        if not np.isfinite(value):
            raise UserError(f"--keep {text!r}: {number} is no limit; give a finite number")
        return cls(name, ">=" if relation in (">=", "≥") else "<=", value)

    def __str__(self) -> str:
        return self.label or f"{self.measure} {self.relation} {self.value:g}"

    def margin(self, value: float) -> float:
        """By how much a value meets it, in the measure's unit; negative where it does not."""
        return value - self.value if self.relation == ">=" else self.value - value


TOLERANCE = 1e-6
"""A requirement that is missed by a smaller part of its measure's scale is met."""


class ParametricDesign(abc.ABC):
    """A design as a function of its parameters; JAX is in float64 wherever it is called."""

    title: str
    """Its name, for people."""

    parameters: tuple[Parameter, ...]
    """Every number that may change; joint angles are not among them."""

    measures: tuple[Measure, ...]
    """All that can be maximised, minimised or kept; the first is what is improved by default."""

    free: tuple[str, ...] | None = None
    """Names of the parameters that an optimisation may change unless others are named; ``None``:
    all of them."""

    requirements: tuple[MeasureBound, ...]
    """What the design itself asks for; every optimisation keeps it."""

    @abc.abstractmethod
    def evaluate(
        self, values: Float[Array, " parameters"], of: tuple[str, ...]
    ) -> dict[str, Float[Array, "..."]]:
        """Measures of a design, differentiable; traced by JAX.

        Beyond what is possible the arrays go on finitely with a slope that leads back: a pad that
        is wholly hidden has a coverage below 0 by the angle (rad) by which it is missed.

        Args:
            values: of all parameters, in their order and units.
            of: names of the measures that are asked for; others are not traced.

        Returns:
            An array for each of these, whose least or greatest element counts.
        """

    @abc.abstractmethod
    def judge(self, values: Values) -> dict[str, float]:
        """Every measure of a design, computed apart from `evaluate`: finer, or by another way.

        Raises:
            UserError: these values give no design, and why.
        """

    @abc.abstractmethod
    def files(self, values: Values) -> Sequence[SpecFile]:
        """The files that describe the design, which the other commands read.

        Args:
            values: of all parameters; also of an explorer's joints where they show a pose.

        Raises:
            UserError: these values give no design, and why.
        """

    def values(self) -> dict[str, float]:
        """As designed."""
        return {parameter.name: parameter.value for parameter in self.parameters}

    def vector(self, values: Values) -> Float[Array, " parameters"]:
        """Values in the order of the parameters."""
        return jnp.array([values[parameter.name] for parameter in self.parameters], float)


def shortfalls(
    measures: Iterable[Measure], judged: Mapping[str, float], keep: Iterable[MeasureBound]
) -> list[tuple[MeasureBound, float]]:
    """The requirements that a judged design misses, each with its margin (negative), worst first.

    Args:
        measures: of the design.
        judged: what `ParametricDesign.judge` returned.
        keep: the requirements.

    Example:
        >>> measures = [Measure("mu", "°", "transmission angle")]
        >>> keep = [MeasureBound("mu", ">=", 40.0), MeasureBound("mu", ">=", 30.0)]
        >>> [(str(bound), margin) for bound, margin in shortfalls(measures, {"mu": 38.0}, keep)]
        [('mu >= 40', -2.0)]
    """
    scales = {measure.name: measure.scale for measure in measures}
    margins = [(bound, bound.margin(judged[bound.measure])) for bound in keep]
    missed = [
        (bound, margin)
        for bound, margin in margins
        if not margin >= -TOLERANCE * scales[bound.measure]
    ]
    return sorted(missed, key=lambda one: one[1] / scales[one[0].measure])


def find_measure(design: ParametricDesign, name: str) -> Measure:
    """A measure by its name.

    Raises:
        UserError: there is none of that name.
    """
    measures = {one.name: one for one in design.measures}
    if name not in measures:
        raise UserError(
            f"{design.title}: it has no measure '{name}'; {_hint(name, measures, 'it has')}"
        )
    return measures[name]


def free_parameters(
    design: ParametricDesign,
    free: Sequence[str] = (),
    bounds: Mapping[str, tuple[float | None, float | None]] | None = None,
) -> dict[str, tuple[float, float]]:
    """Ranges of the parameters that a search may change.

    Args:
        design: the design.
        free: their names, or beginnings of names up to a dot, such as ``mirrors.distal``; by
            default those that the design frees.
        bounds: other bounds of some of them than the design's.

    Raises:
        UserError: there is no such parameter, or its bounds leave nothing.
    """
    known = {one.name: one for one in design.parameters}
    names = list(free) or list(known if design.free is None else design.free)
    found: dict[str, tuple[float, float]] = {}
    # Of a name and the beginning of it, the name's own bounds hold, in whatever order they come.
    for name in sorted(names, key=len):
        own = [one for one in known if one == name or one.startswith(f"{name}.")]
        if not own:
            raise UserError(
                f"--free {name}: {design.title} has no such parameter; "
                f"{_hint(name, known, 'there are')}"
            )
        for one in own:
            ends = (bounds or {}).get(name, (None, None))
            if ends == (None, None) and one in found:
                continue
            parameter = known[one]
            low, high = (
                default if end is None else end
                for end, default in zip(ends, (parameter.low, parameter.high), strict=True)
            )
            if not low < high:
                raise UserError(f"--free {name}={low:g}:{high:g}: leave it a range, low < high")
            least, most = parameter.limits
            if not least < low or not high < most:
                raise UserError(
                    f"--free {name}={low:g}:{high:g}: {one} lies between {least:g} and "
                    f"{amount_text(most, parameter.unit)}, ends not included"
                )
            found[one] = low, high
    return {name: found[name] for name in known if name in found}


def check_bounds(design: ParametricDesign, keep: Sequence[MeasureBound]) -> None:
    """Refuse requirements that nothing can meet, before anything is compiled.

    Raises:
        UserError: a measure is unknown, its relation makes no sense, or its value is beyond what it
            can be.
    """
    for bound in keep:
        measure = find_measure(design, bound.measure)
        natural = ">=" if measure.worst == "least" else "<="
        if bound.relation != natural:
            raise UserError(
                f"--keep '{bound.measure}{bound.relation}{bound.value:g}': of {bound.measure} the "
                f"{measure.worst} value counts, over all postures; write {natural}"
            )
        low, high = measure.limits
        beyond = bound.value > high if natural == ">=" else bound.value < low
        if beyond:
            end, limit = ("at most", high) if natural == ">=" else ("at least", low)
            raise UserError(
                f"--keep '{bound.measure}{bound.relation}{bound.value:g}': {measure.description} "
                f"is {end} {amount_text(limit, measure.unit)}"
            )


def amount_text(value: float, unit: str) -> str:
    """A number with its unit, to four digits."""
    return f"{value:.4g}{'' if unit in ('', '°') else ' '}{unit}"


def _hint(name: str, known: Iterable[str], there_are: str) -> str:
    close = difflib.get_close_matches(name, list(known), n=1)
    return f"did you mean '{close[0]}'?" if close else f"{there_are} {', '.join(known)}"
