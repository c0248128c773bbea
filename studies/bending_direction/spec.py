"""The settings of the study."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from studies.models.soft_finger.spec import ChamberImagesSpec

Bend = Annotated[float, Field(gt=0, le=120)]


class BendingDirectionSpec(ChamberImagesSpec):
    """All settings of ``designopt run bending-direction``."""

    images: Annotated[int, Field(ge=1, le=100_000)] = Field(
        default=300, description="images in every direction; the paper has 300"
    )
    largest_bend_deg: Bend = Field(
        default=90.0, description="bends are spread evenly from 0 to this (degrees)"
    )
    scatter_deg: Annotated[float, Field(ge=0, le=30)] = Field(
        default=8.0, description="standard deviation of a direction bent by hand (degrees)"
    )
    threshold: Annotated[float, Field(ge=0, le=100)] = Field(
        default=4.0, description="a largest displacement below it counts as not bent (px)"
    )
    small_bend_deg: Bend = Field(
        default=2.0, description="largest bend of the images that compare chambers (degrees)"
    )
    small_images: Annotated[int, Field(ge=1, le=100_000)] = Field(
        default=1000, description="of these, in every direction and for every chamber"
    )
    stability_images: Annotated[int, Field(ge=1, le=10_000)] = Field(
        default=20, description="in every direction at every bend from 0.01° to 120°"
    )
