"""Where each color ends at a view's two ends: light on a wall has other colors than light on a pad.

What lies behind a pad's end, as the end face of a layer between two lamps, may be as bright as
the pad: then its far edge is found. It is lit by other lamps, so that some color falls before.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, UInt8

from perception.lengths import ENDS
from perception.lens import Lens, TangentPlane
from perception.medians import median
from perception.sampling import sampled
from perception.sides import TRIMMED

PLACES, PARTS = 24, 3
"""Places along an end, but for its trimmed parts, and parts that these are cut into: beside a lamp
not the same colors are bright as beside another one."""

ACROSS = np.linspace(TRIMMED, 1 - TRIMMED, PLACES)[:, None]
"""Parts of the way along an end at which these are."""

INWARD, OUTWARD, FEWEST = 14, 6, 6
"""How far light is looked at from an end, px: inward over at most half of the view, and over at
least so much. Over the inner third it is that of the pad."""

CONTRAST = 12.0
"""Codes: a color whose step is lower has no edge that is relied on."""

APART = 2.0
"""px: layers and lenses move the edges of colors by less, and blur and noise, too."""


def find_colors_apart(
    picture: UInt8[np.ndarray, "rows columns 3"], lens: Lens, rays: Float[np.ndarray, "views 4 2"]
) -> Bool[np.ndarray, "views 2"]:
    """At which of each view's ends, the lower and the upper, some color ends more than 2 px away.

    It does so if the median of all of the end shows that, or those of two of its thirds, of
    whatever color. Of a view that is less than 12 px long nothing is known.

    Args:
        picture: red, green and blue.
        lens: of the camera.
        rays: of the views' corners, in the order of `perception.quads.Quad`.

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
        >>> find_colors_apart(picture, lens, lens.rays(corners)[None]).tolist()
        [[True, False]]
    """
    angle = (rays[..., 0].min(axis=1) + rays[..., 0].max(axis=1)) / 2
    turned, plane = rays.copy(), TangentPlane(0.0)
    turned[..., 0] -= angle[:, None]
    flat = plane.flat(turned.reshape(-1, 2)).reshape(-1, 4, 2)
    left, right = (flat[:, list(corners), None] for corners in zip(*ENDS, strict=True))
    across = plane.rays((left + ACROSS * (right - left)).reshape(-1, 2))
    across[:, 0] += np.repeat(angle, 2 * PLACES)
    places = lens.project(across).reshape(-1, 2, PLACES, 2)
    way = places[:, 0] - places[:, 1]
    inward = np.minimum(np.hypot(way[..., 0], way[..., 1]).min(axis=1) / 2, INWARD).astype(int)
    apart = np.zeros((len(rays), 2), bool)
    for length in np.unique(inward[inward >= FEWEST]).tolist():
        apart[inward == length] = _apart_over(length, picture, places[inward == length])
    return apart


def _apart_over(
    inward: int,
    picture: UInt8[np.ndarray, "rows columns 3"],
    places: Float[np.ndarray, "views 2 places 2"],
) -> Bool[np.ndarray, "views 2"]:
    """As `find_colors_apart`, by the places along the ends of views.

    Args:
        inward: so many pixels light is looked at from each place.
        picture: red, green and blue.
        places: along the lower and the upper end of each view.
    """
    beyond, across = places - places[:, ::-1], places[:, :, -1] - places[:, :, 0]
    normals = np.stack([-across[..., 1], across[..., 0]], axis=-1)
    outward = np.sum(beyond.sum(axis=2) * normals, axis=-1)
    normals /= np.copysign(np.hypot(across[..., 0], across[..., 1]), outward)[..., None]
    along = np.arange(-inward, OUTWARD + 1)
    sections = places[..., None, :] + along[:, None] * normals[:, :, None, None]
    light = sampled(picture, sections.reshape(-1, len(along), 2))
    # By end, color and part of the end, of which the last is all of it, along the normal.
    light = light.reshape(-1, PARTS, PLACES // PARTS, len(along), 3).transpose(0, 4, 1, 3, 2)
    whole = np.concatenate(np.split(light, PARTS, axis=2), axis=-1)
    profiles = np.concatenate([median(light), median(whole)], axis=2)
    inside = median(profiles[..., : inward // 3])
    outside = profiles[..., inward + 1 :].min(axis=-1)
    below = profiles < (inside + outside)[..., None] / 2
    first_below = along[np.argmax(below, axis=-1)] - 0.5
    ends = (np.abs(first_below) > APART) & (inside - outside >= CONTRAST)
    *parts, all_of_it = np.moveaxis(ends.any(axis=1), 1, 0)
    return (all_of_it | (np.count_nonzero(parts, axis=0) > PARTS / 2)).reshape(-1, 2)
