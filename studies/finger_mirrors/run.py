"""The study itself: from its spec to its results."""

from __future__ import annotations

import equinox as eqx
import numpy as np

from designopt.study.results import Figure, PrecisionStudy, Results
from designopt.study.study import Context
from studies.finger_mirrors import left_out, solvers, statements, tables
from studies.finger_mirrors.findings import GIVEN, OPTIMUM, START, Case, Found, RayCheck
from studies.models.body import BodySpec
from studies.models.finger import Body, Finger
from studies.models.mirror_design import figures as drawings
from studies.models.mirror_design.design import design_mirrors
from studies.models.mirror_design.judging import (
    coverage_grid,
    judged,
    seen_by_rays,
    whole_degrees,
)
from studies.models.mirror_design.placement import poor_layout, reference_layout
from studies.models.mirror_design.spec import FingerMirrorsSpec, MirrorSpec
from studies.models.mirror_design.yields import monte_carlo, sensitivity
from studies.models.spec_files import scene_file

THIN_STARTS = 8
"""Random starts for the second body."""


def run(spec: FingerMirrorsSpec, context: Context) -> Results:
    """Design the mirrors, judge them, and compare the solvers.

    Raises:
        UserError: another float type than float64.
    """
    context.require_float64("finger-mirrors takes no more than 1e-9 of a pad for rounding")
    found = find(spec, context)
    operations = []
    if spec.left_out:
        with context.step("Operations left out"):
            operations = left_out.operations(found.after.scene)
    compared = None
    if found.runs:
        compared = PrecisionStudy(
            solvers.rows(found.runs),
            error="gap (pads) or violation",
            reference="the least objective that any solver of this run found with the "
            f"inequalities held to {solvers.HELD:g}; both computed outside of the solvers",
            claims=[statements.claim(found.runs)],
        )
    degrees = whole_degrees(spec.body.range_deg)
    yields = {case.name: case.yields for case in found.cases if case.name != START}
    pads = [pad.name for pad in found.after.scene.layout.pads]
    return Results(
        findings=statements.findings(spec, found),
        metrics=statements.metrics(spec, found),
        tables=tables.tables(spec, found),
        figures=[
            _views("views", found.after),
            _views("views_before", found.before),
            drawings.coverage_figure(found.squares, degrees),
            drawings.resolution_figure(
                {case.name: (case.scene, case.verdict) for case in (found.before, found.after)}
            ),
            drawings.yield_figure(yields, degrees, pads),
            drawings.sensitivity_figure(found.sensitivity),
        ],
        specs=[scene_file(found.design.finger)],
        precision=compared,
        left_out=operations,
    )


def _views(name: str, case: Case) -> Figure:
    title = f"The {case.name} in four poses"
    return drawings.views_figure(name, title, case.scene, case.verdict)


def find(spec: FingerMirrorsSpec, context: Context) -> Found:
    """Everything that is measured."""
    finger = Finger.of(Body.of(spec.body))
    design = design_mirrors(finger, spec, context)

    def case(name: str, finger: Finger) -> Case:
        # Draws that the search has not seen: its errors come from another generator.
        with context.step(f"Yield: {name}"):
            share = monte_carlo(
                finger,
                spec.tolerances,
                # Of what does not even show everything without errors, a tenth is enough.
                draws=spec.draws if name != START else max(spec.draws // 10, 10),
                seed=context.seed,
            )
        return Case(name, finger, finger.scene(), judged(finger), share)

    before = case(START, poor_layout(finger, spec.camera))
    after = case(OPTIMUM, design.finger)
    others, thin, thin_square = [], None, None
    if spec.body == BodySpec():
        others.append(case(GIVEN, reference_layout(finger, spec.camera)))
    if spec.thin:
        body = Body.of(spec.body.model_copy(update={"thickness": spec.thin}))
        settings = spec.model_dump(include=set(MirrorSpec.model_fields))
        settings["floor"] = min(spec.floor, spec.thin_floor)
        settings["search"]["starts"] = min(THIN_STARTS, spec.search.starts)
        slim = design_mirrors(Finger.of(body), MirrorSpec.model_validate(settings), context)
        thin = case(f"{OPTIMUM}, T = {spec.thin:g} mm", slim.finger)
        others.append(thin)
        thin_square = coverage_grid(thin.finger)
    with context.step("All pairs of angles"):
        squares = {one.name: coverage_grid(one.finger) for one in (before, after)}
    with context.step("Rays at the worst postures"):
        checks = [
            (one, _by_rays(one, spec.ray_poses, spec.rays))
            for one in (after, thin)
            if one is not None
        ]
    with context.step("Sensitivity to each tolerance"):
        tolerance = sensitivity(
            design.finger,
            spec.tolerances,
            draws=max(spec.draws // 5, 10),
            seed=context.seed + 1,
        )
    runs = []
    if spec.solvers != "none":
        with context.step("Solvers"):
            runs = solvers.compared(
                design, spec, spec.solvers, spec.evolution_seconds, context.seed
            )
    starts = [
        judged(eqx.combine(trial.start, design.finger)).mean_coverage for trial in design.trials
    ]
    return Found(
        design,
        before,
        after,
        others,
        thin,
        squares,
        thin_square,
        checks,
        tolerance,
        starts,
        runs,
    )


def _by_rays(case: Case, poses: int, rays: int) -> RayCheck:
    """Rays where errors hide something most often: the angles of both joints by rank."""
    names = [pad.name for pad in case.scene.layout.pads]
    shares = case.yields.by_pose
    # Of equal shares those with the least resolution come first.
    pairs = [
        np.lexsort((case.verdict.px_per_mm[:, names.index(pad)], shares[:, names.index(pad)]))
        for pad in ("proximal", "distal")
    ]
    degrees = case.verdict.degrees[np.stack(pairs, axis=-1)[:poses]]
    return RayCheck(degrees, seen_by_rays(case.scene, degrees, rays))
