"""The settings of the study."""

from __future__ import annotations

from typing import Annotated

from pydantic import AfterValidator, Field

from studies.models.soft_finger.spec import ChamberImagesSpec, distinct

Count = Annotated[int, Field(ge=50, le=100_000)]
Eta = Annotated[float, Field(ge=0.3, le=1.2)]
Pixels = Annotated[int, Field(ge=16, le=640)]


class BendingPostureSpec(ChamberImagesSpec):
    """All settings of ``designopt run bending-posture``."""

    samples: Count = Field(default=2000, description="images that the network is trained on")
    unseen: Count = Field(default=400, description="other images that it is judged on")
    largest_bend_deg: Annotated[float, Field(ge=10, le=120)] = Field(
        default=120.0, description="bends are spread evenly from 0 to this (degrees)"
    )
    label_noise: Annotated[float, Field(ge=0, le=5)] = Field(
        default=0.2, description="standard deviation of a label's coordinates (mm)"
    )
    epochs: Annotated[int, Field(ge=1, le=1000)] = Field(
        default=40, description="how often the network sees every sample"
    )
    seeds: Annotated[int, Field(ge=1, le=10)] = Field(
        default=3, description="trainings of every kind, each from other weights"
    )
    width: Pixels = Field(default=64, description="of the image that the network sees (px)")
    widths: Annotated[list[Pixels], AfterValidator(distinct)] = Field(
        default=[32, 64, 96], description="other widths, error against training time (px)"
    )
    counts: Annotated[list[Count], AfterValidator(distinct)] = Field(
        default=[250, 500, 1000, 2000], description="numbers of samples, likewise"
    )
    etas: Annotated[list[Eta], AfterValidator(distinct)] = Field(
        default=[0.5, 0.6, 0.7, 0.8, 0.9, 1.0], description="chambers whose postures are compared"
    )
    sweep: bool = Field(default=True, description="compare weights of the L2 regularisation")
    eta_samples: Count = Field(default=1000, description="images of each that train a network")
