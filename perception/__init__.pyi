from .detection import detect_quads, detect_views
from .differences import References, compare_with_reference
from .lens import Lens, TangentPlane
from .matching import Sighting, View, ViewCatalog, ViewFamily, match_views
from .paper_route import PaperRoute
from .quads import Quad, fit_quad
from .quality import Quality
from .tags import find_tag_turns
from .unwarping import map_to_image, map_to_pad, select_view, unwarp

__all__ = [
    "Lens",
    "PaperRoute",
    "Quad",
    "Quality",
    "References",
    "Sighting",
    "TangentPlane",
    "View",
    "ViewCatalog",
    "ViewFamily",
    "compare_with_reference",
    "detect_quads",
    "detect_views",
    "find_tag_turns",
    "fit_quad",
    "map_to_image",
    "map_to_pad",
    "match_views",
    "select_view",
    "unwarp",
]
