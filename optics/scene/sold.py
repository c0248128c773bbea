"""A lens and a sensor as they are sold: what follows from two of focal length, field, projection.

Makers name the field of view on the long side of the sensor, on its short side or on its diagonal
(horizontal, vertical, diagonal); the section has one of the sides.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import jax
import numpy as np

from designopt.numerics import as_float
from optics.scene.camera import CLASSICAL, Camera, KannalaBrandt, Projection

AGREEMENT = 0.01
"""Focal lengths that differ by this part of themselves are the same: makers round."""

Axis = Literal["horizontal", "vertical", "diagonal"]
Entry = str | tuple[float, ...]
"""A projection as in a file: a name or Kannala-Brandt coefficients."""


@dataclass(frozen=True)
class SoldLens:
    """What a lens and a sensor make together.

    Attributes:
        projection: as in a file.
        focal_length: mm.
        field: from limit to limit in the section, rad: to the sensor's edge or to the end of the
            image circle.
    """

    projection: Entry
    focal_length: float
    field: float


def projection_of(entry: Entry) -> Projection:
    """The projection that an entry of a file stands for."""
    if isinstance(entry, str):
        return CLASSICAL[entry]
    return KannalaBrandt(as_float(np.array(entry)))


def projection_entry(projection: Projection) -> str | list[float]:
    """The entry of a file that stands for a projection; inverts `projection_of`."""
    if isinstance(projection, KannalaBrandt):
        return np.asarray(projection.coefficients, float).tolist()
    return next(name for name, one in CLASSICAL.items() if type(one) is type(projection))


def solve_sold_lens(
    sensor: tuple[float, float],
    side: float,
    *,
    focal_length: float | None = None,
    fov_deg: float | None = None,
    fov_axis: Axis = "horizontal",
    projection: Entry | None = None,
    image_circle: float | None = None,
) -> SoldLens:
    """What is missing of a lens of which at least two numbers are known.

    Args:
        sensor: its sides, mm.
        side: the one that lies in the section, mm.
        focal_length: mm.
        fov_deg: field of view, degrees; that of the image circle where this ends before the sensor.
        fov_axis: on which axis of the sensor.
        projection: as in a file; without it the classical one that fits.
        image_circle: its diameter, mm.

    Raises:
        ValueError: the numbers contradict each other, or fit no classical projection.

    Example:
        >>> found = solve_sold_lens(
        ...     (4.0, 3.0), 4.0, fov_deg=160.0, fov_axis="diagonal", projection="equidistant"
        ... )
        >>> round(math.degrees(found.field), 9)
        128.0
    """
    circle = math.inf if image_circle is None else image_circle
    with jax.enable_x64(True):
        fitting = focal_length
        if fov_deg is not None:
            extent = min(_extents(*sensor)[fov_axis], circle)
            half = math.radians(fov_deg) / 2
            asked = f"fov_deg = {fov_deg:g} ({fov_axis})"
            names = list(CLASSICAL) if projection is None else [projection]
            heights = {
                name: _height(projection_of(name), half)
                for name in names
                if half <= projection_of(name).widest
            }
            focals = {name: extent / 2 / height for name, height in heights.items() if height > 0}
            if not focals:
                raise ValueError(f"no such lens has {asked}; correct one of them")
            wanted = focal_length or focals[names[0]]
            projection, fitting = min(focals.items(), key=lambda one: abs(one[1] - wanted))
            if abs(fitting - wanted) > AGREEMENT * wanted:
                if len(names) > 1:
                    raise ValueError(
                        f"no classical projection has {asked} at a focal length of {wanted:g} mm; "
                        f'nearest is "{projection}" with {fitting:.4g} mm; correct one of them, or '
                        "give Kannala-Brandt coefficients as 'projection'"
                    )
                raise ValueError(
                    f"a focal_length of {wanted:g} mm contradicts {asked}, for which this "
                    f"projection needs {fitting:.4g} mm; correct one of them, or leave it out"
                )
        assert projection is not None
        assert fitting is not None
        focal = focal_length or fitting
        half = imaged_angle(projection_of(projection), min(side, circle) / 2 / focal)
    if half is None:
        raise ValueError(
            "with this projection the image ends within the sensor; give the diameter of what is "
            "used of it as 'image_circle_mm'"
        )
    return SoldLens(projection, focal, 2 * half)


def imaged_angle(projection: Projection, height: float) -> float | None:
    """The angle from the axis (rad) imaged at a height (focal lengths); none beyond the image."""
    widest = projection.widest
    if height >= _height(projection, widest):
        return None
    return float(projection.angle(as_float(height)))


def fields_of_view(camera: Camera, across: float = 4 / 3) -> dict[Axis, float | None]:
    """Fields of view on all axes of the sensor, degrees; none where the lens does not image it.

    Args:
        camera: a single one.
        across: length of the sensor across the section over that along it, if the camera has none.

    Example:
        >>> import jax.numpy as jnp
        >>> from optics import Camera, Equidistant
        >>> camera = Camera(jnp.zeros(2), 0.0, math.radians(90), 100, Equidistant())
        >>> [round(field, 4) for field in fields_of_view(camera).values()]
        [120.0, 90.0, 150.0]
    """
    circle = math.inf
    if camera.sensor is None:
        along = 2 * _height(camera.projection, float(camera.field_of_view) / 2)
        sides = along, along * across
    else:
        focal = float(camera.sensor.focal_length)
        sides = (np.asarray(camera.sensor.size, float) / focal).tolist()
        if camera.sensor.image_circle is not None:
            circle = float(camera.sensor.image_circle) / focal
    found: dict[Axis, float | None] = {}
    for axis, extent in _extents(*sides).items():
        half = imaged_angle(camera.projection, min(extent, circle) / 2)
        found[axis] = None if half is None else math.degrees(2 * half)
    return found


def _extents(one: float, other: float) -> dict[Axis, float]:
    long, short = max(one, other), min(one, other)
    return {"horizontal": long, "vertical": short, "diagonal": math.hypot(long, short)}


def _height(projection: Projection, angle: float) -> float:
    return float(projection.height(as_float(angle)))
