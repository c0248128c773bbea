"""The centre line of a finger bent with constant curvature, in the plane in which it bends."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

SMALL = 0.1
"""Angle below which four terms of the series of sin(x)/x are exact to rounding."""


class CenterLine(eqx.Module):
    """Places along a bent centre line.

    Attributes:
        across: towards the side to which a positive bend goes, mm.
        along: in the direction in which the line starts, mm.
        turned: angle by which the line has turned there, in radians.
    """

    across: Float[Array, "*places"]
    along: Float[Array, "*places"]
    turned: Float[Array, "*places"]


def bend_center_line(
    arc: Float[Array, "*places"], bend: Float[Array, ""], length: Float[Array, ""]
) -> CenterLine:
    """The centre line at some arc lengths.

    An arc of a circle, x = (1 − cos κs)/κ and z = sin(κs)/κ with κ = bend/length, written so that
    it holds at no bend too, where it is a straight line (constant curvature; R. J. Webster and
    B. A. Jones, Int. J. Robotics Research 29 (2010) 1661, Eq. 1).

    Args:
        arc: s, from where the finger starts, mm.
        bend: angle between both ends of the finger, in radians.
        length: of the finger, mm.

    Example:
        >>> line = bend_center_line(
        ...     jnp.array([0.0, 100.0]), jnp.array(jnp.pi / 2), jnp.array(100.0)
        ... )
        >>> [round(v, 2) for v in line.across.tolist()]  # a quarter of a circle of radius 200/π
        [0.0, 63.66]
    """
    turned = bend / length * arc
    return CenterLine(
        across=arc * turned / 2 * _sinc(turned / 2) ** 2, along=arc * _sinc(turned), turned=turned
    )


def _sinc(angle: Float[Array, "*places"]) -> Float[Array, "*places"]:
    """sin(x)/x, whose derivative is good near 0 too: that of `jnp.sinc` cancels there."""
    square = jnp.minimum(angle**2, SMALL**2)
    series = 1 - square / 6 * (1 - square / 20 * (1 - square / 42 * (1 - square / 72)))
    small = jnp.abs(angle) < SMALL
    large = jnp.where(small, SMALL, angle)
    return jnp.where(small, series, jnp.sin(large) / large)
