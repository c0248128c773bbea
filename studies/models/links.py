"""What the linkage is made of: bars and pins with width, and the layers in which they lie.

The links lie at both sides of the finger, the same at either: the layers are counted from the
middle of the finger outwards, and parts of different layers pass each other. A pin joins two bodies
and crosses the layers between these; where it does, bars of those layers keep away from it. Axles
are stubs at either side, for the camera looks between them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Annotated, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float
from pydantic import Field, model_validator

from designopt import as_float
from designopt.io.spec import Spec
from designopt.study.settings import setting

Number = Float[Array, "*batch"]

OUTLINES = {
    "crank": "FEK",
    "rod": "ED",
    "plate": "CDH",
    "bar": "GH",
    "driver": "MN",
    "coupler": "NK",
}
"""Pins at the corners of every moving link; driver and coupler are those of the motor's
parallelogram, without which there is no K. H is paper B's G'."""

BARS = tuple(OUTLINES)

WALLS = ("proximal", "intermediate", "distal")
"""The phalanges' side walls, which carry the axles."""

AXLES = ("A", "B")
"""Pins that join two walls."""

LAYERS = (
    ("pads", "mirrors", "camera"),
    ("proximal", "distal", "LED strips"),
    ("crank", "plate", "driver"),
    ("rod", "bar", "coupler"),
    ("intermediate",),
)
"""From the middle outwards. It is the only order in which all pins but the axles join neighbouring
layers, for the bars need two layers (plate and rod share a pin) and plate and crank hang on the
walls of the outer phalanges, the bar on that of the intermediate one; but for turning it inside
out."""

THICKNESS = (12.0, 1.4, 1.0, 1.0, 1.2)
"""Of these layers, mm: half of the pads' width, LED strips on the acrylic's sides, bars, walls."""

Length = Annotated[float, Field(gt=0, le=1e3)]
Strength = Annotated[float, Field(gt=0, le=1e5)]


class LinksTable(Spec):
    """``[links]`` of a file and of settings; see `Links`."""

    bar_width: Length = setting(4.0, "width of bars; their ends are round (mm)")
    pin_diameter: Length = setting(2.0, "diameter of the links' pins (mm)")
    axle_diameter: Length = setting(4.0, "diameter of the PIP and DIP axles (mm)")
    shell: float = setting(
        0.7, "thickness of faces, end walls and what closes the joints (mm)", ge=0, le=100
    )
    play: float = setting(0.1, "between neighbouring layers (mm)", ge=0, le=10)
    bar_strength: Strength = setting(276.0, "yield strength of bars, 6061-T6 (N/mm²)")
    pin_strength: Strength = setting(450.0, "yield strength of pins and axles, A2-70 (N/mm²)")
    thickness: list[Length] = setting(list(THICKNESS), "of the layers, from the middle (mm)")
    layers: list[list[str]] = setting(
        [list(parts) for parts in LAYERS], "what lies in each of them"
    )

    @model_validator(mode="after")
    def _one_thickness_each(self) -> LinksTable:
        if len(self.thickness) != len(self.layers):
            raise ValueError(
                f"thickness has {len(self.thickness)} entries and layers {len(self.layers)}: "
                "give every layer its thickness"
            )
        return self

    @model_validator(mode="after")
    def _pins_within_bars(self) -> LinksTable:
        if self.pin_diameter >= self.bar_width:
            raise ValueError(
                f"pin_diameter ({self.pin_diameter:g} mm) leaves nothing of a bar "
                f"{self.bar_width:g} mm wide; make bars wider or pins thinner"
            )
        return self

    @model_validator(mode="after")
    def _every_part_in_one_layer(self) -> LinksTable:
        parts = [part for layer in self.layers for part in layer]
        for part in (*WALLS, *BARS):
            if parts.count(part) != 1:
                raise ValueError(
                    f"layers: '{part}' lies in {parts.count(part)} layers; name it in one"
                )
        for layer in self.layers:
            bars, walls = set(layer) & set(BARS), set(layer) & set(WALLS)
            if bars and walls:
                raise ValueError(
                    f"layers: {', '.join(sorted(bars))} would move through the wall of "
                    f"{', '.join(sorted(walls))}; give bars and walls layers of their own"
                )
        return self


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

    def layer_of(self, part: str) -> int:
        """The layer of a part."""
        return next(i for i, parts in enumerate(self.layers) if part in parts)


class Meeting(NamedTuple):
    """Two parts that lie in one layer, or a bar and an axle that crosses its layer.

    Attributes:
        first: a bar.
        second: a bar or the name of a pin.
    """

    first: str
    second: str


def find_meetings(links: Links, joined: Mapping[str, Sequence[str]]) -> list[Meeting]:
    """Which parts can meet: those in one layer that share no pin.

    Args:
        links: with its layers.
        joined: the bodies that every pin joins, by its name.

    Raises:
        ValueError: two bodies on one pin lie in one layer.

    Example:
        >>> links = Links.of(LinksTable())
        >>> pins = {"E": ("crank", "rod"), "H": ("bar", "plate"), "A": ("proximal", "intermediate")}
        >>> [tuple(pair) for pair in find_meetings(links, pins)][:4]
        [('crank', 'plate'), ('rod', 'bar'), ('crank', 'A'), ('plate', 'A')]
    """
    for pin, bodies in joined.items():
        for one, other in combinations(bodies, 2):
            if links.layer_of(one) == links.layer_of(other):
                raise ValueError(f"{one} and {other} share pin {pin} and lie in one layer")
    present = [bar for bar in BARS if any(bar in bodies for bodies in joined.values())]
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
