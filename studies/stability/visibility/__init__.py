"""Exact visibility beside brute force, and in scenes that are extreme or degenerate."""

from designopt.study.results import Results
from designopt.study.study import Context, Study
from studies.stability.visibility.spec import StabilitySpec


def _run(spec: StabilitySpec, context: Context) -> Results:
    # Imported here, so that listing the study does not load JAX.
    from studies.stability.visibility.run import run

    return run(spec, context)


STUDY = Study(
    name="visibility-stability",
    purpose="Exact visibility against brute-force rays and 50-digit arithmetic, with gradients",
    spec=StabilitySpec,
    run=_run,
)
