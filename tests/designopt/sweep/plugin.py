"""Small studies for sweeps, as another package would offer them; they can lose their worker."""

from __future__ import annotations

import math
import os
import signal
import time
from collections.abc import Sequence
from pathlib import Path

import pydantic

from designopt.errors import UserError
from designopt.io.spec import Spec
from designopt.study.results import Metric, Results, Target
from designopt.study.study import Context, Study

ASKED = Target(">=", 0.5)


class SweptSpec(Spec):
    x: float = pydantic.Field(default=1.0, le=100, description="a length (mm)")
    count: int = pydantic.Field(default=2, description="how many")
    wait: float = pydantic.Field(default=0.0, description="time a point takes (s)")
    fatal: float | None = pydantic.Field(default=None, description="this x ends its process")
    marker: str = pydantic.Field(default="", description="file that lets a point end it once")


def _run(spec: SweptSpec, context: Context) -> Results:
    import jax.numpy as jnp

    time.sleep(spec.wait)
    if spec.x == spec.fatal and not Path(spec.marker).is_file():
        if spec.marker:
            Path(spec.marker).touch()
        os.kill(os.getpid(), signal.SIGKILL)
    if spec.x < 0:
        raise UserError("x: a length is not negative;\nmake it larger")
    sine = spec.count * math.sin(spec.x) / spec.x
    return Results(
        findings=[],
        metrics=[
            Metric("sine_mm", sine, "mm", "a sine over its angle", None, ASKED),
            Metric("seed", context.seed, "", "the seed"),
            Metric("bytes", jnp.zeros(()).dtype.itemsize, "", "of a float"),
            Metric("nothing", float("nan"), "", "not a number"),
        ],
    )


def _batch(specs: Sequence[SweptSpec], context: Context) -> list[Results | UserError]:
    if any(spec.x == 0 for spec in specs):
        raise FloatingPointError("somebody divides by zero")
    found: list[Results | UserError] = []
    for spec in specs:
        try:
            sine, *_ = _run(spec, context).metrics
            found.append(Results([], [sine, Metric("width", len(specs), "", "of the batch")]))
        except UserError as error:
            found.append(error)
    return found


SWEPT = Study("swept", "A sine", SweptSpec, _run)
BATCHED = Study("batched", "Many sines", SweptSpec, _run, batch=_batch)
