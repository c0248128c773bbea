"""Paper A's bending directions (Table II, Fig. 12), and the chamber that shows them best."""

from designopt.results import Results
from designopt.study import Context, Study
from studies.bending_direction.spec import BendingDirectionSpec


def _run(spec: BendingDirectionSpec, context: Context) -> Results:
    # Imported here, so that listing the study does not load JAX.
    from studies.bending_direction.run import run

    return run(spec, context)


STUDY = Study(
    name="bending-direction",
    purpose="Which way a soft finger bends, from its coloured chamber: Table II of paper A",
    spec=BendingDirectionSpec,
    run=_run,
)
