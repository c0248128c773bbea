"""Paper A's chamber, and others that differ from it."""

import dataclasses
import math

from optics import Chamber, read_chamber
from tests.helpers import GALLERY

_, PAPER = read_chamber(GALLERY / "chambers/chamber.toml")
"""With constants that Table I follows, near η = 0.6."""


def chamber(**changes: float) -> Chamber:
    """Of the float type of the moment."""
    fields = {field.name: float(getattr(PAPER, field.name)) for field in dataclasses.fields(PAPER)}
    return Chamber(**(fields | changes))


LENGTHS = ("length_ab", "length_bc", "length_cd", "reference_height")


def eq_1(values):
    """Δl_C, Δl_D, θ_CD and image heights, by Eqs. 1-3 as printed, with plain numbers."""
    a, b, c, h = (values[name] for name in LENGTHS)
    depths = [s + values["pinhole_offset"] for s in (a, a + b, a + b + c)]
    over = values["focal_length"] - values["image_distance"]
    offset_c = values["offset_b"] - b * math.tan(math.radians(values["wall_angle_bc"]))
    image_b = over * (h + values["offset_b"]) / depths[0]
    image_c = over * (h + offset_c) / depths[1]
    image_d = image_c - values["imaging_ratio"] * (image_b - image_c)
    offset_d = h - image_d * depths[2] / over
    angle = math.degrees(math.atan2(offset_c + offset_d, c))
    return offset_c, offset_d, angle, (image_b, image_c, image_d)


MOVES = [
    {},
    {"imaging_ratio": 0.9},
    {"wall_angle_bc": -3.0, "offset_b": 3.0},
    {"length_ab": 55.0, "length_bc": 20.0, "length_cd": 45.0},
    {"focal_length": 3.8, "image_distance": 2.0},
    {"reference_height": 7.0, "pinhole_offset": 3.0, "offset_a": 7.0},
]
