"""The settings of the study."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import AfterValidator, Field

from studies.models.sensor.spec import FingerImagesSpec

Gain = Annotated[float, Field(gt=0, le=10)]
Severity = Annotated[float, Field(ge=0, le=2)]
Rows = Annotated[int, Field(ge=200, le=4000)]


def _distinct(values: list[Any]) -> list[Any]:
    if len(set(values)) < len(values):
        raise ValueError("values must differ from each other")
    return values


class TactileImagesSpec(FingerImagesSpec):
    """All settings of ``designopt run tactile-images``."""

    fingers: Annotated[int, Field(ge=1, le=100)] = Field(
        default=3, description="fingers with errors of fabrication"
    )
    grid: Annotated[int, Field(ge=2, le=31)] = Field(
        default=6, description="values of each joint angle, so poses are its square"
    )
    range_deg: Annotated[float, Field(gt=0, le=90)] = Field(
        default=90.0, description="range of both joints (degrees)"
    )
    gains: Annotated[list[Gain], Field(min_length=1), AfterValidator(_distinct)] = Field(
        default=[0.6, 1.0, 1.5], description="exposures at the stated severity"
    )
    severities: Annotated[list[Severity], AfterValidator(_distinct)] = Field(
        default=[0.0, 0.5, 1.5, 2.0], description="other severities, at gain 1 with one finger"
    )
    independent: Annotated[int, Field(ge=0, le=10_000)] = Field(
        default=100, description="frames, each with effects of severities independent of each other"
    )
    corrupted: Annotated[int, Field(ge=0, le=100_000)] = Field(
        default=1000, description="frames that are no proper images"
    )
    corrupted_rows: Rows = Field(default=540, description="height of these frames (px)")
    sizes: Annotated[list[Rows], AfterValidator(_distinct)] = Field(
        default=[360, 540, 810, 1080], description="heights of images, error over run time (px)"
    )
    size_frames: Annotated[int, Field(ge=1, le=1000)] = Field(
        default=12, description="frames for each of these"
    )
