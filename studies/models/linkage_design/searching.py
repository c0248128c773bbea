"""The search: many starts on few postures, the best of them again with the worst in between."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from designopt.compilation_cache import forget_with_programs
from designopt.optimize import (
    Active,
    EpigraphVariables,
    Method,
    Minimizer,
    Optima,
    Optimum,
    Problem,
    Starts,
    explain_shortfall,
    find_active_set,
    make_elastic,
    make_epigraph,
    make_epigraph_starts,
    minimize,
    select_starts,
)
from designopt.programs import QuickJit
from designopt.vectors import rotation
from studies.models.finger import Finger, pins_of
from studies.models.finger_parts import Body, FingerMotor, FingerSpring
from studies.models.link_layers import Links, Meeting
from studies.models.linkage_design.clearances import clearances_at, find_free_meetings, name_of
from studies.models.linkage_design.judging import STEP_DEG
from studies.models.linkage_design.postures import postures_at
from studies.models.linkage_design.problem import (
    ANGLE,
    Angles,
    ends_of,
    grids,
    linkage_problem,
    with_motor_pin,
)
from studies.models.linkage_design.spec import FingerLinkageSpec
from studies.models.linkage_kinds import KINDS
from studies.models.pins import AnyPins, Pins

FLOOR = -math.pi / 2 / ANGLE
"""No transmission angle exceeds a right angle, so no scaled objective falls below this."""

P = TypeVar("P", bound=AnyPins)

UPDATES, STEPS = 12, 150


WORSE = math.radians(1e-3)
"""A posture in between counts if an angle is smaller there by more than this, rad."""


@dataclass(frozen=True)
class Round:
    """One solve from several designs.

    Attributes:
        problem: over its postures, with ``least``.
        optima: where every design led to, in the problem's epigraph form.
    """

    problem: Problem
    optima: Optima

    @functools.cached_property
    def least_deg(self) -> list[float]:
        """Least transmission angle of every design over its postures, in the optima's order."""
        return least_angles_deg(self.problem, self.optima.found)

    @property
    def feasible_deg(self) -> list[float]:
        """The same of those that meet all requirements."""
        found = zip(self.optima.found, self.least_deg, strict=True)
        return [least for one, least in found if one.feasible]


def least_angles_deg(problem: Problem, optima: Sequence[Optimum]) -> list[float]:
    """Least transmission angles of designs over a problem's postures.

    The level of the epigraph form is below that where a solve ends early, even below 0.
    """
    designs = jax.tree.map(
        lambda *leaves: jnp.stack(leaves), *(one.parameters.design for one in optima)
    )
    return np.rad2deg(make_epigraph_starts(problem, designs).level).tolist()


@dataclass(frozen=True)
class Search:
    """What was found, and how.

    Attributes:
        finger: the design: its pins are rounded to what can be built.
        starts: where the first round began.
        rounds: the solves; the first from Sobol points, the others from the best before.
        near: the parts whose clearance they keep.
    """

    finger: Finger
    starts: Starts
    rounds: tuple[Round, ...]
    near: Sequence[Meeting]

    @functools.cached_property
    def shortfall(self) -> Optimum | None:
        """What is missing at least, over the last round's postures; see `make_elastic`.

        ``None`` where the requirements are met. It takes longer than the search, and is solved
        when it is first asked for.
        """
        last = self.rounds[-1]
        return _shortfall(last, self.starts) if last.optima.best.violation > NEARLY else None

    @property
    def best(self) -> Optimum:
        """The last round's best optimum: the design, wherever it meets the requirements."""
        return self.rounds[-1].optima.best

    @property
    def seconds(self) -> float:
        """Run time of the search, without compiling."""
        return self.starts.seconds + sum(one.optima.seconds for one in self.rounds)

    @property
    def compile_seconds(self) -> float:
        """Time to compile it; the rounds after the second use the second's program."""
        solves = [one.optima.compile_seconds for one in self.rounds[:2]]
        return self.starts.compile_seconds + sum(solves)

    def held_by(self) -> list[Active]:
        """The requirements that hold the optimum; empty if it is none."""
        if not bool(self.best.solution.ok):
            return []
        return find_active_set(exact(self.rounds[-1].problem), self.best)

    def conflict(self) -> list[str]:
        """The requirements that conflict, with amounts; empty where that is not known."""
        if self.shortfall is None or not bool(self.shortfall.solution.ok):
            return []
        form = make_elastic(unbounded(self.rounds[-1].problem))
        return explain_shortfall(form, self.shortfall)


def search(spec: FingerLinkageSpec, seed: int, near: Sequence[Meeting] | None = None) -> Search:
    """The best linkage for a spec's body.

    Few postures decide. The starts are solved on a coarse square; then the postures in between in
    which a finalist is worse than it promised are added, and it is solved again from where it was,
    until there are none (exchange method of semi-infinite programming: R. Hettich, K. O. Kortanek,
    SIAM Review 35, 1993).

    Args:
        spec: the study's settings.
        seed: of the Sobol points.
        near: the parts whose clearance it keeps; those that come near each other at its starts by
            default.
    """
    how, finger = spec.search, blank_finger(spec)
    coarse = grids(finger.body, how.step_deg)
    starts = select_starts(
        over(finger, spec, *coarse, ()), how.starts, seed, among=how.among, scale=ANGLE
    )
    if near is None:
        near = _near_meetings(finger, spec, coarse, starts.parameters)
    problem = over(finger, spec, *coarse, near)
    begin = make_epigraph_starts(problem, starts.parameters)
    rounds = [Round(problem, minimizer(problem, how.starts, "bfgs").solve(begin, exact(problem)))]
    rounds = _exchanged(spec, finger, rounds, near)
    return _finished(spec, finger, starts, rounds, near)


def search_on(spec: FingerLinkageSpec, found: Search) -> Search:
    """The best linkage near one that was found for other settings.

    Args:
        spec: the study's settings.
        found: whose design it begins with; the parts that it keeps apart are kept apart here.
    """
    finger = blank_finger(spec)
    pip, dip = (_filled(one, one) for one in grids(finger.body, spec.search.step_deg))
    problem = over(finger, spec, pip, dip, found.near)
    design = jax.tree.map(lambda leaf: leaf[None], found.best.parameters.design)
    begin = make_epigraph_starts(problem, design)
    rounds = [Round(problem, minimizer(problem, 1, "slsqp").solve(begin, exact(problem)))]
    rounds = _exchanged(spec, finger, rounds, found.near)
    return _finished(spec, finger, found.starts, rounds, found.near)


def _exchanged(
    spec: FingerLinkageSpec, finger: Finger, rounds: list[Round], near: Sequence[Meeting]
) -> list[Round]:
    """The first round and those that follow, with the worst postures of each added."""
    how, worst = spec.search, _worst_postures(finger, spec)
    pip, dip = coarse = grids(finger.body, how.step_deg)
    known = None
    for _ in range(how.exchanges):
        if rounds[-1].optima.best.violation > NEARLY:
            break  # more postures would only ask for more
        finalists = _finalists(rounds[-1].optima, how.finalists)
        more = [worst(one.design, float(one.level)) for one in finalists]
        pip = _joined(pip, [part for part, _ in more])
        dip = _joined(dip, [part for _, part in more])
        # All rounds have places for as many postures, so that one program solves them.
        postures = _filled(pip, coarse[0]), _filled(dip, coarse[1])
        if known is not None and all(map(np.array_equal, postures, known)):
            break
        known = postures
        problem = over(finger, spec, *postures, near)
        again = minimizer(problem, len(finalists), "slsqp")
        designs = jax.tree.map(lambda *leaves: jnp.stack(leaves), *finalists).design
        begin = make_epigraph_starts(problem, designs)
        solved = Round(problem, again.solve(begin, exact(problem)))
        if solved.optima.best.violation > NEARLY:
            break  # from what cannot be met this solver runs astray
        rounds.append(solved)
    return rounds


def _finished(
    spec: FingerLinkageSpec,
    finger: Finger,
    starts: Starts,
    rounds: list[Round],
    near: Sequence[Meeting],
) -> Search:
    found = replace(finger, pins=rounds[-1].optima.best.parameters.design)
    if finger.motor is not None:
        found = with_motor_pin(found, spec.motor.arm, ends_of(finger.body))
    made = finger.with_pins(rounded(pins_of(found), spec.search.rounding))
    return Search(made, starts, tuple(rounds), near)


def blank_finger(spec: FingerLinkageSpec) -> Finger:
    """A finger with the settings' body, links and motor, whose pins are looked for.

    It has their spring, too, if its kind of linkage has one.
    """
    motor = spec.motor
    driven = FingerMotor(motor.behind, motor.above) if motor.parallelogram else None
    kind = KINDS[spec.kind]
    spring = FingerSpring(**spec.spring.model_dump()) if kind.springs else None
    return Finger.of(Body.of(spec.body), None, spring, links=Links.of(spec.links), motor=driven)


SHORTEST = 4
"""Starts, and ends of solves, from which the least shortfall is looked for: it has local minima."""


def unbounded(problem: Problem) -> Problem:
    """The problem without bounds."""
    lower = jax.tree.map(lambda leaf: jnp.full_like(leaf, -jnp.inf), problem.lower)
    upper = jax.tree.map(lambda leaf: jnp.full_like(leaf, jnp.inf), problem.upper)
    return replace(problem, lower=lower, upper=upper, scale=problem.units)


def _shortfall(last: Round, starts: Starts) -> Optimum:
    """What is missing at least, from the first starts and where solves ended that came nearest."""
    near = sorted(last.optima.found, key=lambda one: one.violation)[:SHORTEST]
    designs = [one.parameters.design for one in near]
    first = jax.tree.map(lambda leaf: leaf[:SHORTEST], starts.parameters)
    both = jax.tree.map(
        lambda leaf, *others: jnp.concatenate([leaf, jnp.stack(others)]), first, *designs
    )
    begin = EpigraphVariables(both, jnp.ones(len(jax.tree.leaves(both)[0])))
    # Without the box, in whose corners there are local minima; faces are requirements.
    ends = minimize(make_elastic(unbounded(last.problem)), begin, "slsqp").found
    return min(ends, key=lambda one: (not bool(one.solution.ok), one.objective))


PLACES = 10
"""Places for angles that the exchange adds to those of PIP and of DIP."""


def over(
    finger: Finger,
    spec: FingerLinkageSpec,
    pip: np.ndarray,
    dip: np.ndarray,
    meetings: Sequence[Meeting] | None = None,
) -> Problem:
    """A finger's problem over the postures that combine these angles, rad."""
    # Both ends of a link may be rounded, by half a step along x and y.
    allowance = max(spec.search.allowance, 2 * spec.search.rounding)
    return linkage_problem(
        finger, spec.limits, pip, dip, allowance, motor=spec.motor, meetings=meetings
    )


FAR = 5.0
"""Parts that keep so much more than the clearance at all starts, mm, are left out of the search.
The judgement has them all."""


def _near_meetings(
    finger: Finger, spec: FingerLinkageSpec, grids: tuple[Angles, Angles], starts: Pins
) -> list[Meeting]:
    """The parts that come near each other at any of the starts."""
    meetings = find_free_meetings(finger)
    turns = [rotation(-jnp.asarray(angles)) for angles in grids]

    @QuickJit
    @jax.vmap
    def least(pins: Pins) -> list[Array]:
        moved = replace(finger, pins=pins)
        if finger.motor is not None:
            moved = with_motor_pin(moved, spec.motor.arm, ends_of(finger.body))
        found = clearances_at(moved, postures_at(moved, *turns), turns[0], meetings)
        return [jnp.min(found[name_of(one)]) for one in meetings]

    limit = spec.limits.clearance + FAR
    found = zip(meetings, least(starts), strict=True)
    return [one for one, between in found if np.min(between) < limit]


APART = 0.5
"""Optima are different designs if a coordinate differs by more than this, mm."""

NEARLY = 1e-3
"""Largest scaled violation of a design that is worth solving on."""


def _finalists(optima: Optima, count: int) -> list[EpigraphVariables]:
    """The best different designs, as many as asked for; the best ones again if there are fewer."""
    ranked = sorted(optima.found, key=lambda one: (one.violation > NEARLY, one.objective))
    chosen: list[EpigraphVariables] = []
    for one in ranked:
        place = _coordinates(one.parameters)
        if all(np.max(np.abs(place - _coordinates(other))) > APART for other in chosen):
            chosen.append(one.parameters)
    return (chosen + [one.parameters for one in ranked])[:count]


def _coordinates(found: EpigraphVariables) -> np.ndarray:
    return np.concatenate(jax.tree.leaves(found.design))


def _joined(angles: np.ndarray, more: list[list[float]]) -> np.ndarray:
    """The angles, and those of the others that are new, in the order of the designs."""
    new = [angle for part in more for angle in part if not np.any(np.isclose(angle, angles))]
    return np.concatenate([angles, list(dict.fromkeys(new))])


def _filled(angles: np.ndarray, flexion: np.ndarray) -> np.ndarray:
    """The angles in all places; in those that are left, the straight posture once more."""
    count = len(flexion) + PLACES
    return np.concatenate([angles, np.zeros(max(0, count - len(angles)))])[:count]


def _worst_postures(
    finger: Finger, spec: FingerLinkageSpec
) -> Callable[[Pins, float], tuple[Any, Any]]:
    """From a design and the level it promised to the angles of postures in which it is worse."""
    every = grids(finger.body, STEP_DEG)
    check = linkage_problem(finger, spec.limits, *every, motor=spec.motor)
    terms = QuickJit(check.terms, name=check.name)

    def worst(pins: Pins, level: float) -> tuple[Any, Any]:
        found = terms(pins, *check.data)
        assert found.least is not None
        short = [level - np.asarray(values) - WORSE for values in found.least.values()]
        short += [-np.asarray(values) for values in found.inequalities.values()]
        pip, dip = set(), set()
        for values in short:
            # What one angle decides is a row over DIP.
            if values.shape[-1:] == every[1].shape and np.max(values) > 0:
                *row, column = np.unravel_index(np.argmax(values), values.shape)
                pip.update(every[0][place] for place in row)
                dip.add(every[1][column])
        return sorted(pip), sorted(dip)

    return worst


_MINIMIZERS: dict[Any, Minimizer] = {}
"""Those that are compiled, by all that they are compiled for."""
forget_with_programs(_MINIMIZERS.clear)


def minimizer(problem: Problem, count: int, method: Method) -> Minimizer:
    """A solver of the exact form, compiled once for all problems that differ in their data alone.

    From afar BFGS inside an augmented Lagrangian, all starts in one vectorised program; near the
    optimum sequential quadratic programming needs a few steps, for it sees which postures hold it.
    """
    leaves, structure = jax.tree.flatten(problem.data)
    # SciPy's solve one start after the other.
    together = 1 if method in ("slsqp", "trust-constr") else count
    key = problem.terms, together, method, structure, tuple(map(jnp.shape, leaves))
    if key not in _MINIMIZERS:
        caps: Any = {"floor": FLOOR, "updates": UPDATES, "steps": STEPS}
        _MINIMIZERS[key] = Minimizer(exact(problem), count, method, **caps)
    return _MINIMIZERS[key]


def exact(problem: Problem) -> Problem:
    """The problem's epigraph form."""
    return make_epigraph(problem, scale=ANGLE)


def rounded(pins: P, step: float) -> P:
    """The design with every coordinate a multiple of a step, mm."""
    # The second rounding, to 10 decimals, takes away what binary fractions leave.
    return jax.tree.map(
        lambda leaf: jnp.asarray(np.round(np.round(np.asarray(leaf) / step) * step, 10)), pins
    )
