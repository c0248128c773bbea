"""Paper A's Table I: what the printed equations and constants give, and what the table follows."""

from designopt.results import Results
from designopt.study import Context, Study
from studies.table1.spec import Table1Spec


def _run(spec: Table1Spec, context: Context) -> Results:
    # Imported here, so that listing the study does not load JAX.
    from studies.table1.run import run

    return run(spec, context)


STUDY = Study(
    name="table1",
    purpose="Chamber imaging and Table I of paper A: as printed, and with identified constants",
    spec=Table1Spec,
    run=_run,
)
