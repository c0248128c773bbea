from .errors import UserError
from .fitting import Fit, least_squares
from .io.spec import Spec
from .io.toml_writing import format_toml
from .numerics import as_float, safe_arctan2, safe_divide, safe_quadratic_roots, safe_sqrt
from .roots import find_root
from .solution import Solution, combine_checks
from .study.left_out import count_operations
from .study.precision import Contender, compile_timed, find_dominating, measure
from .study.results import (
    Claim,
    Figure,
    LeftOutRow,
    Metric,
    PrecisionRow,
    PrecisionStudy,
    Results,
    SpecFile,
    StabilityRow,
    Table,
    Target,
)
from .study.stability import Family, assess
from .study.study import Context, Study
from .vectors import Vector, direction_to_meeting, fold_angle

__all__ = [
    "Claim",
    "Contender",
    "Context",
    "Family",
    "Figure",
    "Fit",
    "LeftOutRow",
    "Metric",
    "PrecisionRow",
    "PrecisionStudy",
    "Results",
    "Solution",
    "Spec",
    "SpecFile",
    "StabilityRow",
    "Study",
    "Table",
    "Target",
    "UserError",
    "Vector",
    "as_float",
    "assess",
    "combine_checks",
    "compile_timed",
    "count_operations",
    "direction_to_meeting",
    "find_dominating",
    "find_root",
    "fold_angle",
    "format_toml",
    "least_squares",
    "measure",
    "safe_arctan2",
    "safe_divide",
    "safe_quadratic_roots",
    "safe_sqrt",
]
