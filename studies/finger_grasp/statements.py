"""What the study says: its findings in sentences and its metrics with their targets."""

from __future__ import annotations

import math
from collections.abc import Sequence

from designopt.study.results import Metric, StabilityRow, Target
from studies.models.body import BodySpec
from studies.models.finger import Body
from studies.models.grasp import cases
from studies.models.grasp.analysis import CLOSED, Analysis, radius_of
from studies.models.grasp.check import GraspCheck
from studies.models.grasp.equilibrium import RESIDUAL_TOLERANCE
from studies.models.grasp.spec import GraspSpec, PinsSpec

PADS = {"intermediate": 0, "distal": 1}

LEAST_FORCE = 1e-6
"""A pad that presses with less does not touch, N."""


def is_reference(spec: GraspSpec) -> bool:
    """Whether design, spring and motor are those of the reference values."""
    given = (spec.spring_stiffness, spec.preload, spec.servo_stiffness, spec.motor_end_deg)
    usual = given == (30.0, 0.3, 300.0, 160.0)
    return usual and spec.pins == PinsSpec() and spec.body == BodySpec()


def metrics(spec: GraspSpec, check: GraspCheck, stability: Sequence[StabilityRow]) -> list[Metric]:
    """The study's numbers; targets from reference values hold for their own design only."""
    reference, circle = is_reference(spec), cases.check_touch(Body.of(spec.body))

    def only(target: Target) -> Target | None:
        return target if reference else None

    found = [
        Metric(
            "free_closing_pip_deg",
            check.free_closing_pip_deg,
            "°",
            "PIP flexion up to which free closing keeps DIP on its stop; without load there is no "
            "motor moment until PIP is at its own stop, so the reference value of 88° is read as a "
            "least value",
            88.0,
            only(Target(">=", 88.0)),
        ),
        Metric(
            "adaptive_dip_deg",
            check.adaptive_dip_deg,
            "°",
            f"DIP when the distal pad touches the circle of {2 * circle.radius:.3g} mm that the "
            f"intermediate pad touched at PIP {math.degrees(circle.pip):.3g}°, "
            f"k₁ = {circle.place:g} mm",
            71.4,
            only(Target("=", 71.4, 0.05)),
        ),
        Metric(
            "virtual_work_error",
            check.virtual_work_error,
            "",
            "largest relative difference of forces by virtual work and by every link's balance",
            None,
            Target("<=", 1e-8),
        ),
        Metric(
            "formula_error",
            check.formula_error,
            "",
            "largest difference of both contact forces to the two-phalanx formulas, relative",
            None,
            Target("<=", 1e-8),
        ),
        Metric(
            "pinch_violations",
            check.pinch_violations,
            "",
            f"pinches, of {check.pinches}, that gave way elsewhere than the formula says",
            None,
            Target("=", 0),
        ),
        Metric("states", check.states, "", "equilibria that were looked for"),
        Metric(
            "unconverged",
            check.unconverged,
            "",
            "states without an equilibrium; left out of tables, figures and the other numbers",
            None,
            only(Target("=", 0)),
        ),
        Metric(
            "worst_residual",
            check.worst_residual,
            "",
            "of the states that are reported, recomputed by plain comparisons",
            None,
            Target("<=", RESIDUAL_TOLERANCE),
        ),
        Metric(
            "retrace_error_deg",
            check.retrace_error_deg,
            "°",
            "largest difference of a joint between closing and opening at one motor angle",
        ),
        Metric(
            "least_f1_n", check.least_f1, "N", "least force on the intermediate pad, both touching"
        ),
        Metric(
            "ratio_low",
            check.ratio_low,
            "",
            "least φ₂/φ₁ over all postures",
            0.23,
            only(Target("=", 0.23, 0.005)),
        ),
        Metric(
            "ratio_high",
            check.ratio_high,
            "",
            "largest φ₂/φ₁ over all postures",
            0.46,
            only(Target("=", 0.46, 0.005)),
        ),
    ]
    if stability:
        cases_tried = sum(row.cases for row in stability)
        found += [
            Metric(
                "stability_failures",
                sum(row.failures for row in stability),
                "",
                f"states of extreme closings, of {cases_tried}, not found or wrong",
                None,
                Target("=", 0),
            ),
            Metric(
                "non_finite",
                sum(row.non_finite for row in stability),
                "",
                "numbers of those closings that are not finite",
                None,
                Target("=", 0),
            ),
        ]
    return found


def findings(spec: GraspSpec, found: Analysis, check: GraspCheck) -> list[str]:
    """Plain sentences, most important first."""
    body = Body.of(spec.body)
    circle = cases.check_touch(body)
    wrapped = math.degrees(cases.wrapped_dip(body, circle.place, circle.radius))
    holding = [one for one, _, _ in found.pinches if one.holds]
    yielding = [one for one, _, _ in found.pinches if not one.holds]
    touched = (
        ", and the distal pad never touches"
        if math.isnan(check.adaptive_dip_deg)
        else f", until the distal pad touches at {check.adaptive_dip_deg:.2f}°"
    )
    formulas = (
        ""  # no state in which both pads press
        if math.isnan(check.formula_error)
        else f", and with the formulas for two phalanges to {check.formula_error:.1e}"
    )
    said = [
        f"Free closing turns PIP alone up to {check.free_closing_pip_deg:.1f}° of its "
        f"{spec.body.range_deg:g}°; on a circle of {2 * circle.radius:.3g} mm that blocks the "
        f"intermediate phalanx at PIP {math.degrees(circle.pip):.3g}° the DIP joint closes "
        f"instead{touched} (geometry alone, 2 atan((l − k₁)/(r + h)), asks for {wrapped:.2f}°).",
        f"φ₂/φ₁ runs from {check.ratio_low:.3f} to {check.ratio_high:.3f} over all postures.",
        f"Contact forces by virtual work and by the balance of all six links agree to "
        f"{check.virtual_work_error:.1e}{formulas}.",
    ]
    if yielding:
        limits = [one.limit for one in yielding]
        said.append(
            f"Of {len(found.pinches)} pinches {len(holding)} hold at any motor moment; the others "
            f"give way at {min(limits):.0f} to {max(limits):.0f} N mm, and loading found "
            f"{check.pinches - check.pinch_violations} of {check.pinches} where the formula says."
        )
    if check.pinches < len(found.pinches):
        said.append(
            f"{len(found.pinches) - check.pinches} pinches hold more than the motor can load them "
            "with, so that their limit was not tried."
        )
    apart = []
    for path in found.circles:
        if not path.ok[CLOSED]:
            why = "no equilibrium found"
        else:
            bare = [name for name, pad in PADS.items() if path.push(pad)[CLOSED] < LEAST_FORCE]
            if not bare:
                continue
            why = f"{' and '.join(bare)} pad without contact"
        apart.append(f"{2 * radius_of(path):g} mm ({why})")
    both = len(found.circles) - len(apart)
    text = f"With the motor at {spec.motor_end_deg:g}° both pads press on {both} of "
    text += f"{len(found.circles)} circles"
    said.append(text + (f"; not on those of {', '.join(apart)}." if apart else "."))
    said.append(
        f"{check.states - check.unconverged} of {check.states} states were solved, with residuals "
        f"up to {check.worst_residual:.1e}; opening retraces closing to "
        f"{check.retrace_error_deg:.1e}°."
    )
    return said
