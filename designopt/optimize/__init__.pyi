from .iterating import Iterate, Iteration
from .minimizer import Method, Minimizer, Optima, minimize
from .optimality import (
    FEASIBLE,
    Active,
    Optimum,
    OptimumResult,
    explain_conflict,
    explain_shortfall,
    find_active_set,
)
from .parametric import Measure, MeasureBound, Parameter, ParametricDesign, Values, shortfalls
from .problem import (
    BOUND,
    EpigraphVariables,
    Evaluation,
    Parameters,
    Problem,
    Requirement,
    make_elastic,
    make_epigraph,
    make_epigraph_starts,
    make_soft_minimum,
)
from .reference_solvers import Evolution, run_differential_evolution
from .starts import Starts, draw_sobol_starts, select_starts

__all__ = [
    "BOUND",
    "FEASIBLE",
    "Active",
    "EpigraphVariables",
    "Evaluation",
    "Evolution",
    "Iterate",
    "Iteration",
    "Measure",
    "MeasureBound",
    "Method",
    "Minimizer",
    "Optima",
    "Optimum",
    "OptimumResult",
    "Parameter",
    "Parameters",
    "ParametricDesign",
    "Problem",
    "Requirement",
    "Starts",
    "Values",
    "draw_sobol_starts",
    "explain_conflict",
    "explain_shortfall",
    "find_active_set",
    "make_elastic",
    "make_epigraph",
    "make_epigraph_starts",
    "make_soft_minimum",
    "minimize",
    "run_differential_evolution",
    "select_starts",
    "shortfalls",
]
