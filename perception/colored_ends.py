"""Where each color ends at a view's two ends: light on a wall has other colors than light on a pad.

What lies behind a pad's end, as the end face of a layer between two lamps, may be as bright as
the pad: then its far edge is found. It is lit by other lamps, so that some color falls before.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, UInt8

from perception.lens import Lens, TangentPlane
from perception.sampling import sampled

ENDS = (0, 3), (1, 2)
"""The corners of both ends."""

PLACES, TRIMMED = 24, 0.1
"""Places along an end, and the part of it at each corner that has none."""

INWARD, OUTWARD = 14, 6
"""How far light is looked at from an end, px; over the inner third it is that of the pad."""

CONTRAST = 12.0
"""Codes: a color whose step is lower has no edge."""

APART = 2.0
"""px: layers and lenses move the edges of colors by less, and blur and noise, too."""


def find_colors_apart(
    picture: UInt8[np.ndarray, "rows columns 3"], lens: Lens, rays: Float[np.ndarray, "4 2"]
) -> Float[np.ndarray, "4 2"]:
    """The ways from a view's corners to where they are in the color that ends furthest away.

    Args:
        picture: red, green and blue.
        lens: of the camera.
        rays: of the view's corners, in the order of `perception.quads.Quad`.

    Returns:
        For each corner the way along its side, column and row; 0 where no color ends more than
        2 px away from its end.

    Example:
        >>> rows, columns = np.mgrid[:90, :120]
        >>> rays = np.stack([(44.5 - rows) / 200, (columns - 59.5) / 200], axis=-1)
        >>> lens = Lens(
        ...     rays, lambda r: np.stack([59.5 + 200 * r[:, 1], 44.5 - 200 * r[:, 0]], axis=-1)
        ... )
        >>> picture = np.zeros((90, 120, 3), np.uint8)
        >>> picture[20:70, 30:90] = 200
        >>> picture[64:70, 30:90, 0] = 40  # behind the lower end it is not red
        >>> corners = np.array([[30.0, 69.5], [30.0, 19.5], [89.0, 19.5], [89.0, 69.5]])
        >>> find_colors_apart(picture, lens, lens.rays(corners))[:, 1].tolist()
        [-5.5, 0.0, 0.0, -5.5]
    """
    plane = TangentPlane(float(rays[:, 0].min() + rays[:, 0].max()) / 2)
    flat = plane.flat(rays)
    shares = np.linspace(TRIMMED, 1 - TRIMMED, PLACES)[:, None]
    ends = [flat[list(end)][:1] + shares * np.diff(flat[list(end)], axis=0) for end in ENDS]
    inward = flat + TRIMMED * (flat[[1, 0, 3, 2]] - flat)
    at = lens.project(plane.rays(np.concatenate([flat, inward, *ends])))
    corners, inward, *both = np.split(at, [4, 8, 8 + PLACES])
    away, sides = np.zeros((4, 2)), corners - inward
    for end, places in zip(ENDS, both, strict=True):
        along_end = places[-1] - places[0]
        normal = np.array([-along_end[1], along_end[0]]) / np.hypot(*along_end)
        outward = normal * np.sign(sides[end[0]] @ normal)
        along = np.arange(-INWARD, OUTWARD + 1)
        light = sampled(picture, places[:, None] + along[:, None] * outward)
        profiles = np.median(light.astype(float), axis=0)
        inside, outside = np.median(profiles[: INWARD // 3], axis=0), profiles.min(axis=0)
        below = profiles < (inside + outside) / 2
        first_below = along[np.argmax(below, axis=0)] - 0.5
        found = first_below[(inside - outside >= CONTRAST) & below.any(axis=0)]
        furthest = max(found, key=abs, default=0.0)
        if abs(furthest) > APART:
            for corner in end:
                away[corner] = furthest * sides[corner] / (sides[corner] @ outward)
    return away
