"""The function `optimise`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import jax

from designopt.design_kind import Design
from designopt.designs import load_design
from designopt.errors import UserError
from designopt.optimising.asked import Asked, parse_over
from designopt.optimize.parametric import ParametricDesign
from designopt.optimize.search_result import SearchResult, SearchStep


def optimise(
    design: ParametricDesign | Design | str | Path,
    *,
    maximise: str | None = None,
    minimise: str | None = None,
    free: Sequence[str] = (),
    keep: Sequence[str] = (),
    over: Sequence[str] = (),
    starts: int = 1,
    seed: int = 0,
    on_step: Callable[[SearchStep], None] = lambda step: None,
) -> SearchResult:
    """Improve a design in one measure, within bounds, with all its requirements kept.

    Args:
        design: a file of a linkage, a scene, a chamber or a finger; a study; a folder of a result;
            or what `load_design` returned, or its ``parametric()``.
        maximise: the measure to improve, such as ``min_transmission`` or ``coverage``; the design's
            first one by default.
        minimise: a measure whose greatest value counts, instead.
        free: parameters that may change, each ``"NAME"`` or ``"NAME=low:high"``, or the beginning
            of several names; by default those that the design frees, in its bounds.
        keep: requirements beyond the design's own, such as ``"mu.B>=40"``.
        over: ends of joints or inputs between which the design is measured, such as
            ``"crank=0:360"``; its own by default.
        starts: from how many starts: the design as it is, and random ones.
        seed: of these.
        on_step: called after every iteration.

    Returns:
        What was found, judged apart from the search, what holds it and what that costs; or which
        requirements conflict.

    Raises:
        UserError: the design cannot be read, or what is asked for makes no sense for it.

    Example:
        >>> found = optimise(
        ...     "studies/gallery/linkages/four-bar.toml",
        ...     maximise="min_transmission",
        ...     free=["bodies.coupler.A-B=90:150"],
        ... )
        >>> found.judged["min_transmission"] > found.judged_before["min_transmission"]
        True
    """
    if over and isinstance(design, ParametricDesign):
        raise UserError("over: these are numbers already; give the range where they are made")
    with jax.enable_x64(True):
        if not isinstance(design, ParametricDesign):
            loaded = design if isinstance(design, Design) else load_design(str(design))
            design = loaded.parametric(parse_over(over))
        asked = Asked.of(maximise, minimise, free, keep)
        direction = None if not (maximise or minimise) else bool(maximise)
        found = asked.search(design, direction)
        step = None
        for step in found.steps(design.values(), starts, seed):
            on_step(step)
        assert step is not None
        assert step.result is not None
        return step.result
