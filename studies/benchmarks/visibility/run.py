"""The study itself: from its spec to its results."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Iterable
from functools import partial
from typing import Any

import jax
import numpy as np
from jaxtyping import Array

from designopt.study.benchmark import find_undominated
from designopt.study.left_out import count_operations
from designopt.study.records import Records
from designopt.study.report import Report
from designopt.study.results import Claim, LeftOutRow, PrecisionRow, Results
from designopt.study.stability import DIGITS
from designopt.study.study import Context
from optics.scene.scene import Scene
from optics.visibility.coverage import find_coverage, find_views
from optics.visibility.edge_refined import trace_views
from studies.benchmarks.measuring import key, measure, ratio, say_cores, spans
from studies.benchmarks.visibility import VisibilityPrecisionSpec, cases, grid, tracers
from studies.benchmarks.visibility import methods as by
from studies.oracles import coverage as exact
from studies.oracles.scenes import rounded, seen_by_fan

ACCURACY = 5e-4
"""Gradient error at which run times are compared."""

TARGETS = {
    "least_sigmoid": 100.0,
    "most_coverage_error": 1e-5,
    "most_grid_s": 1.0,
    "most_compile_s": 5.0,
    "most_apart": 1e-12,
    "most_over_numpy": 1.5,
    "least_over_optiland": 2.5,
}
RADIUS_MM = 200.0
"""Of the mirror that is bent to count operations."""


def run(spec: VisibilityPrecisionSpec, context: Context) -> Results:
    """Measure everything in float64, and compare run times."""
    out, rows, claims = Report(spec, package=__package__), Records(), []
    out.values(accuracy=ACCURACY, steps=grid.STEPS, mirrors=tracers.MIRRORS, **TARGETS)
    out.values(tracer_rays=tracers.RAYS)
    with jax.enable_x64(True):
        works = workloads(spec)
        for work in context.each(works, lambda work: work.panel):
            entered = by.methods(work, spec.samples, edge_refined=spec.edge_refined)
            rows.add(**measure(entered, spec.repeats))
        with context.step("Reference in 50 digits"):
            scene, [pose] = works[0].scene, works[0].poses
            fan_error = by.coverage_error(works[0])(exact.coverage(scene, pose))
        claims += add_methods(out, rows)
        claims += add_gallery(out, spec, context)
        if spec.grid:
            with context.step("The finger over a grid of poses"):
                claims.append(add_grid(out, spec.repeats))
        if spec.tracers:
            with context.step("Ray tracers"):
                claims.append(add_tracers(out, spec, context.seed))
        say_cores(out)
        if spec.left_out:
            with context.step("Operations left out"):
                out.left_out(operations())
    reference = (
        f"coverage in one pose: {spec.reference_rays:,} rays in plain NumPy, themselves right to "
        f"{fan_error:.0e}; all else: {DIGITS} digits. A coverage's error is that of the "
        "worst pad; a gradient's that of its worst entry over its largest one"
    )
    out.precision(list(rows["row"]), "worst error", reference, *claims)
    return out.results()


def workloads(spec: VisibilityPrecisionSpec) -> list[by.Workload]:
    """One pose and, if asked for, a sweep of them: coverage and gradient."""
    scene = cases.spoilt_finger()
    sweeps = [cases.bent(scene)[None], *([cases.flexion(scene)] if spec.flexion else [])]
    return [
        by.Workload(scene, poses, gradient, spec.reference_rays)
        for poses in sweeps
        for gradient in (False, True)
    ]


def gallery_of(spec: VisibilityPrecisionSpec) -> list[str]:
    """The scenes of the gallery that a spec asks for; only rays show curved mirrors."""
    names = cases.NAMES if spec.gallery else ()
    return [name for name in names if spec.edge_refined or not cases.gallery(name).layout.curved]


def deviation(name: str, rays: int) -> dict[str, Any]:
    """How far the library is from the reference's rays, for a scene of the gallery."""
    scene = cases.gallery(name)
    method, find = (by.EDGES, trace_views) if scene.layout.curved else (by.OURS, find_views)

    @jax.jit
    def found(scene: Scene) -> tuple[Array, Array]:
        pieces = find(scene, scene.pose()).value
        return pieces.coverage(), pieces.redundancy()

    fan = seen_by_fan(rounded(scene, scene.pose()), rays)
    off = [float(np.max(np.abs(a - b))) for a, b in zip(found(scene), fan, strict=True)]
    return {"scene": name, "method": method, "coverage_error": off[0], "redundancy_error": off[1]}


def fastest_sigmoid(rows: Iterable[PrecisionRow]) -> PrecisionRow | None:
    """The fastest sigmoid that is accurate enough, if there is one."""
    sigmoids = [row for row in rows if row.method in (*by.SOFT.values(), by.BEST)]
    close = [row for row in sigmoids if row.error <= ACCURACY]
    return min(close, key=lambda row: row.seconds, default=None)


def add_methods(out: Report, rows: Records) -> list[Claim]:
    """What the methods reach on the spoilt finger, and how long they take."""
    rivals, claims, gradients = Records(), [], []
    for panel, own in rows.group("panel").items():
        ours, asked, name = own["row"][0], panel.split(",")[0], key(panel)
        out.metric(f"exact_error_{name}", ours.error, f"exact_{asked}", panel=panel)
        best = {method: best_of(part["row"]) for method, part in own.group("method").items()}
        mine = best.pop(by.OURS)
        others = "; ".join(f"{method} {text}" for method, text in best.items())
        out.say("beside", panel=panel, ours=mine, others=others)
        if asked == "coverage":
            continue
        gradients.append(ours)
        both, row = {"ratio": None}, fastest_sigmoid(own["row"])
        if row is None:
            out.say("no-rival", panel=panel)
        else:
            both = ratio(row, ours)
            words = {"setting": row.setting, "error": row.error, **both}
            rivals.add(workload=panel, method=row.method, **words)
            out.say("rival", panel=panel, **words)
            evidence = spans(rivals.where(workload=panel), "setting")
            evidence.append(f"least error: {best[by.BEST]}")
            holds = both["ratio"] >= TARGETS["least_sigmoid"]
            claims.append(out.claim("speed", evidence, holds, panel=panel))
        out.metric(f"sigmoid_over_exact_{name}", both["ratio"], "sigmoid_over_exact", panel=panel)
    if len(gradients) > 1:
        one, many = gradients
        out.say("sweep", many=many.panel, one=one.panel, times=many.seconds / one.seconds)
    if len(rivals):
        out.table("rivals", rivals)
    return [*claims, out.claim("undominated", *find_undominated(list(rows["row"]), by.OURS))]


def best_of(rows: Iterable[PrecisionRow]) -> str:
    """The least error of a method, and the run time it takes."""
    row = min(rows, key=lambda row: (row.error, row.seconds))
    return f"{row.error:.1e} in {1e3 * row.seconds:.3g} ms"


def add_gallery(out: Report, spec: VisibilityPrecisionSpec, context: Context) -> list[Claim]:
    """How far the library is from the reference's rays in the scenes of the gallery."""
    found = Records()
    for name in gallery_of(spec):
        with context.step(f"Gallery: {name}"):
            found.add(**deviation(name, spec.reference_rays))
    methods = found.group("method") if len(found) else {}
    for method, name in ((by.OURS, "exact"), (by.EDGES, "edge_refined")):
        value = methods[method].stat("max coverage_error") if method in methods else None
        out.metric(f"gallery_{name}_deviation", value, "gallery_deviation", method=method)
    if not len(found):
        return []
    errors, scenes = found["coverage_error"], found["scene"]
    out.say("gallery", scenes=len(found), worst=errors.max(), scene=scenes[errors.argmax()])
    out.table("gallery", found)
    columns = zip(scenes, found["method"], errors, strict=True)
    evidence = [f"{scene}, {method}: {error:.1e}" for scene, method, error in columns]
    holds = bool(errors.max() <= TARGETS["most_coverage_error"])
    return [out.claim("gallery", evidence, holds)]


def add_grid(out: Report, repeats: int) -> Claim:
    """The finger over its grid of poses and over the two sweeps."""
    rows, compiling = grid.measure_grid(repeats), grid.compile_in_fresh_processes()
    fingers = cases.gallery("finger"), cases.spoilt_finger()
    apart = max(grid.disagreement(finger, grid.STEPS) for finger in fingers)
    names = {grid.VALUE: "coverage", grid.GRADIENT: "gradient"}
    for row in rows["row"]:
        name = f"finger_{row.panel}_{names[row.method]}_s"
        sign = "×" if row.panel == "grid" else "+"
        out.metric(name, row.seconds, "finger_s", asked=row.method, sign=sign)
    compiled = statistics.median(compiling)
    out.metrics(finger_grid_compile_s=compiled, finger_grid_disagreement=apart)
    out.say("grid")
    poses = [f"{row.panel}: {row.setting}" for row in rows["row"]]
    out.table("finger_grid", rows | {"poses": poses, "asked": rows["method"]})
    evidence = [f"{row.panel}, {row.method}: {row.seconds:.2g} s" for row in rows["row"]]
    evidence.append("compiling: " + ", ".join(f"{seconds:.1f} s" for seconds in compiling))
    evidence.append(f"largest deviation of the two: {apart:.0e}")
    holds = rows.stat("max seconds") <= TARGETS["most_grid_s"]
    holds &= compiled <= TARGETS["most_compile_s"] and apart <= TARGETS["most_apart"]
    return out.claim("grid", evidence, holds)


def add_tracers(out: Report, spec: VisibilityPrecisionSpec, seed: int) -> Claim:
    """The library's rays beside those of other tracers."""
    rows, ratios = Records(), Records()
    for legs, words in ((tracers.MIRRORS, f"{tracers.MIRRORS} legs"), (1, "1 leg")):
        mine = measure(tracers.methods(legs, seed, peers=spec.peers), spec.repeats, legs=legs)
        ours, *others = mine["row"]
        rows.add(**mine)
        for row in others:
            both = ratio(row, ours)
            rate = both["ratio"] * tracers.MIRRORS  # the others meet one mirror in each leg
            ratios.add(method=row.method, who=f"{row.method}, {words}", rate=rate, **both)
            hand = row.method == tracers.NUMPY
            name = "numpy-tracer" if hand else "other-tracer"
            out.say(name, method=row.method, legs=words, rate=rate, **both)
            if hand:
                name = f"tracer_over_numpy_{key(words)}"
                out.metric(name, 1 / both["ratio"], "tracer_over_numpy", legs=words)
    most = 1 / ratios.where(method=tracers.NUMPY).stat("min ratio")
    optiland = ratios.where(method=tracers.OPTILAND)["rate"]
    out.metrics(throughput_over_optiland=optiland[0] if len(optiland) else None)
    ordered = np.isin(rows["method"], (tracers.OPTILAND, tracers.RAYOPTICS))
    met = rows["legs"] * np.where(ordered, 1, tracers.MIRRORS)  # surfaces for each ray
    rate = tracers.RAYS * met / rows["seconds"] / 1e6
    out.table("tracers", rows | {"error_mm": rows["error"], "million_intersections_per_s": rate})
    holds = most <= TARGETS["most_over_numpy"] and all(optiland >= TARGETS["least_over_optiland"])
    return out.claim("tracers", spans(ratios, "who"), holds)


def operations() -> list[LeftOutRow]:
    """Operation counts of programs that leave something out, beside those that need it."""

    def count(function: Callable[..., Any], scene: Scene) -> int:
        return count_operations(function, scene, scene.pose())

    def refined(scene: Scene, pose: Array) -> Array:
        return trace_views(scene, pose).value.coverage()

    finger = cases.gallery("finger")
    bare = cases.changed_finger(lambda data: data.pop("mirrors"))
    bent = cases.changed_finger(lambda data: data["mirrors"][0].update(radius=RADIUS_MM))
    none = count(partial(find_coverage, bounces=0), bare)
    once, twice = (count(partial(find_coverage, bounces=bounces), finger) for bounces in (1, 2))
    rays, views = (count(refined, finger), count(refined, bent)), count(find_views, finger)
    straight = "coverage of the finger by edge-refined rays, its mirrors straight"
    unfolding = "unfolding and apertures: a finger with mirrors, one reflection"
    paths = "paths over two mirrors, which cut each other's views"
    conics = "conic sections, their quadratic equations and horizons: the same with a curved mirror"
    more = "pixels, resolution, distances, margins and reasons: all that `find_views` answers"
    return [
        LeftOutRow("coverage of a finger without mirrors", unfolding, none, once),
        LeftOutRow("coverage of the finger by one reflection", paths, once, twice),
        LeftOutRow(straight, conics, *rays),
        LeftOutRow("coverage of the finger, and nothing else", more, once, views),
    ]
