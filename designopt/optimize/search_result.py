"""What a search for a better design has come to: the design, and what holds it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from designopt.optimize.optimality import Active
from designopt.optimize.parametric import MeasureBound, ParametricDesign, amount_text, find_measure


@dataclass(frozen=True)
class SearchResult:
    """What a search has come to.

    Attributes:
        objective: name of the measure that was improved.
        free: ranges of the parameters that could change.
        keep: all requirements, the design's own first.
        before: every parameter, as it was at the start.
        values: every parameter, as it was found.
        judged_before: every measure at the start, by `ParametricDesign.judge`; empty where that
            is no design.
        judged: every measure of what was found.
        active: what holds it, the dearest first; prices in the objective's unit: by how much it
            would gain, to first order, if one unit less were asked.
        slopes: of the objective and of every measure that is asked for, by the free parameters:
            what one unit more of a parameter changes; empty, as ``active``, where the search found
            nothing better than the start.
        missed: the requirements that are missed, with their margins (negative), worst first.
        conflict: requirements that no design near can meet better together, each with what it is
            short of; empty where all are met, or where nothing shows that they conflict.
        is_optimum: whether nothing near is better, to first order.
        why: what ended the search, in words.
    """

    objective: str
    free: dict[str, tuple[float, float]]
    keep: tuple[MeasureBound, ...]
    before: dict[str, float]
    values: dict[str, float]
    judged_before: dict[str, float]
    judged: dict[str, float]
    active: tuple[Active, ...]
    slopes: dict[str, dict[str, float]]
    missed: tuple[tuple[MeasureBound, float], ...]
    conflict: tuple[str, ...]
    is_optimum: bool
    why: str

    @property
    def labels(self) -> dict[str, MeasureBound]:
        """The requirements by the names that `active` has for them."""
        return dict(zip(labels_of(self.keep), self.keep, strict=True))

    def summary(self, design: ParametricDesign) -> str:
        """What was reached, in one line."""
        if self.conflict:
            return f"the requirements conflict: {'; '.join(self.conflict)}"
        unit = find_measure(design, self.objective).unit
        now, was = (
            amount_text(judged[self.objective], unit) if judged else "no design"
            for judged in (self.judged, self.judged_before)
        )
        what = f"{now} instead of {was}" if now != was else f"{now}, as before"
        short = f"; {len(self.missed)} requirements are missed" if self.missed else ""
        return f"{self.objective} {what}; {self.why}{short}"

    def lines(self, design: ParametricDesign) -> tuple[str, ...]:
        """What holds the result and what it costs, or what is missed, one line each."""
        unit = find_measure(design, self.objective).unit
        lines = [
            f"missed: {bound} by {amount_text(-margin, find_measure(design, bound.measure).unit)}"
            for bound, margin in self.missed
        ]
        lines += [f"conflict: {line}" for line in self.conflict]
        lines += [
            f"held by {one.words}: to ease it by {amount_text(1.0, one.unit)} gives "
            f"{amount_text(one.price, unit)}"
            for one in self.active
        ]
        return tuple(lines)


@dataclass(frozen=True)
class SearchStep:
    """One iteration of a search.

    Attributes:
        phase: what it is part of: meeting the requirements, a search from some start, …
        values: of every parameter after it.
        message: what it reached, in one line.
        done: whether it is the last one.
        report: of the last one: what holds it and what that costs, or what is missed.
        result: of the last one.
    """

    phase: str
    values: dict[str, float]
    message: str
    done: bool = False
    report: tuple[str, ...] = ()
    result: SearchResult | None = field(default=None, repr=False)


def labels_of(keep: Sequence[MeasureBound]) -> list[str]:
    """Names of requirements, of which two may be on one measure."""
    return [f"{number} {bound.measure}" for number, bound in enumerate(keep)]
