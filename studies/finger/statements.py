"""What was required and achieved, in lines, findings and metrics."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from designopt.study.results import Metric, Target
from kinematics.io.assembling import Equations
from kinematics.io.sketch import parse_sketch
from kinematics.io.sketch_geometry import measure_sketch
from studies.finger.spec import FingerSpec
from studies.models.body import BodySpec
from studies.models.finger import PHALANGES, Finger
from studies.models.mirror_design.percent import percent_at_least

if TYPE_CHECKING:
    from studies.finger.found import FingerDesign


@dataclass(frozen=True)
class Line:
    """One requirement of paper B.

    Attributes:
        name: what is required.
        category: as in Table 3.1, or where in the text it stands, or whose it is.
        required: in words.
        achieved: in words.
        met: whether it is.
    """

    name: str
    category: str
    required: str
    achieved: str
    met: bool


def lines(spec: FingerSpec, found: FingerDesign) -> list[Line]:
    """Table 3.1 line by line with this project's resolution, then the requirements of §3.1.2."""
    body, limits, verdict = spec.body, spec.linkage.limits, found.linkage.verdict
    phalanges = len(set(PHALANGES) & set(found.finger.linkage_tables()["bodies"]))
    freedoms = degrees_of_freedom(found.finger)
    seen = found.mirrors.verdict.worst_coverage
    sharp = found.mirrors.verdict.worst_px_per_mm
    assembles = verdict.assembles
    everything = f"{body.range_deg:g}° each"
    crank = verdict.crank_range_deg
    made = [
        Line("phalanges", "Geometry", "3", str(phalanges), phalanges == 3),
        Line("degrees of freedom", "Geometry", "2", str(freedoms), freedoms == 2),
        Line(
            "motors",
            "Hardware",
            "1",
            "1, at the crank (by construction)",
            True,
        ),
        Line("cameras", "Hardware", "1", "1, in the intermediate phalanx (by construction)", True),
        Line(
            "sensing segments visible",
            "Tactile sensing",
            "all, in every posture",
            f"at least {percent_at_least(seen)} of each in every posture",
            seen == 1.0,
        ),
        Line(
            "resolution of the pads",
            "this project",
            f"≥ {spec.mirrors.floor:g} px/mm",
            f"{sharp:.2f} px/mm",
            sharp >= spec.mirrors.floor,
        ),
        Line(
            "transmission angles",
            "Transmission",
            f"> {limits.transmission_deg:g}°",
            f"{verdict.least_deg:.2f}°",
            verdict.least_deg > limits.transmission_deg,
        ),
        Line(
            "range of motion of each joint",
            "Transmission",
            f"0 to {body.range_deg:g}°",
            everything if assembles else "not in every posture",
            assembles,
        ),
        Line(
            "range of the crank",
            "§3.1.2",
            f"≤ {limits.crank_range_deg:g}°",
            f"{crank:.1f}°",
            crank <= limits.crank_range_deg,
        ),
        Line(
            "space for the sensor beside the links",
            "§3.1.2",
            f"≥ {found.linkage.room.required:g} mm wide",
            f"{found.linkage.room.achieved:g} mm",
            found.linkage.room.met,
        ),
        Line(
            "links inside the phalanges, apart, away from lock-up",
            "§3.1.2",
            "every limit kept",
            _kept(found),
            not found.linkage.unmet,
        ),
    ]
    check = found.grasp
    if check is not None:
        straight = check.free_closing_pip_deg
        made += [
            Line(
                "pinch: DIP stays straight while PIP closes freely",
                "§3.1.2",
                f"to {body.range_deg - SHORT_DEG:g}° or beyond",
                f"to PIP {straight:.0f}°",
                straight >= body.range_deg - SHORT_DEG,
            ),
            Line(
                "adaptive: DIP closes when the intermediate pad is held",
                "§3.1.2",
                "until the distal pad touches",
                (
                    f"distal pad touches at DIP {check.adaptive_dip_deg:.1f}°"
                    if check.adaptive_dip_deg > 0
                    else "distal pad never touches"
                ),
                check.adaptive_dip_deg > 0,
            ),
        ]
    return made


SHORT_DEG = 2.0
"""How far before the end of PIP's range free closing may begin to bend DIP, degrees."""


def degrees_of_freedom(finger: Finger) -> int:
    """Kutzbach's count of the linkage: 3 (L − 1) − 2 J."""
    sketch = parse_sketch(finger.linkage_tables(), "finger")
    return Equations(measure_sketch(sketch, "finger").dimensions).kutzbach


def _kept(found: FingerDesign) -> str:
    unmet = found.linkage.unmet
    if not unmet:
        return "every limit kept"
    return "; ".join(f"{one.name} {one.achieved:.3g} {one.unit}".strip() for one in unmet)


def findings(spec: FingerSpec, found: FingerDesign, made: list[Line]) -> list[str]:
    """What was found, most important first."""
    missed = [line for line in made if not line.met]
    body = spec.body
    said = []
    conflict = found.linkage.search.conflict()
    if missed:
        told = "; ".join(
            f"{line.name} ({line.required} required, {line.achieved} achieved)" for line in missed
        )
        said.append(
            f"A finger {body.thickness:g} mm thick does not meet every requirement. What gave way: "
            f"{told}."
        )
        if conflict:
            said.append(f"In the linkage these conflict: {', '.join(conflict)}.")
    else:
        said.append(
            f"A finger {body.thickness:g} mm thick meets all {len(made)} requirements: least "
            f"transmission angle {found.linkage.verdict.least_deg:.2f}°, every pad seen in every "
            f"posture with at least {found.mirrors.verdict.worst_px_per_mm:.2f} px/mm."
        )
    held = [one.words for one in found.linkage.search.held_by()[:4]]
    if held:
        said.append(f"The transmission angle is held by {', '.join(held)}.")
    share = found.share
    said.append(
        f"With the stated errors of assembly {100 * share.value:.1f} % of the fingers still show "
        f"everything (95 %: {100 * share.low:.1f} to {100 * share.high:.1f} %, {share.draws:,} "
        "draws)."
    )
    if found.grasp is None:
        said.append("Not every posture assembles, so that the grasp could not be checked.")
    else:
        said.append(
            f"Closing freely DIP stays straight until PIP {found.grasp.free_closing_pip_deg:.0f}°; "
            f"{_pinching(found, body)}"
        )
    said.append(
        "specs/finger.toml has every dimension; specs/linkage.toml and specs/scene.toml can be "
        "solved and traced as they are."
    )
    return said


def _pinching(found: FingerDesign, body: BodySpec) -> str:
    """Where on the straight distal pad a pinch holds at any torque, in words."""
    ratio = found.linkage.verdict.ratio[:, 0]
    low, high, end = float(ratio.min()), float(ratio.max()), body.distal - body.rim
    # From φ₂/φ₁ ≤ k₂ / (k₂ + l).
    least = body.intermediate * high / (1 - high) if high < 1 else float("inf")
    where = (
        f"so from k₂ = {least:.0f} mm on at any torque"
        if least <= end
        else f"which no contact on the pad (k₂ up to {end:g} mm) keeps at every PIP"
    )
    return (
        f"a pinch with straight DIP holds where φ₂/φ₁ ({low:.2f} to {high:.2f}) is at most "
        f"k₂/(k₂ + {body.intermediate:g} mm), {where}."
    )


def metrics(spec: FingerSpec, found: FingerDesign, made: list[Line]) -> list[Metric]:
    """The numbers."""
    verdict, mirrors, share = found.linkage.verdict, found.mirrors.verdict, found.share
    numbers = [
        Metric(
            "requirements_missed",
            sum(not line.met for line in made),
            "",
            f"lines of paper B's requirements that are not met, of {len(made)}",
            None,
            Target("=", 0),
        ),
        Metric(
            "min_transmission_angle_deg",
            verdict.least_deg,
            "°",
            "least transmission angle over all postures",
            None,
            Target(">=", spec.linkage.limits.transmission_deg),
        ),
        Metric(
            "worst_coverage",
            mirrors.worst_coverage,
            "",
            "least coverage of any pad in any posture",
            None,
            Target("=", 1.0),
        ),
        Metric(
            "worst_px_per_mm",
            mirrors.worst_px_per_mm,
            "px/mm",
            "least resolution of any pad",
            None,
            Target(">=", spec.mirrors.floor),
        ),
        Metric(
            "yield",
            share.value,
            "",
            f"part of {share.draws:,} fingers with errors of assembly that show everything "
            f"(95 %: {share.low:.3f} to {share.high:.3f})",
        ),
    ]
    check = found.grasp
    if check is not None:
        numbers += [
            Metric(
                "free_closing_pip_deg",
                check.free_closing_pip_deg,
                "°",
                "PIP up to which free closing keeps DIP straight",
            ),
            Metric(
                "virtual_work_error",
                check.virtual_work_error,
                "",
                "contact forces by virtual work against every link's balance",
                None,
                Target("<=", 1e-8),
            ),
            Metric(
                "unconverged",
                check.unconverged,
                "",
                f"states without an equilibrium, of {check.states}; none is reported",
                None,
                Target("=", 0),
            ),
        ]
    return numbers
