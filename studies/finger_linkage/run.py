"""The study itself: from its spec to its results."""

from __future__ import annotations

from dataclasses import replace

import jax.numpy as jnp

from designopt.study.left_out import count_operations
from designopt.study.results import LeftOutRow, Results
from designopt.study.study import Context
from studies.finger_linkage import comparisons, statements
from studies.finger_linkage.comparing import Comparison, compare, precision_study
from studies.models.linkage_design import figures as drawings
from studies.models.linkage_design import tables
from studies.models.linkage_design.analysis import LinkageDesign, design_linkage
from studies.models.linkage_design.judging import everywhere
from studies.models.linkage_design.postures import find_postures
from studies.models.linkage_design.problem import grid
from studies.models.linkage_design.spec import FingerLinkageSpec
from studies.models.spec_files import linkage_file


def run(spec: FingerLinkageSpec, context: Context) -> Results:
    """Design the linkage, judge it, and compare the solvers.

    Raises:
        UserError: another float type than float64.
    """
    context.require_float64("finger-linkage solves its requirements to 1e-8")
    with context.step("Linkage: search and judgement"):
        design = design_linkage(spec, context.seed)
    compared = None
    if spec.precision:
        with context.step("Solvers, and differential evolution as the yardstick"):
            compared = compare(spec, design.search, context.seed)
    with context.step("Operations left out"):
        left_out = operations(spec, design)
    return Results(
        findings=statements.findings(spec, design, compared),
        metrics=statements.metrics(spec, design, compared),
        tables=[
            *tables.design_tables(spec, design),
            *([comparisons.table(compared)] if compared else []),
        ],
        figures=[*drawings.design_figures(spec, design), *_run_time(compared)],
        specs=[linkage_file(design.finger)],
        precision=precision_study(compared) if compared else None,
        left_out=left_out,
    )


def _run_time(compared: Comparison | None) -> list:
    return [comparisons.figure(compared)] if compared else []


def operations(spec: FingerLinkageSpec, design: LinkageDesign) -> list[LeftOutRow]:
    """Operations of the search's problem beside the general solver's, and beside all it asks."""
    last = design.search.rounds[-1].problem
    finger = design.finger
    flexion = jnp.asarray(grid(finger.body, spec.search.step_deg))
    square = jnp.stack(jnp.meshgrid(flexion, flexion, indexing="ij"), axis=-1)
    return [
        LeftOutRow(
            "six transmission angles over a square of postures",
            "what DIP alone decides is a row; no closure, no message, no body but those asked for",
            count_operations(
                lambda pins: find_postures(replace(finger, pins=pins), flexion, flexion).angles,
                finger.pins,
            ),
            count_operations(everywhere, finger.linkage(), -square),
        ),
        LeftOutRow(
            "least transmission angle alone",
            "the requirements: assembly, ratios and places",
            count_operations(lambda pins: last.terms(pins, *last.data).value, finger.pins),
            count_operations(lambda pins: last.terms(pins, *last.data), finger.pins),
        ),
    ]
