"""The file a person writes: a camera, and the mirrors, pads, blockers and frames around it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Annotated, Literal

import numpy as np
import pydantic

from designopt.io.spec import Spec
from designopt.io.spec_files import FORMAT, Format, Length, Name, Number, Point, Title
from optics.scene.layers import CHANNELS, EndKind

FIXED = "world"
"""Name of the frame that does not move."""

MOST_BOUNCES = 6

LARGEST_RATIO = 1e9
"""A radius so many times longer or shorter than the chord is a slip of the pen."""

MOST_LAYERS = 4

MOST_BEVEL = 80
"""Degrees; a layer cut back further is a wedge."""

LARGEST_INDEX = 4.0
"""Of refraction: above all glass and plastic."""

Coefficients = tuple[Number, Number, Number, Number]
Side = Literal["left", "right", "both"]


def _joins_no_path(name: str) -> str:
    if "+" in name or ":" in name:
        raise ValueError("'+' and ':' stand between the mirrors of a path; choose another name")
    return name


def _known(value: object, check: Callable[[object], object]) -> object:
    try:
        return check(value)
    except pydantic.ValidationError:
        raise ValueError(
            'write it as "equidistant", "pinhole" or four Kannala-Brandt coefficients, '
            "[k1, k2, k3, k4]"
        ) from None


MirrorName = Annotated[Title, pydantic.AfterValidator(_joins_no_path)]
ProjectionEntry = Annotated[
    Literal["equidistant", "pinhole"] | Coefficients, pydantic.WrapValidator(_known)
]


class SceneTable(Spec):
    """``[scene]``."""

    name: Title | None = None
    format: Format = FORMAT
    bounces: Annotated[int, pydantic.Field(strict=True, ge=0, le=MOST_BOUNCES)] | None = None


class LensTable(Spec):
    """``[camera.lens]``: a thin lens, focused at a distance; mm."""

    focal_length: Length
    f_number: Length
    focus: Length

    @pydantic.model_validator(mode="after")
    def _forms_an_image(self) -> LensTable:
        if self.focus <= self.focal_length:
            raise ValueError(
                "what lies within the focal length is never in focus; make 'focus' longer than "
                "'focal_length'"
            )
        return self


class CameraTable(Spec):
    """``[camera]``: position in mm, optical axis counter-clockwise from +x."""

    position: Point
    direction_deg: Number
    fov_deg: Annotated[Number, pydantic.Field(gt=0, le=360)]
    pixels: Annotated[int, pydantic.Field(strict=True, ge=1, le=1_000_000)]
    projection: ProjectionEntry = "equidistant"
    body: Name = FIXED
    lens: LensTable | None = None

    @pydantic.model_validator(mode="after")
    def _images_all_of_its_field(self) -> CameraTable:
        if self.projection == "pinhole" and self.fov_deg >= 180:
            raise ValueError(
                f"a pinhole camera sees less than 180° (fov_deg is {self.fov_deg:g}); narrow it, "
                'or take projection = "equidistant"'
            )
        if isinstance(self.projection, tuple):
            limit = _turning_point_deg(self.projection)
            if limit <= self.fov_deg / 2:
                raise ValueError(
                    f"with these coefficients the image grows only up to {limit:.4g}° from the "
                    f"axis; keep fov_deg below {2 * limit:.4g}, or correct 'projection'"
                )
        return self


def _turning_point_deg(coefficients: Coefficients) -> float:
    """Angle from the axis (degrees) at which a Kannala-Brandt image stops to grow; or infinity."""
    # Slope 1 + 3 k₁ θ² + … + 9 k₄ θ⁸, over θ⁸: a polynomial in θ⁻² that always begins with 1.
    slope = [1.0, *(n * k for n, k in zip((3, 5, 7, 9), coefficients, strict=True))]
    roots = np.roots(slope)
    # The two parts of a double root come out as a complex pair, apart by the root of rounding.
    real = roots.real[(np.abs(roots.imag) <= 1e-6 * np.abs(roots)) & (roots.real > 0)]
    return math.degrees(real.max() ** -0.5) if real.size else math.inf


class SurfaceTable(Spec):
    """What mirrors, pads and blockers have in common; ends in mm."""

    name: Title
    start: Point = pydantic.Field(alias="from")
    end: Point = pydantic.Field(alias="to")
    side: Side = "both"
    body: Name = FIXED

    @pydantic.model_validator(mode="after")
    def _has_a_length(self) -> SurfaceTable:
        if self.start == self.end:
            raise ValueError("it has no length; move 'from' or 'to'")
        return self


class MirrorTable(SurfaceTable):
    """``[[mirrors]]``: straight, or with a radius a conic section.

    Its ends lie on the curve and its axis is the perpendicular bisector of its chord. At ξ along
    the chord from its middle it lies ξ²/(R (1 + √(1 − (1 + k) ξ²/R²))) away from the tangent at
    its vertex, with R the radius of curvature there (positive: its centre lies to the left of
    ``from`` → ``to``) and k the conic constant (0: circle, −1: parabola).
    """

    name: MirrorName
    radius: Number | None = None
    conic: Number | None = None

    @pydantic.model_validator(mode="after")
    def _is_a_curve(self) -> MirrorTable:
        if self.radius is None:
            if self.conic is not None:
                raise ValueError("'conic' is the form of a curved mirror; add 'radius'")
            return self
        chord, radius = math.dist(self.start, self.end), abs(self.radius)
        if not chord / LARGEST_RATIO <= radius <= chord * LARGEST_RATIO:
            raise ValueError(
                f"a radius of {self.radius:g} mm does not fit a mirror {chord:g} mm long; correct "
                "it, or leave it out for a straight mirror"
            )
        conic = self.conic or 0.0
        least = math.sqrt(max(1 + conic, 0.0)) * chord / 2
        if radius <= least:
            raise ValueError(
                f"the curve ends before 'from' and 'to', which are {chord:g} mm apart; make "
                f"'radius' longer than {least:g} mm, or move them together"
            )
        return self


def _at_both_ends(value: object) -> object:
    return value if isinstance(value, (list, tuple)) else [value, value]


AtBothEnds = pydantic.BeforeValidator(_at_both_ends)
NotNegative = Annotated[Number, pydantic.Field(ge=0)]
Bevel = Annotated[Number, pydantic.Field(gt=-MOST_BEVEL, lt=MOST_BEVEL)]
Index = Annotated[Number, pydantic.Field(ge=1, le=LARGEST_INDEX)]


class IndexTable(Spec):
    """An index of refraction for each color of an image."""

    red: Index
    green: Index
    blue: Index


class SidesTable(Spec):
    """What the end faces of a layer are, and those beside it."""

    start: EndKind = pydantic.Field("black", alias="from")
    end: EndKind = pydantic.Field("black", alias="to")
    beside: EndKind = "black"


def _on_all_sides(value: object) -> object:
    return {"from": value, "to": value, "beside": value} if isinstance(value, str) else value


def _in_all_colors(value: object) -> object:
    return value if isinstance(value, Mapping) else dict.fromkeys(CHANNELS, value)


class LayerTable(Spec):
    """An entry of ``layers``: a plate on the pad, towards the camera; mm."""

    thickness: Length
    index: Annotated[IndexTable, pydantic.BeforeValidator(_in_all_colors)]
    sides: Annotated[SidesTable, pydantic.BeforeValidator(_on_all_sides)] = SidesTable()
    overhang: Annotated[tuple[NotNegative, NotNegative], AtBothEnds] = (0.0, 0.0)
    bevel_deg: Annotated[tuple[Bevel, Bevel], AtBothEnds] = (0.0, 0.0)


class BezelTable(Spec):
    """``bezel``: the seat that holds the outermost layer at its edge; mm."""

    lip: Annotated[tuple[NotNegative, NotNegative], AtBothEnds]
    height: NotNegative


class PadTable(SurfaceTable):
    """``[[pads]]``: a surface that is to be seen, under no less than a grazing angle.

    With ``layers`` it is the membrane behind them, the last layer next to it, and rays must also
    bring at least ``min_transmission`` of their light through all surfaces.
    """

    min_grazing_deg: Annotated[Number, pydantic.Field(ge=0, lt=90)] = 0.0
    min_transmission: Annotated[Number, pydantic.Field(ge=0, lt=1)] | None = None
    width: Length | None = None
    layers: Annotated[list[LayerTable], pydantic.Field(max_length=MOST_LAYERS)] = pydantic.Field(
        default_factory=list
    )
    bezel: BezelTable | None = None

    @pydantic.model_validator(mode="after")
    def _holds_its_layers(self) -> PadTable:
        if not self.layers:
            for key in ("bezel", "min_transmission"):
                if getattr(self, key) is not None:
                    raise ValueError(
                        f"'{key}' is of a pad with layers; add 'layers', or leave it out"
                    )
            return self
        if self.side == "both":
            raise ValueError(
                'layers lie on the sensing side; write side = "left" or "right", the side of the '
                "camera seen from 'from' to 'to'"
            )
        length = math.dist(self.start, self.end)
        for number, layer in enumerate(self.layers, 1):
            cut = [layer.thickness * math.tan(math.radians(bevel)) for bevel in layer.bevel_deg]
            outer = length + sum(layer.overhang) - sum(cut)
            lips = sum(self.bezel.lip) if self.bezel and number == 1 else 0.0
            if outer <= lips:
                raise ValueError(
                    f"layers.{number - 1}: its bevels leave {outer:.4g} mm of its side towards the "
                    f"camera, and the bezel covers {lips:.4g} mm; make the bevels, the lips or the "
                    "thickness smaller, or the overhang larger"
                )
        return self


class FrameTable(Spec):
    """``[frames.NAME]``: what moves, hinged in another frame (hinge in mm)."""

    hinge: Point
    angle: Name
    parent: Name = FIXED
    positive: Literal["counterclockwise", "clockwise"] = "counterclockwise"


class SceneFile(Spec):
    """A whole scene file; all coordinates are those of the pose in which every angle is 0."""

    scene: SceneTable = SceneTable()
    camera: CameraTable
    mirrors: list[MirrorTable] = pydantic.Field(default_factory=list)
    pads: list[PadTable] = pydantic.Field(default_factory=list)
    blockers: list[SurfaceTable] = pydantic.Field(default_factory=list)
    frames: dict[Name, FrameTable] = pydantic.Field(default_factory=dict)
