"""A sweep from its points to its result: what is missing is computed, and kept as it comes."""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Sequence
from contextlib import closing
from functools import partial
from importlib.metadata import entry_points
from pathlib import Path

from designopt.errors import Interrupted, UserError
from designopt.interrupts import interruptible
from designopt.progress import point_display
from designopt.study.runner import RECORDED_PACKAGES
from designopt.study.settings import spec_with
from designopt.study.study import STUDY_GROUP
from designopt.sweep.cluster import run_on_cluster
from designopt.sweep.evaluating import Task, version_of
from designopt.sweep.outcomes import Outcome, failed
from designopt.sweep.points import Sweep
from designopt.sweep.results import write_result
from designopt.sweep.store import RESULT, Folder, kept_in, only_one
from designopt.sweep.workers import run_locally

LARGEST_BATCH = 64
LEAST_TASKS = 16
"""A study with ``batch`` is given so many tasks at least, for several workers to have some."""

Answers = Generator[tuple[int, list[Outcome] | None]]
"""Tasks by their number with what became of their points; ``None`` where the worker was lost."""

LOST = failed(
    "its worker was lost again and again (it crashed, or was killed, perhaps for want of memory); "
    "give the same command again to try once more",
    final=False,
)


def run_sweep(
    sweep: Sweep, out: Path, *, workers: int, scheduler: str | None, force: bool
) -> dict[int, Outcome]:
    """Compute what is missing, and write the result once every point is finished.

    Args:
        sweep: what is asked for.
        out: its folder.
        workers: processes on this machine.
        scheduler: address of a dask scheduler, to compute on its cluster instead; ``None`` for
            this machine.
        force: whether another sweep in the folder may be replaced.

    Returns:
        What became of every point, by its number.

    Raises:
        UserError: no point's settings are valid, the folder holds something else or cannot be
            written, or the cluster fails; points that were finished are kept.
        Interrupted: by Ctrl-C or SIGTERM; points that were finished are kept.
    """
    kept: dict[int, Outcome] = {}
    everything = range(len(sweep.points))
    here = partial(run_locally, count=workers)
    run = here if scheduler is None else partial(run_on_cluster, address=scheduler)
    try:
        with interruptible() as check:
            refused = _refused(sweep)
            with only_one(out):
                folder = Folder(out, _definition(sweep), force=force)
                before = folder.outcomes([sweep.points.settings(index) for index in everything])
                kept |= {index: outcome for index, outcome in before.items() if outcome.final}
                for index in refused.keys() - kept.keys():
                    _keep(sweep, folder, kept, index, refused[index])
                # The groups are those of the whole sweep, however much of it is kept: the last
                # bits of a batch may depend on what else is in it.
                valid = [index for index in everything if index not in refused]
                width = _width(sweep, len(valid))
                groups = [valid[start : start + width] for start in range(0, len(valid), width)]
                _compute(sweep, folder, kept, groups, width, run, check)
                write_result(sweep, [kept[index] for index in everything], out / RESULT)
                check()
    except KeyboardInterrupt as interrupt:
        raise Interrupted(f"{_kept(sweep, out)}; the same command goes on") from interrupt
    return kept


def _refused(sweep: Sweep) -> dict[int, Outcome]:
    """The points whose settings are not valid."""
    refused, study = {}, sweep.study
    for index in range(len(sweep.points)):
        texts = sweep.settings_of(index)
        try:
            spec_with(study.spec, texts, study=study.name, config=sweep.config)
        except UserError as error:
            refused[index] = failed(str(error), final=True)
    if len(refused) == len(sweep.points):
        raise UserError(f"no point can be computed: {refused[0].failure}")
    return refused


def versions_of(study: str) -> dict[str, str]:
    """Of Python, of the packages that shape the numbers, and of the one that offers the study."""
    points = entry_points(group=STUDY_GROUP, name=study)
    offering = [point.dist.name for point in points if point.dist is not None]
    return {name: version_of(name) for name in ("python", *RECORDED_PACKAGES, *offering)}


def _definition(sweep: Sweep) -> dict[str, object]:
    return {
        "study": sweep.study.name,
        "points": dict(sweep.points.definition),
        "settings": list(sweep.settings),
        "config": dict(sweep.config.tables),
        "seed": sweep.seed,
        "dtype": sweep.dtype,
        "versions": dict(sweep.versions),
    }


def _width(sweep: Sweep, points: int) -> int:
    """Points in a task. Independent of the number of workers, or the numbers would depend on it."""
    if sweep.study.batch is None:
        return 1
    return min(LARGEST_BATCH, math.ceil(points / LEAST_TASKS))


def _compute(
    sweep: Sweep,
    folder: Folder,
    kept: dict[int, Outcome],
    groups: Sequence[Sequence[int]],
    width: int,
    run: Callable[[Sequence[Task]], Answers],
    check: Callable[[], None],
) -> None:
    """Compute and keep the points of these groups that are not kept yet."""
    missing = [group for group in groups if not kept.keys() >= set(group)]
    if not missing:
        return
    name = sweep.study.name
    given = width, sweep.seed, sweep.dtype, sweep.versions, sweep.config
    answers = run([Task(name, tuple(map(sweep.settings_of, group)), *given) for group in missing])
    failures = sum(bool(outcome.failure) for outcome in kept.values())
    alone: list[list[int]] = []
    try:
        with point_display(len(sweep.points), len(kept), failures) as show, closing(answers):
            for task, answer in answers:
                if answer is None and len(missing[task]) > 1:
                    alone += [[index] for index in missing[task]]
                    continue
                for index, outcome in zip(missing[task], answer or [LOST], strict=True):
                    if index not in kept:
                        _keep(sweep, folder, kept, index, outcome)
                        show(bool(outcome.failure))
                check()
    except UserError as error:
        raise UserError(f"{error}; {_kept(sweep, folder.path)}") from error
    # Some point ends every worker that is given its group: the others of the group have answers.
    _compute(sweep, folder, kept, alone, width, run, check)


def _keep(
    sweep: Sweep, folder: Folder, kept: dict[int, Outcome], index: int, outcome: Outcome
) -> None:
    folder.keep(index, sweep.points.settings(index), outcome)
    kept[index] = outcome


def _kept(sweep: Sweep, out: Path) -> str:
    # Counted there: an interrupt may come just after a point was written.
    return f"{len(kept_in(out))} of {len(sweep.points)} points are kept in {out}"
