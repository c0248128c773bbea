"""The body of paper B's finger (§3) as a person writes it: ``[body]`` of a file and of settings."""

from __future__ import annotations

import math
from typing import Annotated, Any

from pydantic import Field, model_validator

from designopt.io.spec import Spec
from designopt.study.settings import setting

Length = Annotated[float, Field(gt=0, le=1e3)]
StrictLength = Annotated[Length, Field(strict=True)]


def pad_gap(height: float, protrusion: float, clearance: float, flexion: float) -> float:
    """From a joint's axis to the end of a membrane, mm; see `finger_parts.Body.gaps`.

    Args:
        height: from the palmar face to the axes, mm.
        protrusion: of the membranes from the palmar face, mm.
        clearance: of neighbouring pads, mm.
        flexion: greatest flexion of the joint, rad.

    Example:
        >>> round(pad_gap(4.0, 0.0, 0.0, math.pi / 2), 12)
        4.0
    """
    down = height + protrusion
    return down * math.tan(flexion / 2) + clearance / 2 / math.cos(flexion / 2)


class BodyTable(Spec):
    """``[body]``; see `finger_parts.Body`, which is what is computed with.

    ``range_deg`` may be written as a pair of PIP and DIP, too.
    """

    proximal: StrictLength
    """Length of the proximal phalanx, mm."""
    intermediate: StrictLength
    """PIP axis to DIP axis, mm."""
    distal: StrictLength
    """DIP axis to finger tip, mm."""
    thickness: StrictLength
    """T, palmar to dorsal face, mm."""
    axis_height: StrictLength
    """h, palmar face to the axes, mm."""
    range_deg: Annotated[float, Field(strict=True, ge=2, le=100)]
    """Greatest flexion of both joints, degrees; or a pair of PIP and DIP."""
    rim: Annotated[float, Field(strict=True, ge=0, le=1e3)]
    """From the outer pads to the ends of the finger, mm."""
    protrusion: Annotated[float, Field(strict=True, ge=0, le=1e2)] = 0.0
    """Of the membranes out of the palmar face, mm."""
    pad_clearance: Annotated[float, Field(strict=True, ge=0, le=1e2)] = 0.0
    """Least clearance of neighbouring pads and their layers, mm."""
    dip_range_deg: Annotated[float, Field(strict=True, ge=2, le=100)] | None = None
    """Greatest flexion of DIP, degrees, if it is not that of PIP."""

    @model_validator(mode="before")
    @classmethod
    def _range_of_each_joint(cls, data: Any) -> Any:
        """A pair is that of PIP, and of DIP."""
        if isinstance(data, dict) and isinstance(data.get("range_deg"), (list, tuple)):
            pair = data["range_deg"]
            if len(pair) != 2 or data.get("dip_range_deg") is not None:
                raise ValueError("range_deg: write one number, or a pair of PIP and DIP")
            data = data | {"range_deg": pair[0], "dip_range_deg": pair[1]}
        return data

    @property
    def ranges_deg(self) -> tuple[float, float]:
        """Of PIP and DIP."""
        dip = self.dip_range_deg
        return self.range_deg, self.range_deg if dip is None else dip

    @property
    def gaps(self) -> tuple[float, float]:
        """From PIP and DIP axis to the membranes beside it, mm."""
        pip, dip = (
            pad_gap(self.axis_height, self.protrusion, self.pad_clearance, math.radians(end))
            for end in self.ranges_deg
        )
        return pip, dip

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
        (pip, dip), rim = self.gaps, self.rim
        taken = {"proximal": rim + pip, "intermediate": pip + dip, "distal": dip + rim}
        for name, least in taken.items():
            if getattr(self, name) <= least:
                raise ValueError(
                    f"{name} ({getattr(self, name):g} mm) leaves no room for a pad, whose distance "
                    f"from a joint follows from its range, axis_height, protrusion and "
                    f"pad_clearance: make it longer than {least:.4g} mm"
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
    protrusion: float = setting(0.0, "membranes out of the palmar face (mm)", ge=0, le=1e2)
    pad_clearance: float = setting(
        1.0, "least clearance of neighbouring pads, layers too (mm)", ge=0, le=1e2
    )
    dip_range_deg: Annotated[float, Field(ge=2, le=100)] | None = setting(
        None, "flexion of DIP, if it is not that of PIP (degrees)"
    )
