from .linkage import Line, Link, Linkage, Spring
from .loops import vector_loops
from .plan import PlanError, describe
from .poses import PoseResult, solve_poses
from .rates import Motion, Rates, solve_rates
from .reading import linkage_from, read_linkage
from .solver import Pose
from .vectors import Vector, folded_angle

__all__ = [
    "Line",
    "Link",
    "Linkage",
    "Motion",
    "PlanError",
    "Pose",
    "PoseResult",
    "Rates",
    "Spring",
    "Vector",
    "describe",
    "folded_angle",
    "linkage_from",
    "read_linkage",
    "solve_poses",
    "solve_rates",
    "vector_loops",
]
