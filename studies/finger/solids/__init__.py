"""The solids of a finger, beside a CAD kernel and a path tracer's rays."""

from __future__ import annotations

from designopt.io.spec import Spec
from designopt.study.settings import setting
from designopt.study.study import Study, lazily


class FingerSolidsSpec(Spec):
    """All settings of ``designopt run finger-solids``."""

    finger: str = setting(
        "", "file of a finger, or folder specs of a result (empty: the packaged one)", free=True
    )
    steps: int = setting(
        31, "angles of each joint; parts are looked at in all pairs", scales=True, ge=2, le=181
    )
    traced: int = setting(
        5, "angles of each joint in whose pairs rays are traced", scales=True, ge=2, le=91
    )


STUDY = Study(
    name="finger-solids",
    purpose="A finger's STEP file by a CAD kernel and rays: walls, room to move, light paths",
    spec=FingerSolidsSpec,
    run=lazily("studies.finger.solids.run:run"),
    needs=("cad", "judge"),
)
