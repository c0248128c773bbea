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

from designopt.designs.bench import Step, Values
from designopt.errors import UserError
from designopt.optimising import Iteration, Problem, Terms
from optics.scene import Scene
from optics.scene_bench_knobs import Dimensions, Handles, arranged
from optics.views import Pieces
from optics.visibility import find_views

GRID = {0: 1, 1: 9, 2: 4}
"""How many angles of every joint are looked at together, by the number of joints."""
SCATTERED = 16
"""How many poses are, if there are more joints: those of a Sobol sequence."""

SHARPER = 1.0
"""What a resolution e times as high is worth, in % of a pad that is not seen."""
SOFT = 0.03
"""How much, in logarithms, a resolution is above the least one to count a third as much."""
PLACES = 9
"""Places along a pad at which resolution is asked for."""
NO_VIEW = 30.0
"""Logarithm of the resolution of what is not seen: that is coverage's concern."""

MILLIMETRE, TENTH = 1.0, 0.1
"""Changes of a place (mm) and of a direction (rad) that matter about as much as each other."""

UPDATES, STEPS = 40, 3
"""Cap on iterations, and steps in each."""
GAIN, PATIENCE = 1e-2, 6
"""So many iterations that each gain less than this, in %, end the search."""


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
    """

    scene: Scene
    dimensions: Dimensions
    poses: Float[Array, "poses joints"]


class Worth(NamedTuple):
    """What an arrangement is worth, over all poses and pads.

    Attributes:
        covered: least part of a pad that is seen.
        sharp: least resolution of what is seen, px/mm; 0 where nothing is seen at all.
    """

    covered: Float[Array, ""]
    sharp: Float[Array, ""]


class Improver:
    """Moves camera and mirrors so that more is seen, and more sharply; compiled once for a scene.

    What is minimised is the part of all pads that is not seen, in % and on average over poses that
    cover the joints' ranges, a hidden pad counting more by the angle by which it is missed; less
    `SHARPER` times the logarithm of the least resolution.
    """

    def __init__(self, handles: Handles) -> None:
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

    def _iteration(self, asked: Callable[[Free, Task], Terms]) -> Iteration:
        knobs = self._handles.knobs
        first, low, high = (
            {knob.name: getattr(knob, end) for knob in knobs} for end in ("value", "low", "high")
        )
        lower, upper = (self._free(self._task(ends)) for ends in (low, high))
        scale = Free(
            jnp.full_like(lower.position, MILLIMETRE),
            jnp.full_like(lower.direction, TENTH),
            jnp.full_like(lower.mirrors, MILLIMETRE),
        )
        problem = Problem(asked, lower, upper, scale, data=(self._task(first),))
        return Iteration(problem, steps=STEPS)

    def _task(self, values: Values) -> Task:
        dimensions = jax.tree.map(jnp.asarray, self._handles.dimensions(values))
        return Task(self._handles.design.scene, dimensions, self._poses)

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
        start = self._free(task)
        worth = _worth(start, task)
        iteration = self._coverage if float(worth.covered) > 0 else self._hidden
        best, least, idle, end = start, np.inf, 0, ""
        solve = iteration.run(start, (task,), updates=UPDATES)
        for number, found in enumerate(solve, start=1):
            idle = 0 if found.objective < least - GAIN else idle + 1
            if found.objective < least:
                best, least = found.parameters, found.objective
            moved = _put(task.dimensions, found.parameters)
            told = _told(_worth(found.parameters, task))
            yield Step(self._handles.values(values, moved), told)
            if idle == PATIENCE:
                break
            if found.done and not found.converged:
                end = f"; not converged after {number} iterations"
        moved = _put(task.dimensions, best)
        told = f"{_told(_worth(best, task))}; it was {_told(worth)}{end}"
        yield Step(self._handles.values(values, moved), told)


def poses_of(handles: Handles) -> Float[np.ndarray, "poses joints"]:
    """Poses that stand for the ranges of all joints, rad."""
    ranges = [(math.radians(knob.low), math.radians(knob.high)) for knob in handles.joints]
    if len(ranges) in GRID:
        count = GRID[len(ranges)]
        grid = list(itertools.product(*(np.linspace(low, high, count) for low, high in ranges)))
        return np.array(grid).reshape(len(grid), len(ranges))
    low, high = np.transpose(ranges)
    return low + qmc.Sobol(len(ranges), scramble=False).random(SCATTERED) * (high - low)


def terms(free: Free, task: Task) -> Terms:
    """The objective, of which 1 is 1 % of a pad; differentiable."""
    scene, view, _ = _looked(free, task)
    return _objective(scene, view, 1 - view.coverage())


def terms_of_hidden(free: Free, task: Task) -> Terms:
    """`terms` in which what is not seen counts more by the angle (rad) by which a pad is missed.

    Coverage alone has no slope where a pad is wholly hidden; the angle shows the way out. It takes
    most of the time to compile.
    """
    scene, view, margin = _looked(free, task)
    missed = jnp.maximum(-jnp.max(margin, axis=-2), 0.0)
    return _objective(scene, view, (1 - view.coverage()) * (1 + missed))


def _looked(free: Free, task: Task) -> tuple[Scene, Pieces, Float[Array, "poses paths pads"]]:
    scene = arranged(task.scene, _put(task.dimensions, free))
    views = find_views(scene, task.poses)
    return scene, views.value, views.margin


def _objective(scene: Scene, view: Pieces, missing: Float[Array, "poses pads"]) -> Terms:
    least = -SOFT * jax.nn.logsumexp(-_log_resolution(scene, view) / SOFT)
    return Terms(objective=100 * jnp.mean(jnp.sum(missing, axis=-1)) - SHARPER * least)


def _log_resolution(scene: Scene, view: Pieces) -> Float[Array, "*poses pads places"]:
    """Logarithm of the resolution (px/mm) at places of each pad, each by the best view of it.

    Squared distance is a quadratic of the place (Stewart's theorem), and resolution times squared
    distance is taken as linear, which it is for an equidistant lens.
    """
    step = scene.pads[:, 1] - scene.pads[:, 0]
    lengths = jnp.sqrt(jnp.sum(step * step, axis=-1))[None, :, None, None]
    at = jnp.linspace(0.0, 1.0, PLACES, dtype=lengths.dtype)[None, None, None]
    there, start, end = (leaf[..., None] for leaf in (view.present, view.start, view.end))
    inside = there & (start <= at) & (at <= end)
    width = jnp.where(there, end - start, 1.0)
    part = jnp.where(inside, (at - start) / width, 0.0)
    first, last = (view.distance[..., i, None] ** 2 for i in (0, 1))
    squared = first + part * (last - first) - part * (1 - part) * (width * lengths) ** 2
    scaled = [view.px_per_mm[..., i, None] * (first, last)[i] for i in (0, 1)]
    sharp = (scaled[0] + part * (scaled[1] - scaled[0])) / jnp.where(inside, squared, 1.0)
    best = jnp.max(jnp.where(inside, sharp, 0.0), axis=-2)
    return jnp.where(best > 0, jnp.log(jnp.where(best > 0, best, 1.0)), NO_VIEW)


@jax.jit
def _worth(free: Free, task: Task) -> Worth:
    scene, view, _ = _looked(free, task)
    sharp = jnp.min(_log_resolution(scene, view))
    return Worth(jnp.min(view.coverage()), jnp.where(sharp < NO_VIEW, jnp.exp(sharp), 0.0))


def _told(worth: Worth) -> str:
    return (
        f"{100 * float(worth.covered):.1f} % of the worst pad seen, "
        f"{float(worth.sharp):.3g} px/mm at least"
    )


def _put(dimensions: Dimensions, free: Free) -> Dimensions:
    mirrors = jnp.concatenate([free.mirrors, dimensions.mirrors[len(free.mirrors) :]])
    return Dimensions(
        free.position, free.direction, dimensions.field_of_view, mirrors, dimensions.radii
    )
