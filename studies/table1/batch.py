"""Many specs of the study in one compiled program, for sweeps."""

from __future__ import annotations

from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from designopt.errors import UserError
from designopt.study.results import Results
from designopt.study.stability import assess
from designopt.study.study import Context
from optics.chamber.chamber import Chamber
from studies.models.soft_finger import imaging
from studies.models.soft_finger.imaging import Imaging
from studies.table1 import stability, statements
from studies.table1.analysis import Analysis, RealLens, real_lens
from studies.table1.run import run
from studies.table1.spec import Table1Spec


def run_batch(specs: Sequence[Table1Spec], context: Context) -> list[Results | UserError]:
    """The metrics of every spec, and nothing else of its results.

    A spec that asks for measurements, or whose table follows no camera constants, is run by itself.
    """
    together = [spec for spec in specs if not (spec.precision or spec.stability)]
    solved: dict[int, Results] = {}
    if together:
        rows = assess(stability.nominal(), (context.dtype,))
        for spec, analysis in zip(together, analyses(together), strict=True):
            if bool(analysis.imaging.fit.solution.ok):
                metrics = statements.metrics(spec, analysis, rows)
                solved[id(spec)] = Results(findings=[], metrics=metrics)
    return [solved.get(id(spec)) or _alone(spec, context) for spec in specs]


def _alone(spec: Table1Spec, context: Context) -> Results | UserError:
    try:
        return run(spec, context)
    except UserError as error:
        return error


def analyses(specs: Sequence[Table1Spec]) -> list[Analysis]:
    """What the study says of every spec, without the other reading of the text."""
    chambers = [imaging.printed_chamber(spec.chamber) for spec in specs]
    stacked = jax.tree.map(lambda *leaves: jnp.stack(leaves), *chambers)
    columns = (
        jnp.asarray([getattr(spec, name) for spec in specs])
        for name in ("clearance", "f_number", "blur")
    )
    # As NumPy arrays: taking one spec's numbers out of them compiles and copies nothing.
    solved, lenses = jax.tree.map(np.asarray, _solve(stacked, *columns))
    return [
        Analysis(
            jax.tree.map(lambda leaf, i=i: leaf[i], solved),
            None,
            jax.tree.map(lambda leaf, i=i: leaf[i], lenses),
        )
        for i in range(len(specs))
    ]


@jax.jit
def _solve(
    chambers: Chamber,
    clearances: Float[Array, " specs"],
    f_numbers: Float[Array, " specs"],
    blurs: Float[Array, " specs"],
) -> tuple[Imaging, RealLens]:
    # One fit after another: side by side, rounding ends some a step earlier than alone, and the
    # constants differ in their eighth digit; a fit is so short that nothing is gained by it.
    solved = jax.lax.map(lambda one: imaging.solve(*one), (chambers, clearances))
    return solved, jax.vmap(real_lens)(chambers, f_numbers, blurs)
