"""Stiff, extreme and impossible linkages, judged against arithmetic in 50 digits."""

from designopt.study.results import Results
from designopt.study.study import Context, Study
from studies.stability.linkage.spec import StabilitySpec


def _run(spec: StabilitySpec, context: Context) -> Results:
    # Imported here, so that listing the study does not load JAX.
    from studies.stability.linkage.run import run

    return run(spec, context)


STUDY = Study(
    name="linkage-stability",
    purpose="Stiff, extreme and impossible linkages against 50-digit arithmetic, with gradients",
    spec=StabilitySpec,
    run=_run,
)
