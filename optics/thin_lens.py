"""A real thin lens in front of a fixed sensor: focus, magnification, blur and depth of field.

Everything is written in vergences (reciprocal distances, 1/mm), in which Gauss's lens equation
1/u + 1/v = 1/f is linear: nothing is singular for an object at infinity, in the focal plane or in
focus. Source: E. Hecht, *Optics*, 5th ed., §5.2.3 (lens equation, magnification); S. F. Ray,
*Applied Photographic Optics*, 3rd ed., ch. 22 (depth of field, hyperfocal distance).

Paper A's Eq. 1 is a pinhole relation with image distance f − v. Its v < f would make a thin lens
form a virtual image; this module is the physical model to set beside it.
"""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from designopt.numerics import as_float, safe_divide
from designopt.solution import Solution


class LensResult(eqx.Enumeration):
    """What can be wrong with an object in front of a lens."""

    successful = ""
    behind_lens = "The object lies in or behind the lens: its distance must be positive."


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
    """

    focal_length: Float[Array, ""] = eqx.field(converter=as_float)
    aperture: Float[Array, ""] = eqx.field(converter=as_float)
    sensor_distance: Float[Array, ""] = eqx.field(converter=as_float)

    def image(self, distance: ArrayLike) -> Solution[LensImage]:
        """The image of a point at ``distance`` u (mm, infinity allowed; `jax.vmap` it for several).

        ``margin`` is the distance itself. ``residual`` is 0: the lens equation is explicit in
        vergences.
        """
        distance = as_float(distance)
        object_vergence, _ = safe_divide(jnp.ones_like(distance), distance)
        vergence = 1 / self.focal_length - object_vergence
        blur = self.aperture * jnp.abs(self.sensor_distance * vergence - 1)
        image = LensImage(vergence, -self.sensor_distance * object_vergence, blur)
        result = LensResult.where(distance > 0, LensResult.successful, LensResult.behind_lens)
        return Solution(image, distance, jnp.zeros_like(distance), result)

    @property
    def focus_vergence(self) -> Float[Array, ""]:
        """1/u in 1/mm of the distance in focus; 0 is infinity, negative only a virtual object."""
        return 1 / self.focal_length - 1 / self.sensor_distance

    def depth_of_field(self, blur_diameter: ArrayLike) -> Float[Array, 2]:
        """Vergences 1/u (1/mm) of the near and far limit within which the blur stays small.

        Args:
            blur_diameter: largest accepted spot on the sensor (circle of confusion), mm.

        Returns:
            Near and far limit, symmetric about `focus_vergence`; a far limit of 0 or less means
            that everything to infinity is sharp, a near limit of 0 or less that nothing real is.
        """
        half = as_float(blur_diameter) / (self.aperture * self.sensor_distance)
        return jnp.stack([self.focus_vergence + half, self.focus_vergence - half])

    def hyperfocal_distance(self, blur_diameter: ArrayLike) -> Float[Array, ""]:
        """H = f D / c + f in mm: focused there, the lens is sharp from H/2 to infinity."""
        return self.focal_length * self.aperture / as_float(blur_diameter) + self.focal_length
