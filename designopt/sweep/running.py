"""A sweep from its points to its result: what is missing is computed, and kept as it comes."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from importlib.metadata import entry_points
from pathlib import Path

from designopt.errors import Interrupted, UserError
from designopt.interrupts import interruptible
from designopt.progress import point_display
from designopt.study.runner import RECORDED_PACKAGES
from designopt.study.settings import spec_with
from designopt.study.study import STUDY_GROUP, Study
from designopt.sweep.cluster import run_on_cluster
from designopt.sweep.evaluating import Task, version_of
from designopt.sweep.outcomes import Outcome, failed
from designopt.sweep.points import Points
from designopt.sweep.results import Swept, write_result
from designopt.sweep.store import RESULT, Folder, kept_in, only_one
from designopt.sweep.workers import run_locally

LARGEST_BATCH = 64
LEAST_TASKS = 16
"""A study with ``batch`` is given so many tasks at least, for several workers to have some."""

LOST = failed(
    "its worker was lost again and again (it crashed, or was killed, perhaps for want of memory); "
    "give the same command again to try once more",
    final=False,
)


@dataclass(frozen=True)
class Request:
    """A sweep, as asked for.

    Attributes:
        study: which.
        points: over what.
        settings: ``key=value`` texts that all points share.
        seed: seed of every random draw.
        dtype: float type to compute in.
        out: its folder.
        workers: processes on this machine.
        scheduler: address of a dask scheduler, to compute on its cluster instead; ``None`` for
            this machine.
        force: whether another sweep in the folder may be replaced.
        versions: see `versions_of`.
    """

    study: Study
    points: Points
    settings: tuple[str, ...]
    seed: int
    dtype: str
    out: Path
    workers: int
    scheduler: str | None
    force: bool
    versions: Mapping[str, str]


def run_sweep(request: Request) -> dict[int, Outcome]:
    """Compute what is missing, and write the result once every point is finished.

    Returns:
        What became of every point, by its number.

    Raises:
        UserError: no point's settings are valid, the folder holds something else or cannot be
            written, or the cluster fails; points that were finished are kept.
        Interrupted: by Ctrl-C or SIGTERM; points that were finished are kept.
    """
    kept: dict[int, Outcome] = {}
    try:
        with interruptible() as check:
            refused = _refused(request)
            with only_one(request.out):
                folder = Folder(request.out, _definition(request), force=request.force)
                asked = [request.points.settings(index) for index in range(len(request.points))]
                for index, outcome in folder.outcomes(asked).items():
                    if outcome.final:
                        kept[index] = outcome
                for index in refused.keys() - kept.keys():
                    _keep(request, folder, kept, index, refused[index])
                # The groups are those of the whole sweep, however much of it is kept: the last
                # bits of a batch may depend on what else is in it.
                valid = [index for index in range(len(request.points)) if index not in refused]
                width = _width(request, len(valid))
                groups = [valid[start : start + width] for start in range(0, len(valid), width)]
                _compute(request, folder, kept, groups, width, check)
                write_result(_swept(request, kept), request.out / RESULT)
                check()
    except KeyboardInterrupt as interrupt:
        raise Interrupted(f"{_kept(request)}; the same command goes on") from interrupt
    return kept


def _refused(request: Request) -> dict[int, Outcome]:
    """The points whose settings are not valid."""
    refused = {}
    for index in range(len(request.points)):
        try:
            spec_with(request.study.spec, _settings(request, index), study=request.study.name)
        except UserError as error:
            refused[index] = failed(str(error), final=True)
    if len(refused) == len(request.points):
        raise UserError(f"no point can be computed: {refused[0].failure}")
    return refused


def _settings(request: Request, index: int) -> tuple[str, ...]:
    return (*request.settings, *request.points.assignments(index))


def versions_of(study: str) -> dict[str, str]:
    """Of Python, of the packages that shape the numbers, and of the one that offers the study."""
    points = entry_points(group=STUDY_GROUP, name=study)
    offering = [point.dist.name for point in points if point.dist is not None]
    return {name: version_of(name) for name in ("python", *RECORDED_PACKAGES, *offering)}


def _definition(request: Request) -> dict[str, object]:
    return {
        "study": request.study.name,
        "points": dict(request.points.definition),
        "settings": list(request.settings),
        "seed": request.seed,
        "dtype": request.dtype,
        "versions": dict(request.versions),
    }


def _width(request: Request, points: int) -> int:
    """Points in a task. Independent of the number of workers, or the numbers would depend on it."""
    if request.study.batch is None:
        return 1
    return min(LARGEST_BATCH, math.ceil(points / LEAST_TASKS))


def _compute(
    request: Request,
    folder: Folder,
    kept: dict[int, Outcome],
    groups: Sequence[Sequence[int]],
    width: int,
    check: Callable[[], None],
) -> None:
    """Compute and keep the points of these groups that are not kept yet."""
    missing = [group for group in groups if not kept.keys() >= set(group)]
    if not missing:
        return
    tasks = [
        Task(
            request.study.name,
            tuple(_settings(request, index) for index in group),
            width,
            request.seed,
            request.dtype,
            request.versions,
        )
        for group in missing
    ]
    if request.scheduler is None:
        answers = run_locally(tasks, request.workers)
    else:
        answers = run_on_cluster(tasks, request.scheduler)
    failures = sum(bool(outcome.failure) for outcome in kept.values())
    alone: list[list[int]] = []
    try:
        with point_display(len(request.points), len(kept), failures) as show, closing(answers):
            for task, answer in answers:
                if answer is None and len(missing[task]) > 1:
                    alone += [[index] for index in missing[task]]
                    continue
                for index, outcome in zip(missing[task], answer or [LOST], strict=True):
                    if index not in kept:
                        _keep(request, folder, kept, index, outcome)
                        show(bool(outcome.failure))
                check()
    except UserError as error:
        raise UserError(f"{error}; {_kept(request)}") from error
    # Some point ends every worker that is given its group: the others of the group have answers.
    _compute(request, folder, kept, alone, width, check)


def _keep(
    request: Request, folder: Folder, kept: dict[int, Outcome], index: int, outcome: Outcome
) -> None:
    folder.keep(index, request.points.settings(index), outcome)
    kept[index] = outcome


def _kept(request: Request) -> str:
    # Counted there: an interrupt may come just after a point was written.
    return f"{len(kept_in(request.out))} of {len(request.points)} points are kept in {request.out}"


def _swept(request: Request, kept: dict[int, Outcome]) -> Swept:
    return Swept(
        request.study,
        request.points,
        tuple(kept[index] for index in range(len(request.points))),
        request.settings,
        request.seed,
        request.dtype,
        request.versions,
    )
