"""The study itself: from its spec to its results."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import jax.numpy as jnp
import numpy as np

from designopt.design_kind import Design
from designopt.study.left_out import count_operations
from designopt.study.report import Report
from designopt.study.results import Results
from designopt.study.study import Context
from kinematics.design import LINKAGE
from kinematics.io.designed import DesignedLinkage
from studies.benchmarks.measuring import listed
from studies.finger_linkage.front import add_front, find_front
from studies.finger_linkage.solvers import add_comparison, compare
from studies.models.designed import designed_linkage
from studies.models.finger import Finger
from studies.models.finger_file import packaged_or_designed
from studies.models.linkage_design.analysis import LinkageDesign, design_linkage, search_linkage
from studies.models.linkage_design.coupling.judging import CoupledVerdict
from studies.models.linkage_design.figures import add_figures
from studies.models.linkage_design.judging import Verdict, everywhere
from studies.models.linkage_design.postures import find_postures
from studies.models.linkage_design.problem import grids
from studies.models.linkage_design.spec import DECIDING, FingerLinkageSpec, is_usual_but
from studies.models.linkage_design.tables import add_tables
from studies.models.spec_files import linkage_file
from studies.models.words import words_of

WITHOUT_PINCH = {"limits": {"pinch_force": 0.0}, "links": {"shell": 0.7}}
"""Settings in which no pinch has to hold, with the walls of that search."""

ASKED, ELSEWHERE = 45.8, 46.11
"""Least transmission angle asked for with these settings, a target of this project, and what an
independent search reached with as much room between bars, axles and faces; degrees."""

SAME_DEG = 0.02
"""Starts that end within this of the best count as having reached it, degrees."""


def run(spec: FingerLinkageSpec, context: Context) -> Results:
    """Design the linkage, judge it, and compare the solvers.

    Raises:
        UserError: another float type than float64.
    """
    context.require_float64("finger-linkage solves its requirements to 1e-8")
    words = words_of("studies.finger_linkage", "studies.models.linkage_design")
    out = Report(spec, words)
    with context.step("Linkage: search and judgement"):
        found = design_linkage(spec, context.seed)
    if isinstance(found.verdict, CoupledVerdict):
        add_coupled(out, spec, found, found.verdict)
        return out.results()
    add_metrics(out, spec, found, found.verdict)
    add_findings(out, spec, found, found.verdict)
    add_tables(out, spec.limits, found)
    add_figures(out, spec.limits, found)
    with context.step("Front of the least angle against the bound on φ₂/φ₁"):
        add_front(out, spec, find_front(spec, found.search, context.seed))
    if spec.precision:
        with context.step("Solvers, and differential evolution as the yardstick"):
            add_comparison(out, *compare(spec, found.search, context.seed))
    out.file(linkage_file(found.finger))
    with context.step("Operations left out"):
        add_operations(out, spec, found)
    return out.results()


def design(spec: FingerLinkageSpec, folder: Path | None) -> Design:
    """The linkage that the study designs for these settings, driven at its joints.

    Args:
        spec: the study's settings.
        folder: the ``specs`` of an earlier result with them; the package has that of the default.

    Raises:
        UserError: the folder lacks its file, or it has been spoilt.
    """
    if folder is not None:
        return Design(LINKAGE, DesignedLinkage.read(folder / "linkage.toml"))

    def designed(context: Context) -> Finger:
        return search_linkage(spec, context.seed).finger

    finger = packaged_or_designed(spec, DECIDING, designed)
    return Design(LINKAGE, designed_linkage(finger, "finger-linkage"))


def add_coupled(
    out: Report, spec: FingerLinkageSpec, found: LinkageDesign, verdict: CoupledVerdict
) -> None:
    """A coupled finger's linkage; comparisons of solvers and bounds on φ₂/φ₁ are the six-bar's."""
    out.values(requirements=len(verdict.checks) + 1)
    out.metric("min_transmission_angle_deg", verdict.least_deg, "least-coupled")
    out.metrics(unmet_requirements=len(found.unmet))
    out.metric("dip_end_deg", verdict.dip_deg[-1])
    out.say("coupled", pip=verdict.pip_deg[-1])
    if found.unmet:
        out.say("coupled_unmet", unmet=listed([one.name for one in found.unmet]))
    if conflict := found.search.conflict():
        out.say("conflict", conflict=listed(conflict))
    if held := [one.words for one in found.search.held_by()[:6]]:
        out.say("held", held=listed(held))
    add_tables(out, spec.limits, found)
    add_figures(out, spec.limits, found)
    out.file(linkage_file(found.finger))


def add_metrics(
    out: Report, spec: FingerLinkageSpec, found: LinkageDesign, verdict: Verdict
) -> None:
    """The study's numbers; the search's target is that of settings without pinch."""
    limits = spec.limits
    searched = is_usual_but(spec, WITHOUT_PINCH)
    asked, elsewhere = (ASKED, ELSEWHERE) if searched else (None, None)
    reached = found.search.rounds[0].feasible_deg
    out.values(requirements=len(verdict.checks) + 1, asked=asked or limits.transmission_deg)
    entry = "least-of-six" if elsewhere is None else "least-of-six-elsewhere"
    out.metric("min_transmission_angle_deg", verdict.least_deg, entry, elsewhere=elsewhere)
    out.metrics(
        unmet_requirements=len(found.unmet),
        crank_range_deg=verdict.crank_range_deg,
        largest_force_ratio=verdict.ratio.max(),
        smallest_force_ratio=verdict.ratio.min(),
    )
    for angle, values in verdict.angles_deg.items():
        out.metric(f"least_{angle}_deg", np.min(values), "least-angle", angle=angle)
    out.metrics(
        starts_feasible=len(reached),
        starts_spread_deg=max(reached) - min(reached) if reached else math.nan,
        tolerance_mean_deg=np.mean(found.drawn),
        tolerance_deviation_deg=np.std(found.drawn),
        search_seconds=found.search.seconds,
        compile_seconds=found.search.compile_seconds,
    )


def add_findings(
    out: Report, spec: FingerLinkageSpec, found: LinkageDesign, verdict: Verdict
) -> None:
    """What was found, most important first."""
    required, least = spec.limits.transmission_deg, found.verdict.least_deg
    conflict = found.search.conflict()
    if not found.unmet:
        less = f", less than the {required:g}° required: this requirement gave way"
        out.say("met", gave="" if least > required else less)
    elif conflict:
        out.say("conflict", conflict=listed(conflict))
    else:
        reached = "{0.name} ({0.achieved:.3g} for {0.required:g} {0.unit}"
        out.say("unmet", unmet=listed([f"{reached.format(one).strip()})" for one in found.unmet]))
    if held := [one.words for one in found.search.held_by()[:6]]:
        out.say("held", held=listed(held))
    if reached := found.search.rounds[0].feasible_deg:
        best = max(reached)
        same = sum(level >= best - SAME_DEG for level in reached)
        out.say("starts", low=min(reached), high=best, same=same)
    out.say("tolerance", above=np.mean(found.drawn > required), count=len(found.drawn))
    pip, dip = (np.unique(part.x).size for part in found.search.rounds[-1].problem.data[1:])
    out.say("postures", pip=pip, dip=dip, postures=verdict.crank_deg.size)
    if spec.precision:
        out.say("time")


def add_operations(out: Report, spec: FingerLinkageSpec, found: LinkageDesign) -> None:
    """Operations of the search's problem beside the general solver's, and beside all it asks."""
    last, finger = found.search.rounds[-1].problem, found.finger
    pip, dip = map(jnp.asarray, grids(finger.body, spec.search.step_deg))
    square = jnp.stack(jnp.meshgrid(pip, dip, indexing="ij"), axis=-1)
    angles = count_operations(
        lambda pins: find_postures(replace(finger, pins=pins), pip, dip).angles, finger.pins
    )
    out.operations("angles", angles, count_operations(everywhere, finger.linkage(), -square))
    least = count_operations(lambda pins: last.terms(pins, *last.data).value, finger.pins)
    terms = count_operations(lambda pins: last.terms(pins, *last.data), finger.pins)
    out.operations("least-angle", least, terms)
