"""A design improved in one measure, with every requirement kept: what is found, and what holds it.

The measure is maximised in its epigraph form by an augmented Lagrangian around BFGS, from the
design as it is and from other starts. What `ParametricDesign.evaluate` finds on its grid is then
judged by `ParametricDesign.judge`: where that misses a requirement, more of it is asked for, and
the search goes on, as in an exchange method (R. Hettich, K. O. Kortanek, SIAM Rev. 35 (1993) 380).
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Generator, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from designopt.errors import UserError
from designopt.optimize.augmented_lagrangian import Trace
from designopt.optimize.flat import Flat
from designopt.optimize.iterating import Iteration
from designopt.optimize.optimality import (
    FEASIBLE,
    Active,
    Optimum,
    OptimumResult,
    explain_shortfall,
    find_active_set,
    make_optimality_check,
)
from designopt.optimize.parametric import (
    Bound,
    Measure,
    ParametricDesign,
    Values,
    shortfalls,
)
from designopt.optimize.problem import (
    EpigraphVariables,
    Evaluation,
    Problem,
    Requirement,
    make_elastic,
    make_epigraph,
)
from designopt.optimize.starts import draw_sobol_starts
from designopt.quick_compilation import compile_quickly

UPDATES = 120
"""Cap on iterations of one search, of a few steps each."""

GAIN, PATIENCE = 1e-3, 12
"""So many iterations that together gain less than this part of the measure's scale end it."""

ROUNDS, RESERVE = 3, 1.5
"""How often more is asked of what the judge misses, and how many times what is missing."""

MEETING = "meeting the requirements"

BETTER = 1e-9
"""A gain of a smaller part of the measure's scale is none."""


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
            what one unit more of a parameter changes.
        missed: the requirements that are missed, with their margins (negative), worst first.
        conflict: requirements that cannot be met together from any start, each with what it is
            short of; empty where all are met, or where nothing shows that they conflict.
        is_optimum: whether nothing near is better, to first order.
        why: what ended the search, in words.
    """

    objective: str
    free: dict[str, tuple[float, float]]
    keep: tuple[Bound, ...]
    before: dict[str, float]
    values: dict[str, float]
    judged_before: dict[str, float]
    judged: dict[str, float]
    active: tuple[Active, ...]
    slopes: dict[str, dict[str, float]]
    missed: tuple[tuple[Bound, float], ...]
    conflict: tuple[str, ...]
    is_optimum: bool
    why: str

    @property
    def labels(self) -> dict[str, Bound]:
        """The requirements by the names that `active` has for them."""
        return dict(zip(_labels(self.keep), self.keep, strict=True))

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
            f"held by {one.words}: {amount_text(1.0, one.unit)} less would give "
            f"{amount_text(one.price, unit)} more"
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
    for name in names:
        own = [one for one in known if one == name or one.startswith(f"{name}.")]
        if not own:
            raise UserError(
                f"--free {name}: {design.title} has no such parameter; "
                f"{_hint(name, known, 'there are')}"
            )
        for one in own:
            low, high = (bounds or {}).get(name, (None, None))
            low, high = (
                known[one].low if low is None else low,
                known[one].high if high is None else high,
            )
            if not low < high:
                raise UserError(f"--free {name}={low:g}:{high:g}: leave it a range, low < high")
            found[one] = low, high
    return found


def check_bounds(design: ParametricDesign, keep: Sequence[Bound]) -> None:
    """Refuse requirements that nothing can meet, before anything is compiled.

    Raises:
        UserError: a measure is unknown, its relation makes no sense, its value is beyond what it
            can be, or two requirements leave nothing between them.
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


class DesignSearch:
    """Improves one measure of a design from any start, by programs compiled once."""

    def __init__(
        self,
        design: ParametricDesign,
        objective: str,
        free: Mapping[str, tuple[float, float]],
        keep: Sequence[Bound] = (),
    ) -> None:
        """Nothing is compiled yet.

        Args:
            design: the design.
            objective: name of the measure; its least value is made as large as possible, or its
                greatest value as small.
            free: ranges of the parameters that may change; see `free_parameters`.
            keep: requirements beyond the design's own.

        Raises:
            UserError: there is no such measure or nothing to change, or a requirement that nothing
                can meet; see `check_bounds`.
        """
        if not free:
            raise UserError(f"{design.title}: nothing is free; unlock or name a parameter")
        self.design, self.objective = design, find_measure(design, objective)
        self.keep = (*design.requirements, *keep)
        check_bounds(design, self.keep)
        self.free = {name: free[name] for name in sorted(free)}  # as JAX orders a dictionary
        names = [one.name for one in design.parameters]
        self._places = np.array([names.index(name) for name in self.free])
        asked = (objective, *(bound.measure for bound in self.keep))
        self._asked = tuple(dict.fromkeys(asked))
        self._problem = self._make_problem(design.vector(design.values()))
        self._epigraph = make_epigraph(self._problem, scale=self.objective.scale)
        self._iteration = Iteration(self._epigraph)
        self._look = compile_quickly(self._looked)

    def steps(self, values: Values, starts: int = 1, seed: int = 0) -> Iterator[SearchStep]:
        """Iterations from a design on; the last one has the result, which is never worse.

        Args:
            values: of all parameters, where to begin; what is free is brought inside its bounds.
            starts: from how many starts: these values, and points of a Sobol sequence between the
                bounds.
            seed: of that sequence.
        """
        inside = {
            name: min(max(values[name], low), high) for name, (low, high) in self.free.items()
        }
        first = {**values, **inside}
        data = self.design.vector(first), jnp.zeros(len(self.keep))
        begins = [{name: jnp.array(first[name], float) for name in self.free}]
        if starts > 1:
            drawn = draw_sobol_starts(self._problem, starts - 1, seed)
            begins += [jax.tree.map(lambda leaf, n=n: leaf[n], drawn) for n in range(starts - 1)]
        before = self._judged(values)
        if self._look(begins[0], data)[1] > FEASIBLE:
            conflict, begins = yield from self._make_feasible(begins, data, first)
            if conflict:
                yield self._finish(values, before, first, data, conflict, "no search was made")
                return
        best, best_judged = first, before if first == values else self._judged(first)
        found, why = None, ""
        for number, begin in enumerate(begins):
            phase = f"search {number + 1} of {len(begins)}" if len(begins) > 1 else "search"
            end, reason = yield from self._climb(begin, data, first, phase)
            if found is None or self._rank(end, data) > self._rank(found, data):
                found, why = end, reason
        assert found is not None  # as there is a start
        for again in range(ROUNDS + 1):
            named = self._named(found, first)
            judged = self._judged(named)
            if self._worth(judged) > self._worth(best_judged):
                best, best_judged = named, judged
            missed = shortfalls(self.design, judged, self.keep) if judged else []
            if not missed or again == ROUNDS:
                break
            reserve = np.array(data[1])
            for bound, margin in missed:
                reserve[self.keep.index(bound)] -= RESERVE * margin
            data = data[0], jnp.asarray(reserve)
            found, why = yield from self._climb(found, data, first, "asking for more")
        yield self._finish(values, before, best, data, (), why, best_judged)

    def _make_problem(self, full: Float[Array, " parameters"]) -> Problem:
        """The problem over the free parameters; its data are all parameters, and reserves."""
        keep = dict(zip(_labels(self.keep), self.keep, strict=True))
        sign = 1.0 if self.objective.worst == "least" else -1.0

        def terms(
            free: dict[str, Array],
            full: Float[Array, " parameters"],
            reserve: Float[Array, " keep"],
        ) -> Evaluation:
            changed = full.at[self._places].set(jnp.stack([*free.values()]))
            arrays = self.design.evaluate(changed, self._asked)
            margins = {}
            for number, (label, bound) in enumerate(keep.items()):
                side = 1.0 if bound.relation == ">=" else -1.0
                over = side * (arrays[bound.measure] - bound.value) - reserve[number]
                margins[label] = over / self._measure(bound).scale
            return Evaluation(
                least={self.objective.name: sign * arrays[self.objective.name]},
                inequalities=margins,
            )

        requirements = {}
        for label, bound in keep.items():
            measure = self._measure(bound)
            words = partial(_words, str(bound), measure)
            requirements[label] = Requirement(words, measure.unit, measure.scale)
        labels = {one.name: one for one in self.design.parameters}
        parameters = {
            name: Requirement(partial(_always, labels[name].label or name), labels[name].unit)
            for name in self.free
        }
        low, high = (
            {name: jnp.array(ends[side], float) for name, ends in self.free.items()}
            for side in (0, 1)
        )
        data = full, jnp.zeros(len(self.keep))
        return Problem(
            terms, low, high, requirements=requirements, parameters=parameters, data=data
        )

    def _measure(self, bound: Bound) -> Measure:
        return find_measure(self.design, bound.measure)

    def _looked(self, free: dict[str, Array], data: Any) -> tuple[Array, Array]:
        """The objective, the greater the better, and the largest scaled violation."""
        found = self._problem.terms(free, *data)
        values = [jnp.ravel(part) for part in found.inequalities.values()]
        return -found.value, jnp.max(-jnp.concatenate([*values, jnp.zeros(1)]))

    def _rank(self, free: dict[str, Array], data: Any) -> tuple[bool, float]:
        value, violation = (float(part) for part in self._look(free, data))
        return (True, value) if violation <= FEASIBLE else (False, -violation)

    def _named(self, free: dict[str, Array], first: Values) -> dict[str, float]:
        return {**first, **{name: float(value) for name, value in free.items()}}

    def _judged(self, values: Values) -> dict[str, float]:
        """Every measure; empty where there is no such design."""
        try:
            return self.design.judge(values)
        except UserError:
            return {}

    def _worth(self, judged: Mapping[str, float]) -> tuple[int, float, float]:
        """Greater is better: a design at all, what it misses, what it reaches."""
        if not judged:
            return 0, 0.0, 0.0
        missed = shortfalls(self.design, judged, self.keep)
        worst = min((margin / self._measure(bound).scale for bound, margin in missed), default=0.0)
        value = judged[self.objective.name] / self.objective.scale
        value = value if self.objective.worst == "least" else -value
        return 1, worst, round(value / BETTER) * BETTER if math.isfinite(value) else -math.inf

    def _climb(
        self, begin: dict[str, Array], data: Any, first: Values, phase: str
    ) -> Generator[SearchStep, None, tuple[dict[str, Array], str]]:
        """The best point of one local search, and what ended it."""
        best, rank, trail = begin, self._rank(begin, data), list[tuple[bool, float]]()
        start = EpigraphVariables(begin, self._look(begin, data)[0])
        least = GAIN * self.objective.scale
        for number, one in enumerate(self._iteration.run(start, data, updates=UPDATES), 1):
            free = one.parameters.design
            now = self._rank(free, data)
            if now > rank:
                best, rank = free, now
            trail.append(rank)
            words = f"{phase}, iteration {number}: {self._reached(now)}"
            yield SearchStep(phase, self._named(free, first), words)
            if one.converged:
                return best, "nothing near is better"
            before = trail[-1 - PATIENCE] if len(trail) > PATIENCE else (False, -math.inf)
            if rank[0] and before[0] and rank[1] < before[1] + least:
                return best, f"the last {PATIENCE} iterations gained little"
        return best, f"stopped after {UPDATES} iterations"

    def _make_feasible(
        self, begins: list[dict[str, Array]], data: Any, first: Values
    ) -> Generator[SearchStep, None, tuple[tuple[str, ...], list[dict[str, Array]]]]:
        """Starts that meet all requirements; or, where none is found, what conflicts."""
        form = make_elastic(self._problem)
        iteration, nearest = Iteration(form), (math.inf, begins[0])
        for begin in begins:
            level = self._look(begin, data)[1]
            for number, one in enumerate(
                iteration.run(EpigraphVariables(begin, level), data, updates=UPDATES), 1
            ):
                free = one.parameters.design
                violation = float(self._look(free, data)[1])
                nearest = min(nearest, (violation, free), key=lambda pair: pair[0])
                words = f"{MEETING}, iteration {number}: {violation:.2g} of their scales missed"
                yield SearchStep(MEETING, self._named(free, first), words)
                if violation <= FEASIBLE:
                    return (), [free]
        violation, free = nearest
        flat = Flat.of(form)
        point = flat.point(EpigraphVariables(free, jnp.asarray(violation)))
        optimum = _checked(flat, point, data)
        conflict = explain_shortfall(form, optimum)
        return tuple(conflict or ["no design was found that meets all of them"]), []

    def _reached(self, rank: tuple[bool, float]) -> str:
        met, value = rank
        if not met:
            return "requirements are not met yet"
        value = value if self.objective.worst == "least" else -value
        return f"{self.objective.name} {amount_text(value, self.objective.unit)}"

    def _finish(
        self,
        values: Values,
        before: dict[str, float],
        best: dict[str, float],
        data: Any,
        conflict: tuple[str, ...],
        why: str,
        judged: dict[str, float] | None = None,
    ) -> SearchStep:
        """The last step, with the result."""
        judged = self._judged(best) if judged is None else judged
        free = {name: jnp.array(best[name], float) for name in self.free}
        flat = Flat.of(self._epigraph)
        point = flat.point(EpigraphVariables(free, self._look(free, data)[0]))
        optimum = _checked(flat, point, data)
        is_optimum = bool(optimum.solution.result == OptimumResult.successful)
        active = () if conflict else self._active(optimum)
        missed = tuple(shortfalls(self.design, judged, self.keep)) if judged else ()
        result = SearchResult(
            objective=self.objective.name,
            free=self.free,
            keep=self.keep,
            before=dict(values),
            values=best,
            judged_before=before,
            judged=judged,
            active=active,
            slopes={} if conflict else self._slopes(optimum),
            missed=missed,
            conflict=conflict,
            is_optimum=is_optimum,
            why=why,
        )
        summary, lines = result.summary(self.design), result.lines(self.design)
        return SearchStep("result", best, summary, True, lines, result)

    def _active(self, optimum: Optimum) -> tuple[Active, ...]:
        """What holds the optimum but the objective's own worst places; prices in its unit."""
        scale = self.objective.scale
        return tuple(
            replace(one, price=one.price * scale)
            for one in find_active_set(self._epigraph, optimum)
            if one.name != self.objective.name
        )

    def _slopes(self, optimum: Optimum) -> dict[str, dict[str, float]]:
        """Of every measure asked for, where it is worst, by every free parameter."""
        asked = [bound.measure for bound in self.keep]
        labels = dict(zip(_labels(self.keep), asked, strict=True))
        found = {}
        for label, name in ({self.objective.name: self.objective.name} | labels).items():
            measure, margins = find_measure(self.design, name), optimum.inequalities[label]
            at = np.unravel_index(np.argmin(margins), margins.shape)
            side = 1.0 if measure.worst == "least" else -1.0
            # Per scaled parameter, the level last; dictionaries come in the order of their names.
            row = optimum.slopes[label][at][:-1] * side * measure.scale
            found[name] = {
                one: float(slope / self._problem.units[one])
                for one, slope in zip(self.free, row, strict=True)
            }
        return found


def search(
    design: ParametricDesign,
    values: Values,
    objective: str,
    free: Mapping[str, tuple[float, float]],
    keep: Sequence[Bound] = (),
) -> Iterator[SearchStep]:
    """Improve a design from where it stands; see `DesignSearch`.

    Args:
        design: the design.
        values: of all parameters, where to begin.
        objective: name of the measure to improve.
        free: ranges of the parameters that may change, by their names.
        keep: requirements beyond the design's own.

    Raises:
        UserError: as `DesignSearch`.
    """
    return DesignSearch(design, objective, free, keep).steps(values)


def amount_text(value: float, unit: str) -> str:
    """A number with its unit, to four digits."""
    return f"{value:.4g}{'' if unit in ('', '°') else ' '}{unit}"


def _labels(keep: Sequence[Bound]) -> list[str]:
    """Of requirements among a problem's constraints; two may be on one measure."""
    return [f"{number} {bound.measure}" for number, bound in enumerate(keep)]


def _checked(flat: Flat, point: Any, data: Any) -> Optimum:
    """Multipliers at a point, however it was found."""
    trace = Trace(jnp.zeros(0), jnp.zeros(0), jnp.zeros(0, int))
    return make_optimality_check(flat)(point, (data, flat.own[1]), trace)


def _words(bound: str, measure: Measure, index: tuple[int, ...]) -> str:
    return " ".join(filter(None, (bound, measure.where(index))))


def _always(words: str, index: tuple[int, ...]) -> str:
    return words


def _hint(name: str, known: Iterable[str], there_are: str) -> str:
    close = difflib.get_close_matches(name, list(known), n=1)
    return f"did you mean '{close[0]}'?" if close else f"{there_are} {', '.join(known)}"
