"""Paper A's Table I: what the printed equations and constants give, and what the table follows."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from designopt.errors import UserError
from designopt.study.results import Results
from designopt.study.study import Context, Study
from studies.table1.spec import Table1Spec

if TYPE_CHECKING:
    from designopt.design_kind import Design


def _run(spec: Table1Spec, context: Context) -> Results:
    # Imported here, so that listing the study does not load JAX.
    from studies.table1.run import run

    return run(spec, context)


def _design(spec: Table1Spec, folder: Path | None) -> Design:
    from designopt.design_kind import Design
    from optics.design import CHAMBER
    from studies.table1.design import table1_design

    return Design(CHAMBER, table1_design(spec, folder))


def _batch(specs: Sequence[Table1Spec], context: Context) -> Sequence[Results | UserError]:
    from studies.table1.batch import run_batch

    return run_batch(specs, context)


STUDY = Study(
    name="table1",
    purpose="Chamber imaging and Table I of paper A: as printed, and with identified constants",
    spec=Table1Spec,
    run=_run,
    design=_design,
    batch=_batch,
)
