"""The body of paper B's finger (§3) as a person writes it: ``[body]`` of a file and of settings."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator

from designopt.io.spec import Spec
from designopt.study.settings import setting

Length = Annotated[float, Field(gt=0, le=1e3)]
StrictLength = Annotated[Length, Field(strict=True)]


class BodyTable(Spec):
    """``[body]``; see `finger.Body`, which is what is computed with."""

    proximal: StrictLength
    intermediate: StrictLength
    distal: StrictLength
    thickness: StrictLength
    axis_height: StrictLength
    range_deg: Annotated[float, Field(strict=True, ge=2, le=100)]
    rim: Annotated[float, Field(strict=True, ge=0, le=1e3)]

    @model_validator(mode="after")
    def _axes_inside(self) -> BodyTable:
        if self.axis_height >= self.thickness:
            raise ValueError(
                f"axis_height ({self.axis_height:g} mm) must be smaller than thickness "
                f"({self.thickness:g} mm): the axes lie between the faces"
            )
        return self

    @model_validator(mode="after")
    def _room_for_pads(self) -> BodyTable:
        ends = {"proximal": self.rim, "intermediate": self.axis_height, "distal": self.rim}
        for name, end in ends.items():
            least = self.axis_height + end
            if getattr(self, name) <= least:
                raise ValueError(
                    f"{name} ({getattr(self, name):g} mm) leaves no room for a pad, which begins "
                    f"axis_height from the joint: make it longer than {least:g} mm"
                )
        return self


class BodySpec(BodyTable):
    """The same as settings; defaults are paper B's finger. Lengths in mm.

    That pads end 1.5 mm before the ends of the finger is an argument of this project.
    """

    proximal: Length = setting(35.0, "length of the proximal phalanx (mm)")
    intermediate: Length = setting(23.0, "PIP axis to DIP axis (mm)")
    distal: Length = setting(32.0, "DIP axis to finger tip (mm)")
    thickness: Length = setting(25.0, "T, palmar to dorsal face (mm)")
    axis_height: Length = setting(4.0, "h, palmar face to the axes (mm)")
    range_deg: float = setting(90.0, "flexion of each joint from straight (degrees)", ge=2, le=100)
    rim: float = setting(1.5, "outer pads to the ends of the finger (mm)", ge=0, le=1e3)
