"""A design improved in one measure, with every requirement kept: what is found, and what holds it.

A measure is the least of many pieces (pins, postures), and so are the margins of the requirements.
Every iteration solves the linear program of their slopes in a box around the design; the box grows
where the slopes could be trusted, and shrinks where they could not. Designs of this kind end in
corners, where as many pieces and margins are active as there are parameters, and there such steps
converge fast. What `ParametricDesign.evaluate` finds on its grid is then judged by
`ParametricDesign.judge`: where that misses a requirement, more of it is asked for, and the search
goes on, as in an exchange method (R. Hettich, K. O. Kortanek, SIAM Rev. 35 (1993) 380).
"""

from __future__ import annotations

import difflib
import functools
import math
from collections import deque
from collections.abc import Generator, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.optimize import linprog, nnls
from scipy.stats import qmc

from designopt.errors import UserError
from designopt.optimize.flat import column_slopes
from designopt.optimize.optimality import STATIONARY, Active
from designopt.optimize.parametric import (
    Measure,
    MeasureBound,
    ParametricDesign,
    Values,
    shortfalls,
)
from designopt.optimize.problem import BOUND
from designopt.programs import Program

UPDATES = 150
"""Cap on iterations of one search."""

RADIUS, SMALLEST = 0.1, 1e-7
"""Half the side of the first box, in parts of the parameters' ranges, and of the last one."""

ACCEPTED, TRUSTED = 0.1, 0.7
"""Parts of what the slopes promise: with so much a step is taken, with so much the box grows."""

PENALTIES = (3.0, 3000.0)
"""Least and greatest cost of missing a requirement by its scale, in scales of the objective: as
little as leads back to it, for along curved limits a high one leaves small steps only."""

CONVERGED = 1e-7
"""A step that promises less, in scales, is none."""

REMEMBERED = 8
"""Places whose slopes are remembered, because a step to them did not bring what was promised."""

GAIN, PATIENCE = 1e-5, 25
"""So many iterations that together gain less, in scales, end the search."""

HAIR, MET = 1e-7, 5e-8
"""Requirements are searched with so much of their scale to spare, and are met where no more than
the other is missed of that."""

ROUNDS, RESERVE = 3, 1.5
"""How often more is asked of what the judge misses, and how many times what is missing."""

ACTIVE = 1e-5
"""What is no farther from its limit, in scales or in parts of a range, may hold a design."""

LEAST_SHARE = 0.01
"""What has a smaller part in all that holds a design is left out."""

NO_NUMBER = 1e6
"""By how many scales a piece or a margin that is no number counts as missed."""

MEETING = "meeting the requirements"


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


class _Point(NamedTuple):
    """A design, and what is asked of it to first order.

    Attributes:
        place: of the free parameters, in parts of their ranges.
        pieces: of the objective, in its scale; the least one is made as large as possible.
        margins: of all requirements, in their measures' scales; not negative where they are met.
        piece_slopes: of the pieces by the place.
        margin_slopes: of the margins by the place.
    """

    place: Float[np.ndarray, " free"]
    pieces: Float[np.ndarray, " pieces"]
    margins: Float[np.ndarray, " margins"]
    piece_slopes: Float[np.ndarray, "pieces free"]
    margin_slopes: Float[np.ndarray, "margins free"]

    @property
    def level(self) -> float:
        """The objective."""
        return float(np.min(self.pieces))

    @property
    def missing(self) -> float:
        """By how much the requirement that is farthest from being met is missed."""
        return max(-float(np.min(self.margins, initial=0.0)), 0.0)

    @property
    def rank(self) -> tuple[bool, float]:
        """Greater is better: what meets all requirements, then the objective."""
        return (True, self.level) if self.missing <= MET else (False, -self.missing)

    def without_objective(self) -> _Point:
        """The same, asked for its requirements alone."""
        return self._replace(pieces=np.zeros(1), piece_slopes=np.zeros((1, self.place.size)))

    def merit(self, penalty: float) -> float:
        """What every step makes smaller: an exact penalty."""
        return penalty * self.missing - self.level

    def with_rows_of(self, others: Sequence[_Point]) -> _Point:
        """The same, asked also for what was found missing at other places, to first order there.

        What a step meets unawares, such as the edge beyond which a pad is hidden, has no slope on
        this side of it. Rows that this place contradicts are left out.
        """
        found = self
        for other in others:
            way = self.place - other.place
            low, under = other.pieces < self.level, other.margins < 0
            pieces = other.pieces[low] + other.piece_slopes[low] @ way
            margins = other.margins[under] + other.margin_slopes[under] @ way
            fits, holds = pieces >= self.level, margins >= min(-self.missing, 0.0)
            found = found._replace(
                pieces=np.append(found.pieces, pieces[fits]),
                piece_slopes=np.vstack([found.piece_slopes, other.piece_slopes[low][fits]]),
                margins=np.append(found.margins, margins[holds]),
                margin_slopes=np.vstack([found.margin_slopes, other.margin_slopes[under][holds]]),
            )
        return found


class DesignSearch:
    """Improves one measure of a design from any start, by one program that is compiled once."""

    def __init__(
        self,
        design: ParametricDesign,
        objective: str,
        free: Mapping[str, tuple[float, float]],
        keep: Sequence[MeasureBound] = (),
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
        check_bounds(design, keep)
        self.keep = (*design.requirements, *keep)
        self.free = dict(free)
        names = [one.name for one in design.parameters]
        self._places = np.array([names.index(name) for name in self.free])
        low, high = np.array([*self.free.values()], float).T
        self._low, self._span = low, high - low
        asked = (objective, *(bound.measure for bound in self.keep))
        self._asked = tuple(dict.fromkeys(asked))
        self._program = Program(self._arrays_and_slopes)

    def steps(self, values: Values, starts: int = 1, seed: int = 0) -> Iterator[SearchStep]:
        """Iterations from a design on; the last one has the result, which is never worse.

        Args:
            values: of all parameters, where to begin; what is free is brought inside its bounds.
            starts: from how many starts: these values, and points of a Sobol sequence between the
                bounds.
            seed: of that sequence.
        """
        own = np.array([values[name] for name in self.free])
        place = np.clip((own - self._low) / self._span, 0.0, 1.0)
        begins = [place]
        is_inside = np.all((self._low <= own) & (own <= self._low + self._span))
        if starts > 1:
            sampler = qmc.Sobol(own.size, rng=np.random.default_rng(seed))
            begins += [*sampler.random_base2((starts - 2).bit_length())[: starts - 1]]
        full, reserve = self.design.vector(values), np.zeros(len(self.keep))
        before = self._judged(values)
        first = dict(values) if is_inside else self._named(begins[0], values)
        start = first, before if is_inside else self._judged(first)
        begins = yield from self._meeting(begins, full, reserve, values)
        ends = list[tuple[_Point, str]]()
        for number, begin in enumerate(begins, 1):
            if not self._at(begin, full, reserve).missing <= MET:
                continue
            phase = f"search {number} of {len(begins)}" if len(begins) > 1 else "search"
            ends.append((yield from self._climb(begin, full, reserve, values, phase)))
        if not ends:
            nearest = min((self._at(b, full, reserve) for b in begins), key=lambda p: p.missing)
            # A start that is judged to meet everything has no conflict.
            is_met = start[1] and not shortfalls(self.design.measures, start[1], self.keep)
            conflict = () if is_met else self._conflict(nearest)
            why = "no design near was found that meets all requirements"
            yield self._finish(values, before, *start, None, conflict, why)
            return
        found, why = max(ends, key=lambda end: end[0].rank)
        (best, best_judged), best_point = start, None
        for again in range(ROUNDS + 1):
            named = self._named(found.place, values)
            judged = self._judged(named)
            if self._worth(judged) > self._worth(best_judged):
                best, best_judged, best_point = named, judged, found
            elif best_point is None and np.allclose(found.place, place, rtol=0.0, atol=1e-9):
                best_point = found  # it began at an optimum
            missed = shortfalls(self.design.measures, judged, self.keep) if judged else []
            if not missed or again == ROUNDS:
                break
            for bound, margin in missed:
                more = -margin if math.isfinite(margin) else self._measure(bound).scale
                reserve[self.keep.index(bound)] += RESERVE * more
            phase = "asking for more"
            begins = yield from self._meeting([found.place], full, reserve, values)
            found, why = yield from self._climb(begins[0], full, reserve, values, phase)
        if best_point is None:
            why = "what the search found is judged to be no better"
        yield self._finish(values, before, best, best_judged, best_point, (), why)

    # -- the problem ----------------------------------------------------------------------------

    def _arrays_and_slopes(
        self, place: Float[Array, " free"], full: Float[Array, " parameters"]
    ) -> tuple[dict[str, Array], dict[str, Array]]:
        """Every measure asked for, and its slopes by the place, along a last axis."""

        def arrays(place: Float[Array, " free"]) -> dict[str, Array]:
            values = full.at[self._places].set(self._low + self._span * place)
            return self.design.evaluate(values, self._asked)

        return column_slopes(arrays, place)

    def _at(self, place: np.ndarray, full: Array, reserve: np.ndarray) -> _Point:
        arrays, slopes = self._program(jnp.asarray(place), full)
        sign = 1.0 if self.objective.worst == "least" else -1.0
        own, size = self.objective.name, place.size
        margins, margin_slopes = [np.zeros(0)], [np.zeros((0, size))]
        for bound, more in zip(self.keep, reserve, strict=True):
            measure, side = self._measure(bound), 1.0 if bound.relation == ">=" else -1.0
            scale = measure.scale
            # No more can be asked for than there is.
            there_is = side * (measure.limits[side > 0] - bound.value)
            spare = min(more + HAIR * scale, max(there_is, 0.0))
            margins.append((side * (arrays[bound.measure].ravel() - bound.value) - spare) / scale)
            margin_slopes.append(side * slopes[bound.measure].reshape(-1, size) / scale)
        rows = np.concatenate(margin_slopes)
        moved = np.any(rows != 0, axis=1)  # what nothing free changes has nothing to spare
        pieces = sign * arrays[own].ravel() / self.objective.scale
        piece_slopes = sign * slopes[own].reshape(-1, size) / self.objective.scale
        all_margins = np.concatenate(margins) + HAIR * ~moved
        # What is no number is as bad as can be, and shows no way.
        return _Point(
            place,
            np.where(np.isfinite(pieces), pieces, -NO_NUMBER),
            np.where(np.isfinite(all_margins), all_margins, -NO_NUMBER),
            np.nan_to_num(piece_slopes, nan=0.0, posinf=0.0, neginf=0.0),
            np.nan_to_num(rows, nan=0.0, posinf=0.0, neginf=0.0),
        )

    @functools.cached_property
    def _rows(self) -> list[tuple[str, MeasureBound, tuple[int, ...]]]:
        """Of every margin: its requirement with its name, and the index in that measure's array."""
        shapes = jax.eval_shape(
            lambda values: self.design.evaluate(values, self._asked),
            self.design.vector(self.design.values()),
        )
        return [
            (label, bound, index)
            for label, bound in zip(_labels(self.keep), self.keep, strict=True)
            for index in np.ndindex(shapes[bound.measure].shape)
        ]

    # -- the search -----------------------------------------------------------------------------

    def _meeting(
        self, begins: list[np.ndarray], full: Array, reserve: np.ndarray, values: Values
    ) -> Generator[SearchStep, None, list[np.ndarray]]:
        """Each start where it meets all requirements; as near to that as it gets if it cannot."""
        found = []
        for begin in begins:
            if self._at(begin, full, reserve).missing > MET:
                end, _ = yield from self._climb(begin, full, reserve, values, MEETING, meet=True)
                begin = end.place
            found.append(begin)
        return found

    def _climb(
        self,
        begin: np.ndarray,
        full: Array,
        reserve: np.ndarray,
        values: Values,
        phase: str,
        *,
        meet: bool = False,
    ) -> Generator[SearchStep, None, tuple[_Point, str]]:
        """The best point of one local search, and what ended it.

        Args:
            begin: where it begins.
            full: all parameters.
            reserve: what is asked for beyond the requirements.
            values: all parameters by name.
            phase: in messages.
            meet: whether it ends as soon as all requirements are met, whatever the objective.
        """

        def at(place: np.ndarray) -> _Point:
            point = self._at(place, full, reserve)
            return point.without_objective() if meet else point

        now = best = at(begin)
        met, refused = deque[_Point](maxlen=REMEMBERED), False
        radius, penalty, counted, reached = RADIUS, PENALTIES[0], 0, math.inf
        for number in range(1, UPDATES + 1):
            step, gain, penalty = _linear_step(now.with_rows_of(met), radius, penalty)
            part = 0.0
            if gain > CONVERGED:
                then = at(np.clip(now.place + step, 0.0, 1.0))
                part = (now.merit(penalty) - then.merit(penalty)) / gain
                if not part > TRUSTED:  # nor is NaN
                    met.append(then)
                if part > ACCEPTED:
                    now = then
            if part > TRUSTED:
                radius = min(2 * radius, 1.0)
            elif not part > ACCEPTED:
                radius, refused = (radius / 3, False) if refused else (radius, True)
            best = max(best, now, key=lambda point: point.rank)
            words = f"{phase}, iteration {number}: {self._reached(now)}"
            yield SearchStep(phase, self._named(now.place, values), words)
            if meet and now.missing <= MET:
                return now, "all requirements are met"
            if (gain <= CONVERGED and not met) or radius < SMALLEST:
                return best, "nothing near is better"
            if gain <= CONVERGED:
                met.clear()
            if now.merit(penalty) < reached - GAIN:
                counted, reached = number, now.merit(penalty)
            elif number - counted >= PATIENCE:
                return best, f"the last {PATIENCE} iterations gained little"
        return best, f"stopped after {UPDATES} iterations"

    def _finish(
        self,
        values: Values,
        before: dict[str, float],
        best: dict[str, float],
        judged: dict[str, float],
        found: _Point | None,
        conflict: tuple[str, ...],
        why: str,
    ) -> SearchStep:
        """The last step, with the result; ``found`` is the best design, if the search found it."""
        active, residual = ((), math.inf) if found is None else self._active(found)
        result = SearchResult(
            objective=self.objective.name,
            free=self.free,
            keep=self.keep,
            before=dict(values),
            values=best,
            judged_before=before,
            judged=judged,
            active=active,
            slopes={} if found is None else self._slopes(found),
            missed=tuple(shortfalls(self.design.measures, judged, self.keep)) if judged else (),
            conflict=conflict,
            is_optimum=residual <= STATIONARY,
            why=why,
        )
        summary, lines = result.summary(self.design), result.lines(self.design)
        return SearchStep("result", best, summary, True, lines, result)

    # -- what holds it --------------------------------------------------------------------------

    def _active(self, point: _Point) -> tuple[tuple[Active, ...], float]:
        """What holds an optimum, and what multipliers leave of the objective's slope."""
        pieces = np.flatnonzero(point.pieces <= point.level + ACTIVE)
        margins = np.flatnonzero(point.margins <= ACTIVE)
        ends, rows = _bounds_at(point.place), self._rows
        slopes = np.concatenate([point.margin_slopes[margins], _inward(ends, point.place.size)])
        multipliers, residual = _balance(point.piece_slopes[pieces], slopes)
        scale, found = self.objective.scale, list[Active]()
        for number, multiplier in zip(margins, multipliers, strict=False):
            label, bound, index = rows[number]
            measure = self._measure(bound)
            price = float(multiplier) * scale / measure.scale
            words = self._words(bound, index)
            found.append(Active(label, index, words, measure.unit, price, float(multiplier)))
        names = [*self.free]
        parameters = {one.name: one for one in self.design.parameters}
        for (place, side), multiplier in zip(ends, multipliers[len(margins) :], strict=True):
            one = parameters[names[place]]
            words = f"{one.label or one.name} at its {'lower' if side > 0 else 'upper'} bound"
            price = float(multiplier * scale / self._span[place])
            found.append(Active(BOUND, (place,), words, one.unit, price, float(multiplier)))
        total = sum(one.share for one in found) or 1.0
        shares = [replace(one, share=one.share / total) for one in found]
        held = [one for one in shares if one.share > LEAST_SHARE]
        return tuple(sorted(held, key=lambda one: -one.share)), residual

    def _conflict(self, point: _Point) -> tuple[str, ...]:
        """The requirements that nothing near can meet better together, with what each is short of.

        They are those farthest from being met, if their slopes balance.
        """
        margins = np.flatnonzero(point.margins <= ACTIVE - point.missing)
        slopes = _inward(_bounds_at(point.place), point.place.size)
        multipliers, residual = _balance(point.margin_slopes[margins], slopes, of_level=True)
        rows, lines = self._rows, dict[str, None]()
        for number, multiplier in zip(margins, multipliers, strict=False):
            if multiplier > LEAST_SHARE and residual <= STATIONARY:
                _, bound, index = rows[number]
                measure = self._measure(bound)
                amount = amount_text(point.missing * measure.scale, measure.unit)
                lines[f"{self._words(bound, index)} by {amount}"] = None
        return tuple(lines)

    def _slopes(self, point: _Point) -> dict[str, dict[str, float]]:
        """Of every measure asked for, where it is worst, by every free parameter."""
        kept = dict[str, tuple[np.ndarray, np.ndarray]]()
        rows = np.array([bound.measure for _, bound, _ in self._rows])
        for name in self._asked[1:]:
            kept[name] = point.margins[rows == name], point.margin_slopes[rows == name]
        kept[self.objective.name] = point.pieces, point.piece_slopes
        found = {}
        for name in self._asked:
            measure, (values, slopes) = find_measure(self.design, name), kept[name]
            side = 1.0 if measure.worst == "least" else -1.0
            row = side * measure.scale * slopes[np.argmin(values)] / self._span
            found[name] = dict(zip(self.free, row.tolist(), strict=True))
        return found

    def _words(self, bound: MeasureBound, index: tuple[int, ...]) -> str:
        return " ".join(filter(None, (str(bound), self._measure(bound).where(index))))

    def _measure(self, bound: MeasureBound) -> Measure:
        return find_measure(self.design, bound.measure)

    # -- what it is worth -----------------------------------------------------------------------

    def _named(self, place: np.ndarray, values: Values) -> dict[str, float]:
        free = (self._low + self._span * place).tolist()
        return {**values, **dict(zip(self.free, free, strict=True))}

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
        missed = shortfalls(self.design.measures, judged, self.keep)
        parts = [margin / self._measure(bound).scale for bound, margin in missed]
        worst = min((part if math.isfinite(part) else -math.inf for part in parts), default=0.0)
        value = judged[self.objective.name] / self.objective.scale
        value = value if self.objective.worst == "least" else -value
        return 1, worst, value if math.isfinite(value) else -math.inf

    def _reached(self, point: _Point) -> str:
        if point.missing > MET:
            return f"requirements are missed by {point.missing:.2g} of their scales"
        value = point.level * self.objective.scale
        value = value if self.objective.worst == "least" else -value
        return f"{self.objective.name} {amount_text(value, self.objective.unit)}"


def _linear_step(point: _Point, radius: float, penalty: float) -> tuple[np.ndarray, float, float]:
    """The step that is best to first order, in a box.

    A linear program in the step, the level t of the objective and the missing part s: the largest
    t − P s with every piece at least t and every margin at least −s (R. Fletcher, *Practical
    Methods of Optimization*, 2nd ed., §12.4 and §14.4, of exact penalties and their correction;
    J. Hald, K. Madsen, Math. Programming 20 (1981) 49, of the least of several functions). As long
    as it leaves something missing, P grows.

    Args:
        point: where it begins.
        radius: half the side of the box.
        penalty: P.

    Returns:
        The step, by how much it makes the merit smaller to first order, and P.
    """
    size = point.place.size
    # What no step in the box can bring to its limit is left out.
    reach = radius * np.sum(np.abs(point.margin_slopes), axis=1)
    near = point.margins - reach < 0
    margins, slopes = point.margin_slopes[near], point.piece_slopes
    above = np.hstack([-slopes, np.ones((len(slopes), 1)), np.zeros((len(slopes), 1))])
    kept = np.hstack([-margins, np.zeros((len(margins), 1)), -np.ones((len(margins), 1))])
    limits = np.stack(
        [np.maximum(-radius, -point.place), np.minimum(radius, 1.0 - point.place)], axis=1
    ).tolist()
    rows, values = np.vstack([above, kept]), np.concatenate([point.pieces, point.margins[near]])
    bounds = [*limits, (None, None), (0.0, None)]
    while True:
        cost = np.concatenate([np.zeros(size), [-1.0, penalty]])
        found = linprog(cost, A_ub=rows, b_ub=values, bounds=bounds, method="highs")
        if found.status != 0:
            return np.zeros(size), 0.0, penalty
        if found.x[-1] <= MET or penalty >= PENALTIES[1]:
            return found.x[:size], point.merit(penalty) - float(found.fun), penalty
        penalty *= 10


def _bounds_at(place: np.ndarray) -> list[tuple[int, int]]:
    """The parameters that are at a bound, each with +1 if that is the lower one, −1 otherwise."""
    return [
        (number, side)
        for side in (1, -1)
        for number, part in enumerate(place.tolist())
        if (part if side > 0 else 1.0 - part) <= ACTIVE
    ]


def _inward(ends: Sequence[tuple[int, int]], size: int) -> Float[np.ndarray, "ends free"]:
    """Slopes of the distances to bounds."""
    found = np.zeros((len(ends), size))
    for row, (number, side) in enumerate(ends):
        found[row, number] = side
    return found


def _balance(
    pieces: Float[np.ndarray, "pieces free"],
    others: Float[np.ndarray, "others free"],
    *,
    of_level: bool = False,
) -> tuple[Float[np.ndarray, " multipliers"], float]:
    """Multipliers of the conditions of Karush, Kuhn and Tucker, and what they leave, in parts.

    Of a least piece they are Σ μ = 1 over the pieces that are the least, and Σ μ ∇piece +
    Σ λ ∇other = 0 with what is active (J. Nocedal, S. J. Wright, *Numerical Optimization*, 2nd
    ed., §12.3), found by non-negative least squares.

    Args:
        pieces: slopes of the pieces that are the least.
        others: slopes of what is active.
        of_level: whether to return μ, not λ.
    """
    slopes = np.vstack([pieces, others])
    # The condition on the sum weighs as much as the slopes themselves.
    weight = max(float(np.max(np.abs(pieces), initial=0.0)), SMALLEST)
    sums = np.zeros(len(slopes))
    sums[: len(pieces)] = weight
    wanted = np.append(np.zeros(slopes.shape[1]), weight)
    multipliers, left = nnls(np.vstack([slopes.T, sums]), wanted)
    own = multipliers[: len(pieces)] if of_level else multipliers[len(pieces) :]
    return own, float(left) / weight


def search(
    design: ParametricDesign,
    values: Values,
    objective: str,
    free: Mapping[str, tuple[float, float]],
    keep: Sequence[MeasureBound] = (),
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


def _labels(keep: Sequence[MeasureBound]) -> list[str]:
    """Names of requirements, of which two may be on one measure."""
    return [f"{number} {bound.measure}" for number, bound in enumerate(keep)]


def _hint(name: str, known: Iterable[str], there_are: str) -> str:
    close = difflib.get_close_matches(name, list(known), n=1)
    return f"did you mean '{close[0]}'?" if close else f"{there_are} {', '.join(known)}"
