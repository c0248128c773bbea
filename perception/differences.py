"""What has changed on a pad since it was not touched: difference images, like with like.

A pad looks different in another view and in another light, so a reference is kept for every view,
and both pictures are divided by their smooth part before they are subtracted.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from perception.images import checked_image
from perception.matching import View
from perception.unwarping import PER_MM

SMOOTH = 4.0
"""What varies over less than so many mm is no matter of light: standard deviation of a Gaussian."""

REDUCED = 4
"""Smooth parts are computed on pictures so many times smaller, which changes them by 0.2 %."""

LEAST = 4.0
"""Added to a smooth part before it divides, of 255: the dark has no contrast."""

Unwarped = UInt8[np.ndarray, "along across 3"]


@dataclass
class References:
    """Unwarped pictures of untouched pads, by pad and path."""

    pictures: dict[tuple[str, str], Unwarped] = field(default_factory=dict)

    def keep(self, view: View, picture: Unwarped) -> None:
        """Keep a picture of an untouched pad.

        Raises:
            UserError: it is no image of three channels of 8 bits.
        """
        self.pictures[view.pad, view.path] = checked_image(picture, what="an unwarped pad")

    def compare(self, view: View, picture: Unwarped) -> Float[np.ndarray, "along across 3"] | None:
        """The relative difference from the same view's reference; ``None`` if there is none.

        Raises:
            UserError: as `compare_with_reference`.
        """
        reference = self.pictures.get((view.pad, view.path))
        return None if reference is None else _compared(picture, reference)


def compare_with_reference(
    picture: Unwarped, reference: Unwarped
) -> Float[np.ndarray, "along across 3"]:
    """How much brighter each place is than in the reference, each over its own smooth part.

    Raises:
        UserError: one is no image of three channels of 8 bits, or they differ in size.

    Example:
        >>> import numpy as np
        >>> picture = np.full((48, 32, 3), 100, np.uint8)
        >>> float(np.abs(compare_with_reference(picture, picture)).max())
        0.0
    """
    return _compared(picture, reference)


def _compared(picture: object, reference: object) -> Float[np.ndarray, "along across 3"]:
    untouched = checked_image(reference, what="the reference of a pad")
    like = "its reference", untouched.shape[:2]
    return _flattened(checked_image(picture, like=like, what="an unwarped pad")) - _flattened(
        untouched
    )


def _flattened(picture: Unwarped) -> Float[np.ndarray, "along across 3"]:
    exact = picture.astype(np.float32)
    size = exact.shape[1::-1]
    fewer = max(size[0] // REDUCED, 1), max(size[1] // REDUCED, 1)
    small = cv2.resize(exact, fewer, interpolation=cv2.INTER_AREA)
    deviations = (SMOOTH * PER_MM * np.divide(fewer, size)).tolist()
    small = cv2.GaussianBlur(
        small, (0, 0), deviations[0], sigmaY=deviations[1], borderType=cv2.BORDER_REFLECT
    )
    return exact / (cv2.resize(small, size, interpolation=cv2.INTER_CUBIC) + LEAST)
