from .formatting import Active, active_set, conflict
from .iterating import Iterate, Iteration
from .minimising import Method, Minimiser, Optima, minimise
from .optimality import FEASIBLE, Optimum, OptimumResult
from .problem import (
    BOUND,
    Levelled,
    Parameters,
    Problem,
    Requirement,
    Terms,
    epigraph,
    level_starts,
    softened,
)
from .reference_solvers import Evolution, differential_evolution
from .starts import Starts, best_starts, sobol_starts

__all__ = [
    "BOUND",
    "FEASIBLE",
    "Active",
    "Evolution",
    "Iterate",
    "Iteration",
    "Levelled",
    "Method",
    "Minimiser",
    "Optima",
    "Optimum",
    "OptimumResult",
    "Parameters",
    "Problem",
    "Requirement",
    "Starts",
    "Terms",
    "active_set",
    "best_starts",
    "conflict",
    "differential_evolution",
    "epigraph",
    "level_starts",
    "minimise",
    "sobol_starts",
    "softened",
]
