from .bundle import Poses, Sightings
from .calibrated import CalibratedLens, read_lens, write_lens
from .fisheye import Fisheye
from .guidance import DeviationMap, Suggestion
from .lens import HeldOut, LensFit, PupilModel, locate_boards

__all__ = [
    "CalibratedLens",
    "DeviationMap",
    "Fisheye",
    "HeldOut",
    "LensFit",
    "Poses",
    "PupilModel",
    "Sightings",
    "Suggestion",
    "locate_boards",
    "read_lens",
    "write_lens",
]
