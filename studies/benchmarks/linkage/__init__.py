"""Error against run time of linkage poses: closed form, iterations and other people's tools."""

from designopt.study.results import Results
from designopt.study.study import Context, Study
from studies.benchmarks.linkage.spec import LinkagePrecisionSpec


def _run(spec: LinkagePrecisionSpec, context: Context) -> Results:
    # Imported here, so that listing the study does not load JAX.
    from studies.benchmarks.linkage.run import run

    return run(spec, context)


STUDY = Study(
    name="linkage-precision",
    purpose="Error against run time of linkage poses: closed form, iterations and other tools",
    spec=LinkagePrecisionSpec,
    run=_run,
)
