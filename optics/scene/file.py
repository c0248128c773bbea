"""The file a person writes: a camera, and the mirrors, pads, blockers and frames around it."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Mapping
from typing import Annotated, Any, Literal

import numpy as np
import pydantic

from designopt.io.spec import Spec
from designopt.io.spec_files import FORMAT, Format, Length, Name, Number, Point, Title
from optics.scene.camera import turning_point
from optics.scene.catalogue import filled_in
from optics.scene.layers import CHANNELS, EndKind
from optics.scene.sold import AGREEMENT, Axis, Entry, SoldLens, solve_sold_lens

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

LARGEST_PUPIL_SHIFT = 10.0
"""mm: above all lenses that fit into a finger."""

SQUARE = 0.02
"""Sides of a sensor are stated so exactly, as a part of themselves: pixels are square."""

Pixels = Annotated[int, pydantic.Field(strict=True, ge=1, le=1_000_000)]
Coefficients = Annotated[tuple[Number, ...], pydantic.Field(min_length=4, max_length=8)]
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
            'write it as "equidistant", "pinhole", "equisolid", "stereographic", "orthographic" or '
            "four to eight Kannala-Brandt coefficients, [k1, k2, k3, k4, ...]"
        ) from None


MirrorName = Annotated[Title, pydantic.AfterValidator(_joins_no_path)]
ProjectionEntry = Annotated[
    Literal["equidistant", "pinhole", "equisolid", "stereographic", "orthographic"] | Coefficients,
    pydantic.WrapValidator(_known),
]
NARROW = {"pinhole": 180.0, "stereographic": 360.0, "orthographic": 180.0}
"""Fields of view (degrees) that some projections never reach."""


class SceneTable(Spec):
    """``[scene]``."""

    name: Title | None = None
    """Its name, in titles and file names."""
    format: Format = FORMAT
    """Version of the file's format."""
    bounces: Annotated[int, pydantic.Field(strict=True, ge=0, le=MOST_BOUNCES)] | None = None
    """Most reflections of a path; by default as many as mirrors, at most 2; with a curved one 2."""


class LensTable(Spec):
    """``[camera.lens]``: a thin lens, focused at a distance; mm."""

    focal_length: Length
    """mm."""
    f_number: Length
    """Focal length over the diameter of the entrance pupil."""
    focus: Length
    """Distance at which the image is sharp, mm."""
    nearest_focus: Length | None = None
    """The nearest distance at which the lens can be focused, mm."""

    @pydantic.model_validator(mode="after")
    def _forms_an_image(self) -> LensTable:
        if self.focus <= self.focal_length:
            raise ValueError(
                "what lies within the focal length is never in focus; make 'focus' longer than "
                "'focal_length'"
            )
        if self.nearest_focus is not None and self.focus < self.nearest_focus:
            raise ValueError(
                f"a focus at {self.focus:g} mm is nearer than the lens allows "
                f"({self.nearest_focus:g} mm); move 'focus' away, or correct 'nearest_focus'"
            )
        return self


class FormatTable(Spec):
    """``format`` of ``[camera]``: a sensor as it is sold, its long side first.

    ``section_axis`` is the side that lies in the section. Of the finger of paper B no source states
    it; that the paper lists the views in an image from top to bottom suggests the short one.
    """

    sensor_mm: tuple[Length, Length]
    """Long and short side of the light-sensitive area, mm."""
    pixels: tuple[Pixels, Pixels]
    """Pixels along the long and the short side."""
    section_axis: Literal["long", "short"]
    """The side that lies in the section."""

    @pydantic.model_validator(mode="after")
    def _has_square_pixels(self) -> FormatTable:
        (long, short), (columns, rows) = self.sensor_mm, self.pixels
        if short > long or rows > columns:
            raise ValueError("write the long side first in 'sensor_mm' and in 'pixels'")
        if abs(long / columns * rows / short - 1) > SQUARE:
            raise ValueError(
                f"its pixels would be {1000 * long / columns:.4g} µm by "
                f"{1000 * short / rows:.4g} µm; correct 'sensor_mm' or 'pixels'"
            )
        return self


class ModuleTable(Spec):
    """``[camera.module]``: the body of the camera, in mm; see `CameraModule`."""

    lens_diameter: Length
    """Of the barrel, mm."""
    lens_length: Length
    """From the barrel's front to the board's, mm."""
    pupil_depth: Number
    """From the barrel's front back to the entrance pupil, mm."""
    board: tuple[Length, Length]
    """Sides of the circuit board, along the section and across it, mm."""
    board_thickness: Length
    """mm."""
    connector_length: Annotated[Number, pydantic.Field(ge=0)] = 0.0
    """How far connector and cable stand out at the board's back, mm."""

    @pydantic.model_validator(mode="after")
    def _has_its_pupil_before_the_board(self) -> ModuleTable:
        if self.pupil_depth >= self.lens_length:
            raise ValueError(
                "the entrance pupil would lie behind the board's front; make 'pupil_depth' less "
                "than 'lens_length'"
            )
        return self


class CameraTable(Spec):
    """``[camera]``: position in mm, optical axis counter-clockwise from +x.

    Without ``format``, ``fov_deg`` and ``pixels`` are those of the image line. With it, two of
    ``focal_length`` (mm), ``fov_deg`` with ``fov_axis``, and ``projection`` give the third. Rays
    at θ (rad) from the axis pass e₂ θ² + e₄ θ⁴ before the position: ``pupil_shift``, mm. The axis
    is imaged ``axis_offset_px`` from the image's middle: columns to the right, rows down.
    """

    position: Point
    """Entrance pupil of rays along the axis, mm."""
    direction_deg: Number
    """Optical axis, counter-clockwise from +x, degrees."""
    model: Name | None = None
    """A camera of the catalogue, which fills in what is not given."""
    fov_deg: Annotated[Number, pydantic.Field(gt=0, le=360)] | None = None
    """Field of view, degrees: in the section, or with ``format`` along ``fov_axis``."""
    fov_axis: Axis | None = None
    """The axis of the sensor along which a maker states the field of view."""
    pixels: Pixels | None = None
    """Pixels of the image line, without ``format``."""
    focal_length: Length | None = None
    """Focal length of a lens as it is sold, mm."""
    projection: ProjectionEntry | None = None
    """Name of the projection, or Kannala-Brandt coefficients; equidistant by default."""
    image_circle_mm: Length | None = None
    """Diameter of what the lens images, where it ends before the sensor's edge, mm."""
    max_blur_px: Length | None = None
    """Greatest diameter of the blur disc before a view is named as blurred, px."""
    pupil_shift: tuple[Number, Number] | None = None
    """e₂ and e₄ of the moving entrance pupil, mm per rad² and per rad⁴."""
    axis_offset_px: tuple[Number, Number] | None = None
    """Where the axis is imaged, from the image's middle: columns right, rows down, px."""
    body: Name = FIXED
    """The frame that carries it."""
    format: FormatTable | None = None
    """The sensor as it is sold."""
    lens: LensTable | None = None
    """A thin lens, from which blur follows."""
    module: ModuleTable | None = None
    """The camera's body, which hides what is behind it."""

    @pydantic.model_validator(mode="before")
    @classmethod
    def _filled_in(cls, data: Any) -> Any:
        return filled_in(data)

    @pydantic.model_validator(mode="after")
    def _is_told_once(self) -> CameraTable:
        if self.format is None:
            for name in ("fov_deg", "pixels"):
                if getattr(self, name) is None:
                    raise ValueError(
                        f"'{name}' is missing; add it, or tell by 'format' what sensor it has"
                    )
            for name in ("fov_axis", "focal_length", "image_circle_mm"):
                if getattr(self, name) is not None:
                    raise ValueError(
                        f"'{name}' is that of a lens before a sensor; add 'format', or remove it"
                    )
        else:
            if self.pixels is not None:
                raise ValueError("'pixels' stands in 'format' already; remove one of them")
            if (self.fov_deg is None) != (self.fov_axis is None):
                raise ValueError(
                    '\'fov_deg\' and its \'fov_axis\' ("horizontal", "vertical" or "diagonal") '
                    "belong together; add what is missing"
                )
            if [self.focal_length, self.fov_deg, self.projection].count(None) > 1:
                raise ValueError(
                    "of 'focal_length', 'fov_deg' with 'fov_axis' and 'projection' two are needed; "
                    "add one"
                )
        if self.max_blur_px is not None and self.lens is None:
            raise ValueError("'max_blur_px' limits the blur of a lens; add [camera.lens]")
        return self

    @pydantic.model_validator(mode="after")
    def _images_all_of_its_field(self) -> CameraTable:
        fov, projection = self.fov_deg or 0.0, self.projection
        if isinstance(projection, tuple):
            limit = math.degrees(turning_point(projection))
            if limit <= fov / 2:
                raise ValueError(
                    f"with these coefficients the image grows only up to {limit:.4g}° from the "
                    f"axis; keep fov_deg below {2 * limit:.4g}, or correct 'projection'"
                )
        elif projection in NARROW and fov >= NARROW[projection]:
            raise ValueError(
                f"{'an' if projection[0] == 'o' else 'a'} {projection} camera sees less than "
                f"{NARROW[projection]:g}° (fov_deg is {fov:g}); narrow it, or take projection = "
                '"equidistant"'
            )
        return self

    @pydantic.model_validator(mode="after")
    def _is_one_lens(self) -> CameraTable:
        if self.sold is not None and self.lens is not None:
            own, focal = self.lens.focal_length, self.sold.focal_length
            if abs(own - focal) > AGREEMENT * focal:
                raise ValueError(
                    f"lens.focal_length is {own:g} mm, and {focal:.4g} mm is that of the camera; "
                    "correct one of them"
                )
        return self

    @pydantic.model_validator(mode="after")
    def _moves_its_pupil_little(self) -> CameraTable:
        if self.pupil_shift is not None:
            square = np.radians(np.linspace(0, self.section_fov_deg / 2, 181)) ** 2
            shift = square * (self.pupil_shift[0] + square * self.pupil_shift[1])
            most = shift[np.argmax(np.abs(shift))]
            if abs(most) > LARGEST_PUPIL_SHIFT:
                raise ValueError(
                    f"'pupil_shift' moves the entrance pupil by {most:.4g} mm within the field of "
                    f"view, and {LARGEST_PUPIL_SHIFT:g} mm is the most; correct [e2, e4], in mm "
                    "per rad² and rad⁴"
                )
        return self

    @pydantic.model_validator(mode="after")
    def _images_its_axis(self) -> CameraTable:
        if self.axis_offset_px is not None:
            most = self.section_pixels / 4
            if max(map(abs, self.axis_offset_px)) > most:
                raise ValueError(
                    f"'axis_offset_px' puts the optical axis more than {most:g} px beside the "
                    "image's middle, a quarter of its pixels; correct it"
                )
        return self

    @functools.cached_property
    def sold(self) -> SoldLens | None:
        """What follows from lens and sensor; none without ``format``."""
        if self.format is None:
            return None
        return solve_sold_lens(
            self.format.sensor_mm,
            self.format.sensor_mm[self.section_side],
            focal_length=self.focal_length,
            fov_deg=self.fov_deg,
            fov_axis=self.fov_axis or "horizontal",
            projection=self.projection,
            image_circle=self.image_circle_mm,
        )

    @property
    def section_side(self) -> int:
        """Which entry of the format's pairs is that of the section."""
        return 0 if self.format is None or self.format.section_axis == "long" else 1

    @property
    def section_fov_deg(self) -> float:
        """Field of view in the section, degrees."""
        return self.fov_deg or 0.0 if self.sold is None else math.degrees(self.sold.field)

    @property
    def section_projection(self) -> Entry:
        """The projection, whether it is given, follows, or is the usual one."""
        return (self.projection if self.sold is None else self.sold.projection) or "equidistant"

    @property
    def section_pixels(self) -> int:
        """Pixels along the image line."""
        return self.pixels or 0 if self.format is None else self.format.pixels[self.section_side]


class SurfaceTable(Spec):
    """What mirrors, pads and blockers have in common; ends in mm."""

    name: Title
    """By which paths, measures and messages name it."""
    start: Point = pydantic.Field(alias="from")
    """First end, mm."""
    end: Point = pydantic.Field(alias="to")
    """Second end, mm."""
    side: Side = "both"
    """The side that reflects, senses or hides, seen from ``from`` to ``to``."""
    body: Name = FIXED
    """The frame that carries it."""

    @pydantic.model_validator(mode="after")
    def _has_a_length(self) -> SurfaceTable:
        if self.start == self.end:
            raise ValueError("it has no length; move 'from' or 'to'")
        return self


Index = Annotated[Number, pydantic.Field(ge=1, le=LARGEST_INDEX)]


class SheetTable(Spec):
    """An entry of ``layers`` of a mirror: clear, with black ends at right angles; mm."""

    thickness: Length
    """mm."""
    index: Index
    """Index of refraction."""


class MirrorTable(SurfaceTable):
    """``[[mirrors]]``: straight, or with a radius a conic section.

    Its ends lie on the curve and its axis is the perpendicular bisector of its chord. At ξ along
    the chord from its middle it lies ξ²/(R (1 + √(1 − (1 + k) ξ²/R²))) away from the tangent at
    its vertex, with R the radius of curvature there (positive: its centre lies to the left of
    ``from`` → ``to``) and k the conic constant (0: circle, −1: parabola). A straight one may
    reflect at the back of ``layers``, the outermost first: its ends are those of the coat there.
    """

    name: MirrorName
    """By which paths name it."""
    radius: Number | None = None
    """Radius of curvature at the vertex, signed, mm; straight without."""
    conic: Number | None = None
    """Conic constant k of a curved one; 0 by default, a circle."""
    layers: Annotated[list[SheetTable], pydantic.Field(max_length=MOST_LAYERS)] = pydantic.Field(
        default_factory=list
    )
    """Clear sheets in front of the coat, the outermost first."""

    @pydantic.model_validator(mode="after")
    def _lies_behind_its_layers(self) -> MirrorTable:
        if self.layers and self.radius is not None:
            raise ValueError(
                "a curved mirror has no layers; remove 'layers', or leave 'radius' out for a "
                "straight mirror"
            )
        if self.layers and self.side == "both":
            raise ValueError(
                'layers lie on the reflecting side; write side = "left" or "right", seen from '
                "'from' to 'to'"
            )
        return self

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


class IndexTable(Spec):
    """An index of refraction for each color of an image."""

    red: Index
    """In red light."""
    green: Index
    """In green light, in which views are computed."""
    blue: Index
    """In blue light."""


class SidesTable(Spec):
    """What the end faces of a layer are, and those beside it."""

    start: EndKind = pydantic.Field("black", alias="from")
    """The end face at ``from``."""
    end: EndKind = pydantic.Field("black", alias="to")
    """The end face at ``to``."""
    beside: EndKind = "black"
    """Both faces beside the section."""


BLACK = SidesTable.model_validate({})


def _on_all_sides(value: object) -> object:
    return {"from": value, "to": value, "beside": value} if isinstance(value, str) else value


def _in_all_colors(value: object) -> object:
    return value if isinstance(value, Mapping) else dict.fromkeys(CHANNELS, value)


class LayerTable(Spec):
    """An entry of ``layers``: a plate on the pad, towards the camera; mm."""

    thickness: Length
    """mm."""
    index: Annotated[IndexTable, pydantic.BeforeValidator(_in_all_colors)]
    """Index of refraction, or one for each color."""
    sides: Annotated[SidesTable, pydantic.BeforeValidator(_on_all_sides)] = (
        SidesTable.model_validate({})
    )
    """What its end faces are: one word for all, or a table."""
    overhang: Annotated[tuple[NotNegative, NotNegative], AtBothEnds] = (0.0, 0.0)
    """By how much it is longer than the membrane, at each end, mm."""
    bevel_deg: Annotated[tuple[Bevel, Bevel], AtBothEnds] = (0.0, 0.0)
    """By how much its ends are cut back towards the camera, degrees."""


class BezelTable(Spec):
    """``bezel``: the seat that holds the outermost layer at its edge; mm."""

    lip: Annotated[tuple[NotNegative, NotNegative], AtBothEnds]
    """How far it covers the outermost layer at each end, mm."""
    height: NotNegative
    """Above the outermost layer, mm."""


class PadTable(SurfaceTable):
    """``[[pads]]``: a surface that is to be seen, under no less than a grazing angle.

    With ``layers`` it is the membrane behind them, the last layer next to it, and rays must also
    bring at least ``min_transmission`` of their light through all surfaces.
    """

    min_grazing_deg: Annotated[Number, pydantic.Field(ge=0, lt=90)] = 0.0
    """Least angle between ray and surface for a view to count, degrees; in air."""
    min_transmission: Annotated[Number, pydantic.Field(ge=0, lt=1)] | None = None
    """Least part of the light that must come through all surfaces; 0.3 by default with layers."""
    width: Length | None = None
    """Across the section, mm; needed for images and outlines."""
    layers: Annotated[list[LayerTable], pydantic.Field(max_length=MOST_LAYERS)] = pydantic.Field(
        default_factory=list
    )
    """Clear plates on it, from the camera's side to the membrane."""
    bezel: BezelTable | None = None
    """Seat at the edge of the outermost layer."""

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
    """Where it is hinged, mm."""
    angle: Name
    """Name of its joint angle."""
    parent: Name = FIXED
    """The frame in which it is hinged."""
    positive: Literal["counterclockwise", "clockwise"] = "counterclockwise"
    """The sense in which the angle counts."""


class SceneFile(Spec):
    """A whole scene file; all coordinates are those of the pose in which every angle is 0."""

    scene: SceneTable = SceneTable()
    """What concerns the whole."""
    camera: CameraTable
    """The camera."""
    mirrors: list[MirrorTable] = pydantic.Field(default_factory=list)
    """Mirrors."""
    pads: list[PadTable] = pydantic.Field(default_factory=list)
    """Surfaces that are to be seen."""
    blockers: list[SurfaceTable] = pydantic.Field(default_factory=list)
    """What hides and neither reflects nor senses."""
    frames: dict[Name, FrameTable] = pydantic.Field(default_factory=dict)
    """What moves."""
