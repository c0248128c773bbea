"""A calibrated lens: its rays, what they are worth, and the file that holds them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import pydantic
from jaxtyping import Float

from designopt.io.files import read_toml, replaced_when_complete
from designopt.io.spec import Spec
from designopt.io.spec_files import FORMAT, Format, Length, Number, Title, validated
from designopt.io.toml_writing import degrees_of, format_toml
from optics.calibration.bundle import lens_of, parameters_of
from optics.calibration.fisheye import Fisheye
from optics.scene.camera import turning_point
from optics.scene.file import Coefficients, Pixels

SYMMETRY = 1e-6
"""A covariance is symmetric, and has no negative eigenvalue, but for so much of its largest."""

COMMENT = """Lens of a camera, calibrated by designopt calibrate lens.
Places are column and row, whole numbers at the middles of pixels. A ray at the angle a (rad) from
the axis is imaged focal_px * (a + k1 a^3 + k2 a^5 + ...) from principal_px, and passes the axis
e2 a^2 + e4 a^4 (mm) before where rays along the axis have their pupil.
The covariance is that of focal_px, both of principal_px, k1, k2, ..., e2, e4."""


@dataclass(frozen=True)
class CalibratedLens:
    """A lens that pictures have determined.

    Attributes:
        lens: its rays.
        size: columns and rows of its images.
        covariance: of focal length, principal point (px), k₁, k₂, …, e₂ and e₄ (mm).
        noise: standard deviation of a corner's column or row, px.
        held_out: median distance of predicted corners from those of held-out pictures, px.
        widest: largest angle from the axis at which there was a corner, rad.
        distances: of the boards from the pupil, least and greatest of their middles, mm.
        pictures: how many there were.
        name: of the camera.
    """

    lens: Fisheye
    size: tuple[int, int]
    covariance: Float[np.ndarray, "parameters parameters"]
    noise: float
    held_out: float
    widest: float
    distances: tuple[float, float]
    pictures: int
    name: str = "camera"

    @property
    def deviations(self) -> Float[np.ndarray, " parameters"]:
        """Standard deviations of the parameters."""
        return np.sqrt(np.diagonal(self.covariance))


class LensTable(Spec):
    """``[lens]`` of a lens file."""

    name: Title = "camera"
    """Of the camera."""
    format: Format = FORMAT
    """Version of the file's format."""
    pixels: tuple[Pixels, Pixels]
    """Columns and rows of its images."""
    focal_px: Length
    """Focal length on the axis, px/rad."""
    principal_px: tuple[Number, Number]
    """Where the axis is imaged: column and row, px."""
    projection: Coefficients
    """k₁, k₂, … of Kannala and Brandt."""
    pupil_shift: tuple[Number, Number]
    """e₂ and e₄ of the moving entrance pupil, mm per rad² and per rad⁴."""
    widest_deg: Annotated[Number, pydantic.Field(gt=0, le=180)]
    """Largest angle from the axis at which a corner was seen, degrees."""
    noise_px: Annotated[Number, pydantic.Field(ge=0)]
    """Standard deviation of a corner's column or row, px."""
    held_out_px: Annotated[Number, pydantic.Field(ge=0)]
    """Median distance of predicted from found corners in held-out pictures, px."""
    distances_mm: tuple[Length, Length]
    """Least and greatest distance of the boards from the pupil, mm."""
    pictures: Annotated[int, pydantic.Field(strict=True, ge=1)]
    """How many there were."""
    covariance: list[list[Number]]
    """Of focal_px, principal_px, the coefficients and the pupil's shift, in that order."""

    @pydantic.model_validator(mode="after")
    def _images_what_it_has_seen(self) -> LensTable:
        limit = math.degrees(turning_point(self.projection))
        if limit <= self.widest_deg:
            raise ValueError(
                f"with these coefficients the image grows only up to {limit:.4g}° from the axis, "
                f"and widest_deg is {self.widest_deg:g}; calibrate the lens again"
            )
        return self

    @pydantic.model_validator(mode="after")
    def _has_a_covariance(self) -> LensTable:
        most = len(self.projection) + 5
        if {len(row) for row in self.covariance} | {len(self.covariance)} != {most}:
            raise ValueError(
                f"'covariance' needs {most} rows of {most} numbers, for {most - 5} coefficients of "
                "'projection'; calibrate the lens again"
            )
        matrix = np.array(self.covariance)
        allowed = SYMMETRY * max(np.abs(matrix).max(), 1e-300)
        if np.abs(matrix - matrix.T).max() > allowed or np.linalg.eigvalsh(matrix)[0] < -allowed:
            raise ValueError(
                "'covariance' is none: it is not symmetric, or has a negative eigenvalue; "
                "calibrate the lens again"
            )
        return self


class LensFile(Spec):
    """A whole lens file."""

    lens: LensTable
    """The calibrated lens."""


def read_lens(path: str | Path) -> CalibratedLens:
    """The lens that a file holds.

    Raises:
        UserError: the file cannot be read or holds no lens; one line has the place and the cure.

    Example:
        >>> import tempfile
        >>> fisheye = lens_of(np.array([400.0, 639.5, 479.5, *6 * [0.0]]))
        >>> lens = CalibratedLens(
        ...     fisheye, (1280, 960), np.eye(9), 0.05, 0.05, 1.2, (20.0, 40.0), 10
        ... )
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     write_lens(lens, f"{folder}/lens.toml")
        ...     read_lens(f"{folder}/lens.toml").size
        (1280, 960)
    """
    return calibrated_lens(validated(LensFile, read_toml(path, "lens"), str(path)).lens)


def calibrated_lens(table: LensTable) -> CalibratedLens:
    """The lens of a file's table."""
    parameters = table.focal_px, *table.principal_px, *table.projection, *table.pupil_shift
    return CalibratedLens(
        lens=lens_of(np.array(parameters)),
        size=table.pixels,
        covariance=np.array(table.covariance),
        noise=table.noise_px,
        held_out=table.held_out_px,
        widest=math.radians(table.widest_deg),
        distances=table.distances_mm,
        pictures=table.pictures,
        name=table.name,
    )


def format_lens(lens: CalibratedLens) -> str:
    """The text of a lens's file; `read_lens` reads the same back."""
    focal, column, row, *rest = parameters_of(lens.lens).tolist()
    table = {
        "name": lens.name,
        "format": FORMAT,
        "pixels": list(lens.size),
        "focal_px": focal,
        "principal_px": [column, row],
        "projection": rest[:-2],
        "pupil_shift": rest[-2:],
        "widest_deg": degrees_of(lens.widest),
        "noise_px": lens.noise,
        "held_out_px": lens.held_out,
        "distances_mm": list(lens.distances),
        "pictures": lens.pictures,
        "covariance": lens.covariance.tolist(),
    }
    return format_toml({"lens": table}, COMMENT)


def write_lens(lens: CalibratedLens, path: str | Path) -> None:
    """Write a lens's file; an existing one is replaced when the new one is complete.

    Example:
        >>> import tempfile
        >>> fisheye = lens_of(np.array([400.0, 639.5, 479.5, *6 * [0.0]]))
        >>> lens = CalibratedLens(
        ...     fisheye, (1280, 960), np.eye(9), 0.05, 0.05, 1.2, (20.0, 40.0), 10
        ... )
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     write_lens(lens, f"{folder}/lens.toml")
        ...     read_lens(f"{folder}/lens.toml").size
        (1280, 960)
    """
    with replaced_when_complete(Path(path)) as partial:
        partial.write_text(format_lens(lens), encoding="utf-8")
