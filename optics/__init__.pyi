from .chamber import Chamber, ChamberResult
from .chamber_solve import dimension_for_ratio
from .scene_reading import read_scene, scene_from
from .thin_lens import LensImage, LensResult, ThinLens

__all__ = [
    "Chamber",
    "ChamberResult",
    "LensImage",
    "LensResult",
    "ThinLens",
    "dimension_for_ratio",
    "read_scene",
    "scene_from",
]
