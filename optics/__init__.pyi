from .camera import Camera, Equidistant, KannalaBrandt, Pinhole, Projection
from .chamber import Chamber, ChamberResult
from .chamber_solve import dimension_for_ratio
from .edge_refined import trace_views
from .focus import Focus, find_focus
from .scene import Layout, Scene
from .scene_reading import read_scene, scene_from
from .thin_lens import LensImage, LensResult, ThinLens
from .tracing import Hits, trace_rays
from .views import Pieces, ViewResult, describe_end, path_names
from .visibility import find_coverage, find_views

__all__ = [
    "Camera",
    "Chamber",
    "ChamberResult",
    "Equidistant",
    "Focus",
    "Hits",
    "KannalaBrandt",
    "Layout",
    "LensImage",
    "LensResult",
    "Pieces",
    "Pinhole",
    "Projection",
    "Scene",
    "ThinLens",
    "ViewResult",
    "describe_end",
    "dimension_for_ratio",
    "find_coverage",
    "find_focus",
    "find_views",
    "path_names",
    "read_scene",
    "scene_from",
    "trace_rays",
    "trace_views",
]
