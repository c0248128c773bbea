"""The file a person writes of a soft finger's chamber: its wall and its camera."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import pydantic

from designopt.design_kind import read_tables
from designopt.errors import UserError
from designopt.io.files import printable, replaced_when_complete
from designopt.io.spec import Spec
from designopt.io.spec_files import FORMAT, Format, Length, Number, Title, validated
from designopt.io.toml_writing import degrees_of, format_toml
from optics.chamber.chamber import Chamber

ANGLE = "wall_angle_bc"
"""The one field of `Chamber` that a file has in degrees."""


def _less_than_a_right_angle(angle: float) -> float:
    if abs(angle) >= 90:
        raise ValueError(
            f"θ_BC must be less than a right angle either way (it is {angle:g}°); correct it"
        )
    return angle


class ChamberTable(Spec):
    """``[chamber]``: the fields of `optics.Chamber` by its names, lengths in mm."""

    name: Title | None = None
    """Its name, in titles and file names."""
    format: Format = FORMAT
    """Version of the file's format."""
    length_ab: Length
    """a, red region: A to B along the centre line, mm."""
    length_bc: Length
    """b, blue region: B to C, mm."""
    length_cd: Length
    """c, yellow region: C to D, mm."""
    offset_a: Length
    """Δl_A, wall to centre line at A, mm."""
    offset_b: Number
    """Δl_B, wall to centre line at B, mm."""
    wall_angle_bc_deg: Annotated[Number, pydantic.AfterValidator(_less_than_a_right_angle)]
    """θ_BC, slope of the blue wall, degrees."""
    offset_d: Number
    """Δl_D, wall to centre line at D, counted to the other side, mm."""
    focal_length: Length
    """f, mm."""
    image_distance: Length
    """v, pinhole to image plane, mm."""
    reference_height: Number
    """h, reference ray above the line from which offsets count, mm."""
    pinhole_offset: Number
    """δ, pinhole before A along the centre line, mm."""


class ChamberFile(Spec):
    """The whole file."""

    chamber: ChamberTable
    """Wall and camera."""


def read_chamber(path: Path) -> tuple[str, Chamber]:
    """The chamber that a file describes, and its name: by default the file's.

    Raises:
        UserError: the file cannot be read, or describes no chamber with an image; one line names
            where and what to change.

    Example:
        >>> import tempfile
        >>> from pathlib import Path
        >>> chamber = Chamber(40, 30, 30, 4.1, 2.0, 0.035, 2.5, 4.0, 3.5, 8.6, 0.84)
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     write_chamber("sample", chamber, f"{folder}/chamber.toml")
        ...     name, copy = read_chamber(Path(folder) / "chamber.toml")
        >>> name, float(copy.offset_b)
        ('sample', 2.0)
    """
    table = validated(ChamberFile, read_tables(path, "chamber", "chamber"), str(path)).chamber
    fields = table.model_dump(exclude={"name", "format"})
    fields[ANGLE] = math.radians(fields.pop(f"{ANGLE}_deg"))
    chamber = Chamber(**fields)
    image = chamber.imaging_ratio()
    if not bool(image.ok):
        raise UserError(f"{path}: chamber: {image.messages()[0]}")
    return table.name or printable(path.stem), chamber


def format_chamber(name: str, chamber: Chamber) -> str:
    """The text of a chamber's file; `read_chamber` reads the same back.

    Example:
        >>> chamber = Chamber(40, 30, 30, 4.1, 2.0, 0.035, 2.5, 4.0, 3.5, 8.6, 0.84)
        >>> format_chamber("sample", chamber).count("=") > 11
        True
    """
    table: dict[str, float | str | int] = {"name": name, "format": FORMAT}
    for key in ChamberTable.model_fields:
        if key == f"{ANGLE}_deg":
            table[key] = degrees_of(float(chamber.wall_angle_bc))
        elif key not in table:
            table[key] = float(getattr(chamber, key))
    comment = (
        "A soft finger's chamber and its camera: lengths in mm; Δl_D is counted to the other side "
        "of\nthe centre line from Δl_A and Δl_B. designopt explore and export take this file."
    )
    return format_toml({"chamber": table}, comment)


def write_chamber(name: str, chamber: Chamber, path: str | Path) -> None:
    """Write a chamber's file; an existing one is replaced when the new one is complete.

    Args:
        name: the chamber's.
        chamber: a single one.
        path: of the file.

    Example:
        >>> import tempfile
        >>> from pathlib import Path
        >>> chamber = Chamber(40, 30, 30, 4.1, 2.0, 0.035, 2.5, 4.0, 3.5, 8.6, 0.84)
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     write_chamber("sample", chamber, f"{folder}/chamber.toml")
        ...     name, copy = read_chamber(Path(folder) / "chamber.toml")
        >>> name, float(copy.length_ab)
        ('sample', 40.0)
    """
    with replaced_when_complete(Path(path)) as partial:
        partial.write_text(format_chamber(name, chamber), encoding="utf-8")
