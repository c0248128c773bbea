"""Every solver behind one call and one answer."""

from __future__ import annotations

import time
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal, cast, get_args

import jax
import jax.numpy as jnp
import numpy as np

from designopt.optimize.augmented_lagrangian import Inner, Trace, augmented_lagrangian
from designopt.optimize.flat import Flat, Given
from designopt.optimize.optimality import Optimum, make_optimality_check
from designopt.optimize.problem import Parameters, Problem
from designopt.programs import QuickJit

Method = Literal[
    "bfgs",
    "levenberg-marquardt",
    "jaxopt-lbfgsb",
    "jaxopt-projected-gradient",
    "slsqp",
    "trust-constr",
]


@dataclass(frozen=True)
class Optima:
    """What all starts led to.

    Attributes:
        found: one optimum per start, in the order of the starts.
        seconds: run time of the solves, without compiling and judging.
        compile_seconds: time to compile them.
    """

    found: tuple[Optimum, ...]
    seconds: float
    compile_seconds: float

    @property
    def best(self) -> Optimum:
        """The feasible one of least objective; if none is feasible, the one of least violation."""
        return min(self.found, key=_rank)

    @property
    def feasible(self) -> list[Optimum]:
        """Those that meet all requirements, the best one first."""
        return sorted((one for one in self.found if one.feasible), key=_rank)


def _rank(one: Optimum) -> tuple[bool, float]:
    if one.feasible:
        return False, one.objective
    return True, one.violation if np.isfinite(one.objective) else float("inf")


class Minimizer:
    """A problem and a solver, compiled once for a number of starts."""

    def __init__(
        self,
        problem: Problem,
        count: int,
        method: Method = "bfgs",
        *,
        floor: float | None = None,
        tolerance: float = 1e-8,
        updates: int = 12,
        steps: int = 150,
    ) -> None:
        """Compile.

        Args:
            problem: its terms must not have ``least``: see `make_epigraph` and
                `make_soft_minimum`.
            count: number of starts that will be solved in one call.
            method: the solver. The first four run all starts in one vectorised program, constraints
                (and bounds, for Optimistix, which has none) by an augmented Lagrangian around
                them; SciPy's run one after the other.
            floor: as in `augmented_lagrangian`; for ``"levenberg-marquardt"`` only.
            tolerance: in scaled units; see `augmented_lagrangian`.
            updates: cap on updates of the multipliers.
            steps: cap on steps between two of them; SciPy's solvers have updates × steps.

        Raises:
            ValueError: the terms have ``least``, there is no such method, or it needs what is not
                given.
        """
        if method not in get_args(Method):
            raise ValueError(f"no method {method!r}: choose from {', '.join(get_args(Method))}")
        self.flat = flat = Flat.of(problem)
        self._check = make_optimality_check(flat)
        points = jnp.zeros((count, flat.units.size), flat.units.dtype)
        flat.refuse_least("minimize")
        begin = time.perf_counter()
        # Its SciPy takes half a second to load, and many who load this never search.
        from designopt.optimize.reference_solvers import Reference, compile_reference

        if method in get_args(Reference):
            reference = cast(Reference, method)
            one = compile_reference(flat, reference, tolerance, updates * steps)
            self._solve = partial(_one_by_one, one)
        else:
            caps: Any = {"tolerance": tolerance, "updates": updates, "steps": steps}

            def local(start: Any, given: Given) -> tuple[Any, Trace]:
                inner = cast(Inner, method)
                return augmented_lagrangian(flat.given(given), inner, start, floor=floor, **caps)

            # Compiled ahead, so that its time is apart from the solves', and the same for all data.
            name = flat.name(f"{method} {caps} {floor}")
            program = QuickJit(jax.vmap(local, (0, None)), name=name).compile(points, flat.own)
            self._solve = partial(_together, program)
        self.compile_seconds = time.perf_counter() - begin

    def solve(self, starts: Parameters, problem: Problem | None = None) -> Optima:
        """Solve from every start.

        Args:
            starts: parameters with the starts along every array's first axis.
            problem: one that differs from what was compiled in its data, of the same shapes, and in
                finite bounds alone; that itself by default.
        """
        given = (self.flat if problem is None else Flat.of(problem)).own
        points = jax.vmap(self.flat.point)(starts)
        begin = time.perf_counter()
        found, traces = self._solve(points, given)
        seconds = time.perf_counter() - begin
        judged = zip(found, traces, strict=True)
        optima = (self._check(point, given, trace) for point, trace in judged)
        return Optima(tuple(optima), seconds, self.compile_seconds)


def _one_by_one(one: Any, starts: Any, given: Given) -> tuple[list[Any], list[Trace]]:
    solved = [one(np.asarray(start), given) for start in starts]
    points = [jnp.asarray(point, starts.dtype) for point, _ in solved]
    return points, [trace for _, trace in solved]


def _together(program: Any, starts: Any, given: Given) -> tuple[Any, list[Trace]]:
    found, traces = jax.block_until_ready(program(starts, given))
    return found, [jax.tree.map(lambda leaf, i=i: leaf[i], traces) for i in range(len(found))]


def minimize(
    problem: Problem, starts: Parameters, method: Method = "bfgs", **settings: Any
) -> Optima:
    """Solve a problem from every start; a `Minimizer` that is used once.

    Args:
        problem: as in `Minimizer`.
        starts: parameters with the starts along every array's first axis.
        method: as in `Minimizer`.
        settings: the other settings of `Minimizer`.

    Example:
        >>> import jax.numpy as jnp
        >>> from designopt.optimize import Evaluation
        >>> problem = Problem(
        ...     lambda x: Evaluation(objective=(x[0] - 2) ** 2 + x[1] ** 2),
        ...     jnp.zeros(2),
        ...     jnp.ones(2),
        ... )
        >>> best = minimize(problem, jnp.full((1, 2), 0.5), "slsqp").best
        >>> [round(v, 6) for v in best.parameters.tolist()], best.feasible
        ([1.0, 0.0], True)
    """
    count = jax.tree.leaves(starts)[0].shape[0]
    return Minimizer(problem, count, method, **settings).solve(starts)
