from .bending import CenterLine, bend_center_line
from .endoscope import Endoscope
from .rings import (
    Apertures,
    Posture,
    Rings,
    Spans,
    compute_wall_radii,
    find_apertures,
    find_spans,
    press_wall,
)
from .sensitivity import find_extreme_points, solve_image_rates

__all__ = [
    "Apertures",
    "CenterLine",
    "Endoscope",
    "Posture",
    "Rings",
    "Spans",
    "bend_center_line",
    "compute_wall_radii",
    "find_apertures",
    "find_extreme_points",
    "find_spans",
    "press_wall",
    "solve_image_rates",
]
