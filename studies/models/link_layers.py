"""Widths and layers of the linkage's links as arrays, and which parts can meet."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from designopt import as_float
from studies.models.linkage_kinds import LinkageKind, kind_of_layers
from studies.models.links import OUTLINES, LinksTable

Number = Float[Array, "*batch"]


class Links(eqx.Module):
    """Widths and layers of a linkage's links.

    Attributes:
        bar_width: of the bars, whose ends are round about their pins, mm.
        pin_diameter: of the links' pins, mm.
        axle_diameter: of the PIP and DIP axles, mm.
        shell: thickness of the faces and end walls of the phalanges, mm.
        play: between neighbouring layers, mm.
        bar_strength: yield strength of the bars, N/mm² (6061-T6: 276, ASM Handbook vol. 2, 1990).
        pin_strength: of pins and axles, N/mm² (stainless steel A2-70: 450, ISO 3506-1).
        thickness: of the layers from the middle outwards, mm.
        layers: names of the parts in each layer.
    """

    bar_width: Number = eqx.field(converter=as_float)
    pin_diameter: Number = eqx.field(converter=as_float)
    axle_diameter: Number = eqx.field(converter=as_float)
    shell: Number = eqx.field(converter=as_float)
    play: Number = eqx.field(converter=as_float)
    bar_strength: Number = eqx.field(converter=as_float)
    pin_strength: Number = eqx.field(converter=as_float)
    thickness: Float[Array, "*batch layers"] = eqx.field(converter=as_float)
    layers: tuple[tuple[str, ...], ...] = eqx.field(static=True)

    @classmethod
    def of(cls, table: LinksTable) -> Links:
        """Those of a file or of settings."""
        numbers = table.model_dump(exclude={"layers", "thickness"})
        layers = tuple(map(tuple, table.layers))
        return cls(**numbers, thickness=jnp.asarray(table.thickness), layers=layers)

    @property
    def edges(self) -> Float[Array, "*batch layers 2"]:
        """Inner and outer side of every layer, from the middle of the finger, mm."""
        outer = jnp.cumulative_sum(self.thickness + self.play, axis=-1) - self.play
        return jnp.stack([outer - self.thickness, outer], axis=-1)

    @property
    def width(self) -> Number:
        """Width of the finger that they need, mm."""
        return 2 * self.edges[..., -1, 1]

    @property
    def kind(self) -> LinkageKind:
        """The kind of linkage whose parts lie in the layers."""
        return kind_of_layers(self.layers)

    def layer_of(self, part: str) -> int:
        """The layer of a part."""
        return next(i for i, parts in enumerate(self.layers) if part in parts)


class Meeting(NamedTuple):
    """Two parts that lie in one layer, or a bar and what crosses its layer: an axle, a palmar face.

    Attributes:
        first: a bar.
        second: a bar, the name of a pin, or the phalanx whose palmar face it is.
    """

    first: str
    second: str


def find_meetings(links: Links, joined: Mapping[str, Sequence[str]]) -> list[Meeting]:
    """Which parts can meet: those in one layer that share no pin.

    Args:
        links: with its layers.
        joined: the bodies that every pin joins, by its name.

    Example:
        >>> links = Links.of(LinksTable())
        >>> pins = {"E": ("crank", "rod"), "H": ("bar", "plate"), "A": ("proximal", "intermediate")}
        >>> [tuple(pair) for pair in find_meetings(links, pins)][:4]
        [('crank', 'plate'), ('rod', 'bar'), ('crank', 'A'), ('rod', 'A')]
    """
    present = [bar for bar in OUTLINES if any(bar in bodies for bodies in joined.values())]
    found = [
        Meeting(one, other)
        for one, other in combinations(present, 2)
        if links.layer_of(one) == links.layer_of(other)
    ]
    for pin, bodies in joined.items():
        own = [links.layer_of(body) for body in bodies]
        crossed = set(range(min(own), max(own))) - set(own)
        found += [Meeting(bar, pin) for bar in present if links.layer_of(bar) in crossed]
    return found
