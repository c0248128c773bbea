from .chamber.chamber import Chamber, ChamberResult
from .chamber.file import format_chamber, read_chamber, write_chamber
from .chamber.ratio import solve_dimension_for_ratio
from .scene.camera import (
    Camera,
    Equidistant,
    Equisolid,
    KannalaBrandt,
    Orthographic,
    Pinhole,
    Projection,
    Sensor,
    Stereographic,
)
from .scene.camera_module import CameraModule
from .scene.fabrication import Fabrication, name_fabrication_errors, perturb, scale_errors
from .scene.imaging import Imaging
from .scene.reading import parse_scene, read_scene
from .scene.scene import Layout, Scene
from .scene.thin_lens import LensImage, LensResult, ThinLens
from .scene.writer import format_scene, write_scene
from .visibility.corners_in_space import (
    find_corners_in_space,
    find_places_in_space,
    find_sides_in_space,
)
from .visibility.coverage import find_coverage, find_views
from .visibility.edge_refined import trace_views
from .visibility.focus import Focus, find_blur, find_focus
from .visibility.outline_edges import OutlineEdges, find_outline_edges, name_bound
from .visibility.outlines import Outlines, find_corners, find_outlines
from .visibility.second_images import (
    SecondOutlines,
    Wall,
    clear_walls,
    describe_second_end,
    find_second_images,
    find_second_outlines,
)
from .visibility.tracing import Hits, trace_rays
from .visibility.views import Pieces, ViewResult, describe_end, name_paths

__all__ = [
    "Camera",
    "CameraModule",
    "Chamber",
    "ChamberResult",
    "Equidistant",
    "Equisolid",
    "Fabrication",
    "Focus",
    "Hits",
    "Imaging",
    "KannalaBrandt",
    "Layout",
    "LensImage",
    "LensResult",
    "Orthographic",
    "OutlineEdges",
    "Outlines",
    "Pieces",
    "Pinhole",
    "Projection",
    "Scene",
    "SecondOutlines",
    "Sensor",
    "Stereographic",
    "ThinLens",
    "ViewResult",
    "Wall",
    "clear_walls",
    "describe_end",
    "describe_second_end",
    "find_blur",
    "find_corners",
    "find_corners_in_space",
    "find_coverage",
    "find_focus",
    "find_outline_edges",
    "find_outlines",
    "find_places_in_space",
    "find_second_images",
    "find_second_outlines",
    "find_sides_in_space",
    "find_views",
    "format_chamber",
    "format_scene",
    "name_bound",
    "name_fabrication_errors",
    "name_paths",
    "parse_scene",
    "perturb",
    "read_chamber",
    "read_scene",
    "scale_errors",
    "solve_dimension_for_ratio",
    "trace_rays",
    "trace_views",
    "write_chamber",
    "write_scene",
]
