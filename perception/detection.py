"""From an image to the quadrilaterals in it that may be views of pads."""

from __future__ import annotations

import numpy as np

from perception.blobs import join_halves, stable_blobs
from perception.images import checked_image
from perception.lens import Lens
from perception.masks import brightness, lamp_mask, without_lamps
from perception.matching import Sighting, ViewCatalog, match_views
from perception.quads import Quad, fit_quad


BLOOM = 3
"""A lamp's light spreads over so many pixels beside it, which are no part of a pad."""


def detect_quads(image: object, lens: Lens) -> list[Quad]:
    """All bright quadrilaterals of an image, from its top to its bottom.

    Args:
        image: red, green and blue, or one channel, 8 bits.
        lens: of the camera.

    Raises:
        UserError: it is no image of the lens, but of another size or type.

    Example:
        >>> import cv2
        >>> import numpy as np
        >>> rows, columns = np.mgrid[:90, :120]
        >>> rays = np.stack([(44.5 - rows) / 200, (columns - 59.5) / 200], axis=-1)
        >>> lens = Lens(
        ...     rays, lambda r: np.stack([59.5 + 200 * r[:, 1], 44.5 - 200 * r[:, 0]], axis=-1)
        ... )
        >>> image = cv2.rectangle(np.zeros((90, 120), np.uint8), (30, 20), (89, 69), 200, -1)
        >>> [quad.corners.round().tolist() for quad in detect_quads(image, lens)]
        [[[30.0, 70.0], [30.0, 19.0], [89.0, 19.0], [89.0, 70.0]]]
    """
    picture = checked_image(image, channels=(1, 3), like=("what the lens images", lens.shape))
    gray = brightness(picture) if picture.ndim == 3 else picture
    lamps = lamp_mask(picture, gray)
    exact = lens.light(without_lamps(gray, lamps, 0))
    blobs = join_halves(stable_blobs(without_lamps(gray, lamps, BLOOM)))
    quads = [fit_quad(exact, lens, blob.contour, lamps) for blob in blobs]
    found = [quad for quad in quads if quad is not None]
    return sorted(found, key=lambda quad: float(quad.corners[:, 1].mean()))


def detect_views(image: object, lens: Lens, catalog: ViewCatalog) -> Sighting:
    """What an image shows of a finger.

    Raises:
        UserError: it is no image of the lens, but of another size or type.

    Example:
        >>> import numpy as np
        >>> rows, columns = np.mgrid[:90, :120]
        >>> rays = np.stack([(44.5 - rows) / 200, (columns - 59.5) / 200], axis=-1)
        >>> lens = Lens(
        ...     rays, lambda r: np.stack([59.5 + 200 * r[:, 1], 44.5 - 200 * r[:, 0]], axis=-1)
        ... )
        >>> detect_views(
        ...     np.zeros((90, 120), np.uint8), lens, ViewCatalog((), {}, {}, 5.0, 0)
        ... ).views  # dark
        ()
    """
    return match_views(detect_quads(image, lens), catalog, lens)
