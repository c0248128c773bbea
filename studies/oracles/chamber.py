"""Eqs. 1-3 of paper A in mpmath, written as printed: the reference for errors.

Nothing here shares a line with `optics.chamber.chamber`: image heights are divided and subtracted
as the paper has them, which only many digits make usable. Arguments are named as `Chamber`'s
fields.
"""

from __future__ import annotations

from typing import Any

import mpmath


def image_heights(**chamber: Any) -> tuple[Any, Any, Any]:
    """T_B, T_C and T_D over f − v (Eqs. 1 and 2)."""
    depth_b, depth_c, depth_d = _depths(chamber)
    height = chamber["reference_height"]
    return (
        (height + chamber["offset_b"]) / depth_b,
        (height + _offset_c(chamber)) / depth_c,
        (height - chamber["offset_d"]) / depth_d,
    )


def imaging_ratio(**chamber: Any) -> Any:
    """η = Δd_c / Δd_b (Eq. 3)."""
    image_b, image_c, image_d = image_heights(**chamber)
    return (image_c - image_d) / (image_b - image_c)


def yellow_width(focal_length: Any, image_distance: Any, **chamber: Any) -> Any:
    """Δd_c in mm."""
    _, image_c, image_d = image_heights(**chamber)
    return (focal_length - image_distance) * (image_c - image_d)


def offset_d_from_angle(wall_angle_cd: Any, **chamber: Any) -> Any:
    """Δl_D = c tan θ_CD − Δl_C (Eq. 2 continued)."""
    return chamber["length_cd"] * mpmath.tan(wall_angle_cd) - _offset_c(chamber)


def margin(**chamber: Any) -> Any:
    """Least of depths, lengths, and the pinhole's distance from the line through B and C."""
    depth_b, _, _ = depths = _depths(chamber)
    fall = chamber["offset_b"] - _offset_c(chamber)
    length = chamber["length_bc"]
    # Twice the area of the triangle of pinhole, B and C over its base BC.
    area = length * (chamber["reference_height"] + chamber["offset_b"]) + fall * depth_b
    lengths = (chamber["length_ab"], length, chamber["length_cd"])
    return min(*depths, *lengths, area / mpmath.hypot(length, fall))


def dimension_roots(dimension: str, ratio: Any, sketch: Any, **others: Any) -> list[Any]:
    """Values of a dimension that give ``ratio``: those that can be built first, then by nearness.

    η (T_B − T_C) − (T_C − T_D), times the three depths, is a polynomial of degree 2 at most in
    every dimension but the wall angle; three of its values give it.
    """

    def equation(value: Any) -> Any:
        chamber = {**others, dimension: value}
        image_b, image_c, image_d = image_heights(**chamber)
        left_over = ratio * (image_b - image_c) - (image_c - image_d)
        return left_over * mpmath.fprod(_depths(chamber))

    at_0, at_1, at_2 = (equation(mpmath.mpf(x)) for x in (0, 1, 2))
    square = (at_2 - 2 * at_1 + at_0) / 2
    slope = at_1 - at_0 - square
    if abs(square) <= mpmath.mpf(10) ** (8 - mpmath.mp.dps) * (abs(slope) + abs(at_0)):
        roots = [-at_0 / slope]
    else:
        discriminant = slope**2 - 4 * square * at_0
        if discriminant < 0:
            return []
        roots = [(-slope + sign * mpmath.sqrt(discriminant)) / (2 * square) for sign in (1, -1)]

    def preference(root: Any) -> tuple[bool, Any]:
        return bool(margin(**{**others, dimension: root}) <= 0), abs(root - sketch)

    return sorted(roots, key=preference)


def _offset_c(chamber: Any) -> Any:
    return chamber["offset_b"] - chamber["length_bc"] * mpmath.tan(chamber["wall_angle_bc"])


def _depths(chamber: Any) -> tuple[Any, Any, Any]:
    depth_b = chamber["length_ab"] + chamber["pinhole_offset"]
    depth_c = depth_b + chamber["length_bc"]
    return depth_b, depth_c, depth_c + chamber["length_cd"]
