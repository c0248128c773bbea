from .bounds import Bound, information_bound
from .calibration import Calibration, calibrate
from .corners import CornerModel, Pose, find_pose
from .edge import EdgeCurve, EdgeRuler, fit_edges
from .estimate import Estimate, first_defined, undefined
from .gap import GapMeter, GapTable, calibrate_gap
from .observation import Observation, observe, stack_observations

__all__ = [
    "Bound",
    "Calibration",
    "CornerModel",
    "EdgeCurve",
    "EdgeRuler",
    "Estimate",
    "GapMeter",
    "GapTable",
    "Observation",
    "Pose",
    "calibrate",
    "calibrate_gap",
    "find_pose",
    "first_defined",
    "fit_edges",
    "information_bound",
    "observe",
    "stack_observations",
    "undefined",
]
