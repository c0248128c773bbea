"""Clear layers on the pads of a finger: paper B's silicone on acrylic (§3.3.2), the same on all.

How far their ends may reach beyond the membrane follows from the body. At a joint neighbours'
layers are each other's mirror image about the plane that halves it, so a place o beyond the
membrane's end and z above it stays ``pad_clearance`` from the neighbour's while

    (g − o) cos r/2 − (h + p − z) sin r/2 ≥ c / 2    for every flexion r of the joint.

The left side is concave in r, or falls, so it is least at one end of the range. With the gap g of
`finger_parts.Body.gaps` that makes o ≤ z tan r/2 at the greatest flexion, the plane that halves the
joint, and o ≤ g − c / 2 in the straight finger. Reaches are shares of what these allow: whatever
they are, nothing meets.
"""

from __future__ import annotations

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from designopt.numerics import as_float
from optics.scene.layers import CHANNELS, EndKind, LayerKinds, Layers

ACRYLIC, SILICONE = 1.49, 1.41
"""Indices of refraction."""

LEAST_TRANSMISSION = 0.3
"""Part of the light that must come through all surfaces for a ray to count, as in scene files."""

WALL = 0.5
"""Of the end wall that holds the outer ends of layers, mm: an assumption of this project."""

Number = Float[Array, "*batch"]


class Room(NamedTuple):
    """What the body leaves free for layers.

    Attributes:
        gaps: from PIP and DIP axis to the membranes beside it, mm.
        flexions: greatest flexion of PIP and DIP, rad.
        clearance: least one of neighbouring pads, mm.
        rim: from a membrane's outer end to the end of the finger, mm.
    """

    gaps: tuple[Number, Number]
    flexions: tuple[Number, Number]
    clearance: Number
    rim: Number


class PadLayers(eqx.Module):
    """Clear layers between camera and membrane, the outermost first.

    Attributes:
        thickness: mm.
        index: of refraction.
        reach: how far the lower and the upper edge of a layer's ends stand beyond the membrane at
            the joints, as a share (0 to 1) of what the neighbour leaves free there. All 1 is a
            bevel along the plane that halves the joint.
        outer_reach: the same at the outer ends of the finger, where the rim less ``wall`` is free.
        wall: of the rim, what stays free of layers, mm.
        transmission: least part of the light that must come through for a ray to count.
        ends: what the layers' end faces are.
    """

    thickness: Float[Array, "*batch layers"] = eqx.field(converter=as_float)
    index: Float[Array, "*batch layers"] = eqx.field(converter=as_float)
    reach: Float[Array, "*batch layers 2"] = eqx.field(converter=as_float)
    outer_reach: Float[Array, "*batch layers 2"] = eqx.field(converter=as_float)
    wall: Number = eqx.field(default=WALL, converter=as_float)
    transmission: Number = eqx.field(default=LEAST_TRANSMISSION, converter=as_float)
    ends: EndKind = eqx.field(default="black", static=True)

    @property
    def levels(self) -> Float[Array, "layers 2"]:
        """Heights of the lower and the upper side of every layer above the membrane, mm."""
        upper = jnp.cumsum(self.thickness[::-1])[::-1]
        return jnp.stack([upper - self.thickness, upper], axis=-1)

    def kinds(self, pads: int) -> tuple[tuple[LayerKinds, ...], ...]:
        """What the faces of the layers on so many pads are."""
        return ((LayerKinds(self.ends, self.ends, "black"),) * self.thickness.shape[-1],) * pads

    def reaches(self, room: Room) -> Float[Array, "3 layers 2 2"]:
        """How far the ends of layers stand beyond the membranes, mm.

        Returns:
            Of every pad and layer at the pad's first and second end, and there of the lower and the
            upper edge.
        """
        pip, dip = (
            self.reach * free_reach(room, self.levels, gap, end)
            for gap, end in zip(room.gaps, room.flexions, strict=True)
        )
        outer = self.outer_reach * jnp.maximum(room.rim - self.wall, 0.0)
        ends = (outer, pip), (pip, dip), (dip, outer)
        return jnp.stack([jnp.stack(both, axis=1) for both in ends])

    def on_pads(self, room: Room) -> Layers:
        """The layers of a scene, on the pads of the proximal, intermediate and distal phalanx."""
        lower, upper = jnp.moveaxis(self.reaches(room), -1, 0)
        pads, count = lower.shape[:2]
        thickness = jnp.broadcast_to(self.thickness, (pads, count))
        nothing = jnp.zeros((pads, 2), thickness.dtype)
        return Layers(
            thickness=thickness,
            index=jnp.broadcast_to(self.index[:, None], (pads, count, len(CHANNELS))),
            overhang=lower,
            bevel=jnp.arctan2(lower - upper, thickness[..., None]),
            lip=nothing,
            height=nothing[:, 0],
            transmission=jnp.broadcast_to(self.transmission, (pads,)),
        )


def free_reach(
    room: Room, level: Float[Array, "*levels"], gap: Number, flexion: Number
) -> Float[Array, "*levels"]:
    """How far a layer may stand beyond a membrane at a joint, mm.

    Args:
        room: has the least clearance.
        level: height above the membrane, mm.
        gap: from the joint's axis to the membrane, mm.
        flexion: greatest flexion of the joint, rad.
    """
    straight = gap - room.clearance / 2
    return jnp.minimum(level * jnp.tan(flexion / 2), jnp.maximum(straight, 0.0))
