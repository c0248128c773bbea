from .camera import Camera, Equidistant, KannalaBrandt, Pinhole, Projection
from .chamber import Chamber, ChamberResult
from .chamber_solve import dimension_for_ratio
from .edge_refined import trace_views
from .fabrication import Fabrication, as_made, errors_of, fabrication_names
from .focus import Focus, find_focus
from .imaging import Imaging
from .outlines import Outlines, find_corners, find_outlines
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
    "Fabrication",
    "Focus",
    "Hits",
    "Imaging",
    "KannalaBrandt",
    "Layout",
    "LensImage",
    "LensResult",
    "Outlines",
    "Pieces",
    "Pinhole",
    "Projection",
    "Scene",
    "ThinLens",
    "ViewResult",
    "as_made",
    "describe_end",
    "dimension_for_ratio",
    "errors_of",
    "fabrication_names",
    "find_corners",
    "find_coverage",
    "find_focus",
    "find_outlines",
    "find_views",
    "path_names",
    "read_scene",
    "scene_from",
    "trace_rays",
    "trace_views",
]
