"""Paper B's finger from its requirements: linkage, mirrors, grasp."""

from designopt.results import Results
from designopt.study import Context, Study
from studies.finger.spec import FingerSpec


def _run(spec: FingerSpec, context: Context) -> Results:
    # Imported here, so that listing the study does not load JAX.
    from studies.finger.run import run

    return run(spec, context)


STUDY = Study(
    name="finger",
    purpose="Requirements in, finger out: paper B's linkage, mirrors and camera, and its grasp",
    spec=FingerSpec,
    run=_run,
)
