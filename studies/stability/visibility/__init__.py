"""Exact visibility beside brute force, and in scenes that are extreme or degenerate."""

from __future__ import annotations

from functools import partial

from designopt.io.spec import Spec
from designopt.study.settings import setting
from designopt.study.study import Study, lazily

free = partial(setting, free=True)
"""A setting on which no target depends."""


class StabilitySpec(Spec):
    """All settings of ``designopt run visibility-stability``."""

    scenes: int = free(10_000, "random scenes", ge=10, le=100_000)
    bounces: int = free(
        2, "most reflections of a path; random scenes are asked with 1 to this", ge=1, le=2
    )
    rays: int = free(20_000, "brute-force rays in each random scene", ge=1000, le=1_000_000)
    fine_rays: int = free(
        4_000_000, "rays in a scene that differs, and in the sample", ge=100_000, le=100_000_000
    )
    reference_scenes: int = free(40, "random scenes with fine rays in any case", ge=1, le=1000)
    gradient_scenes: int = free(
        125, "random scenes whose gradients meet central differences", ge=1, le=1000
    )
    family_cases: int = free(24, "scenes in each extreme family", ge=8, le=500)
    float32: bool = free(True, "ask everything in float32 as well")


STUDY = Study(
    name="visibility-stability",
    purpose="Exact visibility against brute-force rays and 50-digit arithmetic, with gradients",
    spec=StabilitySpec,
    run=lazily("studies.stability.visibility.run:run"),
)
