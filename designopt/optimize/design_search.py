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

import functools
import math
from collections import deque
from collections.abc import Generator, Iterator, Mapping, Sequence
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.stats import qmc

from designopt.errors import UserError
from designopt.optimize.flat import column_slopes
from designopt.optimize.linear_steps import (
    ACTIVE,
    MET,
    PENALTIES,
    Point,
    balance,
    bounds_at,
    inward,
    linear_step,
)
from designopt.optimize.optimality import STATIONARY, Active
from designopt.optimize.parametric import (
    Measure,
    MeasureBound,
    ParametricDesign,
    Values,
    amount_text,
    check_bounds,
    find_measure,
    shortfalls,
)
from designopt.optimize.problem import BOUND
from designopt.optimize.search_result import SearchResult, SearchStep, labels_of
from designopt.programs import Program

UPDATES = 150
"""Cap on iterations of one search."""

RADIUS, SMALLEST = 0.1, 1e-7
"""Half the side of the first box, in parts of the parameters' ranges, and of the last one."""

ACCEPTED, TRUSTED = 0.1, 0.7
"""Parts of what the slopes promise: with so much a step is taken, with so much the box grows."""

CONVERGED = 1e-7
"""A step that promises less, in scales, is none."""

REMEMBERED = 8
"""Places whose slopes are remembered, because a step to them did not bring what was promised."""

GAIN, PATIENCE = 1e-5, 25
"""So many iterations that together gain less, in scales, end the search."""

HAIR = 1e-7
"""Requirements are searched with so much of their scale to spare."""

ROUNDS, RESERVE = 3, 1.5
"""How often more is asked of what the judge misses, and how many times what is missing."""

LEAST_SHARE = 0.01
"""What has a smaller part in all that holds a design is left out."""

NO_NUMBER = 1e6
"""By how many scales a piece or a margin that is no number counts as missed."""

MEETING = "meeting the requirements"


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
        ends = list[tuple[Point, str]]()
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

    def _at(self, place: np.ndarray, full: Array, reserve: np.ndarray) -> Point:
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
        return Point(
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
            for label, bound in zip(labels_of(self.keep), self.keep, strict=True)
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
    ) -> Generator[SearchStep, None, tuple[Point, str]]:
        """The best point of one local search, and what ended it.

        Args:
            begin: where it begins.
            full: all parameters.
            reserve: what is asked for beyond the requirements.
            values: all parameters by name.
            phase: in messages.
            meet: whether it ends as soon as all requirements are met, whatever the objective.
        """

        def at(place: np.ndarray) -> Point:
            point = self._at(place, full, reserve)
            return point.without_objective() if meet else point

        now = best = at(begin)
        met, refused = deque[Point](maxlen=REMEMBERED), False
        radius, penalty, counted, reached = RADIUS, PENALTIES[0], 0, math.inf
        for number in range(1, UPDATES + 1):
            step, gain, penalty = linear_step(now.with_rows_of(met), radius, penalty)
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
        found: Point | None,
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

    def _active(self, point: Point) -> tuple[tuple[Active, ...], float]:
        """What holds an optimum, and what multipliers leave of the objective's slope."""
        pieces = np.flatnonzero(point.pieces <= point.level + ACTIVE)
        margins = np.flatnonzero(point.margins <= ACTIVE)
        ends, rows = bounds_at(point.place), self._rows
        slopes = np.concatenate([point.margin_slopes[margins], inward(ends, point.place.size)])
        multipliers, residual = balance(point.piece_slopes[pieces], slopes)
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

    def _conflict(self, point: Point) -> tuple[str, ...]:
        """The requirements that nothing near can meet better together, with what each is short of.

        They are those farthest from being met, if their slopes balance.
        """
        margins = np.flatnonzero(point.margins <= ACTIVE - point.missing)
        slopes = inward(bounds_at(point.place), point.place.size)
        multipliers, residual = balance(point.margin_slopes[margins], slopes, of_level=True)
        rows, lines = self._rows, dict[str, None]()
        for number, multiplier in zip(margins, multipliers, strict=False):
            if multiplier > LEAST_SHARE and residual <= STATIONARY:
                _, bound, index = rows[number]
                measure = self._measure(bound)
                amount = amount_text(point.missing * measure.scale, measure.unit)
                lines[f"{self._words(bound, index)} by {amount}"] = None
        return tuple(lines)

    def _slopes(self, point: Point) -> dict[str, dict[str, float]]:
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

    def _reached(self, point: Point) -> str:
        if point.missing > MET:
            return f"requirements are missed by {point.missing:.2g} of their scales"
        value = point.level * self.objective.scale
        value = value if self.objective.worst == "least" else -value
        return f"{self.objective.name} {amount_text(value, self.objective.unit)}"


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
