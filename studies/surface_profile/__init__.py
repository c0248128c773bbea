"""Surfaces slid along the soft finger: their profile and kind from its chamber's images."""

from __future__ import annotations

from functools import partial
from typing import Annotated

from pydantic import AfterValidator, Field

from designopt import Study, lazily, setting
from designopt.study.settings import distinct
from studies.models.soft_finger.spec import ChamberImagesSpec, MadeSpec, Severity

Counts = Annotated[list[Annotated[int, Field(ge=0, le=200)]], AfterValidator(distinct)]
Severities = Annotated[list[Severity], AfterValidator(distinct)]
Sagittas = Annotated[list[Annotated[float, Field(gt=0, le=6)]], AfterValidator(distinct)]
Roughnesses = Annotated[list[Annotated[float, Field(gt=0, le=1)]], AfterValidator(distinct)]


class SurfaceProfileSpec(ChamberImagesSpec):
    """All settings of ``designopt run surface-profile``."""

    made: MadeSpec = MadeSpec()
    trials: int = setting(50, "surfaces of each of the four kinds", scales=True, ge=1, le=2000)
    fingers: int = setting(
        5, "fingers as made, which share the surfaces; at most trials", scales=True, ge=1, le=100
    )
    slide: float = setting(60.0, "length of a slide (mm)", ge=40, le=200)
    frames: int = setting(41, "frames of a slide, evenly over it", ge=15, le=500)
    contact: float = setting(90.0, "where along the finger it touches (mm)", ge=50, le=100)
    tip_radius: float = setting(5.0, "of the touching pad along the slide (mm)", ge=0.5, le=15)
    preload: float = setting(3.0, "deflection at the surface's lowest place (mm)", ge=0.5, le=5)
    pressed: float = setting(0.5, "depth to which the contact presses the wall (mm)", ge=0, le=2)
    pressed_more: float = setting(0.05, "added to it for every mm of deflection", ge=0, le=0.2)
    direction_scatter_deg: float = setting(
        1.5, "standard deviation of the bending direction, slide to slide (degrees)", ge=0, le=10
    )
    rest_frames: int = setting(20, "frames of every finger that touches nothing", ge=2, le=200)
    calibration: int = setting(17, "frames of every finger on a flat plate", ge=0, le=200)
    setting_error: float = setting(0.05, "the plate's standard deviation (mm)", ge=0, le=1)
    calibrations: Counts = setting(
        [0, 1, 2, 3, 5, 9, 17, 33], "other numbers of these, for the error over them", free=True
    )
    severities: Severities = setting(
        [0.0, 0.5, 1.5, 2.0], "other severities, with one finger", free=True
    )
    severity_trials: int = setting(3, "surfaces of each kind at these", free=True, ge=1, le=1000)
    sagittas: Sagittas = setting(
        [0.4, 0.8, 1.0, 1.1, 1.2, 1.3, 1.4, 1.8, 2.4],
        "of curved surfaces, through the limit from which on they are called so (mm)",
        free=True,
    )
    roughnesses: Roughnesses = setting(
        [0.05, 0.1, 0.12, 0.14, 0.16, 0.18, 0.2, 0.3, 0.4],
        "of rough surfaces, likewise; root mean square (mm)",
        free=True,
    )
    size_slides: int = setting(12, "surfaces of each of these sizes", free=True, ge=1, le=1000)


STUDY = Study(
    name="surface-profile",
    purpose="Soft finger: profile and kind of a surface it is slid along, in px and in mm",
    spec=SurfaceProfileSpec,
    run=lazily("studies.surface_profile.run:run"),
    design=partial(lazily("studies.models.soft_finger.design:chamber_design"), "surface-profile"),
)
