"""Verdicts on random fingers, beside polygons and a path tracer's rays."""

from __future__ import annotations

from designopt.io.spec import Spec
from designopt.study.settings import setting
from designopt.study.study import Study, lazily


class FingerVerdictsSpec(Spec):
    """All settings of ``designopt run finger-verdicts``."""

    fingers: int = setting(20, "fingers that are drawn", scales=True, ge=1, le=1000)
    advised: int = setting(
        1,
        "of those that miss something, how many to look for changes for: the ones that miss least",
        free=True,
        ge=0,
        le=1000,
    )
    postures: int = setting(
        40, "random postures that rays check, besides the worst ones", free=True, ge=1, le=10_000
    )


STUDY = Study(
    name="finger-verdicts",
    purpose="Verdicts of finger on random requirements, beside polygons and a path tracer's rays",
    spec=FingerVerdictsSpec,
    run=lazily("studies.finger.verdicts.run:run"),
    needs=("judge",),
)
