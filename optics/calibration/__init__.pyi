from .bundle import Poses, Sightings
from .calibrated import CalibratedLens, format_lens, read_lens, write_lens
from .fisheye import Fisheye
from .guidance import DeviationMap, Suggestion, predict_deviations, suggest_pictures
from .lens import HeldOut, LensFit, PupilModel, calibrate_lens, locate_boards

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
    "calibrate_lens",
    "format_lens",
    "locate_boards",
    "predict_deviations",
    "read_lens",
    "suggest_pictures",
    "write_lens",
]
