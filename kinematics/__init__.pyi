from .io.reading import parse_linkage, read_linkage
from .io.writer import format_linkage, write_linkage
from .model.grashof import Grashof, classify_grashof
from .model.linkage import Line, Link, Linkage, Spring
from .model.loops import Loop, find_vector_loops
from .solve.assemblies import Assemblies, find_assemblies
from .solve.clearance import find_separation
from .solve.limits import Limit, Limits, find_limits, solve_turning_point
from .solve.packed import PackedPoses, compile_poses, pack_poses
from .solve.plan import describe_plan
from .solve.poses import PoseResult, solve_poses
from .solve.rates import Motion, Rates, solve_rates
from .solve.solver import Pose
from .solve.statics import (
    compute_spring_energy,
    solve_input_efforts,
    solve_input_slopes,
    solve_mechanical_advantage,
)
from .solve.steps import PlanError
from .solve.tolerance import Spread, make_zero_deviations, propagate_deviations
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
    "PackedPoses",
    "PlanError",
    "Pose",
    "PoseResult",
    "Rates",
    "Spread",
    "Spring",
    "Transmission",
    "classify_grashof",
    "compile_poses",
    "compute_spring_energy",
    "describe_plan",
    "find_assemblies",
    "find_limits",
    "find_separation",
    "find_vector_loops",
    "format_linkage",
    "make_zero_deviations",
    "pack_poses",
    "parse_linkage",
    "propagate_deviations",
    "read_linkage",
    "solve_input_efforts",
    "solve_input_slopes",
    "solve_mechanical_advantage",
    "solve_poses",
    "solve_rates",
    "solve_transmission",
    "solve_turning_point",
    "write_linkage",
]
