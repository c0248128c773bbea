"""The endoscope: from directions in the chamber to pixels."""

from __future__ import annotations

import dataclasses

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from designopt.numerics import as_float


class Endoscope(eqx.Module):
    """A camera at the chamber's pinhole that looks along it. Image x is right, y is down.

    Attributes:
        field_of_view: angle between the rays of two opposite corners of the image, lens apart.
        distortion: k1 of r (1 + k1 r²), with r the tangent of a ray's angle to the optical axis;
            negative is a barrel (D. C. Brown, Photogrammetric Engineering 32 (1966) 444).
        pointing: by which angles the camera is turned to the right and down, before it is rolled,
            in radians.
        roll: by which angle it is then turned about its axis, in radians; positive turns the image
            counter-clockwise as it is looked at.
        columns: width of the image, px.
        rows: its height, px.
    """

    field_of_view: Float[Array, ""] = eqx.field(converter=as_float)
    distortion: Float[Array, ""] = eqx.field(converter=as_float, default=0.0)
    pointing: Float[Array, "2"] = eqx.field(converter=as_float, default_factory=lambda: np.zeros(2))
    roll: Float[Array, ""] = eqx.field(converter=as_float, default=0.0)
    columns: int = eqx.field(static=True, default=640)
    rows: int = eqx.field(static=True, default=480)

    @property
    def focal_px(self) -> Float[Array, ""]:
        """Focal length in px."""
        half_diagonal = float((self.columns**2 + self.rows**2) ** 0.5) / 2
        return half_diagonal / jnp.tan(self.field_of_view / 2)

    @property
    def center(self) -> tuple[float, float]:
        """Where the optical axis is imaged, px; pixel centres have whole numbers."""
        return (self.columns - 1) / 2, (self.rows - 1) / 2

    def turned(self, pointing: ArrayLike, roll: ArrayLike) -> Endoscope:
        """The same camera with angles, in radians, added to its own: `pointing` before its roll."""
        return dataclasses.replace(
            self, pointing=self.pointing + as_float(pointing), roll=self.roll + as_float(roll)
        )

    def image(self, slopes: Float[Array, "*points 2"]) -> Float[Array, "*points 2"]:
        """Pixels of rays (x, y, 1) that are given by x and y, right and down.

        Rays must point into the half-space that the turned camera looks into.
        """
        across, down = slopes[..., 0], slopes[..., 1]
        right, below = self.pointing[0], self.pointing[1]
        # Turned to the right about the vertical, then down about the camera's own horizontal.
        depth = across * jnp.sin(right) + jnp.cos(right)
        across = across * jnp.cos(right) - jnp.sin(right)
        ahead = down * jnp.sin(below) + depth * jnp.cos(below)
        down = (down * jnp.cos(below) - depth * jnp.sin(below)) / ahead
        across = across / ahead
        x = across * jnp.cos(self.roll) + down * jnp.sin(self.roll)
        y = down * jnp.cos(self.roll) - across * jnp.sin(self.roll)
        scale = self.focal_px * (1 + self.distortion * (x**2 + y**2))
        column, row = self.center
        return jnp.stack([column + scale * x, row + scale * y], axis=-1)
