"""Paper B's own route to the corners (§4.1.1), as the baseline: polygons around masks.

Threshold (global and adaptive, combined), opening and closing, contours, their convex hulls, and
the polygon approximation of these with the least tolerance that leaves four corners.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float

from perception.images import checked_image
from perception.masks import Gray, brightness, cleaned, combined_mask
from perception.quads import ordered


@dataclass(frozen=True)
class PaperRoute:
    """Its settings, which the paper does not give.

    Attributes:
        threshold: the global one, of 255.
        block: box of the adaptive one, px.
        share: of the box's mean.
        size: of the square that opens and closes, px.
        least_area: of a contour, part of the image.
    """

    threshold: float = 40.0
    block: int = 301
    share: float = 0.7
    size: int = 5
    least_area: float = 5e-4

    def corners(self, image: np.ndarray) -> list[Float[np.ndarray, "4 2"]]:
        """Corners of all quadrilaterals, column and row, in the order of `quads.Quad`.

        Args:
            image: red, green and blue, 8 bits.

        Raises:
            UserError: it is something else.
        """
        gray: Gray = brightness(cv2.split(checked_image(image)))
        mask = cleaned(combined_mask(gray, self.threshold, self.block, self.share), self.size)
        contours = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)[0]
        found = []
        for contour in contours:
            if cv2.contourArea(contour) < self.least_area * gray.size:
                continue
            corners = _four(cv2.convexHull(contour))
            if corners is not None:
                # Up in the image is up in the section.
                found.append(ordered(corners * [1, -1]) * [1, -1])
        return found


def _four(hull: np.ndarray) -> Float[np.ndarray, "4 2"] | None:
    """The hull approximated by four corners, with the least tolerance that leaves no more."""
    around = cv2.arcLength(hull, True)
    for share in np.linspace(0.005, 0.15, 30):
        corners = cv2.approxPolyDP(hull, share * around, True).reshape(-1, 2)
        if len(corners) == 4:
            return corners.astype(float)
        if len(corners) < 4:
            return None
    return None
