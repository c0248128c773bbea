from .designs import load_design
from .errors import UserError
from .fitting import Fit, least_squares
from .io.spec import Spec
from .io.toml_writing import format_toml
from .numerics import as_float, safe_arctan2, safe_divide, safe_quadratic_roots, safe_sqrt
from .optimising.optimise import optimise
from .roots import find_root
from .solution import Solution, combine_checks
from .study.benchmark import (
    BenchmarkMethod,
    Ratio,
    benchmark,
    compile_methods,
    compile_timed,
    find_dominating,
    find_undominated,
    one_core,
)
from .study.left_out import count_operations
from .study.records import Records
from .study.report import Report
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
from .study.runner import run_study
from .study.settings import setting
from .study.stability import Family, assess
from .study.study import Context, Study, lazily
from .vectors import Vector, direction_to_meeting, fold_angle

__version__: str

__all__ = [
    "BenchmarkMethod",
    "Claim",
    "Context",
    "Family",
    "Figure",
    "Fit",
    "LeftOutRow",
    "Metric",
    "PrecisionRow",
    "PrecisionStudy",
    "Ratio",
    "Records",
    "Report",
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
    "benchmark",
    "combine_checks",
    "compile_methods",
    "compile_timed",
    "count_operations",
    "direction_to_meeting",
    "find_dominating",
    "find_root",
    "find_undominated",
    "fold_angle",
    "format_toml",
    "lazily",
    "least_squares",
    "load_design",
    "one_core",
    "optimise",
    "run_study",
    "safe_arctan2",
    "safe_divide",
    "safe_quadratic_roots",
    "safe_sqrt",
    "setting",
]
