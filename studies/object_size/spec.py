"""The settings of the study."""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated

from pydantic import AfterValidator, Field, model_validator

from studies.models.soft_finger.spec import ChamberImagesSpec

Diameter = Annotated[float, Field(ge=20, le=150)]


def _rising(values: list[float]) -> list[float]:
    if any(after <= before for before, after in pairwise(values)):
        raise ValueError("give diameters from the least to the largest, each once")
    return values


class HandSpec(ChamberImagesSpec):
    """The hand's geometry, which the paper does not give, and what is off in a grasp."""

    palm: Annotated[float, Field(ge=20, le=200)] = Field(
        default=68.0, description="from the finger's centre line to the hand's middle (mm)"
    )
    gap: Annotated[float, Field(ge=-10, le=30)] = Field(
        default=0.0, description="how far the palm lies beyond the finger's base (mm)"
    )
    finger_radius: Annotated[float, Field(ge=5, le=30)] = Field(
        default=14.0, description="from the finger's centre line to its skin (mm)"
    )
    place: Annotated[float, Field(ge=0, le=10)] = Field(
        default=1.0, description="standard deviation of a bottle's place, either way (mm)"
    )
    squeeze_least: Annotated[float, Field(ge=0, le=5)] = Field(
        default=0.5, description="least depth to which a bottle presses the wall in (mm)"
    )
    squeeze_most: Annotated[float, Field(ge=0, le=5)] = Field(
        default=2.0, description="largest such depth; all between are as likely (mm)"
    )
    direction_scatter_deg: Annotated[float, Field(ge=0, le=10)] = Field(
        default=3.0, description="standard deviation of the bending direction (degrees)"
    )

    @model_validator(mode="after")
    def _possible(self) -> HandSpec:
        if self.squeeze_most < self.squeeze_least:
            raise ValueError(
                f"squeeze_most ({self.squeeze_most:g} mm) must not be less than squeeze_least "
                f"({self.squeeze_least:g} mm)"
            )
        return self


class ObjectSizeSpec(HandSpec):
    """All settings of ``designopt run object-size``."""

    bottles: Annotated[
        list[Diameter], Field(min_length=2, max_length=12), AfterValidator(_rising)
    ] = Field(
        default=[48.0, 62.0, 82.0, 92.0],
        description="diameters of the bottles that are told apart (mm); the paper's four",
    )
    grasps: Annotated[int, Field(ge=1, le=10_000)] = Field(
        default=50, description="grasps of each bottle"
    )
    least: Diameter = Field(default=40.0, description="least of the random diameters (mm)")
    largest: Diameter = Field(default=100.0, description="largest of the random diameters (mm)")
    random_grasps: Annotated[int, Field(ge=2, le=100_000)] = Field(
        default=200, description="grasps of bottles of random diameters"
    )
    other_lamp_grasps: Annotated[int, Field(ge=2, le=100_000)] = Field(
        default=50, description="the same with a lamp that the network was not trained with"
    )
    samples: Annotated[int, Field(ge=64, le=100_000)] = Field(
        default=1500, description="labelled images that the network is trained on"
    )
    epochs: Annotated[int, Field(ge=1, le=1000)] = Field(
        default=60, description="how often the network sees them"
    )
    largest_bend_deg: Annotated[float, Field(ge=10, le=120)] = Field(
        default=110.0, description="their bends are spread evenly from 0 to this (degrees)"
    )
    columns: Annotated[int, Field(ge=16, le=640)] = Field(
        default=64, description="of the images as the network takes them"
    )
    rows: Annotated[int, Field(ge=12, le=480)] = Field(default=48, description="likewise")
    largest_residual: Annotated[float, Field(gt=0, le=100)] = Field(
        default=1.5,
        description="markers farther than this from every arc are no finger's that the network "
        "knows (root mean square, mm)",
    )
    stability_images: Annotated[int, Field(ge=1, le=1000)] = Field(
        default=5, description="frames at each bend from 0.01° to 120°"
    )

    @model_validator(mode="after")
    def _room(self) -> ObjectSizeSpec:
        if self.largest <= self.least:
            raise ValueError(
                f"largest ({self.largest:g} mm) must be more than least ({self.least:g} mm)"
            )
        widest = max(self.largest, *self.bottles)
        room = 2 * (self.palm - self.finger_radius)
        if widest >= room:
            raise ValueError(
                f"a straight finger leaves room for {room:g} mm, and a bottle has {widest:g} mm; "
                "raise palm or leave that bottle out"
            )
        return self
