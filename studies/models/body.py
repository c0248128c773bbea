"""The body of paper B's finger (§3): three phalanges, their thickness, and where the axes lie."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator

from designopt.io.spec import Spec

Length = Annotated[float, Field(gt=0, le=1e3)]


RIM = 1.5
"""Pads end so far before the ends of the finger, mm (an argument of this project)."""


class BodySpec(Spec):
    """The section of the finger, straight. Lengths in mm.

    PIP axis A at the origin, DIP axis B at (intermediate, 0), x towards the tip, y towards the
    back of the hand. The palmar face is the line y = −axis_height, the dorsal face
    y = thickness − axis_height.
    """

    proximal: Length = Field(default=35.0, description="length of the proximal phalanx (mm)")
    intermediate: Length = Field(default=23.0, description="PIP axis to DIP axis (mm)")
    distal: Length = Field(default=32.0, description="DIP axis to finger tip (mm)")
    thickness: Length = Field(default=25.0, description="T, palmar to dorsal face (mm)")
    axis_height: Length = Field(default=4.0, description="h, palmar face to the axes (mm)")
    range_deg: Annotated[float, Field(ge=2, le=100)] = Field(
        default=90.0, description="flexion of each joint from straight (degrees)"
    )

    @model_validator(mode="after")
    def _axes_inside(self) -> BodySpec:
        if self.axis_height >= self.thickness:
            raise ValueError(
                f"axis_height ({self.axis_height:g} mm) must be smaller than thickness "
                f"({self.thickness:g} mm): the axes lie between the faces"
            )
        return self

    @model_validator(mode="after")
    def _room_for_pads(self) -> BodySpec:
        ends = {"proximal": RIM, "intermediate": self.axis_height, "distal": RIM}
        for name, end in ends.items():
            least = self.axis_height + end
            if getattr(self, name) <= least:
                raise ValueError(
                    f"{name} ({getattr(self, name):g} mm) leaves no room for a pad, which begins "
                    f"axis_height from the joint: make it longer than {least:g} mm"
                )
        return self

    @property
    def palmar(self) -> float:
        """Height of the palmar face over the axes, mm (negative)."""
        return -self.axis_height

    @property
    def dorsal(self) -> float:
        """Height of the dorsal face over the axes, mm."""
        return self.thickness - self.axis_height
