"""From an image to the quadrilaterals in it that may be views of pads."""

from __future__ import annotations

from typing import TypeGuard

import numpy as np

from perception.blobs import stable_blobs
from perception.lens import Lens
from perception.masks import brightness
from perception.matching import Catalogue, Sighting, match
from perception.quads import Quad, fit_quad


def find_quads(image: object, lens: Lens) -> list[Quad]:
    """All bright quadrilaterals of an image, from its top to its bottom.

    Args:
        image: red, green and blue, or one channel, 8 bits.
        lens: of the camera.

    Returns:
        None where the image is no image of the lens (another size or type), or shows nothing.
    """
    if not is_image(image, lens):
        return []
    grey = brightness(image) if image.ndim == 3 else np.ascontiguousarray(image)
    exact = grey.astype(np.float32)
    quads = [fit_quad(exact, lens, blob.contour) for blob in stable_blobs(grey)]
    found = [quad for quad in quads if quad is not None]
    return sorted(found, key=lambda quad: float(quad.corners[:, 1].mean()))


def is_image(image: object, lens: Lens) -> TypeGuard[np.ndarray]:
    """Whether something is an 8-bit image, with one or three channels, of a lens's size."""
    return (
        isinstance(image, np.ndarray)
        and image.dtype == np.uint8
        and image.shape in (lens.shape, (*lens.shape, 3))
    )


def find_views(image: object, lens: Lens, catalogue: Catalogue) -> Sighting:
    """What an image shows of a finger; of anything that is no image of it, nothing."""
    return match(find_quads(image, lens), catalogue, lens)
