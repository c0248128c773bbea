"""A camera in the section: where it is, how it looks, and how it projects angles to pixels.

Pixels are counted along the image line from its first edge, and downwards (clockwise) as rows of an
image are: looking along +x, a point above the axis is imaged before the middle.
"""

from __future__ import annotations

import abc

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from designopt.numerics import as_float, safe_divide
from designopt.roots import find_root
from optics.scene.thin_lens import ThinLens


class Projection(eqx.Module):
    """How an angle from the optical axis becomes a height in the image, in focal lengths."""

    @abc.abstractmethod
    def height(self, angle: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
        """Image height in focal lengths of a ray at an angle (rad) from the axis; odd."""

    @abc.abstractmethod
    def slope(self, angle: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
        """Derivative of `height`, focal lengths per rad."""

    @abc.abstractmethod
    def angle(self, height: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
        """The angle (rad) that is imaged at a height: the inverse of `height`."""


class Pinhole(Projection):
    """The pinhole camera and the lens without distortion: r = f tan θ, for |θ| < 90°."""

    def height(self, angle: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
        """As `Projection.height`."""
        return jnp.tan(angle)

    def slope(self, angle: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
        """As `Projection.slope`."""
        return 1 + jnp.tan(angle) ** 2

    def angle(self, height: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
        """As `Projection.angle`."""
        return jnp.arctan(height)


class Equidistant(Projection):
    """The equidistant wide-angle lens: r = f θ."""

    def height(self, angle: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
        """As `Projection.height`."""
        return angle

    def slope(self, angle: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
        """As `Projection.slope`."""
        return jnp.ones_like(angle)

    def angle(self, height: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
        """As `Projection.angle`."""
        return height


class KannalaBrandt(Projection):
    """A calibrated wide-angle lens: r = f (θ + k₁ θ³ + k₂ θ⁵ + k₃ θ⁷ + k₄ θ⁹).

    Source: J. Kannala, S. S. Brandt, *A generic camera model and calibration method for
    conventional, wide-angle, and fish-eye lenses*, IEEE TPAMI 28 (2006), eq. 6; the coefficients
    are those of OpenCV's fisheye module.

    Attributes:
        coefficients: k₁ … k₄.
    """

    coefficients: Float[Array, "4"] = eqx.field(converter=as_float)

    def height(self, angle: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
        """As `Projection.height`."""
        k1, k2, k3, k4 = (self.coefficients[i] for i in range(4))
        square = angle * angle
        return angle * (1 + square * (k1 + square * (k2 + square * (k3 + square * k4))))

    def slope(self, angle: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
        """As `Projection.slope`."""
        k1, k2, k3, k4 = (self.coefficients[i] for i in range(4))
        square = angle * angle
        return 1 + square * (3 * k1 + square * (5 * k2 + square * (7 * k3 + square * 9 * k4)))

    def angle(self, height: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
        """As `Projection.angle`."""

        def residual(angle: Float[Array, ""], args: tuple[KannalaBrandt, Array]) -> Array:
            projection, wanted = args
            return projection.height(angle) - wanted

        def inverse(wanted: Float[Array, ""]) -> Float[Array, ""]:
            return find_root(residual, wanted, (self, wanted)).value

        return jax.vmap(inverse)(height.reshape(-1)).reshape(height.shape)


class Camera(eqx.Module):
    """A camera in the section; every dimension is an array leaf.

    Attributes:
        position: of the pinhole (entrance pupil), mm.
        direction: of the optical axis, rad, counter-clockwise from +x.
        field_of_view: from limit to limit, rad; up to 2π, for a `Pinhole` below π.
        pixels: number of pixels along the image line, which the field of view fills.
        projection: from angles to heights in the image.
        lens: the lens for questions of focus; ``None`` for a camera that is sharp everywhere.
    """

    position: Float[Array, "2"] = eqx.field(converter=as_float)
    direction: Float[Array, ""] = eqx.field(converter=as_float)
    field_of_view: Float[Array, ""] = eqx.field(converter=as_float)
    pixels: Float[Array, ""] = eqx.field(converter=as_float)
    projection: Projection
    lens: ThinLens | None = None

    @property
    def focal_pixels(self) -> Float[Array, ""]:
        """Focal length in pixels: the field of view fills the image line."""
        focal, _ = safe_divide(self.pixels / 2, self.projection.height(self.field_of_view / 2))
        return focal

    def pixel(self, angle: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
        """Where a ray is imaged, in pixels from the image's first edge.

        Args:
            angle: of the ray from the optical axis, counter-clockwise, rad.
        """
        return self.pixels / 2 - self.focal_pixels * self.projection.height(angle)

    def pixels_per_radian(self, angle: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
        """Pixels per rad at an angle (rad) from the optical axis."""
        return self.focal_pixels * self.projection.slope(angle)

    def angle(self, pixel: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
        """The angle from the axis (rad, counter-clockwise) imaged at a pixel; inverts `pixel`."""
        height, _ = safe_divide(self.pixels / 2 - pixel, self.focal_pixels)
        return self.projection.angle(height)
