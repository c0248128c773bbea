"""What a surface is like by its profile: flat, concave, convex, rough (paper A §IV.D, Fig. 14)."""

from __future__ import annotations

import enum
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from perception.chamber.heights import Heights

CUTOFF = 20.0
"""Wavelength between form and roughness, mm."""

CURVED = 1.2
"""Least sagitta of a curved surface, mm."""

CURVED_OVER_ROUGH = 4.0
"""Least ratio of sagitta and roughness: corners of a curved part are rough too, and a rough
surface is not quite level; a parabola's share of waves shorter than `CUTOFF` is below this."""

ROUGH = 0.15
"""Least roughness of a rough surface, mm; about a pixel's height, and several times the scatter of
a height (some 0.03 mm with a good camera)."""

LEAST_HEIGHTS, LEAST_SPAN = 12, 30.0
"""Heights, and mm from the first to the last, below which no kind is given."""


class SurfaceKind(enum.Enum):
    """Kinds of surfaces; the values are what a person reads."""

    FLAT = "The surface is flat."
    CONCAVE = "The surface is concave: its middle is lower than its ends."
    CONVEX = "The surface is convex: its middle is higher than its ends."
    ROUGH = "The surface is rough."
    UNDEFINED = "Too few heights are known to tell what the surface is like."


@dataclass(frozen=True)
class Shape:
    """What distinguishes surfaces.

    Attributes:
        sagitta: of the middle over both ends, by the parabola through the heights, mm; positive
            if convex.
        roughness: root mean square of what is shorter than `CUTOFF`, mm.
    """

    sagitta: float
    roughness: float


def measure_shape(positions: Float[np.ndarray, " frames"], heights: Heights) -> Shape | None:
    """Sagitta and roughness of a profile; None where too few heights are known.

    The profile less its parts longer than `CUTOFF` is rough; the longer parts are those that a
    Gaussian regression filter of second order leaves (after ISO/TS 16610-31, not robust).

    Args:
        positions: along the slide, mm; rising.
        heights: there.

    Example:
        >>> x = np.linspace(0, 60, 61)
        >>> shape = measure_shape(x, Heights(2 * (1 - ((x - 30) / 30) ** 2), np.ones(61, bool)))
        >>> round(shape.sagitta, 3), shape.roughness < 0.05
        (2.0, True)
    """
    x, z = positions[heights.known], heights.mm[heights.known]
    if len(x) < LEAST_HEIGHTS or np.ptp(x) < LEAST_SPAN:
        return None
    place = (x - (x[0] + x[-1]) / 2) / (np.ptp(x) / 2)
    sagitta = -float(np.polyfit(place, z, 2)[0])
    off = (x[None, :] - x[:, None]) / CUTOFF
    root = np.exp(-np.pi / 2 * (off / 0.7309) ** 2)  # of the filter's weight
    powers = root[..., None] * off[..., None] ** np.arange(3)
    form = (np.linalg.pinv(powers) @ (root * z)[..., None])[:, 0, 0]
    return Shape(sagitta, float(np.sqrt(np.mean((z - form) ** 2))))


def classify_surface(found: Shape | None) -> SurfaceKind:
    """The kind of a surface by its shape: first whether it is curved, then whether it is rough.

    A tilt does not count.

    Example:
        >>> classify_surface(Shape(sagitta=3.0, roughness=0.05)).name
        'CONVEX'
    """
    if found is None:
        return SurfaceKind.UNDEFINED
    if abs(found.sagitta) >= max(CURVED, CURVED_OVER_ROUGH * found.roughness):
        return SurfaceKind.CONVEX if found.sagitta > 0 else SurfaceKind.CONCAVE
    return SurfaceKind.ROUGH if found.roughness >= ROUGH else SurfaceKind.FLAT
