"""What the linkage is made of: bars and pins with width, and the layers in which they lie.

The links lie at both sides of the finger, the same at either: the layers are counted from the
middle of the finger outwards, and parts of different layers pass each other. A pin joins two bodies
and crosses the layers between these; where it does, bars of those layers keep away from it. Axles
are stubs at either side, for the camera looks between them.
"""

from __future__ import annotations

from itertools import combinations
from typing import Annotated

from pydantic import Field, model_validator

from designopt.io.spec import Spec
from designopt.study.settings import setting
from studies.models.linkage_kinds import COUPLED, SIX_BAR, LinkageKind, kind_of_layers

OUTLINES = {**SIX_BAR.outlines, **COUPLED.outlines}
"""Pins at the corners of every moving link of any kind of linkage; driver and coupler are those of
the motor's parallelogram, without which there is no K. H is paper B's G'."""

AXLES = ("A", "B")
"""Pins that join two walls."""

THICKNESS = (11.6, 1.4, 1.2, 1.2, 1.2)
"""Of these layers, mm: half of the pads' width, LED strips on the acrylic's sides, bars, walls. No
wall of a part that is printed or cut is thinner than 1.2 mm."""

Length = Annotated[float, Field(gt=0, le=1e3)]
Strength = Annotated[float, Field(gt=0, le=1e5)]


class LinksTable(Spec):
    """``[links]`` of a file and of settings; see `link_layers.Links`."""

    bar_width: Length = setting(4.0, "width of bars; their ends are round (mm)")
    pin_diameter: Length = setting(1.5, "diameter of the links' pins (mm)")
    axle_diameter: Length = setting(4.0, "diameter of the PIP and DIP axles (mm)")
    shell: float = setting(
        1.2, "thickness of faces, end walls and what closes the joints (mm)", ge=0, le=100
    )
    play: float = setting(0.1, "between neighbouring layers (mm)", ge=0, le=10)
    bar_strength: Strength = setting(276.0, "yield strength of bars, 6061-T6 (N/mm²)")
    pin_strength: Strength = setting(450.0, "yield strength of pins and axles, A2-70 (N/mm²)")
    thickness: list[Length] = setting(list(THICKNESS), "of the layers, from the middle (mm)")
    layers: list[list[str]] = setting(
        [list(parts) for parts in SIX_BAR.layers], "what lies in each of them"
    )

    @property
    def kind(self) -> LinkageKind:
        """The kind of linkage whose parts lie in the layers."""
        return kind_of_layers(self.layers)

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
        parts, kind = [part for layer in self.layers for part in layer], self.kind
        for part in (*kind.walls, *kind.outlines):
            if parts.count(part) != 1:
                raise ValueError(
                    f"layers: '{part}' lies in {parts.count(part)} layers; name it in one"
                )
        bodies = {**kind.walls, **kind.outlines}
        for layer in self.layers:
            bars, walls = set(layer) & {*kind.outlines}, set(layer) & {*kind.walls}
            if bars and walls:
                raise ValueError(
                    f"layers: {', '.join(sorted(bars))} would move through the wall of "
                    f"{', '.join(sorted(walls))}; give bars and walls layers of their own"
                )
            for one, other in combinations((part for part in layer if part in bodies), 2):
                for pin in sorted(set(bodies[one]) & set(bodies[other])):
                    raise ValueError(
                        f"layers: {one} and {other} share pin {pin} and lie in one layer; move one"
                    )
        return self
