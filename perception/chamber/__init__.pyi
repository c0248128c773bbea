from .directions import Direction, bending_direction, displacements
from .points import Points, find_points
from .profile import (
    ChamberMap,
    Heights,
    Movements,
    Shape,
    SurfaceKind,
    kind_of,
    movements,
    scatter,
    shape,
    surface_kind,
)
from .regions import Region, Regions, Sight, find_regions

__all__ = [
    "ChamberMap",
    "Direction",
    "Heights",
    "Movements",
    "Points",
    "Region",
    "Regions",
    "Shape",
    "Sight",
    "SurfaceKind",
    "bending_direction",
    "displacements",
    "find_points",
    "find_regions",
    "kind_of",
    "movements",
    "scatter",
    "shape",
    "surface_kind",
]
