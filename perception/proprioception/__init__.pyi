from .bounds import Bound, information_bound
from .calibration import Calibration, CalibrationResult, calibrate
from .corners import CornerModel, FingerErrors, JointAngleResult, JointAngles, find_pose
from .edge import EdgeCurve, EdgeRuler, fit_edges
from .estimate import Estimate, estimates_of, first_defined, undefined
from .gap import GapMeter, GapTable, calibrate_gap
from .misfit import Misfit
from .observation import Observation, observe, stack_observations

__all__ = [
    "Bound",
    "Calibration",
    "CalibrationResult",
    "CornerModel",
    "EdgeCurve",
    "EdgeRuler",
    "Estimate",
    "FingerErrors",
    "GapMeter",
    "GapTable",
    "JointAngleResult",
    "JointAngles",
    "Misfit",
    "Observation",
    "calibrate",
    "calibrate_gap",
    "estimates_of",
    "find_pose",
    "first_defined",
    "fit_edges",
    "information_bound",
    "observe",
    "stack_observations",
    "undefined",
]
