"""Joint angles from the finger's images: the paper's gap, better ways, and their bound."""

from __future__ import annotations

from designopt import Study, lazily, setting
from studies.models.sensor.spec import FingerImagesSpec


class ProprioceptionSpec(FingerImagesSpec):
    """All settings of ``designopt run proprioception``."""

    fingers: int = setting(40, "fingers with errors of fabrication", scales=True, ge=1, le=1000)
    frames: int = setting(
        30, "random frames of each, whose joint angles are estimated", scales=True, ge=2, le=1000
    )
    labelled: int = setting(5, "frames of each with known joint angles", ge=2, le=100)
    label_deviation_deg: float = setting(
        0.5, "standard deviation of these labels (degrees)", gt=0, le=10
    )
    pixel_noise: float = setting(
        1.0, "of every corner, when the gap is tried without images (px)", gt=0, le=20
    )
    gap_fingers: int = setting(
        100, "fingers on which the gap is tried without images", scales=True, ge=1, le=10_000
    )
    cost_fingers: int = setting(
        6, "fingers rendered again with smooth edges", free=True, ge=0, le=1000
    )
    size_fingers: int = setting(4, "fingers for each of the sizes", free=True, ge=1, le=1000)
    size_frames: int = setting(10, "frames of each of these fingers", free=True, ge=1, le=1000)


STUDY = Study(
    name="proprioception",
    purpose="Joint angles from images: gap, edge, all corners, calibrated with and without labels",
    spec=ProprioceptionSpec,
    run=lazily("studies.proprioception.run:run"),
    design=lazily("studies.models.sensor.design:imaged_finger_design"),
)
