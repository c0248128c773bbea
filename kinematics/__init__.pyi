from .assemblies import Assemblies, assemblies
from .grashof import Grashof, grashof
from .limits import Limit, Limits, find_limits, turning_point
from .linkage import Line, Link, Linkage, Spring, Vector
from .loops import Loop, vector_loops
from .plan import describe
from .poses import PoseResult, solve_poses
from .rates import Motion, Rates, solve_rates
from .reading import linkage_from, read_linkage
from .solver import Pose
from .statics import input_efforts, input_slopes, mechanical_advantage, spring_energy
from .steps import PlanError
from .tolerance import Spread, no_deviations, output_spread
from .transmission import Transmission, solve_transmission

__all__ = [
    "Assemblies",
    "Grashof",
    "Limit",
    "Limits",
    "Line",
    "Link",
    "Linkage",
    "Loop",
    "Motion",
    "PlanError",
    "Pose",
    "PoseResult",
    "Rates",
    "Spread",
    "Spring",
    "Transmission",
    "Vector",
    "assemblies",
    "describe",
    "find_limits",
    "grashof",
    "input_efforts",
    "input_slopes",
    "linkage_from",
    "mechanical_advantage",
    "no_deviations",
    "output_spread",
    "read_linkage",
    "solve_poses",
    "solve_rates",
    "solve_transmission",
    "spring_energy",
    "turning_point",
    "vector_loops",
]
