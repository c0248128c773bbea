"""Clear layers over pads: plates of acrylic and silicone between the camera and the membrane.

A layered pad is a body. Its membrane is the pad's segment; the layers lie on it, towards the
sensing side, each with two end faces that may overhang the membrane and be cut at a bevel; a bezel
may hold the outermost one. Along the pad places are counted from its first end, heights from the
membrane.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from designopt.numerics import as_float, safe_divide
from designopt.vectors import Vector

EndKind = Literal["black", "clear", "painted", "lamp"]

CHANNELS = ("red", "green", "blue")
"""Colors for which a layer has an index of refraction, in their order."""

GREEN = CHANNELS.index("green")


class LayerKinds(NamedTuple):
    """What the faces of a layer are: at the pad's first end, at its second, and beside it."""

    first: EndKind
    second: EndKind
    beside: EndKind


class BodyFace(NamedTuple):
    """A face of a layered pad's body other than its outermost surface.

    Attributes:
        pad: index of the pad.
        part: an end face of a layer, the upper side of a layer under another, or the outer or
            inner side of the bezel.
        layer: index of the layer; of a bezel that of the outermost one.
        end: 0 at the pad's first end, 1 at its second; 0 of an upper side.
        kind: of an end face; the others are black.
        name: for messages.
    """

    pad: int
    part: Literal["end", "top", "rim", "lip"]
    layer: int
    end: int
    kind: EndKind
    name: str


def body_faces(pad: int, kinds: tuple[LayerKinds, ...], bezel: bool) -> list[BodyFace]:
    """Faces of the body of a pad, by index, with layers of given kinds."""
    faces = []
    for layer, of_layer in enumerate(kinds):
        for end, at in enumerate(("from", "to")):
            name = f"layer {layer + 1} at '{at}'"
            faces.append(BodyFace(pad, "end", layer, end, of_layer[end], name))
        if layer > 0:
            faces.append(
                BodyFace(pad, "top", layer, 0, "black", f"upper side of layer {layer + 1}")
            )
    if bezel:
        for end, at in enumerate(("from", "to")):
            faces += [
                BodyFace(pad, "rim", 0, end, "black", f"outer side of the bezel at '{at}'"),
                BodyFace(pad, "lip", 0, end, "black", f"bezel at '{at}'"),
            ]
    return faces


class Layers(eqx.Module):
    """The layers of all pads, the outermost first.

    A pad with fewer layers than another has entries here that are none of its; see `own`.

    Attributes:
        thickness: mm.
        index: of refraction, for each of `CHANNELS`.
        overhang: by how much a layer's membrane side is longer than the membrane at either end, mm.
        bevel: angles by which its ends are cut back towards the camera, rad.
        lip: how far the bezel covers the outermost layer from its two ends, mm.
        height: of the bezel over the outermost layer, mm.
        transmission: least part of the light that must come through all surfaces (Fresnel,
            unpolarised) for a ray to count.
    """

    thickness: Float[Array, "pads layers"] = eqx.field(converter=as_float)
    index: Float[Array, "pads layers 3"] = eqx.field(converter=as_float)
    overhang: Float[Array, "pads layers 2"] = eqx.field(converter=as_float)
    bevel: Float[Array, "pads layers 2"] = eqx.field(converter=as_float)
    lip: Float[Array, "pads 2"] = eqx.field(converter=as_float)
    height: Float[Array, " pads"] = eqx.field(converter=as_float)
    transmission: Float[Array, " pads"] = eqx.field(converter=as_float)

    @property
    def green(self) -> Float[Array, "pads layers"]:
        """The index of refraction for green light, by which views are found."""
        return self.index[..., GREEN]

    def own(self, kinds: tuple[tuple[LayerKinds, ...], ...], bezels: tuple[bool, ...]) -> Layers:
        """The same with nothing in the place of layers and bezels that pads do not have.

        A layer that is not there has no thickness and the index of the pad's last layer, 1 if there
        is none. So neither values nor derivatives depend on its entries.

        Args:
            kinds: of the layers of every pad.
            bezels: which pads have one.
        """
        count, pads = np.array([len(of_pad) for of_pad in kinds]), np.arange(len(kinds))
        layer = np.arange(self.thickness.shape[1])
        there, layered, held = layer < count[:, None], count > 0, np.array(bezels)
        if there.all() and held.all():
            return self
        last = np.minimum(layer, np.maximum(count - 1, 0)[:, None])
        index = self.index[pads[:, None], last]
        return Layers(
            thickness=jnp.where(there, self.thickness, 0.0),
            index=jnp.where(layered[:, None, None], index, 1.0),
            overhang=jnp.where(there[..., None], self.overhang, 0.0),
            bevel=jnp.where(there[..., None], self.bevel, 0.0),
            lip=jnp.where(held[:, None], self.lip, 0.0),
            height=jnp.where(held, self.height, 0.0),
            transmission=jnp.where(layered, self.transmission, 0.0),
        )


class MirrorLayers(eqx.Module):
    """Clear layers on flat mirrors, the outermost first.

    A mirror with fewer layers than another has entries here that are none of its; see `own`.

    Attributes:
        thickness: mm, or units of a placed scene.
        index: of refraction.
    """

    thickness: Float[Array, "mirrors layers"] = eqx.field(converter=as_float)
    index: Float[Array, "mirrors layers"] = eqx.field(converter=as_float)

    def own(self, counts: tuple[int, ...]) -> MirrorLayers:
        """The same with air of no thickness in the place of layers that mirrors do not have."""
        there = np.arange(self.thickness.shape[1]) < np.array(counts)[:, None]
        thickness, index = jnp.where(there, self.thickness, 0.0), jnp.where(there, self.index, 1.0)
        return MirrorLayers(thickness, index)


class Profile(eqx.Module):
    """The section of the layers of one pad or of several, along the pad and above its membrane, mm.

    Attributes:
        levels: heights of the layers' upper sides, the outermost first, and of the membrane.
        lower: along the pad, both ends of each layer's side towards the membrane.
        upper: the same of its side towards the camera.
        membrane: both ends of the membrane.
    """

    levels: Float[Array, "*pads levels"]
    lower: Float[Array, "*pads layers 2"]
    upper: Float[Array, "*pads layers 2"]
    membrane: Float[Array, "*pads 2"]

    @classmethod
    def of(cls, layers: Layers, length: Float[Array, " pads"]) -> Profile:
        """The profiles of pads of given lengths, mm."""
        below = jnp.cumsum(layers.thickness[:, ::-1], axis=1)[:, ::-1]
        levels = jnp.concatenate([below, jnp.zeros_like(below[:, :1])], axis=1)
        outward = jnp.array([[[-1.0, 1.0]]], levels.dtype)
        membrane = jnp.stack([jnp.zeros_like(length), length], axis=-1)
        lower = membrane[:, None] + outward * layers.overhang
        upper = lower - outward * layers.thickness[..., None] * jnp.tan(layers.bevel)
        return cls(levels, lower, upper, membrane)

    def face(self) -> Float[Array, "*pads 2"]:
        """Both ends of the outermost surface."""
        return self.upper[..., 0, :]

    def windows(self) -> Float[Array, "*pads layers 2"]:
        """What rays may pass at the lower side of each layer: what both layers there share.

        At the last one that is the membrane.
        """
        below = jnp.concatenate([self.upper[..., 1:, :], self.membrane[..., None, :]], axis=-2)
        first = jnp.maximum(self.lower[..., 0], below[..., 0])
        return jnp.stack([first, jnp.minimum(self.lower[..., 1], below[..., 1])], axis=-1)


def along_and_normal(ends: Vector, side: Float[Array, " pads"]) -> tuple[Vector, Vector, Array]:
    """Unit vectors along pads and towards their sensing sides, and their lengths."""
    step = ends[..., 1] - ends[..., 0]
    length = step.length()
    along = step.scaled(safe_divide(jnp.ones_like(length), length)[0])
    return along, along.perpendicular().scaled(side), length


def profile_faces(
    profile: Profile, layers: Layers, bodies: tuple[BodyFace, ...]
) -> Float[Array, "faces 2 2"]:
    """Outermost surfaces of all pads, then faces of their bodies: both ends along and above."""
    top = profile.levels[:, :1]
    outermost = jnp.stack([profile.face(), jnp.repeat(top, 2, axis=1)], axis=-1)

    pad, layer, end = np.array([(face.pad, face.layer, face.end) for face in bodies]).T
    parts = np.array([face.part for face in bodies])
    is_end, is_top = parts == "end", parts == "top"
    upper, level = profile.upper[pad, layer, end], profile.levels[pad, layer]
    turned = jnp.asarray((1 - 2 * end) * (parts == "lip"), upper.dtype)
    inward = layers.lip[pad, end] * turned
    first = jnp.where(is_end, profile.lower[pad, layer, end], upper)
    last = jnp.where(is_top, profile.upper[pad, layer, 1], upper)
    below = jnp.where(is_end, profile.levels[pad, layer + 1], level)
    raised = level + jnp.where(is_end | is_top, 0.0, layers.height[pad])
    ends = [jnp.stack([first + inward, last + inward], -1), jnp.stack([below, raised], -1)]
    return jnp.concatenate([outermost, jnp.stack(ends, axis=-1)])
