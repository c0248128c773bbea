"""The camera model that the analysis of an image needs: rays of pixels and the inverse.

A ray is a section angle (rad, from the optical axis, counter-clockwise: up in the image) and a
lateral slope (way across the section per way within it, towards greater columns). Places are
(column, row), whole numbers at pixel centres.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float, Int, UInt8

from perception.sampling import sampled

MOST = 30_000
"""Places that OpenCV samples at a time: tables of 2¹⁵ rows it refuses."""

Rays = Float[np.ndarray, "_ 2"]
Places = Float[np.ndarray, "_ 2"]


@dataclass(frozen=True)
class Lens:
    """A camera's rays.

    Attributes:
        ray_map: section angle and lateral slope of the ray through every pixel's middle.
        project: from rays to where they are imaged, the inverse.
        response: light that each code of 8 bits means, 0 to 255 and rising; ``None`` where the
            camera is linear. Of a camera with gamma g it is 255 (code / 255)^g.
    """

    ray_map: Float[np.ndarray, "rows columns 2"]
    project: Callable[[Rays], Places]
    response: Float[np.ndarray, "256"] | None = None

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of the images it is for."""
        rows, columns, _ = self.ray_map.shape
        return rows, columns

    def light(self, codes: UInt8[np.ndarray, "rows columns"]) -> Float[np.ndarray, "rows columns"]:
        """Light on every pixel, float32, from its code."""
        if self.response is None:
            return codes.astype(np.float32)
        return cv2.LUT(codes, self.response.astype(np.float32))

    def codes(self, light: Float[np.ndarray, "*places"]) -> Float[np.ndarray, "*places"]:
        """Codes of light, 0 to 255, not rounded; inverts `light`."""
        if self.response is None:
            return light
        return np.interp(light, self.response, np.arange(256.0))

    def rays(self, places: Places) -> Rays:
        """The rays through places in the image, interpolated between pixels."""
        found = np.empty((len(places), 2))
        for start in range(0, len(places), MOST):
            part = slice(start, start + MOST)
            for axis, plane in enumerate(self._planes):
                found[part, axis] = sampled(plane, places[part, None])[:, 0]
        return found

    @functools.cached_property
    def _planes(self) -> list[Float[np.ndarray, "rows columns"]]:
        """Section angles and lateral slopes, each by itself in memory."""
        return [np.ascontiguousarray(self.ray_map[..., part]) for part in range(2)]

    def pixel_rays(self, pixels: Int[np.ndarray, "_ 2"]) -> Rays:
        """The rays through the middles of pixels."""
        return self.ray_map[pixels[:, 1], pixels[:, 0]].astype(float)


@dataclass(frozen=True)
class TangentPlane:
    """The plane that touches the unit sphere of rays at a section angle: straight lines stay so.

    Its coordinates are across the section and along it (up). A view lies within 90° of its middle.

    Attributes:
        angle: section angle of the point that it touches, rad.
    """

    angle: float

    def flat(self, rays: Rays) -> Float[np.ndarray, "_ 2"]:
        """Places of rays in the plane."""
        turn = rays[:, 0] - self.angle
        return np.stack([rays[:, 1] / np.cos(turn), np.tan(turn)], axis=-1)

    def rays(self, flat: Float[np.ndarray, "_ 2"]) -> Rays:
        """The rays through places in the plane; inverts `flat`."""
        turn = np.arctan(flat[:, 1])
        return np.stack([self.angle + turn, flat[:, 0] * np.cos(turn)], axis=-1)
