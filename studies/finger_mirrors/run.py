"""The study itself: from its spec to its results."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from designopt import Context, Records, Report, Results, count_operations
from designopt.design_kind import Design
from designopt.plot.typesetting import heading
from optics import Scene, find_coverage
from optics.design import SCENE
from optics.scene.designed import DesignedScene
from studies.finger_mirrors import solvers
from studies.models.body import BodySpec
from studies.models.designed import designed_scene
from studies.models.finger import Finger, camera_of
from studies.models.finger_file import packaged_or_designed
from studies.models.finger_parts import PHALANGES, Body
from studies.models.link_layers import Links
from studies.models.links import LinksTable
from studies.models.mirror_design import errors, figures, judging
from studies.models.mirror_design.design import MirrorDesign, design_mirrors
from studies.models.mirror_design.placement import poor_layout, reference_layout
from studies.models.mirror_design.requirements import add_requirements
from studies.models.mirror_design.spec import FingerMirrorsSpec, MirrorSpec
from studies.models.mirror_design.yields import Sensitivity, Yield, monte_carlo, sensitivity
from studies.models.spec_files import scene_file
from studies.models.words import words_of

START, OPTIMUM, GIVEN, THIN = "start", "optimum", "reference layout", "thin"

THIN_STARTS = 8
"""Random starts for the second body."""

ROW_ROUNDING = 1e-12
"""A larger deviation of all pairs of angles from the row for them is no rounding."""

DECIDING = {"body", *MirrorSpec.model_fields}
"""The settings on which the design depends; the others decide how it is judged."""


class Case(NamedTuple):
    """A layout of camera and mirrors and what it is worth.

    Attributes:
        name: in tables and figures.
        finger: with its camera and mirrors.
        verdict: degree by degree.
        share: by Monte Carlo, of the fingers that show everything.
    """

    name: str
    finger: Finger
    verdict: judging.Verdict
    share: Yield

    @property
    def mirror_mm(self) -> float:
        """Length of all mirrors together."""
        return float(sum(mirror.length for mirror in self.finger.mirrors))

    @property
    def percent(self) -> str:
        """The share with its 95 % confidence interval, in words."""
        value, low, high = (100 * one for one in self.share[:3])
        return f"{value:.1f} % ({low:.1f} to {high:.1f} %)"


class JudgedMirrors(NamedTuple):
    """What is measured of the layouts, by `START`, `OPTIMUM`, `GIVEN` and `THIN`.

    Attributes:
        design: of the main body.
        cases: the layouts; `GIVEN` only for the body that it is for, with the camera where its own
            is, `THIN` if asked for.
        squares: coverage over all pairs of angles, of all but `GIVEN`.
        rays: coverage by rays, of the optima.
        sensitivity: of the optimum to each error.
    """

    design: MirrorDesign
    cases: dict[str, Case]
    squares: dict[str, judging.Square]
    rays: Records
    sensitivity: Sensitivity

    def worst_by_rays(self, name: str) -> float:
        """Least coverage of any pad of a layout."""
        own = self.rays.where(arrangement=self.cases[name].name)
        return min(own.stat(f"min {pad}") for pad in PHALANGES)


def run(spec: FingerMirrorsSpec, context: Context) -> Results:
    """Design the mirrors, judge them, and compare the solvers.

    Raises:
        UserError: another float type than float64.
    """
    context.require_float64("finger-mirrors takes no more than 1e-9 of a pad for rounding")
    out = Report(spec, words_of("studies.finger_mirrors", "studies.models.mirror_design"))
    found = find(spec, context)
    add_metrics(out, spec, found)
    add_findings(out, spec, found)
    add_requirements(out, found.design, found.cases[OPTIMUM].share, spec)
    add_tables(out, spec, found)
    add_figures(out, found)
    out.file(scene_file(found.design.finger))
    if spec.solvers != "none":
        with context.step("Solvers"):
            solvers.add_comparison(out, solvers.compare(found.design, spec, context.seed))
    if spec.left_out:
        with context.step("Operations left out"):
            scene = found.design.finger.scene()
            out.operations("one-reflection", operations(scene, 1), operations(scene, 2))
    return out.results()


def design(spec: FingerMirrorsSpec, folder: Path | None) -> Design:
    """Camera and mirrors that the study designs for these settings.

    Args:
        spec: the study's settings.
        folder: the ``specs`` of an earlier result with them; the package has that of the default.

    Raises:
        UserError: the folder lacks its file, or it has been spoilt.
    """
    if folder is not None:
        return Design(SCENE, DesignedScene.read(folder / "scene.toml"))

    def designed(context: Context) -> Finger:
        return design_mirrors(unseeing_finger(spec), spec, context).finger

    finger = packaged_or_designed(spec, DECIDING, designed)
    return Design(SCENE, designed_scene(finger, "finger-mirrors"))


def unseeing_finger(spec: FingerMirrorsSpec) -> Finger:
    """Body, pads and the walls of the default links, without camera and mirrors."""
    links = Links.of(LinksTable())
    return Finger.of(Body.of(spec.body), links=links, layers=spec.pads.layers())


def find(spec: FingerMirrorsSpec, context: Context) -> JudgedMirrors:
    """Everything that is measured."""
    finger = unseeing_finger(spec)
    found = design_mirrors(finger, spec, context)
    start = poor_layout(finger, spec.camera, spec.phalanges, spec.room.mount)
    layouts = {START: start, OPTIMUM: found.finger}
    if spec.body == BodySpec() and spec.camera.phalanx == "intermediate":
        layouts[GIVEN] = reference_layout(finger, spec.camera, mount=spec.room.mount)
    if spec.thin:
        body = Body.of(spec.body.model_copy(update={"thickness": spec.thin}))
        settings = spec.model_dump(include=set(MirrorSpec.model_fields))
        settings["floor"] = min(spec.floor, spec.thin_floor)
        settings["search"]["starts"] = min(THIN_STARTS, spec.search.starts)
        slim = design_mirrors(Finger.of(body), MirrorSpec.model_validate(settings), context)
        layouts[THIN] = slim.finger
    cases = {}
    for key, layout in layouts.items():
        name = f"{OPTIMUM}, T = {spec.thin:g} mm" if key == THIN else key
        # Of what does not even show everything without errors, a tenth is enough. These
        # draws are not those of the search, whose errors come from another generator.
        draws = max(spec.draws // 10, 10) if key == START else spec.draws
        with context.step(f"Yield: {name}"):
            share = monte_carlo(layout, spec.tolerances, draws=draws, seed=context.seed)
        cases[key] = Case(name, layout, judging.judged(layout), share)
    with context.step("All pairs of angles"):
        squares = {key: judging.coverage_grid(one) for key, one in layouts.items() if key != GIVEN}
    rays = Records()
    with context.step("Rays at the worst postures"):
        for key in (OPTIMUM, THIN):
            if key in cases:
                rays.add(**_by_rays(cases[key], spec.ray_poses, spec.rays))
    with context.step("Sensitivity to each tolerance"):
        draws, seed = max(spec.draws // 5, 10), context.seed + 1
        tolerances = sensitivity(found.finger, spec.tolerances, draws=draws, seed=seed)
    return JudgedMirrors(found, cases, squares, rays, tolerances)


def _by_rays(case: Case, poses: int, rays: int) -> dict[str, Any]:
    """Rays where errors hide something most often: the angles of both joints by rank.

    A fan of 200,000 rays may leave 5e-4 of a pad because of the distance between its rays: a ray's
    share of the field of view, 14 µrad, is 3 µm of a pad 80 mm away under 20°, of 26.5 mm, at
    either end, and a hand-over between two views has two ends more.
    """
    scene = case.finger.scene()
    pairs = [
        # Of equal shares those with the least resolution come first.
        np.lexsort((case.verdict.px_per_mm[:, pad], case.share.by_pose[:, pad]))
        for pad in map(PHALANGES.index, figures.moving_pads(scene))
    ]
    degrees = case.verdict.degrees[np.stack(pairs, axis=-1)[:poses]]
    seen = judging.seen_by_rays(scene, degrees, rays)
    joints = {"pip_deg": degrees[:, 0], "dip_deg": degrees[:, 1]}
    return {"arrangement": case.name, **joints, **dict(zip(PHALANGES, seen.T, strict=True))}


def operations(scene: Scene, bounces: int) -> int:
    """Operation count of the coverage of all pads by at most so many reflections."""

    def coverage(scene: Scene, poses: Float[Array, "poses joints"]) -> Float[Array, "poses pads"]:
        return find_coverage(scene, poses, bounces=bounces).value

    return count_operations(coverage, scene, jnp.zeros((1, 2)))


def add_metrics(out: Report, spec: FingerMirrorsSpec, found: JudgedMirrors) -> None:
    """The study's numbers."""
    after, square, cases = found.cases[OPTIMUM], found.squares[OPTIMUM], found.cases
    reached = [verdict.meets(spec.floor) for verdict in found.design.verdicts]
    out.values(
        share=after.share,
        square_poses=square.coverage[..., 0].size,
        row_poses=len(square.coverage),
        row_rounding=ROW_ROUNDING,
        random_starts=spec.search.starts,
    )
    out.metrics(
        start_coverage=cases[START].verdict.mean_coverage,
        worst_coverage=min(after.verdict.worst_coverage, square.worst_coverage),
        worst_coverage_rays=found.worst_by_rays(OPTIMUM),
        worst_px_per_mm=after.verdict.worst_px_per_mm,
        **{"yield": after.share.value},
        yield_low=after.share.low,
        yield_high=after.share.high,
        mirror_mm=after.mirror_mm,
        single_view_postures=after.verdict.in_single_views,
        starts_reached=sum(reached[1 : spec.search.starts + 1]),
        row_disagreement=square.disagreement,
        row_speedup=square.speedup,
    )
    if GIVEN in cases:
        given = cases[GIVEN]
        out.values(given=given.share)
        out.metrics(yield_given_layout=given.share.value, mirror_given_layout_mm=given.mirror_mm)
    if THIN in cases:
        thin = cases[THIN]
        out.values(thin_share=thin.share)
        worst = min(thin.verdict.worst_coverage, found.squares[THIN].worst_coverage)
        out.metrics(
            worst_coverage_thin=worst,
            worst_coverage_thin_rays=found.worst_by_rays(THIN),
            worst_px_per_mm_thin=thin.verdict.worst_px_per_mm,
            yield_thin=thin.share.value,
        )


def add_findings(out: Report, spec: FingerMirrorsSpec, found: JudgedMirrors) -> None:
    """Plain sentences, most important first."""
    cases, worst = found.cases, found.cases[OPTIMUM].verdict.worst_coverage
    shown = "all of every pad" if worst == 1 else f"{judging.percent_at_least(worst)} or more"
    out.say("optimum", shown=shown, percent=cases[OPTIMUM].percent)
    if GIVEN in cases:
        given = cases[GIVEN]
        out.say("given", px_per_mm=given.verdict.worst_px_per_mm, percent=given.percent)
    whole = [verdict.worst_coverage == 1.0 for verdict in found.design.verdicts]
    out.say(
        "starts",
        reached="reached" if whole[0] else "did not reach",
        px_per_mm=found.design.verdicts[0].worst_px_per_mm,
        whole=sum(whole[1 : spec.search.starts + 1]),
    )
    doubled = {name: 100 * one.value for name, one in found.sensitivity.doubled.items()}
    worst = min(doubled, key=lambda name: doubled[name])
    base = 100 * found.sensitivity.base.value
    out.say("tolerances", worst=worst, base=base, doubled=doubled[worst])
    if THIN in cases:
        whole = cases[THIN].verdict.worst_coverage == 1.0
        shown = "all of every pad is seen in every posture" if whole else "not all is seen"
        asked = min(spec.floor, spec.thin_floor)
        out.say("thin", shown=shown, percent=cases[THIN].percent, asked=asked)
    out.say("row" if out["row_disagreement"] <= ROW_ROUNDING else "no-row")
    out.say("definitions")


def add_tables(out: Report, spec: FingerMirrorsSpec, found: JudgedMirrors) -> None:
    """Where camera and mirrors are, what that is worth, degrees, starts, single errors, rays."""
    out.table("arrangements", arrangements(found.cases))
    verdicts = Records()
    for case in found.cases.values():
        verdicts.add(
            arrangement=case.name,
            thickness_mm=float(case.finger.body.thickness),
            mean_coverage=case.verdict.mean_coverage,
            worst_coverage=case.verdict.worst_coverage,
            postures_in_single_views=case.verdict.in_single_views,
            worst_px_per_mm=case.verdict.worst_px_per_mm,
            mirror_mm=case.mirror_mm,
            draws=case.share.draws,
            **dict(zip(("yield", "yield_low", "yield_high"), case.share[:3], strict=True)),
        )
    out.table("verdicts", verdicts)
    after = found.cases[OPTIMUM]
    degrees = {"pip_and_dip_deg": after.verdict.degrees}
    for index, pad in enumerate(PHALANGES):
        degrees[f"{pad}_coverage"] = after.verdict.coverage[:, index]
        degrees[f"{pad}_px_per_mm"] = after.verdict.px_per_mm[:, index]
        degrees[f"{pad}_yield"] = after.share.by_pose[:, index]
    out.table("degrees", **degrees)
    out.table("worst", worst_rows(after.verdict))
    made, starts = found.design, Records()
    names = ["poor", *(f"random {number + 1}" for number in range(spec.search.starts)), GIVEN]
    for number, (trial, verdict) in enumerate(zip(made.trials, made.verdicts, strict=True)):
        before = judging.judged(eqx.combine(trial.start, made.finger), everywhere=False)
        starts.add(
            start=names[number],
            mean_coverage_at_start=before.mean_coverage,
            objective=trial.objective,
            violation=trial.violation,
            worst_coverage=verdict.worst_coverage,
            worst_px_per_mm=verdict.worst_px_per_mm,
            met=verdict.meets(spec.floor),
            chosen=number == made.chosen,
            steps=trial.steps,
            seconds=trial.seconds,
        )
    out.table("starts", starts)
    names = names_of_errors(made.finger)
    tilts = ["tilt" in name for name in names]
    sizes = errors.deviations(spec.tolerances, len(made.finger.mirrors)) * np.where(
        tilts, math.degrees(1), 1
    )
    least, greatest = found.sensitivity.limits.T
    out.table(
        "tolerances",
        error=names,
        unit=["°" if tilt else "mm" for tilt in tilts],
        standard_deviation=sizes,
        least=least * sizes,
        greatest=greatest * sizes,
        least_over_deviation=least,
        greatest_over_deviation=greatest,
    )
    out.table("rays", found.rays)


def worst_rows(verdict: judging.Verdict) -> Records:
    """What is worst of every pad, and where; a pad that is wholly seen is so everywhere."""
    rows, worst = Records(), verdict.worst
    assert worst is not None  # of a design
    kinds = {"coverage": worst.coverage, "px/mm": worst.px_per_mm, "blur (px)": worst.blur_px}
    for quantity, pads in kinds.items():
        for one in pads:
            place = {"pip_deg": one.pip_deg, "dip_deg": one.dip_deg}
            rows.add(quantity=quantity, pad=one.pad, value=one.value, **place)
    return rows


def names_of_errors(finger: Finger) -> tuple[str, ...]:
    """What the entries of a row of its errors are."""
    return errors.error_names(finger.mirror_names)


def arrangements(cases: dict[str, Case]) -> Records:
    """Where camera and mirrors are, in columns; those of other mirrors are left empty."""
    places = {case.name: _numbers(case.finger) for case in cases.values()}
    names = list(dict.fromkeys(name for place in places.values() for name in place))
    columns = {key: [place.get(name, math.nan) for name in names] for key, place in places.items()}
    return Records({"number": list(map(heading, names)), **columns})


def _numbers(finger: Finger) -> dict[str, float]:
    """Heights above the axes, for they are what a drawing shows."""
    dorsal, camera = float(finger.body.dorsal), camera_of(finger)
    found = {
        "camera_x_mm": float(camera.along),
        "camera_y_mm": dorsal - float(camera.depth),
        "camera_tilt_deg": math.degrees(float(camera.tilt)),
    }
    for name, mirror in zip(finger.mirror_names, finger.mirrors, strict=True):
        for end, (along, depth) in zip(("near", "far"), mirror.ends.tolist(), strict=True):
            mirror_end = f"{name.replace(' ', '_')}_{end}"
            found |= {f"{mirror_end}_x_mm": along, f"{mirror_end}_y_mm": dorsal - depth}
    return found


def add_figures(out: Report, found: JudgedMirrors) -> None:
    """Views, coverage and resolution before and after, yields and sensitivity."""
    before, after = found.cases[START], found.cases[OPTIMUM]
    degrees = after.verdict.degrees
    shown = ", ".join(f"{degrees[i]:g}" for i in figures.drawn_postures(after.verdict))
    for name, case in (("views", after), ("views_before", before)):
        out.figure(name, figures.draw_views(case.finger.scene(), case.verdict), degrees=shown)
    squares = {key: found.squares[key] for key in (START, OPTIMUM)}
    out.figure("coverage", figures.draw_coverage(squares, degrees))
    scenes = {case.name: (case.finger.scene(), case.verdict) for case in (before, after)}
    out.figure("resolution", figures.draw_resolution(scenes))
    shares = {one.name: one.share for key, one in found.cases.items() if key != START}
    joints = figures.moving_pads(after.finger.scene())
    out.figure("yield", figures.draw_yield(shares, degrees, joints), most=2)
    out.figure(
        "sensitivity", figures.draw_sensitivity(found.sensitivity, names_of_errors(after.finger))
    )
