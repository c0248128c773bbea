"""Stiff, extreme and impossible linkages, judged against arithmetic in 50 digits."""

from __future__ import annotations

from functools import partial

from designopt.io.spec import Spec
from designopt.study.settings import setting
from designopt.study.study import Study, lazily

free = partial(setting, free=True)
"""A setting on which no target depends."""


class StabilitySpec(Spec):
    """All settings of ``designopt run linkage-stability``."""

    random_cases: int = free(
        100_000, "random four-bars, and as many random slider-cranks", ge=100, le=2_000_000
    )
    decades: float = free(
        2.0, "decades over which the lengths of random linkages spread", ge=0.1, le=6
    )
    family_cases: int = free(
        40, "cases in each extreme family, half in each assembly", ge=16, le=2000, multiple_of=2
    )
    triad: bool = free(True, "follow a Stephenson six-bar through large steps of its input")


STUDY = Study(
    name="linkage-stability",
    purpose="Stiff, extreme and impossible linkages against 50-digit arithmetic, with gradients",
    spec=StabilitySpec,
    run=lazily("studies.stability.linkage.run:run"),
)
