"""What a worker does: some points of a study, one after another or as one batch.

Nothing here loads JAX before `evaluate` has asked for one thread.
"""

from __future__ import annotations

import functools
import os
import platform
import sys
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext, suppress
from importlib.metadata import PackageNotFoundError, version
from typing import Any, NamedTuple

from designopt.compilation_cache import forget_programs_if_many
from designopt.errors import UserError
from designopt.io.spec import Spec
from designopt.study.results import Results
from designopt.study.settings import NO_CONFIG, Config, spec_with
from designopt.study.study import Context, Study, load_study
from designopt.sweep.outcomes import Outcome, failed, found

ONE_THREAD = {
    "NPROC": "1",  # XLA's threads
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "OPENCV_FOR_THREADS_NUM": "1",
}
"""Environment variables for one thread; the libraries below read them when they are loaded."""

_ALONE = threading.Lock()


class Task(NamedTuple):
    """Some points for a worker.

    Attributes:
        study: its name.
        settings: of every point, ``key=value`` texts.
        width: points in a batch; the last point fills a batch that has fewer, so that one
            compiled program serves all.
        seed: seed of every random draw.
        dtype: float type to compute in.
        versions: of Python and of packages, as the sweep was begun with.
        config: settings of every point, over which the others lie.
    """

    study: str
    settings: tuple[tuple[str, ...], ...]
    width: int
    seed: int
    dtype: str
    versions: Mapping[str, str]
    config: Config = NO_CONFIG


def evaluate(task: Task) -> list[Outcome]:
    """What becomes of every point of a task, in its order.

    A process works on one task at a time, on one thread: neither the other workers nor the cores
    of a machine change its numbers, and studies draw with Matplotlib, which threads must not share.

    Raises:
        UserError: there is no such study here, or other versions than the sweep was begun with.
    """
    with _ALONE:
        if "jax" not in sys.modules:
            os.environ.update(ONE_THREAD)
        import jax

        from designopt.sweep.compiled_programs import compiled

        programs = compiled()  # listens from now on
        study = _loaded(task.study, tuple(task.versions.items()))
        specs = [
            spec_with(study.spec, settings, study=task.study, config=task.config)
            for settings in task.settings
        ]
        context = Context(task.seed, task.dtype, lambda _: nullcontext())
        with jax.enable_x64(task.dtype == "float64"):
            device = f"{jax.devices()[0].device_kind} ({platform.machine()}), one thread a worker"
            outcomes = _outcomes(study, specs, task.width, context, device)
            programs.task_is_done()
            forget_programs_if_many()
            return outcomes


@functools.cache  # looking through what is installed takes longer than many a point
def _loaded(name: str, versions: tuple[tuple[str, str], ...]) -> Study:
    for package, asked in versions:
        try:
            here = version_of(package)
        except PackageNotFoundError:
            here = "missing"
        if here != asked:
            raise UserError(
                f"worker on {platform.node()}: {package} is {here}, and the sweep was begun with "
                f"{asked}; install the same versions everywhere"
            )
    return load_study(name)


def version_of(package: str) -> str:
    """The version that is installed here of a package, or of ``"python"``."""
    return platform.python_version() if package == "python" else version(package)


def _point(
    run: Callable[[Any, Context], Results], spec: Spec, context: Context, device: str
) -> Outcome:
    start = time.perf_counter()
    try:
        metrics = run(spec, context).metrics
        return found(metrics, time.perf_counter() - start, device)
    except UserError as error:
        reason, final = str(error), True
    except BaseException as error:  # a study is anyone's code, and the rest goes on
        reason, final = ": ".join(filter(None, (type(error).__name__, str(error)))), False
    return failed(reason, final=final, seconds=time.perf_counter() - start, device=device)


def _outcomes(
    study: Study, specs: Sequence[Spec], width: int, context: Context, device: str
) -> list[Outcome]:
    """What becomes of points: as one batch, if the study has it, or one after another."""
    if study.batch is not None:
        filled = [*specs, *[specs[-1]] * (width - len(specs))]
        start = time.perf_counter()
        with suppress(BaseException):  # which point raised is known from single points only
            answers = study.batch(filled, context)
            seconds = (time.perf_counter() - start) / len(specs)
            return [
                failed(str(answer), final=True, seconds=seconds, device=device)
                if isinstance(answer, UserError)
                else found(answer.metrics, seconds, device)
                for answer, _ in zip(answers, filled, strict=True)
            ][: len(specs)]
    return [_point(study.run, spec, context, device) for spec in specs]
