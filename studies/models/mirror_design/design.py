"""Designing the mirrors of a body: several starts, each judged degree by degree, and the best."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import jax
import jax.numpy as jnp

from designopt.optimize import sobol_starts
from designopt.study.study import Context
from optics.scene.scene import Scene
from studies.models.body import BodySpec
from studies.models.mirror_design.arrangement import Arrangement, bounds, poor_start, scene_of
from studies.models.mirror_design.judging import Verdict, judged
from studies.models.mirror_design.problem import Task, problem_of
from studies.models.mirror_design.searching import STAGES, Trial, search
from studies.models.mirror_design.spec import MirrorSpec


@dataclass(frozen=True)
class MirrorDesign:
    """The mirrors that were designed for a body.

    Attributes:
        arrangement: camera and mirrors, each in its phalanx; `arrangement.scene_table` writes it.
        scene: the finger with them.
        verdict: what it shows, degree by degree.
        trials: what every start led to: the poor one first, then the random ones.
        verdicts: on every trial.
        tasks: of all stages.
        chosen: index of the trial that was taken.
    """

    arrangement: Arrangement
    scene: Scene
    verdict: Verdict
    trials: Sequence[Trial]
    verdicts: Sequence[Verdict]
    tasks: Sequence[Task]
    chosen: int

    @property
    def task(self) -> Task:
        """The last stage's; its errors are those that the search has seen."""
        return self.tasks[-1]

    def meets(self, trial: int, floor: float) -> bool:
        """Whether a trial sees everything, with at least a resolution (px/mm)."""
        return meets(self.verdicts[trial], floor)


def meets(verdict: Verdict, floor: float) -> bool:
    """Whether everything is seen, with at least a resolution (px/mm)."""
    return verdict.worst_coverage == 1.0 and verdict.worst_px_per_mm >= floor


def design_mirrors(body: BodySpec, spec: MirrorSpec, context: Context) -> MirrorDesign:
    """Camera and mirrors that show all pads of a body in every posture and bear errors.

    Args:
        body: the finger's body.
        spec: camera, room, tolerances, resolution and how to search.
        context: its seed chooses the random starts and the errors that the search sees; the float
            type is that of the study that runs.

    Returns:
        The trial of least objective among those that see everything with the resolution asked for
        on a 1° grid; if none does, that of least objective and violation. ``verdict`` says which.
    """
    tasks = [
        Task.of(body, spec, context.seed + number, stage.growth)
        for number, stage in enumerate(STAGES)
    ]
    task, limits = tasks[-1], bounds(body, spec)
    starts = [poor_start(body), *_random(body, spec, task, context.seed)]
    trials, verdicts = [], []
    for number, start in enumerate(starts):
        with context.step(f"T = {body.thickness:g} mm: start {number + 1} of {len(starts)}"):
            trials.append(search(start, limits, tasks, STAGES))
            found = scene_of(trials[-1].arrangement, task.finger)
            verdicts.append(judged(found, body.range_deg))

    def rank(number: int) -> tuple[bool, float]:
        fine = meets(verdicts[number], spec.floor)
        trial = trials[number]
        return not fine, trial.objective + (0.0 if fine else 100 * trial.violation)

    chosen = min(range(len(trials)), key=rank)
    arrangement = trials[chosen].arrangement
    scene = scene_of(arrangement, task.finger)
    return MirrorDesign(arrangement, scene, verdicts[chosen], trials, verdicts, tasks, chosen)


def _random(body: BodySpec, spec: MirrorSpec, task: Task, seed: int) -> list[Arrangement]:
    count = spec.search.starts
    points = sobol_starts(problem_of(body, spec, task), count, seed)
    return [jax.tree.map(lambda leaf, i=i: jnp.asarray(leaf[i]), points) for i in range(count)]
