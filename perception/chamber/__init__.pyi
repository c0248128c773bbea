from .directions import Direction, bending_direction, displacements
from .heights import ChamberMap, Heights, Movements, movements, scatter
from .points import Points, find_points
from .regions import IN_VIEW, Region, Regions, Sight, find_regions
from .surfaces import Shape, SurfaceKind, kind_of, shape_of

__all__ = [
    "IN_VIEW",
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
    "shape_of",
]
