from .bending import Bends, bend_of_markers
from .boundary import boundary_image, shrunk
from .estimator import PostureEstimator
from .measures import marker_errors, mean_predictor_error
from .network import PostureNetwork, weighted_loss
from .seeing import USABLE, SeenPosture, find_posture
from .settings import EQUAL_WEIGHTS, Training, TrainingRecord
from .training import train

__all__ = [
    "EQUAL_WEIGHTS",
    "USABLE",
    "Bends",
    "PostureEstimator",
    "PostureNetwork",
    "SeenPosture",
    "Training",
    "TrainingRecord",
    "bend_of_markers",
    "boundary_image",
    "find_posture",
    "marker_errors",
    "mean_predictor_error",
    "shrunk",
    "train",
    "weighted_loss",
]
