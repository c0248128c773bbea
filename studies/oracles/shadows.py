"""Shadows of edges behind clear layers, in closed form: one ray, Snell's law, the method of images.

The ray that grazes an edge is known before it is bent: it goes straight from the camera, or from
its image in a mirror, through the edge. Behind a black end as high as the layers it begins the
strip that is hidden, as wide as Σ t tan θ, with each layer's thickness t and the angle θ inside it.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence
from typing import NamedTuple


class Shadow(NamedTuple):
    """Where a ray meets a membrane behind layers.

    Attributes:
        along: from the membrane's first end, mm.
        width: from where it enters, mm, either way.
        air: angle from the pad's normal in air, rad.
        inside: the same in the layer on the membrane.
    """

    along: float
    width: float
    air: float
    inside: float


def shadow(
    source: complex, edge: complex, ends: Sequence[complex], layers: Sequence[tuple[float, float]]
) -> Shadow:
    """Of an edge, on a membrane whose layers lie to the left of its direction.

    Args:
        source: the camera, or its image.
        edge: a place in air that the ray goes through; x + iy, mm.
        ends: of the membrane.
        layers: thickness (mm) and index of each, from the camera's side to the membrane; none for
            a bare pad.

    Example:
        >>> found = shadow(10j, -5j, (-20 - 5j, 20 - 5j), [(3.0, 1.49)])
        >>> found.along, found.width
        (20.0, 0.0)
    """
    turn = (ends[1] - ends[0]) / abs(ends[1] - ends[0])
    start, step = (source - ends[0]) / turn, (edge - source) / turn
    sine = step.real / abs(step)
    down = sum(thickness for thickness, _ in layers) - start.imag
    entry = start.real + step.real * down / step.imag
    beyond = sum(t * sine / math.sqrt(n * n - sine * sine) for t, n in layers)
    inside = math.asin(abs(sine) / (layers[-1][1] if layers else 1.0))
    return Shadow(entry + beyond, abs(beyond), math.asin(abs(sine)), inside)


def shadow_width(layers: Sequence[tuple[float, float]], air: float) -> float:
    """Width (mm) of what a black end hides of a ray at an angle (rad) from the normal in air.

    Example:
        >>> round(shadow_width([(3.0, 1.41)], math.radians(70)), 2)
        2.68
    """
    return sum(t * math.tan(math.asin(math.sin(air) / n)) for t, n in layers)


def image(place: complex, ends: Sequence[complex]) -> complex:
    """The image of a place in a straight mirror.

    Example:
        >>> image(1 + 2j, (0j, 5 + 0j))
        (1-2j)
    """
    turn = cmath.exp(1j * cmath.phase(ends[1] - ends[0]))
    return ends[0] + turn * ((place - ends[0]) / turn).conjugate()
