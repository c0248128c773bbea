"""Paper A's bending directions (Table II, Fig. 12), and the chamber that shows them best."""

from __future__ import annotations

from functools import partial

from designopt import Study, lazily, setting
from studies.models.soft_finger.spec import ChamberImagesSpec


class BendingDirectionSpec(ChamberImagesSpec):
    """All settings of ``designopt run bending-direction``."""

    images: int = setting(
        300, "images in every direction; the paper has 300", scales=True, ge=1, le=100_000
    )
    largest_bend_deg: float = setting(
        90.0, "bends are spread evenly from 0 to this (degrees)", gt=0, le=120
    )
    scatter_deg: float = setting(
        8.0, "standard deviation of a direction bent by hand (degrees)", ge=0, le=30
    )
    threshold: float = setting(
        4.0, "a largest displacement below it counts as not bent (px)", ge=0, le=100
    )
    small_bend_deg: float = setting(
        2.0, "largest bend of the images that compare chambers (degrees)", gt=0, le=120
    )
    small_images: int = setting(
        1000, "of these, in every direction and for every chamber", scales=True, ge=1, le=100_000
    )
    real_images: int = setting(
        75,
        "images in every direction in the light of a lamp at the lens, with gloss and dust",
        scales=True,
        ge=1,
        le=100_000,
    )
    traced_bends: int = setting(
        2,
        "bends at which frames are path-traced, in every direction and with every kind of wall; 0: "
        "none are",
        scales=True,
        ge=0,
        le=100,
    )
    cache: str = setting(
        "", "folder that keeps path-traced frames (empty: the user's cache folder)", free=True
    )
    stability_images: int = setting(
        20, "in every direction at every bend from 0.01° to 120°", scales=True, ge=1, le=10_000
    )


STUDY = Study(
    name="bending-direction",
    purpose="Which way a soft finger bends, from its coloured chamber: Table II of paper A",
    spec=BendingDirectionSpec,
    run=lazily("studies.bending_direction.run:run"),
    design=partial(lazily("studies.models.soft_finger.design:chamber_design"), "bending-direction"),
)
