"""The linkage of paper B's finger, designed for the largest least transmission angle."""

from designopt.results import Results
from designopt.study import Context, Study
from studies.finger_linkage.spec import FingerLinkageSpec


def _run(spec: FingerLinkageSpec, context: Context) -> Results:
    # Imported here, so that listing the study does not load JAX.
    from studies.finger_linkage.run import run

    return run(spec, context)


STUDY = Study(
    name="finger-linkage",
    purpose="The pins of paper B's six-bar finger, for the largest least transmission angle",
    spec=FingerLinkageSpec,
    run=_run,
)
