"""The settings of the study; defaults are paper B's finger and the stated errors of assembly."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import Field, model_validator

from designopt import Spec, setting
from optics.scene.catalogue import camera_catalogue, filled_in
from studies.models.body import BodySpec, Length

if TYPE_CHECKING:
    from optics.scene.camera import Camera
    from studies.models.pad_layers import PadLayers

Error = Annotated[float, Field(gt=0, le=10)]

MOST_LAYERS, LARGEST_INDEX = 4, 4.0
"""As in scene files, whose module takes long to import."""

MOST_MIRRORS = 3

FLOOR = 2.5
"""Least resolution, px/mm, of which the study's targets speak."""

MODEL = "imx219-200"
"""The default camera, whose maker states F2.0; the catalogue has no f-numbers of the others."""

FOV_DEG, PIXELS = 160.0, 1080
"""Of a lens that is none of the catalogue, unless they are given."""


class CameraSpec(Spec):
    """The camera: a lens with an opaque body behind it, in one of the phalanges.

    The lens is one that is sold (``model``) or, where ``fov_deg`` or ``pixels`` are given, an
    equidistant one whose field of view fills the image line. Width and depth of the body are
    assumptions: no maker states them for a lens and its sensor without their board.
    """

    model: str = setting(
        MODEL, "camera of the catalogue (empty: an equidistant lens of fov_deg and pixels)"
    )
    fov_deg: Annotated[float, Field(ge=20, le=220)] | None = setting(
        None, "field of view in the section, in place of a model's (degrees)"
    )
    pixels: Annotated[int, Field(ge=16, le=100_000)] | None = setting(
        None, "pixels along the image line, in place of a model's"
    )
    section_axis: Literal["long", "short"] = setting(
        "long", "side of its sensor that lies in the section"
    )
    f_number: float = setting(
        2.0,
        "focal length over aperture, for blur (0: sharp everywhere, and so unless given for other "
        "lenses than the default)",
        ge=0,
        le=100,
    )
    focus: Length = setting(
        32.0, "distance at which it is focused: nearest and farthest place blur alike (mm)"
    )
    max_blur_px: Length = setting(8.0, "largest blur spot that is accepted (pixels)")
    phalanx: Literal["proximal", "intermediate", "distal"] = setting(
        "intermediate", "what carries the camera"
    )
    width: Length = setting(8.0, "width of the opaque body (mm)")
    depth: Length = setting(4.0, "from the pinhole to the back of the opaque body (mm)")
    min_grazing_deg: float = setting(
        2.0, "least angle between a pad and a ray that shows it (degrees)", ge=0, lt=60
    )

    @property
    def back(self) -> float:
        """From the pinhole to the back of the body, mm."""
        return self.depth

    @property
    def optics(self) -> Camera:
        """Lens and sensor, somewhere."""
        from optics.scene.file import CameraTable
        from optics.scene.reading import build_camera

        place: dict[str, Any] = {"position": (0.0, 0.0), "direction_deg": 0.0}
        table = place | {"fov_deg": self.fov_deg, "pixels": self.pixels}
        if self.model:
            table = place | {"model": self.model, "format": {"section_axis": self.section_axis}}
        camera = CameraTable.model_validate(table)
        if self.f_number and camera.sold is not None:
            lens = {"focal_length": camera.sold.focal_length, "f_number": self.f_number}
            table |= {"lens": lens | {"focus": self.focus}, "max_blur_px": self.max_blur_px}
            camera = CameraTable.model_validate(table)
        return build_camera(camera)

    @model_validator(mode="before")
    @classmethod
    def _one_lens(cls, data: Any) -> Any:
        """A lens of the catalogue or one of ``fov_deg`` and ``pixels``."""
        if not isinstance(data, dict):
            return data
        own = {name: data.get(name) for name in ("fov_deg", "pixels")}
        given = [name for name, value in own.items() if value is not None]
        model = data.get("model", "" if given else MODEL)
        if model and given:
            raise ValueError(
                f"{' and '.join(given)} and model '{model}' are two lenses; leave one of both out"
            )
        if model == MODEL:
            return data
        if not model:
            usual = {"fov_deg": FOV_DEG, "pixels": PIXELS}
            data = data | {name: usual[name] if own[name] is None else own[name] for name in own}
        return {"f_number": 0.0} | data | {"model": model}

    @model_validator(mode="after")
    def _is_sold(self) -> CameraSpec:
        if self.model:
            filled_in({"model": self.model})
        elif self.f_number:
            raise ValueError(
                "f_number is of a lens before a sensor; set it to 0, or name a 'model' of the "
                "catalogue, too: " + ", ".join(camera_catalogue())
            )
        return self


class PadsSpec(Spec):
    """Clear layers on the pads, from the camera's side to the membrane: acrylic and silicone."""

    thickness: list[Length] = setting(
        [1.0, 1.0],
        "of each layer; none, and no index either: bare pads (mm)",
        max_length=MOST_LAYERS,
    )
    index: list[Annotated[float, Field(ge=1, le=LARGEST_INDEX)]] = setting(
        [1.49, 1.41], "of refraction of each layer"
    )
    ends: Literal["black", "clear"] = setting("black", "end faces of the layers")
    reach: Literal["flush", "free"] = setting(
        "free", "whether the search places the edges of the end faces, or they end at the membrane"
    )
    wall: float = setting(0.5, "of the rim, what stays free of layers (mm)", ge=0, le=100)
    min_transmission: float = setting(
        0.3, "least part of the light of a ray that counts", ge=0, lt=1
    )

    @model_validator(mode="after")
    def _fit(self) -> PadsSpec:
        if len(self.index) != len(self.thickness):
            raise ValueError(
                f"{len(self.thickness)} layers have a thickness and {len(self.index)} an index; "
                "give both of each"
            )
        return self

    def layers(self) -> PadLayers | None:
        """The layers, their ends bevelled along the planes that halve the joints; or none."""
        import jax.numpy as jnp

        from studies.models.pad_layers import PadLayers

        if not self.thickness:
            return None
        reach = [[1.0 if self.reach == "free" else 0.0] * 2] * len(self.thickness)
        numbers = self.thickness, self.index, reach, reach, self.wall, self.min_transmission
        return PadLayers(*map(jnp.asarray, numbers), ends=self.ends)


class RoomSpec(Spec):
    """Where mirrors may be. Lengths in mm."""

    clearance: Length = setting(1.5, "of mirrors from faces, end walls and camera body (mm)")
    mount: float = setting(
        1.0, "thickness of a mirror's glass and backing, behind its line (mm)", ge=0, le=20
    )
    overhang: float = setting(
        5.0, "how far a mirror may reach beyond its own joint's axis (mm)", ge=0, le=100
    )


class ToleranceSpec(Spec):
    """Errors of assembly: standard deviations of independent normal errors."""

    camera_position: Error = setting(0.3, "camera, along x and along y (mm)")
    camera_tilt_deg: Error = setting(2.0, "camera, about its pinhole (degrees)")
    mirror_tilt_deg: Error = setting(1.0, "each mirror, about its middle (degrees)")
    mirror_offset: Error = setting(0.3, "each mirror, along its normal (mm)")


class SearchSpec(Spec):
    """How the arrangement is searched for; a design is judged apart from it."""

    starts: int = setting(
        2, "random starts, besides the poor one that is written down", free=True, ge=1, le=256
    )
    copies: int = setting(
        24, "copies with errors, all of which are to see everything", free=True, ge=2, le=1024
    )
    poses: int = setting(
        8, "postures in which each copy is looked at, its own ones", free=True, ge=2, le=91
    )
    spread: float = setting(
        2.0, "size of the copies' errors over the stated ones, at the end", free=True, ge=0.1, le=10
    )
    mirror_weight: float = setting(
        0.1, "price of 10 mm of mirror, in % of a pad that is not seen", free=True, ge=0, le=100
    )


class MirrorSpec(Spec):
    """What `design_mirrors` is given besides the body."""

    phalanges: list[Literal["distal", "proximal", "intermediate"]] = setting(
        ["distal", "proximal"],
        "what carries each mirror; none: the camera looks at the pads directly",
        max_length=MOST_MIRRORS,
    )
    camera: CameraSpec = CameraSpec()
    pads: PadsSpec = PadsSpec()
    room: RoomSpec = RoomSpec()
    tolerances: ToleranceSpec = ToleranceSpec()
    search: SearchSpec = SearchSpec()
    floor: float = setting(
        FLOOR, "least resolution, each place in its best view (px/mm)", gt=0, le=1000
    )
    least_yield: float = setting(
        0.99, "least part of assembled fingers that show everything", ge=0, le=1
    )
    least_membrane: float = setting(
        67.45, "least length of the membranes together, 95 % of 71 (mm)", ge=0, le=1e3
    )


class FingerMirrorsSpec(MirrorSpec):
    """All settings of ``designopt run finger-mirrors``."""

    body: BodySpec = BodySpec()
    search: SearchSpec = SearchSpec(starts=8)
    thin: float = setting(0.0, "thickness of a second body; 0 for none (mm)", ge=0, le=1e3)
    thin_floor: float = setting(
        1.2, "least resolution of the second body (px/mm)", free=True, gt=0, le=1000
    )
    draws: int = setting(
        2000, "random draws of all errors for the yield", scales=True, ge=10, le=100_000
    )
    rays: int = setting(200_000, "rays of the second check", scales=True, ge=1000, le=20_000_000)
    ray_poses: int = setting(20, "worst postures that rays check", scales=True, ge=1, le=91)
    solvers: Literal["none", "few", "all"] = setting(
        "few", "which solvers to compare: gap and violation over run time", free=True
    )
    evolution_seconds: float = setting(
        20.0, "run time of differential evolution, the yardstick (s)", free=True, gt=0, le=1e4
    )
    left_out: bool = setting(True, "count operations left out", free=True)

    @model_validator(mode="after")
    def _room_for_everything(self) -> FingerMirrorsSpec:
        thinnest = min(self.body.thickness, self.thin or self.body.thickness)
        needed = self.body.axis_height + self.camera.depth + 2 * self.room.clearance
        if thinnest <= needed:
            raise ValueError(
                f"a finger {thinnest:g} mm thick has no room for the camera: axis_height, "
                f"camera.depth and two clearances already take {needed:g} mm; make it thicker"
            )
        host = self.camera.phalanx
        length: float = getattr(self.body, host)
        if self.camera.width >= length:
            raise ValueError(
                f"camera.width ({self.camera.width:g} mm) must be smaller than body.{host} "
                f"({length:g} mm), on which the camera sits"
            )
        return self
