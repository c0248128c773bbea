"""The settings of the study; defaults are those of the reference values."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, PositiveFloat, model_validator

from designopt.io.spec import Spec
from designopt.study.settings import setting
from studies.models.body import BodySpec

ROUNDING = 1e-9
"""mm."""

Coordinate = Annotated[float, Field(ge=-1e3, le=1e3)]
Place = tuple[Coordinate, Coordinate]
Stiffness = Annotated[float, Field(ge=1e-6, le=1e6)]
Angle = Annotated[float, Field(ge=0, le=90)]
Diameter = Annotated[float, Field(ge=1, le=500)]


class PinsSpec(Spec):
    """Pins in the straight finger, mm, [x, y] from the PIP axis.

    The default is a feasible design for a finger 25 mm thick (design B).
    """

    F: Place = setting((-7.75, -2.0), "axis of the crank (mm)")
    E: Place = setting((-21.27, 14.06), "crank and rod (mm)")
    D: Place = setting((-2.49, 13.73), "rod and plate (mm)")
    C: Place = setting((25.88, 5.27), "plate and distal phalanx (mm)")
    G: Place = setting((11.13, 2.01), "bar and intermediate phalanx (mm)")
    H: Place = setting((15.0, 19.0), "bar and plate, the paper's G' (mm)")


class GraspSpec(Spec):
    """All settings of ``designopt run finger-grasp``."""

    body: BodySpec = BodySpec(pad_clearance=0.0)
    pins: PinsSpec = PinsSpec()
    spring_stiffness: Stiffness = setting(
        30.0, "k, torsion spring between distal phalanx and plate (N mm/rad)"
    )
    preload: float = setting(
        0.3, "γ_p, how far that spring is wound in the straight finger (rad)", ge=0, le=3
    )
    servo_stiffness: Stiffness = setting(
        300.0, "k_s, stiffness of the motor at the crank (N mm/rad)"
    )
    motor_end_deg: float = setting(
        160.0, "angle to which the motor closes (degrees)", ge=10, le=360
    )
    diameters: list[Diameter] = setting(
        [10.0 * i for i in range(1, 10)], "circles to close on (mm)", free=True, min_length=1
    )
    grip_at: PositiveFloat = setting(
        11.5,
        "the circles lie on the proximal pad so far from the PIP axis, smaller ones nearer (mm)",
        free=True,
    )
    opening_load: tuple[float, float] = setting(
        (15.0, 5.0), "moments that pull PIP and DIP open in the loaded sequence (N mm)", free=True
    )
    pinch_pip_deg: list[Angle] = setting(
        [30.0, 60.0], "PIP at which the straight distal pad pinches (°)", free=True, min_length=1
    )
    pinch_at: list[PositiveFloat] = setting(
        [5.0, 8.0, 12.0, 16.0, 20.0, 30.0],
        "k₂, distances of the pinched contact from the DIP axis (mm)",
        free=True,
        min_length=1,
    )
    precision: bool = setting(True, "measure error against run time", free=True)
    precision_repeats: int = setting(5, "timed repeats of each setting", free=True, ge=3, le=1000)
    stability: bool = setting(True, "run the stiff and extreme cases", free=True)

    @model_validator(mode="after")
    def _pinches_within_reach(self) -> GraspSpec:
        range_deg = self.body.ranges_deg[0]
        if max(self.pinch_pip_deg) > range_deg:
            raise ValueError(
                f"pinch_pip_deg ({max(self.pinch_pip_deg):g}°) lies beyond body.range_deg "
                f"({range_deg:g}°): pinch within the range"
            )
        start, end = self.body.gaps[1], self.body.distal - self.body.rim
        if not start - ROUNDING <= min(self.pinch_at) <= max(self.pinch_at) <= end:
            raise ValueError(
                f"pinch_at lies beside the distal pad, which reaches from {start:g} to {end:g} mm"
            )
        return self
