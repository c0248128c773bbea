"""How far the image moves when the finger bends: what a chamber is designed for."""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from designopt.numerics import as_float
from designopt.solution import Solution, combine_checks
from optics.chamber.chamber import Chamber, ChamberResult
from optics.chamber.endoscope import Endoscope
from optics.chamber.rings import Rings, find_spans


def find_extreme_points(
    chamber: Chamber, endoscope: Endoscope, bend: ArrayLike, direction: ArrayLike
) -> Solution[Float[Array, "3 2"]]:
    """Where blue, yellow and the top end in the image on the side to which the finger bends.

    Args:
        chamber: of the straight finger, not pressed.
        endoscope: its camera.
        bend: in radians; the points are those of the other side where it is negative.
        direction: to which side it bends, in the image: 0 is right, a right angle is down.

    Returns:
        Points of the outer outlines of blue, of yellow and of the top, px; where a nearer wall
        hides a ring's own end, its edge. ``margin`` is the least width that is seen of the three
        in the plane of bending, a difference of tangents.

    Example:
        >>> chamber = Chamber(40, 30, 30, 4.1, 2.0, 0.035, 2.5, 4.0, 3.5, 8.6, 0.84)
        >>> found = jax.jit(find_extreme_points)(chamber, Endoscope(jnp.pi / 2), 0.0, 0.0)
        >>> [round(row, 2) for row in found.value[:, 1].tolist()]  # all in the image's middle row
        [239.5, 239.5, 239.5]
    """
    rings = Rings.of(chamber)
    bend = as_float(bend).astype(rings.arc.dtype)
    direction = as_float(direction).astype(rings.arc.dtype)
    seen = find_spans(rings, bend, jnp.zeros_like(rings.arc))
    ends = jnp.asarray(rings.ends)
    side = jnp.stack([jnp.cos(direction), jnp.sin(direction)])
    points = endoscope.image(seen.seen_high[ends][:, None] * side[None])
    # What does not lie in front of the camera, or has no radius, has no width either.
    margin, result = combine_checks(
        ChamberResult.successful, (jnp.min(seen.width[ends]), ChamberResult.hidden)
    )
    return Solution(points, margin, jnp.zeros_like(margin), result)


def solve_image_rates(
    chamber: Chamber, endoscope: Endoscope, direction: ArrayLike
) -> Solution[Float[Array, "3"]]:
    """Px per radian of bend by which blue's, yellow's and the top's outline starts to move.

    The derivative, for the straight finger, of `find_extreme_points` along the direction of
    bending. Of a ring of radius r at s that no nearer wall hides, it is

        f (s²/2 + r² s/(s + δ)) / ((s + δ) L) (1 + 3 k1 r²/(s + δ)²)

    with f the focal length in px; the first part is the ring's way sideways, the second its turn
    towards the camera, the last the lens. ``margin`` is that of `find_extreme_points`.

    Example:
        >>> chamber = Chamber(40, 30, 30, 4.1, 2.0, 0.035, 2.5, 4.0, 3.5, 8.6, 0.84)
        >>> rates = jax.jit(solve_image_rates)(chamber, Endoscope(jnp.pi / 2), 0.0).value
        >>> bool((rates > 0).all())
        True
    """
    angle = as_float(direction).astype(chamber.length_ab.dtype)
    side = jnp.stack([jnp.cos(angle), jnp.sin(angle)])

    def along(bend: Float[Array, ""]) -> tuple[Float[Array, "3"], Solution[Float[Array, "3 2"]]]:
        points = find_extreme_points(chamber, endoscope, bend, angle)
        return points.value @ side, points

    rates, points = jax.jacfwd(along, has_aux=True)(jnp.zeros_like(angle))
    return Solution(rates, points.margin, points.residual, points.result)
