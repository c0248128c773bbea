"""Camera and mirrors of a scene improved from where they stand, a few steps at a time."""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Callable, Iterator
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.stats import qmc

from designopt.errors import UserError
from designopt.explore.bench import Step, Values
from designopt.optimize import Evaluation, Iteration, Problem
from optics.explore.scene_knobs import Dimensions, ParameterMap, apply_parameters
from optics.explore.scene_seeing import sharpness_of
from optics.scene.scene import Scene
from optics.visibility.coverage import find_views
from optics.visibility.views import Pieces

GRID = {0: 1, 1: 9, 2: 4}
"""How many angles of every joint are looked at together, by the number of joints."""
SCATTERED = 16
"""How many poses are, if there are more joints: those of a Sobol sequence."""

SOFT = 0.03
"""How much, in logarithms, a resolution is above the least one to count a third as much."""
PLACES = 17
"""Places along a pad at which resolution is asked for, its ends included."""
BEYOND = (30.0, 100.0, 300.0)
"""How much less, in logarithms, a view is worth at a place one pad's length beyond its end. What
is seen best often ends at the pad's end, and slopes have to tell that it must not recede: gently
at first, as a search gets far on gentle slopes, and then as steeply as is true."""
NO_VIEW = 30.0
"""Logarithm of the resolution of a pad that is not seen: that is coverage's concern."""

MILLIMETER, TENTH = 1.0, 0.1
"""Changes of a place (mm) and of a direction (rad) that matter about as much as each other."""

UPDATES, STEPS = 120, 3
"""Cap on iterations, and steps in each."""
GAIN, PATIENCE = 1e-2, 6
"""So many iterations that together gain less than this part of a resolution end the search."""
FINE = 1e-4
"""A smaller part of a pad may be left out, and does not count."""


class Free(eqx.Module):
    """What is improved of the dimensions.

    Attributes:
        position: of the camera, mm.
        direction: of the optical axis, rad.
        mirrors: ends of the mirrors that have knobs, mm.
    """

    position: Float[Array, "2"]
    direction: Float[Array, ""]
    mirrors: Float[Array, "mirrors 2 2"]


class Task(eqx.Module):
    """What stays as it is.

    Attributes:
        scene: as in its file.
        dimensions: as they stand.
        poses: joint angles to look at, rad.
        beyond: one of `BEYOND`.
    """

    scene: Scene
    dimensions: Dimensions
    poses: Float[Array, "poses joints"]
    beyond: Float[Array, ""]


class Worth(NamedTuple):
    """What an arrangement is worth, over all poses and pads; the greater is better.

    Attributes:
        covered: least part of a pad that is seen.
        mean: part that is seen, on average.
        sharp: least resolution of what is seen, px/mm; 0 where nothing is seen at all.
    """

    covered: float
    mean: float
    sharp: float

    @property
    def order(self) -> tuple[float, float, float]:
        """By this it is compared: what is seen first, and `FINE` parts of it do not count."""
        return (round(self.covered / FINE), round(self.mean / FINE), self.sharp)

    def exceeds(self, other: Worth) -> bool:
        """Whether it is better by more than little."""
        *seen, sharp = self.order
        *less, blunt = other.order
        return seen > less or (seen == less and sharp > (1 + GAIN) * blunt)


class Improver:
    """Moves camera and mirrors so that more is seen, and more sharply; compiled once for a scene.

    What is maximised is the least resolution over poses that cover the joints' ranges, while all of
    every pad has to be seen in all of them; a hidden pad counts more by the angle by which it is
    missed. It never ends worse than it began: first of all in what is seen of the worst pad.
    """

    def __init__(self, handles: ParameterMap) -> None:
        """Nothing is compiled yet.

        Raises:
            UserError: the scene has curved mirrors.
        """
        layout = handles.design.scene.layout
        if layout.curved:
            names = ", ".join(layout.mirrors[index].name for index in layout.curved)
            raise UserError(
                f"mirror {names}: the search looks into straight mirrors only; "
                "turn the knobs by hand"
            )
        self._handles = handles
        self._poses = jnp.asarray(poses_of(handles))
        mirrors = {handle.place[0] for handle in handles.handles if handle.field == "mirrors"}
        self._count = len(mirrors)

    @functools.cached_property
    def _coverage(self) -> Iteration:
        return self._iteration(terms)

    @functools.cached_property
    def _hidden(self) -> Iteration:
        return self._iteration(terms_of_hidden)

    def _iteration(self, asked: Callable[[Free, Task], Evaluation]) -> Iteration:
        knobs = self._handles.knobs
        first, low, high = (
            {knob.name: getattr(knob, end) for knob in knobs} for end in ("value", "low", "high")
        )
        lower, upper = (self._free(self._task(ends)) for ends in (low, high))
        scale = Free(
            jnp.full_like(lower.position, MILLIMETER),
            jnp.full_like(lower.direction, TENTH),
            jnp.full_like(lower.mirrors, MILLIMETER),
        )
        problem = Problem(asked, lower, upper, scale, data=(self._task(first),))
        return Iteration(problem, steps=STEPS)

    def _task(self, values: Values) -> Task:
        dimensions = jax.tree.map(jnp.asarray, self._handles.dimensions(values))
        return Task(self._handles.design.scene, dimensions, self._poses, jnp.asarray(BEYOND[0]))

    def _free(self, task: Task) -> Free:
        found = task.dimensions
        position, direction, mirrors = map(
            jnp.asarray, (found.position, found.direction, found.mirrors)
        )
        return Free(position, direction, mirrors[: self._count])

    def steps(self, values: Values) -> Iterator[Step]:
        """Where every iteration from these values has come to; the last one is the best.

        Raises:
            UserError: they describe no scene.
        """
        self._handles.tables(values)
        return self._steps(values)

    def _steps(self, values: Values) -> Iterator[Step]:
        task = self._task(values)
        best = first = self._free(task)
        greatest = before = self._worth(first, task)
        iteration = self._coverage if before.covered > 0 else self._hidden
        number, since, end = 0, before, ""
        for steepness in itertools.cycle(BEYOND):
            task = eqx.tree_at(lambda task: task.beyond, task, jnp.asarray(steepness))
            trail, kept = list[float](), list[Worth]()
            for found in iteration.run(best, (task,), updates=UPDATES - number):
                number += 1
                worth = self._worth(found.parameters, task)
                if worth.order > greatest.order:
                    best, greatest = found.parameters, worth
                yield self._step(values, task, found.parameters, _told(worth))
                trail.append(found.objective)
                kept.append(greatest)
                if _idle(trail, kept):
                    end = f"little gained in the last {PATIENCE} iterations"
                    break
                end = "converged" if found.converged else f"stopped after {number} iterations"
            if number == UPDATES:
                break
            if steepness == BEYOND[-1]:
                if greatest == since:
                    break
                since = greatest
        yield self._step(values, task, best, f"{_told(greatest)}; it was {_told(before)}; {end}")

    def _step(self, values: Values, task: Task, free: Free, message: str) -> Step:
        return Step(self._handles.values(values, _put(task.dimensions, free)), message)

    def _worth(self, free: Free, task: Task) -> Worth:
        scene, view = _seen(free, task)
        covered = np.asarray(view.coverage())
        least = sharpness_of(scene, np.asarray(task.poses), view).px_per_mm[..., 0]
        sharp = float(np.min(least, where=least > 0, initial=np.inf))
        sharp = sharp if math.isfinite(sharp) else 0.0
        return Worth(float(np.min(covered)), float(np.mean(covered)), sharp)


def _idle(trail: list[float], kept: list[Worth]) -> bool:
    """Whether the last iterations have hardly changed the objective, nor found anything better."""
    last = slice(-1 - PATIENCE, None)
    few = len(trail) <= PATIENCE
    still = not few and float(np.ptp(trail[last])) < GAIN
    return still and not kept[-1].exceeds(kept[last][0])


def poses_of(handles: ParameterMap) -> Float[np.ndarray, "poses joints"]:
    """Poses that stand for the ranges of all joints, rad."""
    ranges = [(math.radians(knob.low), math.radians(knob.high)) for knob in handles.joints]
    if len(ranges) in GRID:
        count = GRID[len(ranges)]
        grid = list(itertools.product(*(np.linspace(low, high, count) for low, high in ranges)))
        return np.array(grid).reshape(len(grid), len(ranges))
    low, high = np.transpose(ranges)
    return low + qmc.Sobol(len(ranges), scramble=False).random(SCATTERED) * (high - low)


def terms(free: Free, task: Task) -> Evaluation:
    """Resolution, and that all is seen; differentiable."""
    scene, view, _ = _looked(free, task)
    return _objective(scene, view, 1 - view.coverage(), task)


def terms_of_hidden(free: Free, task: Task) -> Evaluation:
    """`terms` in which what is not seen counts more by the angle (rad) by which a pad is missed.

    Coverage alone has no slope where a pad is wholly hidden; the angle shows the way out. It takes
    most of the time to compile.
    """
    scene, view, margin = _looked(free, task)
    missed = jnp.maximum(-jnp.max(margin, axis=-2), 0.0)
    return _objective(scene, view, (1 - view.coverage()) * (1 + missed), task)


def _looked(free: Free, task: Task) -> tuple[Scene, Pieces, Float[Array, "poses paths pads"]]:
    scene = apply_parameters(task.scene, _put(task.dimensions, free))
    views = find_views(scene, task.poses)
    return scene, views.value, views.margin


def _objective(
    scene: Scene, view: Pieces, missing: Float[Array, "poses pads"], task: Task
) -> Evaluation:
    sharp = _log_resolution(scene, view, task.beyond)
    least = -SOFT * jax.nn.logsumexp(-sharp / SOFT)
    return Evaluation(objective=-least, inequalities={"seen": FINE - missing})


def _log_resolution(
    scene: Scene, view: Pieces, beyond: Float[Array, ""]
) -> Float[Array, "*poses pads places"]:
    """Logarithm of the resolution (px/mm) at places of each pad, each by the best view of it.

    Squared distance is a quadratic of the place (Stewart's theorem), and resolution times squared
    distance is taken as linear, which it is for an equidistant lens. Beyond a view's end it is
    what it is there, less ``beyond`` times the distance in lengths of the pad.
    """
    step = scene.pads[:, 1] - scene.pads[:, 0]
    lengths = jnp.sqrt(jnp.sum(step * step, axis=-1))[None, :, None, None]
    at = jnp.linspace(0.0, 1.0, PLACES, dtype=lengths.dtype)[None, None, None]
    there, start, end = (leaf[..., None] for leaf in (view.present, view.start, view.end))
    there &= end > start
    width = jnp.where(there, end - start, 1.0)
    gap = jnp.maximum(jnp.maximum(start - at, at - end), 0.0)
    part = jnp.where(there, jnp.clip((at - start) / width, 0.0, 1.0), 0.0)
    first, last = (view.distance[..., i, None] ** 2 for i in (0, 1))
    squared = first + part * (last - first) - part * (1 - part) * (width * lengths) ** 2
    scaled = [view.px_per_mm[..., i, None] * (first, last)[i] for i in (0, 1)]
    sharp = (scaled[0] + part * (scaled[1] - scaled[0])) / jnp.where(there, squared, 1.0)
    usable = there & (sharp > 0)
    worth = jnp.log(jnp.where(usable, sharp, 1.0)) - beyond * gap
    best = jnp.max(jnp.where(usable, worth, -jnp.inf), axis=-2)
    return jnp.where(jnp.any(usable, axis=-2), best, NO_VIEW)


@jax.jit
def _seen(free: Free, task: Task) -> tuple[Scene, Pieces]:
    scene, view, _ = _looked(free, task)
    return scene, view


def _told(worth: Worth) -> str:
    return f"{100 * worth.covered:.1f} % of the worst pad seen, {worth.sharp:.3g} px/mm at least"


def _put(dimensions: Dimensions, free: Free) -> Dimensions:
    mirrors = jnp.concatenate([free.mirrors, dimensions.mirrors[len(free.mirrors) :]])
    return Dimensions(
        free.position, free.direction, dimensions.field_of_view, mirrors, dimensions.radii
    )
