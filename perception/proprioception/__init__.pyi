from .bounds import Bound, information_bound
from .calibration import Calibration, calibrate
from .corners import CornerModel, PoseSolver
from .edge import EdgeCurve, EdgeRuler, fit_edges
from .estimate import UNDEFINED, Estimate
from .gap import GapMeter, GapTable, calibrate_gap
from .observation import Observation, observe, stack_observations

__all__ = [
    "UNDEFINED",
    "Bound",
    "Calibration",
    "CornerModel",
    "EdgeCurve",
    "EdgeRuler",
    "Estimate",
    "GapMeter",
    "GapTable",
    "Observation",
    "PoseSolver",
    "calibrate",
    "calibrate_gap",
    "fit_edges",
    "information_bound",
    "observe",
    "stack_observations",
]
