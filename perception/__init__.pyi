from .detection import find_quads, find_views
from .differences import References, difference
from .lens import Lens, TangentPlane
from .matching import Catalogue, Family, Sighting, View, match
from .paper_route import PaperRoute
from .quads import Quad, fit_quad
from .quality import Quality
from .unwarping import best_view, image_of, pad_of, unwarp

__all__ = [
    "Catalogue",
    "Family",
    "Lens",
    "PaperRoute",
    "Quad",
    "Quality",
    "References",
    "Sighting",
    "TangentPlane",
    "View",
    "best_view",
    "difference",
    "find_quads",
    "find_views",
    "fit_quad",
    "image_of",
    "match",
    "pad_of",
    "unwarp",
]
