"""The settings of the study; defaults are those of the reference values."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

from pydantic import Field, PositiveFloat, model_validator

from designopt.io.spec import Spec
from studies.models.body import BodySpec

if TYPE_CHECKING:
    from studies.models.pins import Pins

Coordinate = Annotated[float, Field(ge=-1e3, le=1e3)]
Place = tuple[Coordinate, Coordinate]
Stiffness = Annotated[float, Field(ge=1e-6, le=1e6)]
Angle = Annotated[float, Field(ge=0, le=90)]


class PinsSpec(Spec):
    """Pins in the straight finger, mm, [x, y] from the PIP axis; the default is design B."""

    F: Place = Field(default=(-7.75, -2.0), description="axis of the crank (mm)")
    E: Place = Field(default=(-21.27, 14.06), description="crank and rod (mm)")
    D: Place = Field(default=(-2.49, 13.73), description="rod and plate (mm)")
    C: Place = Field(default=(25.88, 5.27), description="plate and distal phalanx (mm)")
    G: Place = Field(default=(11.13, 2.01), description="bar and intermediate phalanx (mm)")
    H: Place = Field(default=(15.0, 19.0), description="bar and plate, the paper's G' (mm)")

    def design(self) -> Pins:
        """The pins as a design."""
        # Imported here, so that listing the study does not load JAX.
        import numpy as np

        from studies.models.pins import Pins

        return Pins(**{name: np.array(getattr(self, name)) for name in "FEDCGH"})


class GraspSpec(Spec):
    """All settings of ``designopt run finger-grasp``."""

    body: BodySpec = BodySpec()
    pins: PinsSpec = PinsSpec()
    spring_stiffness: Stiffness = Field(
        default=30.0, description="k, torsion spring between distal phalanx and plate (N mm/rad)"
    )
    preload: Annotated[float, Field(ge=0, le=3)] = Field(
        default=0.3, description="γ_p, how far that spring is wound in the straight finger (rad)"
    )
    servo_stiffness: Stiffness = Field(
        default=300.0, description="k_s, stiffness of the motor at the crank (N mm/rad)"
    )
    motor_end_deg: Annotated[float, Field(ge=10, le=360)] = Field(
        default=160.0, description="angle to which the motor closes (degrees)"
    )
    diameters: Annotated[list[Annotated[float, Field(ge=1, le=500)]], Field(min_length=1)] = Field(
        default=[10.0, 20.0, 30.0, 40.0, 50.0, 60.0, 70.0, 80.0, 90.0],
        description="circles to close on (mm)",
    )
    grip_at: PositiveFloat = Field(
        default=11.5,
        description="the circles lie on the proximal pad so far from the PIP axis, smaller ones "
        "nearer (mm)",
    )
    opening_load: tuple[float, float] = Field(
        default=(15.0, 5.0),
        description="moments that pull PIP and DIP open in the loaded sequence (N mm)",
    )
    pinch_pip_deg: Annotated[list[Angle], Field(min_length=1)] = Field(
        default=[30.0, 60.0], description="PIP flexion at which the straight distal pad pinches"
    )
    pinch_at: Annotated[list[PositiveFloat], Field(min_length=1)] = Field(
        default=[4.0, 8.0, 12.0, 16.0, 20.0, 30.0],
        description="k₂, distances of the pinched contact from the DIP axis (mm)",
    )
    precision: bool = Field(default=True, description="measure error against run time")
    precision_repeats: Annotated[int, Field(ge=3, le=1000)] = Field(
        default=5, description="timed repeats of each setting"
    )
    stability: bool = Field(default=True, description="run the stiff and extreme cases")

    @model_validator(mode="after")
    def _pinches_within_reach(self) -> GraspSpec:
        if max(self.pinch_pip_deg) > self.body.range_deg:
            raise ValueError(
                f"pinch_pip_deg ({max(self.pinch_pip_deg):g}°) lies beyond body.range_deg "
                f"({self.body.range_deg:g}°): pinch within the range"
            )
        start, end = self.body.axis_height, self.body.distal - self.body.rim
        if not start <= min(self.pinch_at) <= max(self.pinch_at) <= end:
            raise ValueError(
                f"pinch_at lies beside the distal pad, which reaches from {start:g} to {end:g} mm"
            )
        return self
