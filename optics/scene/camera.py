"""A camera in the section: where it is, how it looks, and how it projects angles to pixels.

Pixels are counted along the image line from its first edge, and downwards (clockwise) as rows of an
image are: looking along +x, a point above the axis is imaged before the middle.
"""

from __future__ import annotations

import abc
import math
from collections.abc import Sequence
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from designopt.numerics import as_float, optional_float, safe_divide
from optics.scene.camera_module import CameraModule
from optics.scene.thin_lens import ThinLens

TABLE, NEWTON_STEPS = 128, 12
"""Angles from 0 to 180° from which an image height is inverted, and steps from there. Each squares
what is left; where the image stops to grow it halves it."""


class Projection(eqx.Module):
    """How an angle from the optical axis becomes a height in the image, in focal lengths.

    The five of a closed form are in the table of the PanoTools wiki, *General lens model*; the
    papers by Bettonvil (WGN 33, 2005) and by Kannala and Brandt, who discuss them, are not read.

    Attributes:
        edge: height beyond which nothing is imaged, focal lengths.
    """

    edge: ClassVar[float] = math.inf

    @property
    def widest(self) -> float:
        """Angle from the axis (rad) up to which the image grows; not in traced code."""
        return math.pi

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

    @property
    def widest(self) -> float:
        """As `Projection.widest`."""
        return math.pi / 2

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


class Equisolid(Projection):
    """The lens that images equal solid angles on equal areas: r = 2 f sin(θ/2)."""

    edge: ClassVar[float] = 2.0

    def height(self, angle: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
        """As `Projection.height`."""
        return 2 * jnp.sin(angle / 2)

    def slope(self, angle: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
        """As `Projection.slope`."""
        return jnp.cos(angle / 2)

    def angle(self, height: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
        """As `Projection.angle`; what lies beyond the edge has the angle of the edge."""
        return 2 * _arcsin(height / 2)


class Stereographic(Projection):
    """The lens that keeps the form of what is small: r = 2 f tan(θ/2), for |θ| < 180°."""

    def height(self, angle: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
        """As `Projection.height`."""
        return 2 * jnp.tan(angle / 2)

    def slope(self, angle: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
        """As `Projection.slope`."""
        return 1 + jnp.tan(angle / 2) ** 2

    def angle(self, height: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
        """As `Projection.angle`."""
        return 2 * jnp.arctan(height / 2)


class Orthographic(Projection):
    """The lens that images a hemisphere as seen from afar: r = f sin θ, for |θ| < 90°."""

    edge: ClassVar[float] = 1.0

    @property
    def widest(self) -> float:
        """As `Projection.widest`."""
        return math.pi / 2

    def height(self, angle: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
        """As `Projection.height`."""
        return jnp.sin(angle)

    def slope(self, angle: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
        """As `Projection.slope`."""
        return jnp.cos(angle)

    def angle(self, height: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
        """As `Projection.angle`; what lies beyond the edge has the angle of the edge."""
        return _arcsin(height)


def _arcsin(sine: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
    """Arcsine, and ±π/2 with zero slope from ±1 on."""
    inside = jnp.abs(sine) < 1
    return jnp.where(inside, jnp.arcsin(jnp.where(inside, sine, 0.0)), jnp.sign(sine) * jnp.pi / 2)


class KannalaBrandt(Projection):
    """A calibrated wide-angle lens: r = f (θ + k₁ θ³ + k₂ θ⁵ + …).

    Source: OpenCV's documentation, *Fisheye camera model*, whose four coefficients are the first,
    after J. Kannala, S. S. Brandt, *A generic camera model and calibration method for
    conventional, wide-angle, and fish-eye lenses*, IEEE TPAMI 28 (2006), which is not read.

    Attributes:
        coefficients: k₁, k₂, …
    """

    coefficients: Float[Array, " coefficients"] = eqx.field(converter=as_float)

    @property
    def widest(self) -> float:
        """As `Projection.widest`."""
        return min(turning_point(np.asarray(self.coefficients, float)), math.pi)

    def height(self, angle: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
        """As `Projection.height`."""
        return angle * _polynomial([1.0, *self.coefficients], angle * angle)

    def slope(self, angle: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
        """As `Projection.slope`."""
        slopes = ((2 * i + 3) * k for i, k in enumerate(self.coefficients))
        return _polynomial([1.0, *slopes], angle * angle)

    def angle(self, height: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
        """As `Projection.angle`, by Newton's method; about `widest` of heights above all.

        It begins at the next lower angle of a table that ends where the image stops to grow: begun
        elsewhere it may lead to where the polynomial has the same height once more, or nowhere.
        """
        sign = jnp.where(height < 0, -1, 1).astype(height.dtype)
        fixed, wanted = jax.lax.stop_gradient((self, sign * height))
        table = jnp.linspace(0.0, jnp.pi, TABLE, dtype=height.dtype)
        grows = jnp.cumprod(fixed.slope(table) > 0)
        heights = jnp.where(grows > 0, fixed.height(table), jnp.inf)
        start = table[jnp.searchsorted(heights, wanted, side="right") - 1]
        end = table[jnp.minimum(jnp.sum(grows), TABLE - 1)]

        def closer(projection: KannalaBrandt, angle: Array, wanted: Array) -> Array:
            off, _ = safe_divide(projection.height(angle) - wanted, projection.slope(angle))
            return angle - off

        near = jax.lax.fori_loop(
            0,
            NEWTON_STEPS,
            lambda _, angle: jnp.clip(closer(fixed, angle, wanted), start, end),
            start,
        )
        # Each step from a root, which has no derivatives, makes those of one order more right.
        angle = near
        for _ in range(2):
            angle = closer(self, angle, sign * height)
        return sign * jnp.where(jnp.abs(angle - near) < table[1], angle, near)


def _polynomial(
    coefficients: Sequence[float | Float[Array, ""]], at: Float[Array, "*batch"]
) -> Float[Array, "*batch"]:
    """Σ cᵢ xⁱ, by Horner's rule."""
    value = jnp.zeros_like(at)
    for coefficient in reversed(coefficients):
        value = value * at + coefficient
    return value


def turning_point(coefficients: Sequence[float] | Float[np.ndarray, " coefficients"]) -> float:
    """Angle from the axis (rad) at which a Kannala-Brandt image stops to grow; or infinity."""
    # Slope 1 + 3 k₁ θ² + 5 k₂ θ⁴ + …, over its highest power: a polynomial in θ⁻² that always
    # begins with 1.
    slope = [1.0, *((2 * i + 3) * k for i, k in enumerate(coefficients))]
    roots = np.roots(slope)
    # The two parts of a double root come out as a complex pair, apart by the root of rounding.
    real = roots.real[(np.abs(roots.imag) <= 1e-6 * np.abs(roots)) & (roots.real > 0)]
    return float(real.max() ** -0.5) if real.size else math.inf


CLASSICAL: dict[str, Projection] = {
    "pinhole": Pinhole(),
    "equidistant": Equidistant(),
    "equisolid": Equisolid(),
    "stereographic": Stereographic(),
    "orthographic": Orthographic(),
}
"""The projections without coefficients, by their names in files."""


def shift_pupil(
    coefficients: Float[Array, "2"], angle: Float[Array, "*batch"]
) -> Float[Array, "*batch"]:
    """How far forward the entrance pupil is for rays at an angle (rad) from the axis, mm.

    Args:
        coefficients: e₂ and e₄ of e₂ θ² + e₄ θ⁴, mm.
        angle: θ.
    """
    square = angle * angle
    return square * (coefficients[0] + square * coefficients[1])


class Sensor(eqx.Module):
    """A sensor behind a lens, as both are sold; every dimension is an array leaf.

    Attributes:
        size: length of the image line, and of the sensor across it, mm.
        aspect: pixels across the section over those along it.
        focal_length: of the lens, mm: of how high a ray is imaged, whatever is seen of the field.
        image_circle: diameter of what the lens images, mm; ``None`` if it holds the sensor.
    """

    size: Float[Array, "2"] = eqx.field(converter=as_float)
    aspect: Float[Array, ""] = eqx.field(converter=as_float)
    focal_length: Float[Array, ""] = eqx.field(converter=as_float)
    image_circle: Float[Array, ""] | None = eqx.field(default=None, converter=optional_float)


class Camera(eqx.Module):
    """A camera in the section; every dimension is an array leaf.

    Attributes:
        position: of the pinhole (entrance pupil), mm.
        direction: of the optical axis, rad, counter-clockwise from +x.
        field_of_view: from limit to limit of what is seen, rad; up to 2π, below π for a `Pinhole`
            or an `Orthographic` lens, below 2π for a `Stereographic` one.
        pixels: number of pixels along the image line, which the field of view fills unless there
            is a sensor.
        projection: from angles to heights in the image.
        lens: the lens for questions of focus; ``None`` for a camera that is sharp everywhere.
        sensor: with it the focal length does not follow from the field of view.
        module: the body that moves with the camera and hides what is behind it.
        max_blur: largest blur spot that is accepted, pixels.
        pupil_shift: how the entrance pupil moves forward for a ray at θ (rad) from the axis: mm per
            rad² and per rad⁴, of `pupil_at`; ``None`` for one that stays at ``position``.
        axis_offset: where the optical axis is imaged, from the image's middle towards greater
            columns and along the image line, px; ``None`` in the middle.
    """

    position: Float[Array, "2"] = eqx.field(converter=as_float)
    direction: Float[Array, ""] = eqx.field(converter=as_float)
    field_of_view: Float[Array, ""] = eqx.field(converter=as_float)
    pixels: Float[Array, ""] = eqx.field(converter=as_float)
    projection: Projection
    lens: ThinLens | None = None
    sensor: Sensor | None = None
    module: CameraModule | None = None
    max_blur: Float[Array, ""] | None = eqx.field(default=None, converter=optional_float)
    pupil_shift: Float[Array, "2"] | None = eqx.field(default=None, converter=optional_float)
    axis_offset: Float[Array, "2"] | None = eqx.field(default=None, converter=optional_float)

    @property
    def axis_pixel(self) -> Float[Array, ""]:
        """Where the optical axis is imaged, in pixels from the image's first edge."""
        middle = self.pixels / 2
        return middle if self.axis_offset is None else middle + self.axis_offset[1]

    @property
    def focal_pixels(self) -> Float[Array, ""]:
        """Focal length in pixels; without a sensor the field of view fills the image line."""
        if self.sensor is not None:
            focal, _ = safe_divide(self.pixels * self.sensor.focal_length, self.sensor.size[0])
            return focal
        focal, _ = safe_divide(self.pixels / 2, self.projection.height(self.field_of_view / 2))
        return focal

    @property
    def pixel_size(self) -> Float[Array, ""]:
        """Length of a pixel, mm, from the sensor, or from how far it is behind the lens.

        Raises:
            ValueError: the camera has neither.
        """
        if self.sensor is not None:
            size, _ = safe_divide(self.sensor.size[0], self.pixels)
        elif self.lens is not None:
            size, _ = safe_divide(self.lens.sensor_distance, self.focal_pixels)
        else:
            raise ValueError("a camera with neither sensor nor lens has no size of a pixel")
        return size

    def pupil_at(self, angle: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
        """How far before ``position`` rays at an angle (rad) from the axis pass it, mm.

        Example:
            >>> fisheye = Camera(
            ...     jnp.zeros(2), 0.0, 2.8, 100.0, Equidistant(), pupil_shift=jnp.array([0.4, 0.01])
            ... )
            >>> round(float(fisheye.pupil_at(jnp.deg2rad(80.0))), 3)
            0.818
        """
        if self.pupil_shift is None:
            return jnp.zeros_like(angle)
        return shift_pupil(self.pupil_shift, angle)

    def pixel(self, angle: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
        """Where a ray is imaged, in pixels from the image's first edge.

        Args:
            angle: of the ray from the optical axis, counter-clockwise, rad.
        """
        return self.axis_pixel - self.focal_pixels * self.projection.height(angle)

    def pixels_per_radian(self, angle: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
        """Pixels per rad at an angle (rad) from the optical axis."""
        return self.focal_pixels * self.projection.slope(angle)

    def angle(self, pixel: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
        """The angle from the axis (rad, counter-clockwise) imaged at a pixel; inverts `pixel`."""
        height, _ = safe_divide(self.axis_pixel - pixel, self.focal_pixels)
        return self.projection.angle(height)
