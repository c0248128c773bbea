"""A real thin lens in front of a fixed sensor: focus, magnification, blur and depth of field.

Everything is written in vergences (reciprocal distances, 1/mm), in which Gauss's lens equation
1/u + 1/v = 1/f is linear: nothing is singular for an object at infinity, in the focal plane or in
focus. Source: E. Hecht, *Optics*, 5th ed., §5.2.3 (lens equation, magnification); S. F. Ray,
*Applied Photographic Optics*, 3rd ed., ch. 22 (depth of field, hyperfocal distance).

Paper A's Eq. 1 is a pinhole relation with image distance f − v. Its v < f would make a thin lens
form a virtual image; this module is the physical model to set beside it.
"""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from designopt.numerics import as_float, optional_float, safe_divide
from designopt.solution import Solution, combine_checks


class LensResult(eqx.Enumeration):
    """What can be wrong with a lens or with an object in front of it."""

    successful = ""
    behind_lens = "The object lies in or behind the lens: its distance must be positive."
    no_lens = "The lens does not gather light: its focal length must be positive."
    no_sensor = "The sensor lies in or before the lens: its distance must be positive."
    no_aperture = "The lens lets no light through: its aperture must be positive."
    no_blur = "No blur is accepted, so nothing is sharp: the accepted spot must be positive."
    out_of_range = "A reciprocal does not fit this float type: use float64 or rescale the lengths."


class LensImage(eqx.Module):
    """What a lens makes of an object point, and what the sensor shows of it.

    Attributes:
        vergence: 1/v' in 1/mm of the sharp image's distance v' behind the lens: 0 where the
            image is at infinity (object in the focal plane), negative where it is virtual.
        magnification: −v/u, image size over object size on the sensor along the chief ray;
            equal to −v'/u for an object in focus.
        blur_diameter: diameter in mm of the spot on the sensor; its derivative is taken as 0 at
            perfect focus, where it has a kink.
    """

    vergence: Float[Array, ""]
    magnification: Float[Array, ""]
    blur_diameter: Float[Array, ""]


class ThinLens(eqx.Module):
    """A thin lens with a sensor. Lengths in mm; every field is an array leaf.

    Attributes:
        focal_length: f.
        aperture: diameter of the opening (f over the f-number).
        sensor_distance: v, distance of the sensor behind the lens.
        nearest_focus: nearest distance at which it can be focused; ``None`` if it is not known.
    """

    focal_length: Float[Array, ""] = eqx.field(converter=as_float)
    aperture: Float[Array, ""] = eqx.field(converter=as_float)
    sensor_distance: Float[Array, ""] = eqx.field(converter=as_float)
    nearest_focus: Float[Array, ""] | None = eqx.field(default=None, converter=optional_float)

    def image(self, distance: ArrayLike) -> Solution[LensImage]:
        """The image of a point at ``distance`` u (mm, infinity allowed; `jax.vmap` it for several).

        ``margin`` (mm) is the smaller of u and f. ``residual`` is 0: the lens equation is
        explicit in vergences.
        """
        distance = as_float(distance)
        object_vergence, distance_fits = safe_divide(jnp.ones_like(distance), distance)
        power, power_fits = safe_divide(jnp.ones_like(self.focal_length), self.focal_length)
        vergence = power - object_vergence
        blur = self.aperture * jnp.abs(self.sensor_distance * vergence - 1)
        image = LensImage(vergence, -self.sensor_distance * object_vergence, blur)
        return _judged(
            image,
            distance_fits & power_fits,
            (distance, LensResult.behind_lens),
            (self.focal_length, LensResult.no_lens),
        )

    def focus_vergence(self) -> Solution[Float[Array, ""]]:
        """1/u in 1/mm of the distance in focus; 0 is infinity, negative only a virtual object.

        ``margin`` (mm) is the smaller of f and v.
        """
        power, power_fits = safe_divide(jnp.ones_like(self.focal_length), self.focal_length)
        sensor, sensor_fits = safe_divide(jnp.ones_like(self.focal_length), self.sensor_distance)
        return _judged(
            power - sensor,
            power_fits & sensor_fits,
            (self.focal_length, LensResult.no_lens),
            (self.sensor_distance, LensResult.no_sensor),
        )

    def depth_of_field(self, blur_diameter: ArrayLike) -> Solution[Float[Array, "2"]]:
        """Vergences 1/u (1/mm) of the near and far limit within which the blur stays small.

        Args:
            blur_diameter: largest accepted spot on the sensor (circle of confusion), mm.

        Returns:
            Near and far limit, symmetric about `focus_vergence`; a far limit of 0 or less means
            that everything to infinity is sharp, a near limit of 0 or less that nothing real is.
            ``margin`` (mm) is the least of f, v and the aperture.
        """
        focus = self.focus_vergence()
        half, fits = safe_divide(as_float(blur_diameter), self.aperture * self.sensor_distance)
        return _judged(
            jnp.stack([focus.value + half, focus.value - half]),
            fits & (focus.result != LensResult.out_of_range),
            (self.focal_length, LensResult.no_lens),
            (self.sensor_distance, LensResult.no_sensor),
            (self.aperture, LensResult.no_aperture),
        )

    def hyperfocal_distance(self, blur_diameter: ArrayLike) -> Solution[Float[Array, ""]]:
        """H = f D / c + f in mm: focused there, the lens is sharp from H/2 to infinity.

        ``margin`` (mm) is the smaller of f and the accepted blur c.
        """
        blur_diameter = as_float(blur_diameter)
        beyond, fits = safe_divide(self.focal_length * self.aperture, blur_diameter)
        return _judged(
            beyond + self.focal_length,
            fits,
            (self.focal_length, LensResult.no_lens),
            (blur_diameter, LensResult.no_blur),
        )


def _judged(value: Any, fits: Any, *checks: tuple[Float[Array, ""], LensResult]) -> Solution[Any]:
    margin, result = combine_checks(LensResult.successful, *checks)
    result = LensResult.where((margin > 0) & ~fits, LensResult.out_of_range, result)
    return Solution(value, margin, jnp.zeros_like(margin), result)
