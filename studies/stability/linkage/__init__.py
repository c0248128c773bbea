"""Stiff, extreme and impossible linkages, judged against arithmetic in 50 digits."""

from __future__ import annotations

from designopt.io.spec import Spec
from designopt.study.settings import setting
from designopt.study.study import Study, lazily


class StabilitySpec(Spec):
    """All settings of ``designopt run linkage-stability``."""

    random_cases: int = setting(
        100_000,
        "random four-bars, and as many random slider-cranks",
        free=True,
        ge=100,
        le=2_000_000,
    )
    decades: float = setting(
        2.0, "decades over which the lengths of random linkages spread", free=True, ge=0.1, le=6
    )
    family_cases: int = setting(
        40,
        "cases in each extreme family; half of them in each assembly",
        free=True,
        ge=16,
        le=2000,
        multiple_of=2,
    )
    triad: bool = setting(
        True, "follow a Stephenson six-bar through large steps of its input", free=True
    )


STUDY = Study(
    name="linkage-stability",
    purpose="Stiff, extreme and impossible linkages against 50-digit arithmetic, with gradients",
    spec=StabilitySpec,
    run=lazily("studies.stability.linkage.run:run"),
)
