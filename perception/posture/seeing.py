"""The posture that one frame shows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from perception.chamber import Sight, find_regions
from perception.images import checked_image
from perception.masks import Image
from perception.posture.boundary import boundary_image, shrunk
from perception.posture.estimator import PostureEstimator

USABLE = frozenset({Sight.CHAMBER, Sight.NO_YELLOW})
"""What has to be seen of the chamber, for a posture to be read from it."""


@dataclass(frozen=True)
class SeenPosture:
    """What one frame says of the finger's posture.

    Attributes:
        sight: what is seen of the chamber.
        markers: places relative to the marker nearest the camera, mm; None if the frame shows no
            chamber, for the network would answer to anything.
    """

    sight: Sight
    markers: Float[np.ndarray, "3 2"] | None


def find_posture(image: Image, estimator: PostureEstimator) -> SeenPosture:
    """The posture in one frame (paper A §III.A).

    Args:
        image: red, green, blue.
        estimator: trained on boundary images of frames of this size.

    Raises:
        UserError: it is no image of three channels of 8 bits, or shows a chamber in fewer pixels
            than the network takes.
    """
    regions = find_regions(checked_image(image))
    if regions.sight not in USABLE:
        return SeenPosture(regions.sight, None)
    small = shrunk(boundary_image(regions.nested()), estimator.record.image_size)
    return SeenPosture(regions.sight, estimator.predict(small[None])[0])
