"""From an image to the quadrilaterals in it that may be views of pads."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Float

from perception.blobs import join_halves, stable_blobs
from perception.colored_ends import CONTRAST, find_colors_apart
from perception.images import checked_image
from perception.lens import Lens
from perception.masks import Gray, Mask, brightness, lamp_mask, without_lamps
from perception.matching import Sighting, ViewCatalog, match_views
from perception.quads import Quad, fit_quads, follow_quads
from perception.quality import Quality

CHANNEL = 1
"""Green."""

COLOR_DOUBT = 0.3
"""px: by so much layers and lens image red and blue elsewhere than green, for which corners are
predicted."""

Fits = list[Quad | None]

BLOOM = 3
"""A lamp's light spreads over so many pixels beside it, which are no part of a pad."""


def detect_quads(image: object, lens: Lens) -> list[Quad]:
    """All bright quadrilaterals of an image, from its top to its bottom.

    Layers and lenses image every color elsewhere: a quadrilateral is looked for in the brightest
    color, and its edges in green alone if that is bright enough.

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
    return _Light.of(image, lens).quads(lens)


class _Light(NamedTuple):
    """An image as edges are looked for in it.

    Attributes:
        picture: the image.
        codes: brightest color of every pixel, 8 bits.
        brightest: light of that color.
        green: light in green; ``None`` if the image has one channel.
        lamps: lamps in view, if any are.
    """

    picture: np.ndarray
    codes: Gray
    brightest: Float[np.ndarray, "rows columns"]
    green: Float[np.ndarray, "rows columns"] | None
    lamps: Mask | None

    @classmethod
    def of(cls, image: object, lens: Lens) -> _Light:
        """The light of an image.

        Raises:
            UserError: it is no image of the lens, but of another size or type.
        """
        picture = checked_image(image, channels=(1, 3), like=("what the lens images", lens.shape))
        gray, green = picture, None
        if picture.ndim == 3:
            channels = cv2.split(picture)
            gray, green = brightness(channels), lens.light(channels[CHANNEL])
        lamps = lamp_mask(picture, gray)
        return cls(picture, gray, lens.light(gray), green, lamps if lamps.any() else None)

    def quads(self, lens: Lens) -> list[Quad]:
        """All quadrilaterals, from the image's top to its bottom."""
        codes = self.codes if self.lamps is None else without_lamps(self.codes, self.lamps, BLOOM)
        blobs = join_halves(stable_blobs(codes))
        contours = [blob.contour for blob in blobs]
        if self.green is None:
            found = fit_quads(self.brightest, lens, contours, self.lamps)
        else:
            found = fit_quads(self.green, lens, contours, self.lamps)
            doubtful = [i for i, quad in enumerate(found) if not _is_clear(quad)]
            others = fit_quads(self.brightest, lens, [contours[i] for i in doubtful], self.lamps)
            for i, other in zip(doubtful, others, strict=True):
                found[i] = _clearer(found[i], other)
        quads = [quad for quad in self.colored(found, lens) if quad is not None]
        return sorted(quads, key=lambda quad: float(quad.corners[:, 1].mean()))

    def follow(
        self, lens: Lens, expected: Sequence[Float[np.ndarray, "4 2"]], beside: int | None
    ) -> Fits:
        """The quadrilaterals whose corners are expected at given places, as `follow_quads`."""
        if self.green is None:
            return follow_quads(self.brightest, lens, expected, self.lamps, beside)
        # A round of a few views in two colors takes hardly longer than in one.
        count = len(expected)
        every = [self.green] * count + [self.brightest] * count
        quads = follow_quads(every, lens, [*expected, *expected], self.lamps, beside)
        return self.colored(map(_clearer, quads[:count], quads[count:]), lens)

    def colored(self, quads: Iterable[Quad | None], lens: Lens) -> Fits:
        """Quadrilaterals, and whether some color ends elsewhere than at their ends."""
        every = list(quads)
        asked = {i: one for i, one in enumerate(every) if one is not None and _has_sides(one)}
        if self.green is None or not asked:
            return every
        rays = np.stack([one.rays for one in asked.values()])
        found = find_colors_apart(self.picture, lens, rays)
        for (i, one), apart in zip(asked.items(), found, strict=True):
            every[i] = replace(one, apart=apart)
        return every


def _has_sides(quad: Quad) -> bool:
    """Whether all four sides are found, one of them maybe before a lamp."""
    return quad.quality is Quality.COMPLETE or quad.before_lamp


def _is_clear(quad: Quad | None) -> bool:
    return quad is not None and quad.contrast >= CONTRAST and _has_sides(quad)


def _clearer(green: Quad | None, brightest: Quad | None) -> Quad | None:
    """What is found in green where that is clear, else in the brightest color, if it is there."""
    if _is_clear(green) or brightest is None:
        return green
    return replace(brightest, covariance=brightest.covariance + COLOR_DOUBT**2 * np.eye(2))


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
    light = _Light.of(image, lens)

    follow = partial(light.follow, lens)
    return match_views(light.quads(lens), catalog, lens, follow)
