"""Joint angles from the finger's images: the paper's gap, better ways, and their bound."""

from designopt.results import Results
from designopt.study import Context, Study
from studies.proprioception.spec import ProprioceptionSpec


def _run(spec: ProprioceptionSpec, context: Context) -> Results:
    # Imported here, so that listing the study does not load JAX and OpenCV.
    from studies.proprioception.run import run

    return run(spec, context)


STUDY = Study(
    name="proprioception",
    purpose="Joint angles from images: gap, edge, all corners, calibrated with and without labels",
    spec=ProprioceptionSpec,
    run=_run,
)
