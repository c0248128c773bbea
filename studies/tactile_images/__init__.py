"""Tactile images of the finger: its pads found in synthetic images, unwarped, and compared."""

from __future__ import annotations

from designopt.study.study import Study, lazily
from studies.tactile_images.spec import TactileImagesSpec

STUDY = Study(
    name="tactile-images",
    purpose="Images of the finger: every view found, unwarped, and imprints made visible",
    spec=TactileImagesSpec,
    run=lazily("studies.tactile_images.run:run"),
    design=lazily("studies.models.sensor.design:imaged_finger_design"),
)
