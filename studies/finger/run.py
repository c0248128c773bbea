"""The study itself: linkage, then mirrors in the space that it leaves, then the grasp check.

The links lie beside the sensing pads' width (`finger_linkage.analysis.sensor_room`), so that
mirrors have the whole section between the faces.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from designopt.study.results import Results
from designopt.study.study import Context
from studies.finger import drawings, statements, tables
from studies.finger.design import spring_from
from studies.finger.found import FingerDesign
from studies.finger.spec import FingerSpec
from studies.finger.spec_files import spec_files
from studies.models.grasp import figures as grasp_drawings
from studies.models.grasp.analysis import analyze
from studies.models.grasp.check import summary
from studies.models.grasp.spec import GraspSpec
from studies.models.linkage_design.analysis import design_linkage
from studies.models.linkage_design.figures import design_figures
from studies.models.linkage_design.tables import design_tables
from studies.models.mirror_design import figures as mirror_drawings
from studies.models.mirror_design.design import design_mirrors
from studies.models.mirror_design.yields import monte_carlo


def run(spec: FingerSpec, context: Context) -> Results:
    """Design a finger for its requirements, and say line by line which of them it meets.

    Raises:
        UserError: another float type than float64.
    """
    context.require_float64("finger solves its requirements to 1e-8")
    found = design(spec, context)
    lines = statements.lines(spec, found)
    linkage_spec = spec.linkage_spec()
    closings = [] if found.closings is None else [grasp_drawings.sequences(found.closings)]
    return Results(
        findings=statements.findings(spec, found, lines),
        metrics=statements.metrics(spec, found, lines),
        tables=[
            tables.requirements(lines),
            tables.dimensions(spec, found),
            *design_tables(linkage_spec, found.linkage),
        ],
        figures=[
            drawings.section_figure(found.finger),
            mirror_drawings.views_figure(
                "views",
                "What the camera sees in four poses",
                found.mirrors.scene,
                found.mirrors.verdict,
            ),
            *closings,
            *design_figures(linkage_spec, found.linkage),
        ],
        specs=spec_files(found.finger),
    )


PINCHES = 6
"""Places on the distal pad at which it pinches."""


def design(spec: FingerSpec, context: Context) -> FingerDesign:
    """Linkage, mirrors and grasp of a finger for its requirements."""
    with context.step("Linkage"):
        linkage = design_linkage(spec.linkage_spec(), context.seed)
    mirrors = design_mirrors(linkage.finger, spec.mirrors, context)
    finger = replace(mirrors.finger, spring=spring_from(spec.spring))
    with context.step("Yield of the mirrors"):
        share = monte_carlo(
            finger,
            spec.mirrors.tolerances,
            draws=spec.yield_draws,
            seed=context.seed,
        )
    closings, body = None, spec.body
    if linkage.verdict.assembles:
        settings = GraspSpec(
            body=spec.body,
            diameters=spec.spring.diameters,
            pinch_pip_deg=[body.range_deg / 3, 2 * body.range_deg / 3],
            pinch_at=np.linspace(body.axis_height, body.distal - body.rim, PINCHES).tolist(),
        )
        with context.step("Grasp"):
            closings = analyze(finger, settings, polygon=False)
    check = None if closings is None else summary(closings)
    return FingerDesign(finger, linkage, mirrors, share, check, closings)
