"""Designing the mirrors of a body: several starts, each judged degree by degree, and the best.

Each start leads through the problem with large errors first, then with smaller ones. With errors
many times the stated ones, some copy sees something from almost every start, so the objective has a
slope where the exact problem has none; shrunk step by step they lead to the optimum (the idea of
graduated optimisation: A. Blake, A. Zisserman, *Visual Reconstruction*, 1987). Between the stages
only numbers change, so all stages, starts and bodies share one compiled program. Every stage is one
search by Optimistix' BFGS of the augmented Lagrangian, as between two updates of the multipliers in
`designopt.optimize.augmented_lagrangian`. It is written out here because that program needs the
slope of all looks at once: kept apart, look by look, they compile and run several times faster.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float, Int

from designopt.batching import side_by_side
from designopt.optimize import Evaluation, draw_sobol_starts
from designopt.programs import QuickJit
from designopt.study.study import Context
from studies.models.finger import Finger
from studies.models.finger_parts import PHALANGES
from studies.models.mirror_design.clearances import clearance_checks
from studies.models.mirror_design.errors import sample_errors
from studies.models.mirror_design.judging import Verdict, judged
from studies.models.mirror_design.placement import (
    Placement,
    bounds,
    free_part,
    poor_layout,
    reference_layout,
    scale,
)
from studies.models.mirror_design.postures import ROUNDING
from studies.models.mirror_design.problem import (
    Look,
    Task,
    clearance_names,
    cost_and_clearance,
    look,
    problem_of,
    put_in,
)
from studies.models.mirror_design.spec import MirrorSpec
from studies.models.mirror_design.yields import coverages, monte_carlo, postures

Multipliers = dict[str, Float[Array, "..."]]
"""Of every inequality, by name: ``coverage``, ``resolution`` and ``clearance``."""

Penalties = dict[str, Float[Array, ""]]
"""On the squares of violations, by the same names."""


class Stage(NamedTuple):
    """One stage.

    Attributes:
        growth: of the copies' errors, over those at the end.
        penalty: on the square of a violation; 0 leaves the inequalities out, for early ones would
            hold on to whatever glimpse is sharp.
        room: factor on the penalty of clearances.
    """

    growth: float
    penalty: float
    room: float = 1.0

    @property
    def penalties(self) -> Penalties:
        """On every inequality, by name."""
        own = {"coverage": 1.0, "resolution": 1.0, "clearance": self.room}
        return {name: jnp.asarray(self.penalty * times) for name, times in own.items()}


STAGES = (Stage(4.0, 0.0), Stage(2.0, 1.0), Stage(1.0, 10.0), Stage(1.0, 100.0))

STEPS = 60
"""Cap on steps of a stage, each of them one evaluation of the slope."""

EXCHANGES = 4
"""How often postures that the verdict names are looked at, too, of the trial that seems best."""

HIDDEN = 0.01
"""Of a pad: where more of it is hidden without errors, these do not matter yet."""

DRAWS = 100
"""Random draws of the errors, by which trials that meet the requirements are ranked."""

FAILURE_DRAWS, FAILURE_ROUNDS, FAILURE_GROWTH = 400, 7, 1.2
"""Draws among which errors are looked for that hide something, how often at most, and by how much
larger these errors are looked at."""

ROOM, ROOM_ROUNDS = Stage(1.0, 100.0, 100.0), 5
"""How a design that shows too little is moved until it keeps all clearances, and how often at most:
with the penalty of the other stages what nothing can show would outweigh them."""

SHARE = 0.1
"""Of the Lagrangian, which is what the solver sees: its first steps, for it begins with the
identity as curvature, are then of a few mm."""

WALL = 10.0
"""Weight on the square of what a point is outside its bounds, beside the value at the nearest point
inside them."""

TOLERANCE = 1e-6
"""Relative and absolute, of the solver."""


class Trial(NamedTuple):
    """What one start led to.

    Attributes:
        start: where it began.
        placement: where it ended.
        objective: there, of the last stage.
        violation: largest violation of an inequality there, scaled.
        steps: of the solver, in all.
        seconds: its run time; the first search of a process compiles, too, and of several starts
            the others run beside each other.
        multipliers: of the inequalities at the end.
    """

    start: Placement
    placement: Placement
    objective: float
    violation: float
    steps: int
    seconds: float
    multipliers: Multipliers


@dataclass(frozen=True)
class MirrorDesign:
    """The mirrors that were designed for a finger.

    Attributes:
        finger: with its camera and mirrors.
        trials: what every start led to, in their order; see `first_placements`.
        verdicts: on every trial.
        tasks: of all stages.
        chosen: index of the trial that was taken.
    """

    finger: Finger
    trials: Sequence[Trial]
    verdicts: Sequence[Verdict]
    tasks: Sequence[Task]
    chosen: int

    @property
    def verdict(self) -> Verdict:
        """What it shows, degree by degree."""
        return self.verdicts[self.chosen]

    @property
    def task(self) -> Task:
        """The last stage's, as the search of every start has seen it."""
        return self.tasks[-1]


def design_mirrors(
    finger: Finger,
    spec: MirrorSpec,
    context: Context,
    starts: Sequence[Placement] | None = None,
) -> MirrorDesign:
    """Camera and mirrors that show all pads of a finger in every posture, errors included.

    Args:
        finger: its body; the design has its pins and spring as well.
        spec: camera, room, tolerances, resolution and how to search.
        context: its seed chooses the random starts and the errors that the search sees; the float
            type is that of the study that runs.
        starts: where to begin; by default all `first_placements`.

    Returns:
        Of the trials that see everything with the resolution asked for in all postures, and keep
        all clearances, the one that still sees everything most often with errors; if none does,
        that of least objective and violation, moved to where it keeps all clearances, if that is
        found. ``verdict`` has which.
    """
    poor = _poor(finger, spec)
    limits = bounds(poor, spec)
    tasks = [
        Task.of(poor, spec, context.seed + number, stage.growth)
        for number, stage in enumerate(STAGES)
    ]
    if starts is None:
        starts = first_placements(finger, spec, context.seed)
    thickness = float(finger.body.thickness)

    is_done = context.count(len(starts))

    def tried(number: int) -> tuple[Trial, Verdict]:
        with context.step(f"T = {thickness:g} mm: start {number + 1} of {len(starts)}"):
            trial = search(starts[number], limits, tasks)
            verdict = judged(put_in(trial.placement, poor), everywhere=False)
        is_done()
        return trial, verdict

    # The first alone, for it compiles.
    others = [partial(tried, number) for number in range(1, len(starts))]
    found = [tried(0), *side_by_side(others)]
    trials, verdicts = (list(part) for part in zip(*found, strict=True))

    def share(number: int) -> float:
        """The yield by few draws, for the objective's copies have larger errors."""
        with context.step("Yield of a start"):
            made = put_in(trials[number].placement, poor)
            return monte_carlo(made, spec.tolerances, draws=DRAWS, seed=context.seed + 1).value

    shares: dict[int, float] = {}

    def rank(number: int) -> tuple[bool, float, float]:
        trial = trials[number]
        if not (verdicts[number].meets(spec.floor) and _is_clear(trial, poor, spec)):
            return True, 0.0, trial.objective + 100 * trial.violation
        if number not in shares:
            shares[number] = share(number)
        return False, -shares[number], trial.objective

    def best() -> int:
        return min(range(len(trials)), key=rank) if len(trials) > 1 else 0

    # All pairs of angles are judged of the best by their rows, until one of these meets them.
    exchanges = EXCHANGES
    while verdicts[chosen := best()].worst is None:
        with context.step("All pairs of angles"):
            better = _with_worst(trials[chosen], poor, tasks, limits, spec.floor, exchanges)
        trials[chosen], verdicts[chosen] = better
        exchanges = 0
    if not _is_clear(trials[chosen], poor, spec):
        with context.step("Room of the mirrors"):
            trials[chosen] = _with_room(trials[chosen], poor, tasks[-1], limits, spec)
            verdicts[chosen] = judged(put_in(trials[chosen].placement, poor))
    if verdicts[chosen].meets(spec.floor):
        with context.step("Errors that hide something"):
            better = trials[chosen], verdicts[chosen]
            better = _with_failures(better, poor, tasks[-1], limits, spec, context.seed + 2)
        trials[chosen], verdicts[chosen] = better
    made = put_in(trials[chosen].placement, poor)
    return MirrorDesign(made, trials, verdicts, tasks, chosen)


def _with_worst(
    trial: Trial,
    poor: Finger,
    tasks: Sequence[Task],
    limits: tuple[Placement, Placement],
    floor: float,
    exchanges: int,
) -> tuple[Trial, Verdict]:
    """A trial searched on with the postures that are worst in it, and the verdict on it.

    The search looks at some postures and the verdict at all. As in an exchange method (R. Hettich,
    K. O. Kortanek, SIAM Rev. 35 (1993) 380) those that the verdict names take the place of others
    until it is content, `exchanges` times at most; the best of the rounds counts.
    """
    best = trial, judged(put_in(trial.placement, poor))
    task, now = tasks[-1], best
    # What is not even seen without errors is looked for without copies, all but one.
    copies = None if np.min(best[1].coverage) >= 1 - HIDDEN else 1
    for number in range(min(exchanges, task.plain)):
        if best[1].meets(floor):
            break
        worst = now[1].worst
        assert worst is not None  # as it is judged everywhere
        task = task.looking_at(worst.postures, number)
        known = _without(now[0].multipliers, task, number)
        more = _searched_on(now[0], limits, task, known, copies)
        now = more, judged(put_in(more.placement, poor))
        best = max(best, now, key=lambda one: one[1].quality(floor))
    return best


def _with_failures(
    found: tuple[Trial, Verdict],
    poor: Finger,
    task: Task,
    limits: tuple[Placement, Placement],
    spec: MirrorSpec,
    seed: int,
) -> tuple[Trial, Verdict]:
    """A trial searched on with errors that hide something in it, and the verdict on it.

    As in `_with_worst`, but with errors: of a sample of these, the ones that hide most take the
    places of copies, in the postures in which they do, one round after the other: those of earlier
    rounds are looked at on while there are places, or the search would come back to what failed
    there. What then hides less often counts, if it still meets all else.
    """
    errors = sample_errors(spec.tolerances, len(poor.mirrors), FAILURE_DRAWS, seed)
    poses, taken = task.angles.shape[1], 0
    now, best, least = found[0], found[0], np.inf
    for number in range(FAILURE_ROUNDS + 1):
        made = put_in(now.placement, poor)
        hidden = 1 - np.min(coverages(made, errors), axis=2)
        most = np.max(hidden, axis=1)
        failed = np.argsort(-most)[: np.sum(most > ROUNDING)]
        if len(failed) < least:
            best, least = now, len(failed)
        if least <= (1 - spec.least_yield) / 2 * len(errors) or number == FAILURE_ROUNDS:
            break
        own = failed[: task.copies // 2]
        copies = task.plain + (taken + np.arange(len(own))) % task.copies
        taken += len(own)
        worst = np.argsort(-hidden[own], axis=1)[:, :poses]
        angles = np.deg2rad(postures(made))[worst]
        task = replace(
            task,
            errors=task.errors.at[copies].set(FAILURE_GROWTH * errors[own]),
            angles=task.angles.at[copies].set(angles),
        )
        now = _searched_on(now, limits, task, now.multipliers)
    verdict = judged(put_in(best.placement, poor))
    return (best, verdict) if verdict.meets(spec.floor) and _is_clear(best, poor, spec) else found


def _is_clear(trial: Trial, poor: Finger, spec: MirrorSpec) -> bool:
    """Whether a trial keeps all clearances."""
    made = put_in(trial.placement, poor)
    return all(one.met for one in clearance_checks(made, spec.room.clearance))


def _with_room(
    trial: Trial,
    poor: Finger,
    task: Task,
    limits: tuple[Placement, Placement],
    spec: MirrorSpec,
) -> Trial:
    """A trial that runs into something, searched on until it keeps all clearances; else as it was.

    Where the inequalities contradict each other, their multipliers grow without end and what gives
    way depends on the scales. So here they begin anew, and only those of the clearances are kept
    from round to round: whatever is hidden then.
    """
    now, known = trial, no_multipliers(task)
    for _ in range(ROOM_ROUNDS):
        now = _searched_on(now, limits, task, known, stage=ROOM)
        if _is_clear(now, poor, spec):
            return now
        known = known | {"clearance": now.multipliers["clearance"]}
    return trial


def _searched_on(
    trial: Trial,
    limits: tuple[Placement, Placement],
    task: Task,
    multipliers: Multipliers,
    copies: int | None = None,
    stage: Stage = STAGES[-1],
) -> Trial:
    """A trial after one more stage; its steps and run time are those of all stages."""
    more = search(trial.placement, limits, [task], copies, [stage], multipliers)
    steps, seconds = more.steps + trial.steps, more.seconds + trial.seconds
    return more._replace(start=trial.start, steps=steps, seconds=seconds)


def _without(multipliers: Multipliers, task: Task, number: int) -> Multipliers:
    """Multipliers for a task, one of whose looks without errors has other postures now."""
    poses = task.angles.shape[1]
    own = slice(number * poses, (number + 1) * poses)
    zeroed = {name: multipliers[name].at[own].set(0.0) for name in ("coverage", "resolution")}
    return multipliers | zeroed


def _poor(finger: Finger, spec: MirrorSpec) -> Finger:
    poor = poor_layout(finger, spec.camera, spec.phalanges, spec.room.mount)
    return replace(poor, layers=spec.pads.layers())


def first_placements(finger: Finger, spec: MirrorSpec, seed: int) -> list[Placement]:
    """Where searches begin: the poor layout, random ones and, of layered pads, the reference.

    The reference has its camera in the intermediate phalanx and no mirror there: it is left out
    where the settings have others.

    Args:
        finger: its body.
        spec: camera, room and how many random ones.
        seed: of these.
    """
    poor = _poor(finger, spec)
    starts = [free_part(poor), *_random(poor, spec, seed)]
    alike = spec.camera.phalanx == "intermediate" and "intermediate" not in spec.phalanges
    if poor.layers is not None and alike:
        known = reference_layout(finger, spec.camera, spec.phalanges, spec.room.mount)
        starts.append(free_part(replace(known, layers=poor.layers)))
    return starts


def _random(finger: Finger, spec: MirrorSpec, seed: int) -> list[Placement]:
    count, (least, greatest) = spec.search.starts, bounds(finger, spec)
    points = draw_sobol_starts(problem_of(spec, Task.of(finger, spec, seed)), count, seed)
    starts = [jax.tree.map(lambda leaf, i=i: jnp.asarray(leaf[i]), points) for i in range(count)]
    # Depths are drawn as heights, so that a seed gives the starts that it gave when the places of
    # camera and mirrors were heights.
    placed: list[Callable[[Any], Any]] = [lambda one: one.camera.depth]
    if finger.mirrors:
        placed.append(lambda one: one.mirrors)
    for depths in placed:
        low, high = depths(least), depths(greatest)
        starts = [
            eqx.tree_at(depths, start, jax.tree.map(_turned_over, low, high, depths(start)))
            for start in starts
        ]
    return starts


def _turned_over(low: Array, high: Array, point: Array) -> Array:
    """A depth, or the depths of two ends, as far from the other bound."""
    turned = low + high - point
    return turned if point.ndim == 0 else point.at[:, 1].set(turned[:, 1])


def search(
    start: Placement,
    bounds: tuple[Placement, Placement],
    tasks: Sequence[Task],
    copies: int | None = None,
    stages: Sequence[Stage] | None = None,
    multipliers: Multipliers | None = None,
) -> Trial:
    """Search from one start through all stages.

    Args:
        start: it need not be inside the bounds.
        bounds: least and greatest values.
        tasks: one for each stage, all of one size.
        copies: the first so many of a task count; all of them by default.
        stages: `STAGES` by default.
        multipliers: of the inequalities, as far as these are known; 0 by default.
    """
    begin = time.perf_counter()
    units, build = ravel_pytree(scale(tasks[0].finger))
    low, high, point = (ravel_pytree(one)[0] / units for one in (*bounds, start))
    multipliers = no_multipliers(tasks[0]) if multipliers is None else multipliers
    count = jnp.asarray(tasks[0].copies if copies is None else copies)
    terms: Evaluation | None = None
    steps = 0
    for task, stage in zip(tasks, STAGES if stages is None else stages, strict=True):
        penalties = stage.penalties
        given = task, count, penalties, multipliers
        point, taken, reached = _stage(point, (low, high), given)
        multipliers = {
            name: jnp.maximum(multipliers[name] - penalties[name] * level, 0.0)
            for name, level in reached.inequalities.items()
        }
        terms, steps = reached, steps + int(taken)
    assert terms is not None
    placement, objective, violation = build(point * units), float(terms.value), _violation(terms)
    seconds = time.perf_counter() - begin
    return Trial(start, placement, objective, violation, steps, seconds, multipliers)


@QuickJit
def _stage(
    point: Float[Array, " parameters"],
    bounds: tuple[Float[Array, " parameters"], Float[Array, " parameters"]],
    given: tuple[Task, Int[Array, ""], Penalties, Multipliers],
) -> tuple[Float[Array, " parameters"], Int[Array, ""], Evaluation]:
    """One stage: where it ends, inside the bounds, its number of steps, and the terms there."""

    def walled(
        point: Float[Array, " parameters"], given: Any
    ) -> tuple[Float[Array, ""], Evaluation]:
        inside = jnp.clip(point, *bounds)
        value, terms = _value(inside, given)
        return SHARE * value + WALL * jnp.sum((point - inside) ** 2), terms

    # Traced once: for the value and for its derivative JAX would trace it anew, 8 s each.
    traced = eqx.filter_closure_convert(lagrangian, point, *given)
    solver = optx.BFGS(TOLERANCE, TOLERANCE)
    found = optx.minimise(
        walled,
        solver,
        jnp.clip(point, *bounds),
        (traced, given),
        has_aux=True,
        max_steps=STEPS,
        throw=False,
    )
    return jnp.clip(found.value, *bounds), found.stats["num_steps"], found.aux


@eqx.filter_custom_jvp
def _value(point: Float[Array, " parameters"], given: Any) -> tuple[Float[Array, ""], Evaluation]:
    """Value and terms of a traced `lagrangian`; the value's derivative is the slope it gives."""
    traced, data = given
    found, _ = traced(point, *data)
    return found


@_value.def_jvp
def _with_slope(at: Any, towards: Any) -> Any:
    traced, data = at[1]
    (value, terms), slope = traced(at[0], *data)
    return (value, terms), (slope @ towards[0], jax.tree.map(jnp.zeros_like, terms))


def measured(placement: Placement, task: Task, copies: int | None = None) -> tuple[float, float]:
    """Objective and largest scaled violation of a placement, by the search's own program."""
    point = ravel_pytree(jax.tree.map(jnp.divide, placement, scale(task.finger)))[0]
    count = jnp.asarray(task.copies if copies is None else copies)
    none = no_multipliers(task)
    (_, terms), _ = lagrangian(point, task, count, Stage(1.0, 0.0).penalties, none)
    return float(terms.value), _violation(terms)


def _violation(terms: Evaluation) -> float:
    return max(float(jnp.max(-leaf, initial=0.0)) for leaf in terms.inequalities.values())


def no_multipliers(task: Task) -> Multipliers:
    """Zeros: nothing is known of the inequalities yet."""
    of_pads = jnp.zeros((task.plain * task.angles.shape[1], len(PHALANGES)))
    of_rest = jnp.zeros(len(clearance_names(task.finger)))
    return {"coverage": of_pads, "resolution": of_pads, "clearance": of_rest}


@jax.jit
def lagrangian(
    point: Float[Array, " parameters"],
    task: Task,
    copies: Int[Array, ""],
    penalties: Penalties,
    multipliers: Multipliers,
) -> tuple[tuple[Float[Array, ""], Evaluation], Float[Array, " parameters"]]:
    """Augmented Lagrangian of `problem.terms_of`, the terms, and its slope.

    It is a sum over looks, so each look's slope is found by itself: nothing of the other looks is
    kept for it, and how many copies count is a number, not a shape.
    """
    units, build = ravel_pytree(scale(task.finger))
    plain, poses = task.plain, task.angles.shape[1]
    of_pads = {
        name: given.reshape(plain, poses, -1)
        for name, given in multipliers.items()
        if name != "clearance"
    }

    def of_look(
        point: Float[Array, " parameters"], number: Int[Array, ""]
    ) -> tuple[Float[Array, ""], Look]:
        seen = look(build(point * units), task, number)
        own = jnp.minimum(number, plain - 1)
        unmet = sum(
            _unmet(seen.levels[name], given[own], penalties[name])
            for name, given in of_pads.items()
        )
        with_errors = number >= plain
        value = jnp.where(with_errors, 100 / copies, 100 / plain) * seen.missing
        return value + jnp.where(with_errors, 0.0, unmet), seen._replace(missing=value)

    def of_rest(
        point: Float[Array, " parameters"],
    ) -> tuple[Float[Array, ""], tuple[Float[Array, ""], Float[Array, " clearances"]]]:
        price, clearance = cost_and_clearance(build(point * units), task)
        unmet = _unmet(clearance, multipliers["clearance"], penalties["clearance"])
        return price + unmet, (price, clearance)

    def add(number: Int[Array, ""], so_far: Any) -> Any:
        total, value, levels, slope = so_far
        (part, seen), of_part = jax.value_and_grad(of_look, has_aux=True)(point, number)
        levels = jax.tree.map(lambda all_, one: all_.at[number].set(one), levels, seen.levels)
        return total + part, value + seen.missing, levels, slope + of_part

    (total, (price, clearance)), slope = jax.value_and_grad(of_rest, has_aux=True)(point)
    levels = {
        name: jnp.zeros((len(task.angles), *given.shape[1:])) for name, given in of_pads.items()
    }
    first = (total, price, levels, slope)
    total, value, levels, slope = jax.lax.fori_loop(0, plain + copies, add, first)
    inequalities = {
        name: level[:plain].reshape(multipliers[name].shape) for name, level in levels.items()
    } | {"clearance": clearance}
    return (total, Evaluation(objective=value, inequalities=inequalities)), slope


def _unmet(
    levels: Float[Array, "*all"], multipliers: Float[Array, "*all"], penalty: Float[Array, ""]
) -> Float[Array, ""]:
    squares = jnp.maximum(multipliers - penalty * levels, 0.0) ** 2 - multipliers * multipliers
    return jnp.sum(squares) / jnp.maximum(2 * penalty, 1e-9)
