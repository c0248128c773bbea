"""The settings of the study; defaults are paper B's finger and the stated errors of assembly."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from designopt.io.spec import Spec
from studies.models.body import BodySpec

Length = Annotated[float, Field(gt=0, le=1e3)]
Error = Annotated[float, Field(gt=0, le=10)]

FLOOR = 2.5
"""Least resolution, px/mm, of which the study's targets speak."""


class CameraSpec(Spec):
    """The camera on the intermediate phalanx: an equidistant lens with an opaque body behind it."""

    fov_deg: Annotated[float, Field(ge=20, le=220)] = Field(
        default=160.0, description="field of view (degrees)"
    )
    pixels: Annotated[int, Field(ge=16, le=100_000)] = Field(
        default=1080, description="pixels along the image line"
    )
    width: Length = Field(default=8.0, description="width of the opaque body (mm)")
    depth: Length = Field(
        default=4.0, description="what the body needs below the dorsal face, behind the lens (mm)"
    )
    min_grazing_deg: Annotated[float, Field(ge=0, lt=60)] = Field(
        default=2.0, description="least angle between a pad and a ray that shows it (degrees)"
    )


class RoomSpec(Spec):
    """Where mirrors may be. Lengths in mm."""

    clearance: Length = Field(
        default=1.0, description="of mirrors from faces, end walls and camera body (mm)"
    )
    overhang: Annotated[float, Field(ge=0, le=100)] = Field(
        default=5.0, description="how far a mirror may reach beyond its own joint's axis (mm)"
    )


class ToleranceSpec(Spec):
    """Errors of assembly: standard deviations of independent normal errors."""

    camera_position: Error = Field(default=0.3, description="camera, along x and along y (mm)")
    camera_tilt_deg: Error = Field(default=2.0, description="camera, about its pinhole (degrees)")
    mirror_tilt_deg: Error = Field(
        default=1.0, description="each mirror, about its middle (degrees)"
    )
    mirror_offset: Error = Field(default=0.3, description="each mirror, along its normal (mm)")


class SearchSpec(Spec):
    """How the arrangement is searched for."""

    starts: Annotated[int, Field(ge=1, le=256)] = Field(
        default=2, description="random starts, besides the poor one that is written down"
    )
    copies: Annotated[int, Field(ge=2, le=1024)] = Field(
        default=24, description="copies with errors, all of which are to see everything"
    )
    poses: Annotated[int, Field(ge=2, le=91)] = Field(
        default=8, description="postures in which each copy is looked at, its own ones"
    )
    spread: Annotated[float, Field(ge=0.1, le=10)] = Field(
        default=2.0, description="size of the copies' errors over the stated ones, at the end"
    )
    mirror_weight: Annotated[float, Field(ge=0, le=100)] = Field(
        default=0.3, description="price of 10 mm of mirror, in % of a pad that is not seen"
    )


class MirrorSpec(Spec):
    """What `design_mirrors` needs to know besides the body."""

    camera: CameraSpec = CameraSpec()
    room: RoomSpec = RoomSpec()
    tolerances: ToleranceSpec = ToleranceSpec()
    search: SearchSpec = SearchSpec()
    floor: Annotated[float, Field(gt=0, le=1000)] = Field(
        default=FLOOR, description="least resolution, each place in its best view (px/mm)"
    )


class FingerMirrorsSpec(MirrorSpec):
    """All settings of ``designopt run finger-mirrors``."""

    body: BodySpec = BodySpec()
    search: SearchSpec = SearchSpec(starts=8)
    thin: Annotated[float, Field(ge=0, le=1e3)] = Field(
        default=20.0, description="thickness of a second body; 0 for none (mm)"
    )
    thin_floor: Annotated[float, Field(gt=0, le=1000)] = Field(
        default=1.2, description="least resolution of the second body (px/mm)"
    )
    draws: Annotated[int, Field(ge=10, le=100_000)] = Field(
        default=2000, description="random draws of all errors for the yield"
    )
    rays: Annotated[int, Field(ge=1000, le=20_000_000)] = Field(
        default=200_000, description="rays of the second check"
    )
    ray_poses: Annotated[int, Field(ge=1, le=91)] = Field(
        default=20, description="worst postures that rays check"
    )
    solvers: Literal["none", "few", "all"] = Field(
        default="few", description="which solvers to compare: gap and violation over run time"
    )
    evolution_seconds: Annotated[float, Field(gt=0, le=1e4)] = Field(
        default=20.0, description="run time of differential evolution, the yardstick (s)"
    )
    left_out: bool = Field(default=True, description="count operations left out")

    @model_validator(mode="after")
    def _room_for_everything(self) -> FingerMirrorsSpec:
        thinnest = min(self.body.thickness, self.thin or self.body.thickness)
        needed = self.body.axis_height + self.camera.depth + 2 * self.room.clearance
        if thinnest <= needed:
            raise ValueError(
                f"a finger {thinnest:g} mm thick has no room for the camera: axis_height, "
                f"camera.depth and two clearances already take {needed:g} mm; make it thicker"
            )
        if self.camera.width >= self.body.intermediate:
            raise ValueError(
                f"camera.width ({self.camera.width:g} mm) must be smaller than body.intermediate "
                f"({self.body.intermediate:g} mm), on which the camera sits"
            )
        return self
