from .boundary import boundary_image, shrunk
from .estimator import PostureEstimator
from .measures import marker_errors, mean_predictor_error
from .network import PostureNetwork, weighted_loss
from .settings import DISTANCE_WEIGHTS, EQUAL_WEIGHTS, Training, TrainingRecord
from .training import train

__all__ = [
    "DISTANCE_WEIGHTS",
    "EQUAL_WEIGHTS",
    "PostureEstimator",
    "PostureNetwork",
    "Training",
    "TrainingRecord",
    "boundary_image",
    "marker_errors",
    "mean_predictor_error",
    "shrunk",
    "train",
    "weighted_loss",
]
