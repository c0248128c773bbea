"""Error against run time of visibility: exact intervals, sampling, rays and other tracers."""

from designopt.study.results import Results
from designopt.study.study import Context, Study
from studies.benchmarks.visibility.spec import VisibilityPrecisionSpec


def _run(spec: VisibilityPrecisionSpec, context: Context) -> Results:
    # Imported here, so that listing the study does not load JAX.
    from studies.benchmarks.visibility.run import run

    return run(spec, context)


STUDY = Study(
    name="visibility-precision",
    purpose="Error against run time of visibility: exact intervals, sampling, rays, other tracers",
    spec=VisibilityPrecisionSpec,
    run=_run,
)
