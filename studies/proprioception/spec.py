"""The settings of the study."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from studies.models.sensor.spec import FingerImagesSpec


class ProprioceptionSpec(FingerImagesSpec):
    """All settings of ``designopt run proprioception``."""

    fingers: Annotated[int, Field(ge=1, le=1000)] = Field(
        default=40, description="fingers with errors of fabrication"
    )
    frames: Annotated[int, Field(ge=2, le=1000)] = Field(
        default=30, description="random frames of each, whose joint angles are estimated"
    )
    labelled: Annotated[int, Field(ge=2, le=100)] = Field(
        default=5, description="frames of each whose joint angles are told"
    )
    label_deviation_deg: Annotated[float, Field(gt=0, le=10)] = Field(
        default=0.5, description="standard deviation of these labels (degrees)"
    )
    range_deg: Annotated[float, Field(gt=0, le=90)] = Field(
        default=90.0, description="range of both joints (degrees)"
    )
    pixel_noise: Annotated[float, Field(gt=0, le=20)] = Field(
        default=1.0, description="of every corner, when the gap is tried without images (px)"
    )
    gap_fingers: Annotated[int, Field(ge=1, le=10_000)] = Field(
        default=100, description="fingers on which the gap is tried without images"
    )
    cost_fingers: Annotated[int, Field(ge=0, le=1000)] = Field(
        default=6, description="fingers rendered again with smooth edges"
    )
    sizes: list[Annotated[int, Field(ge=200, le=4000)]] = Field(
        default=[360, 540, 810, 1080], description="heights of images, error over run time (px)"
    )
    size_fingers: Annotated[int, Field(ge=1, le=1000)] = Field(
        default=4, description="fingers for each of these"
    )
    size_frames: Annotated[int, Field(ge=1, le=1000)] = Field(
        default=10, description="frames of each of these fingers"
    )
