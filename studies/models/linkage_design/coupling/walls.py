"""Walls of the outer phalanges beside the pads: they lie in one layer and reach past their joints.

Each reaches around its axle and its pin of the coupling bar, to the end of its pad at the joint,
and above the axle to the back. The convex hulls of these are apart by the widest strip that fits
between them (separating axis theorem). This is judged, not searched for: in all but the shortest
intermediate phalanges the walls are far apart.

Source: C. Ericson, *Real-Time Collision Detection* (2005), chapter 5.2.1.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping

import jax.numpy as jnp
from jaxtyping import Array, Float

from designopt.vectors import Vector, rotation
from studies.models.finger import Finger, links_of
from studies.models.finger_parts import Number

WALLS = "walls about P and Q apart"
"""Name of the requirement that they do not meet."""

DIRECTIONS = 180
"""Directions of strips that are tried: what is found is too small by 0.02 % of it at most."""


def find_wall_gap(finger: Finger, places: Mapping[str, Vector]) -> Float[Array, " pip"]:
    """What lies between the walls of the proximal and the distal phalanx, mm; negative: they meet.

    Args:
        finger: coupled, with links.
        places: of O, A, B, T, P and Q over angles of PIP, in one frame.
    """
    links, body = links_of(finger), finger.body
    around = rotation(jnp.linspace(0.0, 2 * jnp.pi, DIRECTIONS, endpoint=False))
    pip, dip = body.gaps

    def reach(ends: str, joint: str, pin: str, gap: Number, across: Vector) -> Array:
        """How far a wall reaches in every direction."""
        start, end = (places[name] for name in ends)
        line, at = end - start, places[joint]
        ahead = line.scaled(1 / line.length())
        discs = [
            (at, links.axle_diameter / 2 + links.shell),
            (places[pin], links.pin_diameter / 2 + links.shell),
        ]
        for x, y in ((gap, body.palmar), (0 * gap, body.dorsal - links.shell)):
            discs.append((at + ahead.scaled(x) + ahead.perpendicular().scaled(y), 0 * gap))
        outer = jnp.multiply.outer
        found = [outer(at.x, across.x) + outer(at.y, across.y) + radius for at, radius in discs]
        return functools.reduce(jnp.maximum, found)

    first = reach("OA", "A", "P", -pip, around)
    second = reach("BT", "B", "Q", dip, -around)
    return jnp.max(-first - second, axis=-1)
