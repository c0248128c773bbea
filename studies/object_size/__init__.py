"""The diameter of a grasped bottle from the chamber of the finger around it (paper A, Fig. 13)."""

from __future__ import annotations

from functools import partial
from itertools import pairwise
from typing import Annotated

from pydantic import AfterValidator, Field, model_validator

from designopt import Study, lazily, setting
from studies.models.soft_finger.spec import ChamberImagesSpec

Diameter = Annotated[float, Field(ge=20, le=150)]


def _rising(values: list[float]) -> list[float]:
    if any(after <= before for before, after in pairwise(values)):
        raise ValueError("give diameters from the least to the largest, each once")
    return values


class ObjectSizeSpec(ChamberImagesSpec):
    """All settings of ``designopt run object-size``.

    First the hand's geometry, which the paper does not give, and what is off in a grasp.
    """

    palm: float = setting(
        68.0, "from the finger's centre line to the hand's middle (mm)", ge=20, le=200
    )
    gap: float = setting(0.0, "how far the palm lies beyond the finger's base (mm)", ge=-10, le=30)
    finger_radius: float = setting(
        14.0, "from the finger's centre line to its skin (mm)", ge=5, le=30
    )
    place: float = setting(
        1.0, "standard deviation of a bottle's place, either way (mm)", ge=0, le=10
    )
    squeeze_least: float = setting(
        0.5, "least depth to which a bottle presses the wall in (mm)", ge=0, le=5
    )
    squeeze_most: float = setting(
        2.0, "largest such depth; all between are as likely (mm)", ge=0, le=5
    )
    direction_scatter_deg: float = setting(
        3.0, "standard deviation of the bending direction (degrees)", ge=0, le=10
    )
    bottles: Annotated[list[Diameter], AfterValidator(_rising)] = setting(
        [48.0, 62.0, 82.0, 92.0],
        "diameters of the bottles that are distinguished (mm); the paper's four",
        min_length=2,
        max_length=12,
    )
    grasps: int = setting(50, "grasps of each bottle", scales=True, ge=1, le=10_000)
    least: Diameter = setting(40.0, "least of the random diameters (mm)")
    largest: Diameter = setting(100.0, "largest of the random diameters (mm)")
    random_grasps: int = setting(
        200, "grasps of bottles of random diameters", scales=True, ge=2, le=100_000
    )
    other_lamp_grasps: int = setting(
        50,
        "the same with a lamp that the network was not trained with",
        free=True,
        ge=2,
        le=100_000,
    )
    samples: int = setting(
        1500, "labelled images that the network is trained on", ge=64, le=100_000
    )
    epochs: int = setting(60, "passes of the training over all of them", ge=1, le=1000)
    largest_bend_deg: float = setting(
        110.0, "their bends are spread evenly from 0 to this (degrees)", ge=10, le=120
    )
    columns: int = setting(64, "of the images as the network takes them", ge=16, le=640)
    rows: int = setting(48, "likewise", ge=12, le=480)
    largest_residual: float = setting(
        1.5,
        "markers farther than this from every arc belong to no posture (root mean square, mm)",
        gt=0,
        le=100,
    )
    stability_images: int = setting(
        5, "frames at each bend from 0.01° to 120°", scales=True, ge=1, le=1000
    )

    @model_validator(mode="after")
    def _possible(self) -> ObjectSizeSpec:
        widest, room = max(self.largest, *self.bottles), 2 * (self.palm - self.finger_radius)
        if self.squeeze_most < self.squeeze_least:
            raise ValueError(
                f"squeeze_most ({self.squeeze_most:g} mm) must not be less than squeeze_least "
                f"({self.squeeze_least:g} mm)"
            )
        if self.largest <= self.least:
            raise ValueError(
                f"largest ({self.largest:g} mm) must be more than least ({self.least:g} mm)"
            )
        if widest >= room:
            raise ValueError(
                f"a straight finger leaves room for {room:g} mm, and a bottle has {widest:g} mm; "
                "raise palm or leave that bottle out"
            )
        return self


STUDY = Study(
    name="object-size",
    purpose="How wide a grasped bottle is, from the posture that its finger's chamber shows",
    spec=ObjectSizeSpec,
    run=lazily("studies.object_size.run:run"),
    design=partial(lazily("studies.models.soft_finger.design:chamber_design"), "object-size"),
)
