"""The study itself: from its spec to its results."""

from __future__ import annotations

import math
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

from designopt.plot.figures import MARKERS, PALETTE, label_plainly, new_figure
from designopt.study.left_out import count_operations
from designopt.study.plots import DASHES, lines
from designopt.study.records import Records
from designopt.study.report import Report
from designopt.study.results import Results
from designopt.study.study import Context
from studies.benchmarks.solvers import grasp as benchmark
from studies.models.finger import Finger
from studies.models.grasp import cases
from studies.models.grasp.analysis import CLOSED, Analysis, GraspCheck, analyze, radius_of, summary
from studies.models.grasp.closing import Path
from studies.models.grasp.conditions import equations, straight
from studies.models.grasp.figures import draw_sequences
from studies.models.grasp.pinch import APPROACH, least_place
from studies.models.grasp.spec import GraspSpec
from studies.models.grasp.transfer import Joints, transfer
from studies.models.linkage_design.figures import draw_over_postures
from studies.stability import grasp as stability

PADS = ("intermediate", "distal")
LEAST_FORCE = 1e-6
"""A pad that presses with less does not touch, N."""
EVERY = 4
"""Every so many states are tabulated."""
NAMES = {
    "motor_deg": "motor angle α (°)",
    "motor_n_mm": "motor moment (N mm)",
    "f1_n": "force on the intermediate pad (N)",
    "f2_n": "force on the distal pad (N)",
}
"""What figures write for columns of the tables."""


def run(spec: GraspSpec, context: Context) -> Results:
    """Close the design on everything, check its forces, and measure the solvers.

    Raises:
        UserError: another float type than float64.
    """
    context.require_float64("finger-grasp compares forces to 1e-8")
    out = Report(spec, package=__package__)
    with context.step("Closing, opening and pinching"):
        found = analyze(cases.finger_of(spec), spec)
    add_numbers(out, found, summary(found))
    if spec.stability:
        end = float(found.adaptive.commands.max())
        with context.step("Stiff and extreme cases"):
            extreme = stability.families(found.finger, end, context.seed)
            rows = [stability.assess(family) for family in extreme]
        out.values(extreme=sum(row.cases for row in rows))
        out.metrics(
            stability_failures=sum(row.failures for row in rows),
            non_finite=sum(row.non_finite for row in rows),
        )
        out.stability(rows)
    if spec.precision:
        with context.step("Error against run time"):
            rows = benchmark.measure(found.adaptive, spec.precision_repeats)
        if rows:
            claim = out.claim("newton", *benchmark.compare_with_minimizers(rows))
            out.precision(rows, "worst error of a joint (rad)", benchmark.REFERENCE, claim)
    with context.step("Operations left out"):
        add_operations(out, found.finger)
    shown = tables(found)
    for name, records in shown.items():
        out.table(name, records)
    add_figures(out, found, shown)
    return out.results()


def add_numbers(out: Report, found: Analysis, check: GraspCheck) -> None:
    """Metrics, and findings in plain sentences, most important first."""
    body = found.finger.body
    circle = cases.check_touch(body)
    out.values(circle_pip_deg=math.degrees(circle.pip), circle_mm=2 * circle.radius)
    out.values(circle_at=circle.place, pinches=check.pinches)
    out.metrics(**{name: value for name, value in vars(check).items() if name != "pinches"})
    touched = f", until the distal pad touches at {check.adaptive_dip_deg:.2f}°"
    out.say(
        "closing",
        range_deg=body.ranges_deg[0],
        touched=", and the distal pad never touches"
        if math.isnan(check.adaptive_dip_deg)
        else touched,
        wrapped_deg=math.degrees(cases.wrapped_dip(body, circle.place, circle.radius)),
    )
    out.say("ratio")
    formulas = f", and with the formulas for two phalanges to {check.formula_error:.1e}"
    # NaN: there was no state in which both pads press.
    out.say("forces", formulas="" if math.isnan(check.formula_error) else formulas)
    limits = [one.limit for one, _, _ in found.pinches if not one.holds]
    count = len(found.pinches)
    if limits:
        out.say(
            "pinches",
            all_pinches=count,
            holding=count - len(limits),
            least_limit=min(limits),
            most_limit=max(limits),
            agreeing=check.pinches - check.pinch_violations,
        )
    if check.pinches < count:
        out.say("unloaded", unloaded=count - check.pinches)
    apart = [
        f"{2 * radius_of(path):g} mm ({why})" for path in found.circles if (why := _apart(path))
    ]
    out.say(
        "circles",
        both=len(found.circles) - len(apart),
        circles=len(found.circles),
        except_on=f"; not on those of {', '.join(apart)}" if apart else "",
    )
    out.say("solved", converged=check.states - check.unconverged)


def _apart(path: Path) -> str:
    """Why not both pads press at the end of a closing; empty where they do."""
    if not path.ok[CLOSED]:
        return "no equilibrium found"
    bare = [name for pad, name in enumerate(PADS) if path.push(pad)[CLOSED] < LEAST_FORCE]
    return f"{' and '.join(bare)} pad without contact" if bare else ""


def states_of(path: Path, states: np.ndarray) -> dict[str, Any]:
    """Columns of a table: posture, contacts and forces in some states of a path."""
    forces = np.stack([path.push(pad)[states] for pad in (0, 1)], axis=1)
    pressed = [[name for name, f in zip(PADS, own, strict=True) if f > 1e-9] for own in forces]
    return {
        "motor_deg": np.degrees(path.commands[states]),
        "pip_deg": np.degrees(path.joints[states, 0]),
        "dip_deg": np.degrees(path.joints[states, 1]),
        "motor_n_mm": path.motor[states],
        "contacts": [" and ".join(names) or "none" for names in pressed],
        "f1_n": forces[:, 0],
        "f2_n": forces[:, 1],
    }


def tables(found: Analysis) -> dict[str, Records]:
    """Closings, their ends on the circles, pinches, and how all was solved; equilibria only."""
    sequences, circles, pinches, solved = Records(), Records(), Records(), Records()
    for name, path in found.paths().items():
        states, bad = np.flatnonzero(path.ok)[::EVERY], np.flatnonzero(~path.ok)
        if states.size and not name.startswith("pinch"):
            sequences.add(
                closing=name,
                **states_of(path, states),
                stop_pip_n_mm=path.stops[states, 0],
                stop_dip_n_mm=path.stops[states, 1],
                residual=path.residual[states],
                margin=path.margin[states],
            )
        compared = found.compared[name]
        solved.add(
            closing=name,
            states=len(path.ok),
            solved=int(path.ok.sum()),
            first_message=path.messages[int(bad[0])] if bad.size else "",
            worst_residual=float(path.residual[path.ok].max(initial=0.0)),
            least_margin=float(path.margin[path.ok].min(initial=1.0)),
            virtual_work_error=compared.error,
            compared=compared.states,
            undetermined=compared.undetermined,
        )
    for path in found.circles:
        if path.ok[CLOSED]:
            k1, k2 = path.along[CLOSED].tolist()
            end = states_of(path, np.array([CLOSED]))
            circles.add(diameter_mm=2 * radius_of(path), k1_mm=k1, k2_mm=k2, **end)
    for one, _, shown in found.pinches:
        pinches.add(
            pip_deg=math.degrees(one.pip),
            k2_mm=one.place,
            ratio=one.ratio,
            threshold=one.threshold,
            limit_n_mm=math.nan if one.holds else one.limit,
            held_n_mm=shown.low,
            gave_way_n_mm=shown.high if math.isfinite(shown.high) else math.nan,
            agrees=[shown.agrees],
        )
    return {"sequences": sequences, "circles": circles, "pinches": pinches, "solved": solved}


def add_figures(out: Report, found: Analysis, shown: dict[str, Records]) -> None:
    """The finger in section, its closings, where a grasp holds, circles and pinches."""
    body = found.finger.body
    out.figure("closing", draw_sequences(found))
    paths = shown["sequences"].where(closing=list(found.paths())[:3])
    columns = ("pip_deg", "dip_deg", "motor_n_mm", "f1_n", "f2_n")
    out.figure("paths", lines(paths, "motor_deg", columns, by="closing", names=NAMES, height=5.6))
    ratio, middle = found.relative_pull, float(body.intermediate)
    places = least_place(ratio, found.angles[None, :], middle)
    maps = {"φ₂/φ₁": ratio, "least k₂ with f₁ > 0 (mm)": places}
    low, high = float(body.gaps[1]), float(body.distal - body.rim)
    degrees = np.degrees(found.angles)
    drawing = draw_over_postures((degrees, degrees), maps)
    out.figure("stability_map", drawing, low=low, high=high)
    columns = ("pip_deg", "dip_deg", "f1_n", "f2_n")
    circles = lines(shown["circles"], "diameter_mm", columns, names=NAMES, height=5.6)
    out.figure("over_diameter", circles)
    if not all(pinch.holds for pinch, _, _ in found.pinches):
        out.figure("pinches", draw_pinches(found))


def draw_pinches(found: Analysis) -> Figure:
    """The limit of every pinch that gives way, by the formula, between what loading showed."""
    drawing, [[limit, loading]] = new_figure(1, 2, height=3.6)
    given_way = [part for part in found.pinches if not part[0].holds]
    for i, pip in enumerate(dict.fromkeys(one.pip for one, _, _ in given_way)):
        color, label = PALETTE[i % len(PALETTE)], f"PIP {math.degrees(pip):.0f}°"
        own = [part for part in given_way if part[0].pip == pip]
        places, limits = [one.place for one, _, _ in own], [one.limit for one, _, _ in own]
        mark = {"color": color, "markerfacecolor": "none", "label": f"{label}, formula"}
        limit.plot(places, limits, MARKERS[i % len(MARKERS)], markersize=8, **mark)
        low, high = np.array([(shown.low, shown.high) for _, _, shown in own]).T
        bars = {"fmt": "none", "color": color, "capsize": 4, "label": f"{label}, loading"}
        limit.errorbar(places, (low + high) / 2, (high - low) / 2, **bars)
        for one, path, _ in own:
            states = APPROACH + np.flatnonzero(path.ok[APPROACH:])
            dip = np.degrees(path.joints[states, 1])
            style = {"color": color, "linewidth": 1, "linestyle": DASHES[i % len(DASHES)]}
            loading.plot(path.motor[states] / one.limit, dip, **style)
    limit.set(xlabel="k₂ (mm)", ylabel="largest motor moment (N mm)", yscale="log")
    limit.set(title="Where a pinch gives way")
    label_plainly(limit.yaxis)
    loading.axvline(1.0, color="0.4", linewidth=0.8)
    loading.set(xlabel="motor moment over the formula's limit", ylabel="DIP flexion (°)")
    loading.set(title="DIP under load")
    return drawing


def add_operations(out: Report, finger: Finger) -> None:
    """Operation counts of programs that leave something out beside the general ones."""
    body = finger.body
    things = (None, cases.circle_on_pad(body, 40.0, 11.5), cases.box(body))
    problems = [cases.problem_of(finger, thing) for thing in things]
    free, circle, square = (count_operations(equations, straight(one), one) for one in problems)
    out.operations("free", free, circle)
    out.operations("circle", circle, square)

    def pull(finger: Finger, joints: Joints) -> jax.Array:
        found = transfer(finger, joints)
        return found.winding * found.slope

    joints = jnp.asarray([0.4, 0.3])
    winding = count_operations(pull, finger, joints)
    out.operations("spring", winding, count_operations(transfer, finger, joints))
