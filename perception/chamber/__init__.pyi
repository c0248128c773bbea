from .directions import Direction, compute_displacements, estimate_bending_direction
from .heights import ChamberMap, Heights, Movements, compute_movements, estimate_scatter
from .points import Points, find_points
from .regions import IN_VIEW, ChamberStatus, Region, Regions, find_regions
from .surfaces import Shape, SurfaceKind, classify_surface, measure_shape

__all__ = [
    "IN_VIEW",
    "ChamberMap",
    "ChamberStatus",
    "Direction",
    "Heights",
    "Movements",
    "Points",
    "Region",
    "Regions",
    "Shape",
    "SurfaceKind",
    "classify_surface",
    "compute_displacements",
    "compute_movements",
    "estimate_bending_direction",
    "estimate_scatter",
    "find_points",
    "find_regions",
    "measure_shape",
]
