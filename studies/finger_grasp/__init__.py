"""How paper B's finger closes: pinching, adapting and opening, with its contact forces."""

from designopt.study.study import Study, lazily
from studies.models.grasp.spec import GraspSpec

STUDY = Study(
    name="finger-grasp",
    purpose="Paper B's finger closing on objects: pinch, adaptive grasp, contact forces",
    spec=GraspSpec,
    run=lazily("studies.finger_grasp.run:run"),
    design=lazily("studies.finger_grasp.design:design"),
)
