"""Exact visibility beside brute force, and in scenes that are extreme or degenerate."""

from __future__ import annotations

from designopt.io.spec import Spec
from designopt.study.settings import setting
from designopt.study.study import Study, lazily


class StabilitySpec(Spec):
    """All settings of ``designopt run visibility-stability``."""

    scenes: int = setting(10_000, "random scenes", free=True, ge=10, le=100_000)
    bounces: int = setting(
        2,
        "most reflections of a path; random scenes are asked with 1 to this",
        free=True,
        ge=1,
        le=2,
    )
    rays: int = setting(
        20_000, "brute-force rays in each random scene", free=True, ge=1000, le=1_000_000
    )
    fine_rays: int = setting(
        4_000_000,
        "rays in a scene that differs, and in the sample",
        free=True,
        ge=100_000,
        le=100_000_000,
    )
    reference_scenes: int = setting(
        40, "sample of random scenes that get the fine rays in any case", free=True, ge=1, le=1000
    )
    gradient_scenes: int = setting(
        125, "random scenes whose gradients meet central differences", free=True, ge=1, le=1000
    )
    family_cases: int = setting(24, "scenes in each extreme family", free=True, ge=8, le=500)
    float32: bool = setting(True, "ask everything in float32 as well", free=True)


STUDY = Study(
    name="visibility-stability",
    purpose="Exact visibility against brute-force rays and 50-digit arithmetic, with gradients",
    spec=StabilitySpec,
    run=lazily("studies.stability.visibility.run:run"),
)
