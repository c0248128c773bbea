from .io.reading import linkage_from, read_linkage
from .io.writer import linkage_text, write_linkage
from .model.grashof import Grashof, grashof
from .model.linkage import Line, Link, Linkage, Spring, Vector
from .model.loops import Loop, vector_loops
from .solve.assemblies import Assemblies, assemblies
from .solve.limits import Limit, Limits, find_limits, turning_point
from .solve.plan import describe
from .solve.poses import PoseResult, solve_poses
from .solve.rates import Motion, Rates, solve_rates
from .solve.solver import Pose
from .solve.statics import input_efforts, input_slopes, mechanical_advantage, spring_energy
from .solve.steps import PlanError
from .solve.tolerance import Spread, no_deviations, output_spread
from .solve.transmission import Transmission, solve_transmission

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
    "linkage_text",
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
    "write_linkage",
]
