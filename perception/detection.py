"""From an image to the quadrilaterals in it that may be views of pads."""

from __future__ import annotations

import numpy as np

from perception.blobs import stable_blobs
from perception.images import checked_image
from perception.lens import Lens
from perception.masks import brightness
from perception.matching import Sighting, ViewCatalog, match_views
from perception.quads import Quad, fit_quad


def detect_quads(image: object, lens: Lens) -> list[Quad]:
    """All bright quadrilaterals of an image, from its top to its bottom.

    Args:
        image: red, green and blue, or one channel, 8 bits.
        lens: of the camera.

    Raises:
        UserError: it is no image of the lens, but of another size or type.
    """
    picture = checked_image(image, channels=(1, 3), like=("what the lens images", lens.shape))
    gray = brightness(picture) if picture.ndim == 3 else picture
    exact = gray.astype(np.float32)
    quads = [fit_quad(exact, lens, blob.contour) for blob in stable_blobs(gray)]
    found = [quad for quad in quads if quad is not None]
    return sorted(found, key=lambda quad: float(quad.corners[:, 1].mean()))


def detect_views(image: object, lens: Lens, catalog: ViewCatalog) -> Sighting:
    """What an image shows of a finger.

    Raises:
        UserError: it is no image of the lens, but of another size or type.
    """
    return match_views(detect_quads(image, lens), catalog, lens)
