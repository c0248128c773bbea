from .chamber.chamber import Chamber, ChamberResult
from .chamber.file import chamber_text, read_chamber, write_chamber
from .chamber.ratio import dimension_for_ratio
from .scene.camera import Camera, Equidistant, KannalaBrandt, Pinhole, Projection
from .scene.fabrication import Fabrication, as_made, errors_of, fabrication_names
from .scene.imaging import Imaging
from .scene.reading import read_scene, scene_from
from .scene.scene import Layout, Scene
from .scene.thin_lens import LensImage, LensResult, ThinLens
from .scene.writer import scene_text, write_scene
from .visibility.coverage import find_coverage, find_views
from .visibility.edge_refined import trace_views
from .visibility.focus import Focus, find_focus
from .visibility.outlines import Outlines, find_corners, find_outlines
from .visibility.tracing import Hits, trace_rays
from .visibility.views import Pieces, ViewResult, describe_end, path_names

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
    "chamber_text",
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
    "read_chamber",
    "read_scene",
    "scene_from",
    "scene_text",
    "trace_rays",
    "trace_views",
    "write_chamber",
    "write_scene",
]
