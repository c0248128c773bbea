"""The whole image of a camera: pixels to rays and back, across the section as well as along it.

Everything in a finger is extruded across its width, so mirrors change a ray only within the
section. A ray therefore has two coordinates: its section angle (from the optical axis to the
ray's projection on the section, counter-clockwise, rad) and its lateral slope (way across the
section per way within it). A ray of slope s that has gone a path of unfolded length L in the
section is s·L beside it, over any number of mirrors.

Image places are (column, row), with whole numbers at pixel centres as OpenCV has them.
"""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from designopt.numerics import as_float, safe_arctan2, safe_divide, safe_sqrt
from optics.scene.camera import Camera

RADII = 4096
"""Entries of the table that inverts the lens for a whole image; interpolation errs by 1e-8 rad
for an equidistant lens, by 4e-7 rad for a pinhole of 160°, and by 2e-5 rad a tenth of a pixel from
the edge of an orthographic image."""

CENTER = 0.5
"""From a pixel's first edge to its middle, px."""


class Imaging(eqx.Module):
    """A camera with an image around its image line.

    Attributes:
        camera: in the section; the image line runs down the image and fills its height.
        rows: height of the image, px.
        columns: width of the image, px.
    """

    camera: Camera
    rows: Float[Array, ""] = eqx.field(converter=as_float)
    columns: Float[Array, ""] = eqx.field(converter=as_float)

    @classmethod
    def of(cls, camera: Camera, aspect: float | None = None) -> Imaging:
        """An image of a given width over its height around the camera's image line.

        Without one it is the sensor's, and 4/3 of a camera that has none.
        """
        rows = round(float(camera.pixels))
        if aspect is None:
            aspect = 4 / 3 if camera.sensor is None else float(camera.sensor.aspect)
        return cls(camera, rows, round(aspect * rows))

    @property
    def axis_place(self) -> tuple[Float[Array, ""], Float[Array, ""]]:
        """Column and row at which the optical axis is imaged: the image's middle, or beside it."""
        column, row = self.columns / 2 - CENTER, self.rows / 2 - CENTER
        offset = self.camera.axis_offset
        return (column, row) if offset is None else (column + offset[0], row + offset[1])

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns, as an image has them."""
        return round(float(self.rows)), round(float(self.columns))

    def place(
        self, angle: Float[Array, "*batch"], slope: Float[Array, "*batch"]
    ) -> Float[Array, "*batch 2"]:
        """Where rays are imaged: column and row.

        The lens is the camera's, turned about its axis: a ray at θ from the axis is imaged at
        the radius r(θ), in the direction in which it leaves the axis.

        Args:
            angle: section angle of the rays, rad.
            slope: their lateral slope.
        """
        up, forward = jnp.sin(angle), jnp.cos(angle)
        off = safe_sqrt(up * up + slope * slope)
        radius = self.camera.focal_pixels * self.camera.projection.height(
            safe_arctan2(off, forward)
        )
        # On the axis itself the quotient is the focal length.
        scale, there = safe_divide(radius, off)
        scale = jnp.where(there, scale, self.camera.focal_pixels)
        return jnp.stack(
            [
                self.axis_place[0] + scale * slope,
                self.axis_place[1] - scale * up,
            ],
            axis=-1,
        )

    def ray(self, place: Float[Array, "*batch 2"]) -> Float[Array, "*batch 2"]:
        """Section angle (rad) and lateral slope of what is imaged at places; inverts `place`."""
        column, row = self.axis_place
        across, up = place[..., 0] - column, row - place[..., 1]
        radius = safe_sqrt(up * up + across * across)
        height, _ = safe_divide(radius, self.camera.focal_pixels)
        focal = self.camera.focal_pixels
        return _ray(self.camera.projection.angle(height), across, up, radius, focal)

    def lit(self) -> Bool[np.ndarray, "rows columns"] | None:
        """Which pixels the lens images anything on; none where it is all of them."""
        focal, edge = float(self.camera.focal_pixels), self.camera.projection.edge
        sensor = self.camera.sensor
        if sensor is not None and sensor.image_circle is not None:
            edge = min(edge, float(sensor.image_circle) / 2 / float(sensor.focal_length))
        rows, columns = self.shape
        column, row = (float(one) for one in self.axis_place)
        if _farthest((rows, columns), (row, column)) <= edge * focal:
            return None
        up, across = np.arange(rows) - row, np.arange(columns) - column
        return np.hypot(up[:, None], across) <= edge * focal

    def ray_map(self, scale: float = 1.0) -> Float[np.ndarray, "rows columns 2"]:
        """`ray` of every pixel's middle, as float32, of an image that is larger by a factor.

        The lens is inverted at radii from the middle to the corner and interpolated between them.
        """
        return np.asarray(_ray_map(self, *self.shape, jnp.asarray(scale)), np.float32)


@eqx.filter_jit
def _ray_map(
    imaging: Imaging, rows: int, columns: int, scale: Float[Array, ""]
) -> Float[Array, "rows columns 2"]:
    focal = scale * imaging.camera.focal_pixels
    offset = imaging.camera.axis_offset
    column, row = columns / 2 - CENTER, rows / 2 - CENTER
    if offset is not None:
        column, row = column + scale * offset[0], row + scale * offset[1]
    farthest = _farthest((rows, columns), (row, column))
    radii = jnp.linspace(0.0, farthest, RADII, dtype=focal.dtype)
    angles = imaging.camera.projection.angle(radii / focal)
    across = (jnp.arange(columns, dtype=focal.dtype) - column)[None, :]
    up = (row - jnp.arange(rows, dtype=focal.dtype))[:, None]
    across, up = jnp.broadcast_arrays(across, up)
    radius = jnp.hypot(up, across)
    return _ray(jnp.interp(radius, radii, angles), across, up, radius, focal)


def _farthest(size: tuple[int, int], place: tuple[Any, Any]) -> Any:
    """Distance from a place of an image to its farthest corner, px."""
    away = [
        jnp.maximum(at + CENTER, count - CENTER - at) for count, at in zip(size, place, strict=True)
    ]
    return jnp.hypot(*away)


def _ray(
    angle: Float[Array, "*batch"],
    across: Float[Array, "*batch"],
    up: Float[Array, "*batch"],
    radius: Float[Array, "*batch"],
    focal: Float[Array, ""],
) -> Float[Array, "*batch 2"]:
    """Section angle and lateral slope of a ray at an angle from the axis, seen in a direction."""
    sine, forward = jnp.sin(angle), jnp.cos(angle)
    there = radius > 0
    # On the axis itself the quotient is one over the focal length.
    scale = jnp.where(there, sine / jnp.where(there, radius, 1.0), 1 / focal)
    above = scale * up
    slope, _ = safe_divide(scale * across, safe_sqrt(forward * forward + above * above))
    return jnp.stack([safe_arctan2(above, forward), slope], axis=-1)
