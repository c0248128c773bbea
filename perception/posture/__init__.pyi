from .bending import Bends, fit_bend
from .boundary import make_boundary_image, shrink
from .estimate import USABLE, PostureEstimate, find_posture
from .estimator import PostureEstimator
from .marker_errors import compute_marker_errors, compute_mean_predictor_error
from .network import PostureNetwork, compute_weighted_loss
from .settings import EQUAL_WEIGHTS, Training, TrainingRecord
from .training import train

__all__ = [
    "EQUAL_WEIGHTS",
    "USABLE",
    "Bends",
    "PostureEstimate",
    "PostureEstimator",
    "PostureNetwork",
    "Training",
    "TrainingRecord",
    "compute_marker_errors",
    "compute_mean_predictor_error",
    "compute_weighted_loss",
    "find_posture",
    "fit_bend",
    "make_boundary_image",
    "shrink",
    "train",
]
