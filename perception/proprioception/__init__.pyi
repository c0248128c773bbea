from .bounds import Bound, compute_information_bound
from .calibration import Calibration, CalibrationResult, calibrate
from .corners import CornerModel, FingerErrors, JointAngleResult, JointAngles, find_pose
from .edge import EdgeCurve, EdgeEstimator, fit_edges
from .estimate import Estimate, make_undefined, select_defined, split_estimates
from .gap import GapEstimator, GapTable, calibrate_gap
from .guidance import LabelAdvice, suggest_labels
from .misfit import Misfit
from .observation import Observation, observe, stack_observations

__all__ = [
    "Bound",
    "Calibration",
    "CalibrationResult",
    "CornerModel",
    "EdgeCurve",
    "EdgeEstimator",
    "Estimate",
    "FingerErrors",
    "GapEstimator",
    "GapTable",
    "JointAngleResult",
    "JointAngles",
    "LabelAdvice",
    "Misfit",
    "Observation",
    "calibrate",
    "calibrate_gap",
    "compute_information_bound",
    "find_pose",
    "fit_edges",
    "make_undefined",
    "observe",
    "select_defined",
    "split_estimates",
    "stack_observations",
    "suggest_labels",
]
