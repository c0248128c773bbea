"""Where places of a pad are imaged, flat or lifted, and from where they are seen.

What is pressed into a pad lifts its membrane towards the camera, and what is lifted appears at
another place of the flat pad: by its height times the slope of the ray that shows it. In air both
follow from a view's corners alone, since four corners of a known rectangle place the (virtual)
camera. Behind clear layers they do not: there `PlacesOf` comes from a model of the optics.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from perception.lens import Lens
from perception.matching import View
from perception.unwarping import PlacesOf, pad_plane

NODES = 13
"""Slopes vary smoothly: they are computed at so many places along a pad and across it."""

LIFT = 0.05
"""mm: by so much places are moved and lifted to find slopes."""


def find_places_in_air(view: View, lens: Lens, length: float, width: float) -> PlacesOf:
    """Where places of a bare pad are imaged in a view, flat or lifted towards the camera.

    Args:
        view: of the pad, complete.
        lens: of the camera.
        length: of the pad, mm.
        width: of the pad, mm.

    Returns:
        From places (along the pad from its first end, across from its middle, above its plane;
        mm) to column and row.

    Example:
        >>> from perception.quality import Quality
        >>> rows, columns = np.mgrid[:90, :120]
        >>> rays = np.stack([(44.5 - rows) / 200, (columns - 59.5) / 200], axis=-1)
        >>> lens = Lens(
        ...     rays, lambda r: np.stack([59.5 + 200 * r[:, 1], 44.5 - 200 * r[:, 0]], axis=-1)
        ... )
        >>> corners = np.array([[30.0, 70.0], [30.0, 20.0], [80.0, 20.0], [80.0, 70.0]])
        >>> view = View(
        ...     "tip",
        ...     "direct",
        ...     0,
        ...     Quality.COMPLETE,
        ...     (True, True),
        ...     corners,
        ...     lens.rays(corners),
        ...     *np.zeros((2, 4, 2, 2)),
        ...     2500.0,
        ... )
        >>> places_of = find_places_in_air(view, lens, 10.0, 10.0)
        >>> places_of(np.array([[5.0, 0.0, 0.0]])).round(1).tolist()  # the pad's middle
        [[55.0, 45.0]]
    """
    plane, homography = pad_plane(view, length, width)
    along, across, origin = homography.T
    scale = np.sqrt(np.linalg.norm(along) * np.linalg.norm(across))
    up = np.cross(along, across) / scale
    # The pad lies before the camera: above it is where the camera is.
    if up @ origin > 0:
        up = -up
    axes = np.stack([along, across, up])

    def places_of(points: Float[np.ndarray, "_ 3"]) -> Float[np.ndarray, "_ 2"]:
        there = points @ axes + origin
        return lens.project(plane.rays(there[:, :2] / there[:, 2:]))

    return places_of


@dataclass(frozen=True, eq=False)
class Sight:
    """How a view shows a pad, at `NODES` places along it and across it, edges among them.

    Attributes:
        slopes: how far along and across what is lifted by 1 mm appears. A ray that meets the flat
            pad at x has passed x + z s at the height z: towards the camera.
        pixels: how large a pixel is along the pad and across it, mm.
    """

    slopes: Float[np.ndarray, "_ _ 2"]
    pixels: Float[np.ndarray, "_ _ 2"]


def find_sight(places_of: PlacesOf, length: float, width: float) -> Sight:
    """How a view shows a pad.

    Args:
        places_of: where places are imaged.
        length: of the pad, mm.
        width: of the pad, mm.

    Example:
        >>> camera = np.array([4.0, 1.0, 20.0])
        >>> def places_of(points):
        ...     way = points - camera
        ...     return 100 * way[:, :2] / way[:, 2:]
        >>> sight = find_sight(places_of, 24.0, 20.0)
        >>> sight.slopes[0, 0].round(2).tolist(), sight.pixels[0, 0].round(2).tolist()
        ([0.2, 0.55], [0.2, 0.2])
    """
    along, across = np.linspace(0, length, NODES), np.linspace(-width / 2, width / 2, NODES)
    flat = np.stack([*np.meshgrid(along, across, indexing="ij"), np.zeros((NODES, NODES))], -1)
    moves = LIFT * np.concatenate([np.zeros((1, 3)), np.eye(3)])
    moved = (flat.reshape(-1, 3) + moves[:, None]).reshape(-1, 3)
    at, *beside = places_of(moved).reshape(4, -1, 2)
    columns = [(one - at) / LIFT for one in beside]
    inverse = np.linalg.inv(np.stack(columns[:2], axis=-1))
    slopes = -(inverse @ columns[2][..., None])[..., 0]
    pixels = np.linalg.norm(inverse, axis=-1)
    return Sight(slopes.reshape(NODES, NODES, 2), pixels.reshape(NODES, NODES, 2))
