"""Mirrors of the finger: one camera that sees all pads in every posture, and bears its errors."""

from designopt.results import Results
from designopt.study import Context, Study
from studies.finger_mirrors.spec import FingerMirrorsSpec


def _run(spec: FingerMirrorsSpec, context: Context) -> Results:
    # Imported here, so that listing the study does not load JAX.
    from studies.finger_mirrors.run import run

    return run(spec, context)


STUDY = Study(
    name="finger-mirrors",
    purpose="Camera and mirrors of the finger: every pad seen in every posture, errors included",
    spec=FingerMirrorsSpec,
    run=_run,
)
