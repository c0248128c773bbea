"""Path-traced pictures of fabricated fingers in real light, and what perception makes of them."""

from __future__ import annotations

from designopt import Spec, Study, lazily, setting
from studies.models.sensor.spec import MadeSpec


class ImageCheckSpec(Spec):
    """All settings of ``designopt run image-check``."""

    fingers: int = setting(
        30, "fabricated fingers, one after the other of every kind", scales=True, ge=1, le=1000
    )
    calibrated: int = setting(
        6,
        "further ones, each with a lens of its own that is calibrated from a board's pictures",
        scales=True,
        ge=0,
        le=1000,
    )
    frames: int = setting(
        5, "random frames of each, whose joint angles are estimated", scales=True, ge=1, le=1000
    )
    labelled: int = setting(5, "frames of each with known joint angles", ge=2, le=100)
    label_deviation_deg: float = setting(
        0.1, "standard deviation of these labels (degrees)", gt=0, le=10
    )
    tolerances: MadeSpec = MadeSpec()
    cache: str = setting(
        "", "folder that keeps pictures (empty: the user's cache folder)", free=True
    )


STUDY = Study(
    name="image-check",
    purpose="Views, corners and joint angles from path-traced pictures of fabricated fingers",
    spec=ImageCheckSpec,
    run=lazily("studies.image_check.run:run"),
    needs=("judge",),
)
