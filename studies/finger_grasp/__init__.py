"""How paper B's finger closes: pinching, adapting and opening, with its contact forces."""

from designopt.results import Results
from designopt.study import Context, Study
from studies.finger_grasp.spec import GraspSpec


def _run(spec: GraspSpec, context: Context) -> Results:
    # Imported here, so that listing the study does not load JAX.
    from studies.finger_grasp.run import run

    return run(spec, context)


STUDY = Study(
    name="finger-grasp",
    purpose="Paper B's finger closing on objects: pinch, adaptive grasp, contact forces",
    spec=GraspSpec,
    run=_run,
)
