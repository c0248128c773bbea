"""Lenses calibrated from pictures that a path tracer has taken of a board."""

from __future__ import annotations

from pydantic import model_validator

from designopt.io.spec import Spec
from designopt.study.settings import setting
from designopt.study.study import Study, lazily


class LensCheckSpec(Spec):
    """All settings of ``designopt run physical-check-lenses``."""

    sets: int = setting(200, "random lenses, each with pictures of a board", scales=True, ge=1)
    fewest: int = setting(8, "pictures of a lens, at least", ge=4, le=100)
    most: int = setting(20, "pictures of a lens, at most", ge=4, le=100)
    further: int = setting(
        2, "pictures of each lens that its calibration does not get", scales=True, ge=1, le=100
    )
    cache: str = setting(
        "", "folder that keeps corners of pictures (empty: the user's cache folder)", free=True
    )

    @model_validator(mode="after")
    def _has_pictures(self) -> LensCheckSpec:
        if self.fewest > self.most:
            raise ValueError(f"fewest ({self.fewest}) must not exceed most ({self.most}); lower it")
        return self


STUDY = Study(
    name="physical-check-lenses",
    purpose="Lenses calibrated from a path tracer's pictures, beside those that took them",
    spec=LensCheckSpec,
    run=lazily("studies.physical_check.lenses.run:run"),
    needs=("judge",),
)
