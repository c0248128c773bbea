"""Tactile images of the finger: its pads found in synthetic images, unwarped, and compared."""

from __future__ import annotations

from typing import Annotated

from pydantic import AfterValidator, Field

from designopt import Study, lazily, setting
from designopt.study.settings import distinct
from studies.models.sensor.spec import FingerImagesSpec, Rows

Gain = Annotated[float, Field(gt=0, le=10)]
Severity = Annotated[float, Field(ge=0, le=2)]


class TactileImagesSpec(FingerImagesSpec):
    """All settings of ``designopt run tactile-images``."""

    fingers: int = setting(3, "fingers with errors of fabrication", scales=True, ge=1, le=100)
    grid: int = setting(6, "values of each joint angle", scales=True, ge=2, le=31)
    gains: Annotated[list[Gain], Field(min_length=1), AfterValidator(distinct)] = setting(
        [0.6, 1.0, 1.5], "exposures at the stated severity"
    )
    severities: Annotated[list[Severity], AfterValidator(distinct)] = setting(
        [0.0, 0.5, 1.5, 2.0], "other severities, at gain 1 with one finger", free=True
    )
    independent: int = setting(
        100, "frames with effects of independent severities", scales=True, ge=0, le=10_000
    )
    corrupted: int = setting(
        1000, "frames that are no proper images", scales=True, ge=0, le=100_000
    )
    corrupted_rows: Rows = setting(540, "height of these frames (px)")
    size_frames: int = setting(12, "frames for each of the sizes", free=True, ge=1, le=1000)


STUDY = Study(
    name="tactile-images",
    purpose="Images of the finger: every view found, unwarped, and imprints made visible",
    spec=TactileImagesSpec,
    run=lazily("studies.tactile_images.run:run"),
    design=lazily("studies.models.sensor.design:imaged_finger_design"),
)
