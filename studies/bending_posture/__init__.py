"""Paper A's bending posture (Figs. 10 and 11): a network that reads markers from the chamber."""

from __future__ import annotations

from functools import partial
from typing import Annotated

from pydantic import AfterValidator, Field

from designopt import Study, lazily, setting
from designopt.study.settings import distinct
from studies.models.soft_finger.spec import ChamberImagesSpec

Count = Annotated[int, Field(ge=50, le=100_000)]
Eta = Annotated[float, Field(ge=0.3, le=1.2)]
Pixels = Annotated[int, Field(ge=16, le=640)]


class BendingPostureSpec(ChamberImagesSpec):
    """All settings of ``designopt run bending-posture``."""

    samples: Count = setting(2000, "images that the network is trained on")
    unseen: Count = setting(400, "other images that it is tested on", scales=True)
    largest_bend_deg: float = setting(
        120.0, "bends are spread evenly from 0 to this (degrees)", ge=10, le=120
    )
    label_noise: float = setting(
        0.2, "standard deviation of a label's coordinates (mm)", ge=0, le=5
    )
    epochs: int = setting(40, "passes of the training over all samples", ge=1, le=1000)
    seeds: int = setting(
        3, "trainings of every kind, each from other weights", scales=True, ge=1, le=10
    )
    width: Pixels = setting(64, "of the image that enters the network (px)")
    widths: Annotated[list[Pixels], AfterValidator(distinct)] = setting(
        [32, 64, 96], "other widths, error against training time (px)", free=True
    )
    counts: Annotated[list[Count], AfterValidator(distinct)] = setting(
        [250, 500, 1000, 2000], "numbers of samples, likewise", free=True
    )
    etas: Annotated[list[Eta], AfterValidator(distinct)] = setting(
        [0.5, 0.6, 0.7, 0.8, 0.9, 1.0], "chambers whose postures are compared", free=True
    )
    sweep: bool = setting(True, "compare weights of the L2 regularisation", free=True)
    eta_samples: Count = setting(1000, "images of each that train a network", free=True)


STUDY = Study(
    name="bending-posture",
    purpose="How a soft finger is bent, from its chamber, by a network: Figs. 10 and 11 of paper A",
    spec=BendingPostureSpec,
    run=lazily("studies.bending_posture.run:run"),
    design=partial(lazily("studies.models.soft_finger.design:chamber_design"), "bending-posture"),
)
