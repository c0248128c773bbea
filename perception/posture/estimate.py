"""The posture that one frame shows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from perception.chamber import ChamberStatus, find_regions
from perception.images import checked_image
from perception.masks import Image
from perception.posture.boundary import make_boundary_image, shrink
from perception.posture.estimator import PostureEstimator

USABLE = frozenset({ChamberStatus.CHAMBER, ChamberStatus.NO_YELLOW})
"""What has to be seen of the chamber, for a posture to be read from it."""


@dataclass(frozen=True)
class PostureEstimate:
    """The finger's posture in one frame.

    Attributes:
        status: what is seen of the chamber.
        markers: places relative to the marker nearest the camera, mm; None if the frame shows no
            chamber, for the network would answer to anything.
    """

    status: ChamberStatus
    markers: Float[np.ndarray, "3 2"] | None


def find_posture(image: Image, estimator: PostureEstimator) -> PostureEstimate:
    """The posture in one frame (paper A §III.A).

    Args:
        image: red, green, blue.
        estimator: trained on boundary images of frames of this size.

    Raises:
        UserError: it is no image of three channels of 8 bits, or shows a chamber in fewer pixels
            than the network takes.

    Example:
        >>> import numpy as np
        >>> from perception.posture import Training, train
        >>> generator = np.random.default_rng(0)
        >>> images, markers = generator.random((8, 12, 16)), generator.random((8, 3, 2))
        >>> estimator = train(images.astype(np.float32), markers, Training(epochs=1, batch=4))
        >>> find_posture(
        ...     np.zeros((240, 320, 3), np.uint8), estimator
        ... ).markers is None  # nothing is seen
        True
    """
    regions = find_regions(checked_image(image))
    if regions.status not in USABLE:
        return PostureEstimate(regions.status, None)
    small = shrink(make_boundary_image(regions.nested()), estimator.record.image_size)
    return PostureEstimate(regions.status, estimator.predict(small[None])[0])
