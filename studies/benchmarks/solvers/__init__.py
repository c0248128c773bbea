"""Solvers of our own beside those of Optimistix, jaxopt and SciPy, on three problems."""

from designopt.io.spec import Spec
from designopt.study.settings import setting
from designopt.study.study import Study, lazily


class SolverPrecisionSpec(Spec):
    """All settings of ``designopt run solver-precision``."""

    angles: int = setting(10_000, "wall angles in the batch for η", free=True, ge=1, le=10_000_000)
    minimizers: bool = setting(
        True, "minimisers of the grasp's energy, which take a minute to compile", free=True
    )
    repeats: int = setting(5, "timed repeats of each setting", free=True, ge=3, le=1000)


STUDY = Study(
    name="solver-precision",
    purpose="Error against run time of solvers: a grasp's equilibrium, the chamber's η, a box",
    spec=SolverPrecisionSpec,
    run=lazily("studies.benchmarks.solvers.run:run"),
)
