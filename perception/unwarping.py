"""From a view to the pad itself: an image in the pad's own plane, in millimetres.

A plane pad through a wide lens needs its rays first, and then a homography: four corners alone, and
an affine map as the paper has it (§4.1.1, "affine transformations"), are off by millimetres. Rows
of an unwarped pad go along it from its first end, columns across the section towards greater
columns of the image, in whatever view it was seen: a mirror's reversal along the finger is undone.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Literal

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from perception.images import checked_image
from perception.lens import Lens, TangentPlane
from perception.matching import View
from perception.quality import Quality
from perception.sampling import sampled

PER_MM = 10.0
"""Samples of an unwarped pad per mm."""

PlacesOf = Callable[[Float[np.ndarray, "_ 3"]], Float[np.ndarray, "_ 2"]]
"""Column and row of places of a pad: along it, across it from its middle, and above it, mm."""

LATTICE = 96
"""The map from pad to image is smooth: it is computed at so many places a side and interpolated."""


def pad_plane(
    view: View, length: float, width: float
) -> tuple[TangentPlane, Float[np.ndarray, "3 3"]]:
    """The tangent plane of a view's rays, and the homography from the pad (mm) to it.

    Places of the pad are (along it from its first end, across it from its middle).
    """
    plane = TangentPlane(float(view.rays[:, 0].min() + view.rays[:, 0].max()) / 2)
    half = width / 2
    corners = np.array([[0, -half], [length, -half], [length, half], [0, half]], np.float32)
    flat = plane.flat(view.rays)
    return plane, cv2.getPerspectiveTransform(corners, flat.astype(np.float32))


def map_to_image(
    view: View, lens: Lens, places: Float[np.ndarray, "_ 2"], length: float, width: float
) -> Float[np.ndarray, "_ 2"]:
    """Where places of a pad are imaged in a view: column and row.

    Example:
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
        >>> map_to_image(view, lens, np.array([[5.0, 0.0]]), 10.0, 10.0).round(
        ...     1
        ... ).tolist()  # the pad's middle
        [[55.0, 45.0]]
    """
    plane, homography = pad_plane(view, length, width)
    flat = cv2.perspectiveTransform(places[None].astype(float), homography)[0]
    return lens.project(plane.rays(flat))


def map_to_pad(
    view: View, lens: Lens, places: Float[np.ndarray, "_ 2"], length: float, width: float
) -> Float[np.ndarray, "_ 2"]:
    """Which places of a pad are imaged at given columns and rows; inverts `map_to_image`.

    Example:
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
        >>> (map_to_pad(view, lens, np.array([[55.0, 45.0]]), 10.0, 10.0).round(1) + 0.0).tolist()
        [[5.0, 0.0]]
    """
    plane, homography = pad_plane(view, length, width)
    flat = plane.flat(lens.rays(places))
    back = cv2.invert(homography)[1]
    return cv2.perspectiveTransform(flat[None], back)[0]


def map_to_pad_affinely(
    view: View, places: Float[np.ndarray, "_ 2"], length: float, width: float
) -> Float[np.ndarray, "_ 2"]:
    """As `map_to_pad`, by the affine map nearest the four corners (paper B), to compare with."""
    half = width / 2
    corners = np.array([[0, -half], [length, -half], [length, half], [0, half]])
    design = np.column_stack([view.corners, np.ones(4)])
    affine = np.linalg.lstsq(design, corners, rcond=None)[0]
    return np.column_stack([places, np.ones(len(places))]) @ affine


def unwarp(
    image: UInt8[np.ndarray, "rows columns *channels"],
    view: View,
    lens: Lens,
    length: float,
    width: float,
    places_of: PlacesOf | None = None,
) -> UInt8[np.ndarray, "along across *channels"]:
    """The pad as if seen from straight above, `PER_MM` samples per mm.

    Args:
        image: the picture.
        view: of the pad, complete.
        lens: of the camera.
        length: of the pad, mm.
        width: of the pad, mm.
        places_of: where its places are imaged; by default as in air, from the view's corners.
            Behind 3 mm of acrylic that is off by 2 mm in flat views.

    Raises:
        UserError: it is no image of the lens, but of another size or type.

    Example:
        >>> import cv2
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
        >>> image = np.full((90, 120), 80, np.uint8)
        >>> unwarp(image, view, lens, 10.0, 10.0).shape[:2]
        (100, 100)
    """
    image = checked_image(image, channels=(1, 3), like=("what the lens images", lens.shape))
    shape = round(length * PER_MM), round(width * PER_MM)
    along, across = (np.linspace(0, size, LATTICE) for size in (length, width))
    lattice = np.stack(np.meshgrid(along, across - width / 2, indexing="ij"), axis=-1)
    lattice = lattice.reshape(-1, 2)
    if places_of is None:
        places = map_to_image(view, lens, lattice, length, width)
    else:
        places = places_of(np.column_stack([lattice, np.zeros(len(lattice))]))
    coarse = places.reshape(LATTICE, LATTICE, 2).astype(np.float32)
    # Samples are the middles of squares, the lattice has its outermost places on the edges.
    rows, columns = ((np.arange(count) + 0.5) / count * (LATTICE - 1) for count in shape)
    fine = sampled(coarse, np.stack(np.meshgrid(columns, rows), axis=-1))
    return sampled(image, fine)


def least_scale(view: View, lens: Lens, length: float, width: float) -> float:
    """The least number of pixels per mm at which a view shows its pad, along or across it."""
    along, across = np.linspace(0, length, 5), np.linspace(-width / 2, width / 2, 5)
    places = np.stack(np.meshgrid(along, across, indexing="ij"), axis=-1).reshape(-1, 2)
    small = 0.1
    along_it, beside_it = small * np.eye(2)
    moved = np.concatenate([places, places + along_it, places + beside_it])
    at, further, beside = np.split(map_to_image(view, lens, moved, length, width), 3)
    jacobians = np.stack([further - at, beside - at], axis=-1) / small
    return float(np.linalg.svd(jacobians, compute_uv=False)[:, -1].min())


def select_view(
    views: Iterable[View],
    lens: Lens,
    length: float,
    width: float,
    *,
    by: Literal["scale", "area"] = "scale",
) -> View | None:
    """The view that shows a pad best, among the complete ones.

    Args:
        views: of one pad.
        lens: of the camera.
        length: of the pad, mm.
        width: of the pad, mm.
        by: ``"scale"``, the view whose least scale is the greatest; or ``"area"``, the one that is
            largest in the image, as in paper B (§4.1.1).

    Example:
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
        >>> select_view([view], lens, 10.0, 10.0).path, select_view([], lens, 10.0, 10.0)
        ('direct', None)
    """
    complete = [view for view in views if view.quality is Quality.COMPLETE]
    if not complete:
        return None
    if by == "area":
        return max(complete, key=lambda view: view.area)
    return max(complete, key=lambda view: least_scale(view, lens, length, width))
