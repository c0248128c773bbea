from .directions import Direction, bending_direction, displacements
from .points import Points, find_points
from .regions import Region, Regions, Sight, find_regions

__all__ = [
    "Direction",
    "Points",
    "Region",
    "Regions",
    "Sight",
    "bending_direction",
    "displacements",
    "find_points",
    "find_regions",
]
