"""The diameter of a grasped bottle from the chamber of the finger around it (paper A, Fig. 13)."""

from designopt.results import Results
from designopt.study import Context, Study
from studies.object_size.spec import ObjectSizeSpec


def _run(spec: ObjectSizeSpec, context: Context) -> Results:
    # Imported here, so that listing the study does not load JAX.
    from studies.object_size.run import run

    return run(spec, context)


STUDY = Study(
    name="object-size",
    purpose="How wide a grasped bottle is, from the posture that its finger's chamber shows",
    spec=ObjectSizeSpec,
    run=_run,
)
