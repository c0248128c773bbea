"""Designing the mirrors of a body: several starts, each judged degree by degree, and the best."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array

from designopt.optimize import draw_sobol_starts
from designopt.study.study import Context
from studies.models.finger import Finger
from studies.models.mirror_design.judging import Verdict, judged
from studies.models.mirror_design.placement import Placement, bounds, free_part, poor_layout
from studies.models.mirror_design.problem import Task, problem_of
from studies.models.mirror_design.searching import STAGES, Trial, search
from studies.models.mirror_design.spec import MirrorSpec


@dataclass(frozen=True)
class MirrorDesign:
    """The mirrors that were designed for a finger.

    Attributes:
        finger: with its camera and mirrors.
        trials: what every start led to: the poor one first, then the random ones.
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
        """The last stage's; its errors are those that the search has seen."""
        return self.tasks[-1]


def design_mirrors(finger: Finger, spec: MirrorSpec, context: Context) -> MirrorDesign:
    """Camera and mirrors that show all pads of a finger in every posture, errors included.

    Args:
        finger: its body; the design has its pins and spring as well.
        spec: camera, room, tolerances, resolution and how to search.
        context: its seed chooses the random starts and the errors that the search sees; the float
            type is that of the study that runs.

    Returns:
        The trial of least objective among those that see everything with the resolution asked for
        on a 1° grid; if none does, that of least objective and violation. ``verdict`` has which.
    """
    poor = poor_layout(finger, spec.camera)
    tasks = [
        Task.of(poor, spec, context.seed + number, stage.growth)
        for number, stage in enumerate(STAGES)
    ]
    limits = bounds(poor, spec)
    starts = [free_part(poor), *_random(spec, tasks[-1], context.seed)]
    thickness = float(finger.body.thickness)
    trials, verdicts = [], []
    for number, start in enumerate(starts):
        with context.step(f"T = {thickness:g} mm: start {number + 1} of {len(starts)}"):
            trials.append(search(start, limits, tasks, STAGES))
            verdicts.append(judged(eqx.combine(trials[-1].placement, poor)))

    def rank(number: int) -> tuple[bool, float]:
        fine, trial = verdicts[number].meets(spec.floor), trials[number]
        return not fine, trial.objective + (0.0 if fine else 100 * trial.violation)

    chosen = min(range(len(trials)), key=rank)
    best = eqx.combine(trials[chosen].placement, poor)
    return MirrorDesign(best, trials, verdicts, tasks, chosen)


def _random(spec: MirrorSpec, task: Task, seed: int) -> list[Placement]:
    count, (least, greatest) = spec.search.starts, bounds(task.finger, spec)
    points = draw_sobol_starts(problem_of(spec, task), count, seed)
    starts = [jax.tree.map(lambda leaf, i=i: jnp.asarray(leaf[i]), points) for i in range(count)]
    # Depths are drawn as heights, so that a seed gives the starts that it gave when the places of
    # camera and mirrors were heights.
    for depths in (lambda one: one.camera.depth, lambda one: one.mirrors):
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
