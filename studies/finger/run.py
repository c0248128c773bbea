"""The study itself: linkage, then mirrors in the space that it leaves, then the grasp check.

The links lie beside the sensing pads' width (`studies.models.links`), so that mirrors have the
whole section between the faces.
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

from designopt.design_kind import Design
from designopt.plot.figures import PALETTE
from designopt.study.records import Records
from designopt.study.report import Report
from designopt.study.results import Results
from designopt.study.study import Context
from kinematics.io.assembling import Equations
from kinematics.io.sketch import parse_sketch
from kinematics.io.sketch_geometry import measure_sketch
from studies.finger import FingerSpec, SpringSpec
from studies.finger.bench import FingerBench
from studies.finger.kind import FINGER
from studies.models.checks import Check
from studies.models.finger import (
    PHALANGES,
    Finger,
    FingerSpring,
    camera_of,
    mirror_names,
    spring_of,
)
from studies.models.finger_file import packaged_or_designed, read_finger
from studies.models.grasp.analysis import Analysis, GraspCheck, analyze, summary
from studies.models.grasp.figures import draw_sequences
from studies.models.grasp.spec import GraspSpec
from studies.models.linkage_design.analysis import LinkageDesign, design_linkage
from studies.models.linkage_design.figures import add_figures, draw_straight
from studies.models.linkage_design.tables import add_tables
from studies.models.mirror_design.design import MirrorDesign, design_mirrors
from studies.models.mirror_design.figures import draw_views, drawn_postures
from studies.models.mirror_design.judging import percent_at_least
from studies.models.mirror_design.requirements import (
    COVERAGE,
    SHARPNESS,
    SPARE,
    add_requirements,
    optical_checks,
)
from studies.models.mirror_design.yields import Yield, monte_carlo
from studies.models.spec_files import finger_files
from studies.models.words import words_of

PINCHES = 6
"""Places on the distal pad at which it pinches."""

SHORT_DEG = 2.0
"""How far before the end of PIP's range free closing may begin to bend DIP, degrees."""

DECIDING = {"body", "linkage", "mirrors"}
"""The settings on which linkage and mirrors depend."""

OPTICAL = {
    "yield": "yield with errors of assembly",
    "blur": "largest blur spot",
    "transmission": "light through layers",
    "membrane": "membranes together",
}
"""Requirements on the optics that have lines of their own, and what these are called."""

WORDS = ("studies.finger", "studies.models.linkage_design", "studies.models.mirror_design")
"""Packages that have the words of the report."""

MIRROR, CAMERA = PALETTE[4], PALETTE[1]


class FingerDesign(NamedTuple):
    """A finger that was designed.

    Attributes:
        finger: itself.
        linkage: its linkage.
        mirrors: its camera and mirrors.
        share: part of the fingers with errors of assembly that show everything.
        closings: how it closes; ``None`` where its linkage does not assemble in every posture,
            for then there is no closing to compute.
        grasp: what these come to.
    """

    finger: Finger
    linkage: LinkageDesign
    mirrors: MirrorDesign
    share: Yield
    closings: Analysis | None
    grasp: GraspCheck | None


def run(spec: FingerSpec, context: Context) -> Results:
    """Design a finger for its requirements, and check line by line which of them it meets.

    Raises:
        UserError: another float type than float64.
    """
    context.require_float64("finger solves its requirements to 1e-8")
    out = Report(spec, words_of(*WORDS))
    found = find(spec, context)
    lines = requirements(spec, found)
    add_metrics(out, found, lines)
    add_findings(out, spec, found, lines)
    out.table("table_3_1", lines)
    out.table("dimensions", dimensions(found.finger))
    add_requirements(out, found.mirrors, found.share, spec.mirrors)
    add_tables(out, spec.linkage.limits, found.linkage)
    out.figure("drawing", draw_section(found.finger), most=4)
    verdict = found.mirrors.verdict
    degrees = ", ".join(f"{verdict.degrees[i]:g}" for i in drawn_postures(verdict))
    out.figure("views", draw_views(found.mirrors.finger.scene(), verdict), degrees=degrees)
    if found.closings is not None:
        out.figure("closing", draw_sequences(found.closings))
    add_figures(out, spec.linkage.limits, found.linkage)
    for file in finger_files(found.finger):
        out.file(file)
    return out.results()


def design(spec: FingerSpec, folder: Path | None) -> Design:
    """`finger_design`, explored with the resolution that the settings ask for."""
    kind = replace(FINGER, explorer=lambda finger: FingerBench(finger, spec.mirrors.floor))
    return Design(kind, finger_design(spec, folder))


def finger_design(spec: FingerSpec, folder: Path | None) -> Finger:
    """The finger that the study designs for these requirements.

    Args:
        spec: the requirements.
        folder: the ``specs`` of an earlier result with them; the package has those of the default
            body, linkage and mirrors.

    Raises:
        UserError: the folder lacks its files, or they have been spoilt.
    """

    def designed(context: Context) -> Finger:
        with context.step("Linkage"):
            linkage = design_linkage(spec.linkage_spec(), context.seed)
        return design_mirrors(linkage.finger, spec.mirrors, context).finger

    known = folder is not None
    finger = read_finger(folder) if known else packaged_or_designed(spec, DECIDING, designed)
    return replace(finger, spring=spring_from(spec.spring))


def spring_from(spec: SpringSpec) -> FingerSpring:
    """Spring and motor of the settings."""
    return FingerSpring(spec.stiffness, spec.preload, spec.servo)


def find(spec: FingerSpec, context: Context) -> FingerDesign:
    """Linkage, mirrors and grasp of a finger for its requirements."""
    with context.step("Linkage"):
        linkage = design_linkage(spec.linkage_spec(), context.seed)
    mirrors = design_mirrors(linkage.finger, spec.mirrors, context)
    finger = mirrors.finger
    with context.step("Yield of the mirrors"):
        errors = spec.mirrors.tolerances
        share = monte_carlo(finger, errors, draws=spec.yield_draws, seed=context.seed)
    if not linkage.verdict.assembles:
        return FingerDesign(finger, linkage, mirrors, share, None, None)
    body = spec.body
    settings = GraspSpec(
        body=body,
        diameters=spec.spring.diameters,
        pinch_pip_deg=[body.range_deg / 3, 2 * body.range_deg / 3],
        pinch_at=np.linspace(body.axis_height, body.distal - body.rim, PINCHES).tolist(),
    )
    with context.step("Grasp"):
        closings = analyze(finger, settings, polygon=False)
    return FingerDesign(finger, linkage, mirrors, share, closings, summary(closings))


def requirements(spec: FingerSpec, found: FingerDesign) -> Records:
    """Table 3.1 line by line with this project's resolution, then the requirements of §3.1.2."""
    end, limits, floor = spec.body.range_deg, spec.linkage.limits, spec.mirrors.floor
    linkage, width, unmet = found.linkage.verdict, found.linkage.width, found.linkage.unmet
    seen, sharp = found.mirrors.verdict.worst_coverage, found.mirrors.verdict.worst_px_per_mm
    lines = Records()

    def line(requirement: str, category: str, required: str, achieved: str, met: bool) -> None:
        """As in Table 3.1; the category is where in the text it stands, or whose it is, too."""
        words = {"required": required, "achieved": achieved, "met": "yes" if met else "no"}
        lines.add(requirement=requirement, category=category, **words)

    phalanges = len(set(PHALANGES) & set(found.finger.linkage_tables()["bodies"]))
    line("phalanges", "Geometry", "3", str(phalanges), phalanges == 3)
    freedoms = degrees_of_freedom(found.finger)
    line("degrees of freedom", "Geometry", "2", str(freedoms), freedoms == 2)
    line("motors", "Hardware", "1", "1, at the crank (by construction)", True)
    line("cameras", "Hardware", "1", "1, in the intermediate phalanx (by construction)", True)
    parts = f"at least {percent_at_least(seen)} of each in every posture"
    asked = "all, in every posture"
    line("sensing segments visible", "Tactile sensing", asked, parts, seen == 1.0)
    asked = f"≥ {floor:g} px/mm"
    line("resolution of the pads", "this project", asked, f"{sharp:.2f} px/mm", sharp >= floor)
    checks = optical_checks(found.finger, found.mirrors.verdict, found.share, spec.mirrors)
    others = [one for one in checks if one.name not in (COVERAGE, SHARPNESS)]
    for check in others:
        if check.name in OPTICAL:
            line(OPTICAL[check.name], "this project", *in_words(check), check.met)
    rooms = [one for one in others if one.name not in OPTICAL and not one.name.startswith(SPARE)]
    amounts = [f"{one.name} {one.achieved:.3g} mm" for one in rooms if not one.met]
    asked, kept = f"≥ {spec.mirrors.room.clearance:g} mm, camera inside", "every clearance kept"
    reached = "; ".join(amounts) or kept
    line("clearance of mirrors, mounts and camera", "this project", asked, reached, not amounts)
    asked, least = f"> {limits.transmission_deg:g}°", linkage.least_deg
    met = least > limits.transmission_deg
    line("transmission angles", "Transmission", asked, f"{least:.2f}°", met)
    reached = f"{end:g}° each" if linkage.assembles else "not in every posture"
    asked = f"0 to {end:g}°"
    line("range of motion of each joint", "Transmission", asked, reached, linkage.assembles)
    asked, crank = f"≤ {limits.crank_range_deg:g}°", linkage.crank_range_deg
    line("range of the crank", "§3.1.2", asked, f"{crank:.1f}°", crank <= limits.crank_range_deg)
    asked, reached = f"≤ {width.required:g} mm", f"{width.achieved:g} mm"
    line("width with pads, LED strips, walls and links", "§3.1", asked, reached, width.met)
    name = "links inside the phalanges, apart, away from lock-up"
    amounts = [f"{one.name} {one.achieved:.3g} {one.unit}".strip() for one in unmet]
    line(name, "§3.1.2", "every limit kept", "; ".join(amounts) or "every limit kept", not unmet)
    if found.grasp is not None:
        straight, touching = found.grasp.free_closing_pip_deg, found.grasp.adaptive_dip_deg
        name, asked = "pinch: DIP stays straight while PIP closes freely", end - SHORT_DEG
        reached = f"to PIP {straight:.0f}°"
        line(name, "§3.1.2", f"to {asked:g}° or beyond", reached, straight >= asked)
        name = "adaptive: DIP closes when the intermediate pad is held"
        reached = "distal pad never touches"
        if touching > 0:
            reached = f"distal pad touches at DIP {touching:.1f}°"
        line(name, "§3.1.2", "until the distal pad touches", reached, touching > 0)
    return lines


def in_words(check: Check) -> tuple[str, str]:
    """A requirement and what is achieved."""
    sign, unit = "≥" if check.at_least else "≤", f" {check.unit}".rstrip()
    return f"{sign} {check.required:g}{unit}", f"{check.achieved:.4g}{unit}"


def degrees_of_freedom(finger: Finger) -> int:
    """Kutzbach's count of the linkage: 3 (L − 1) − 2 J."""
    sketch = parse_sketch(finger.linkage_tables(), "finger")
    return Equations(measure_sketch(sketch, "finger").dimensions).kutzbach


def dimensions(finger: Finger) -> Records:
    """Phalanges, camera, mirrors and spring; the pins have their own table."""
    body, scene, spring = finger.body, finger.scene(), spring_of(finger)
    x, y = scene.camera.position
    tilt = math.degrees(camera_of(finger).tilt)
    camera = "camera, from A in the intermediate phalanx"
    rows = [
        *((f"{name} phalanx", "length", getattr(body, name), "mm") for name in PHALANGES),
        ("all phalanges", "thickness", body.thickness, "mm"),
        ("all phalanges", "palmar face to axes", body.axis_height, "mm"),
        (camera, "x", x, "mm"),
        (camera, "y", y, "mm"),
        (camera, "optical axis from straight down, counter-clockwise", tilt, "°"),
    ]
    dorsal = float(body.dorsal)
    names = mirror_names([mirror.phalanx for mirror in finger.mirrors])
    for name, mirror in zip(names, finger.mirrors, strict=True):
        origin = "A" if mirror.phalanx == "proximal" else "B"
        part = f"{name} mirror, from {origin} in its phalanx"
        for end, (along, depth) in zip(("near", "far"), mirror.ends.tolist(), strict=True):
            rows += [
                (part, f"{end} end, x", along, "mm"),
                (part, f"{end} end, y", dorsal - depth, "mm"),
            ]
        rows.append((part, "mount behind it", float(mirror.mount), "mm"))
    for name, unit in (("stiffness", "N mm/rad"), ("preload", "rad")):
        part = "spring between distal phalanx and plate"
        rows.append((part, name, getattr(spring, name), unit))
    parts, names, values, units = zip(*rows, strict=True)
    numbers = [float(value) for value in values]
    return Records({"part": parts, "dimension": names, "value": numbers, "unit": units})


def add_metrics(out: Report, found: FingerDesign, lines: Records) -> None:
    """The numbers; targets are the requirements."""
    mirrors, grasp = found.mirrors.verdict, found.grasp
    out.values(lines=len(lines), share=found.share)
    out.metrics(
        requirements_missed=len(lines.where(met="no")),
        min_transmission_angle_deg=found.linkage.verdict.least_deg,
        worst_coverage=mirrors.worst_coverage,
        worst_px_per_mm=mirrors.worst_px_per_mm,
        **{"yield": found.share.value},
    )
    if grasp is not None:
        out.values(states=grasp.states)
        out.metrics(
            free_closing_pip_deg=grasp.free_closing_pip_deg,
            virtual_work_error=grasp.virtual_work_error,
            unconverged=grasp.unconverged,
        )


def add_findings(out: Report, spec: FingerSpec, found: FingerDesign, lines: Records) -> None:
    """What was found, most important first."""
    missed, search = lines.where(met="no"), found.linkage.search
    if len(missed):
        cells = (missed[name] for name in ("requirement", "required", "achieved"))
        words = map("{} ({} required, {} achieved)".format, *cells)
        out.say("missed", missed="; ".join(words))
        if conflict := search.conflict():
            out.say("conflict", conflict=", ".join(conflict))
    else:
        out.say("met")
    if held := [one.words for one in search.held_by()[:4]]:
        out.say("held", held=", ".join(held))
    out.say("yield", low=100 * found.share.low)
    if found.grasp is None:
        out.say("no-grasp")
    else:
        ratio = found.linkage.verdict.ratio[:, 0]
        low, high = float(ratio.min()), float(ratio.max())
        out.say("grasp", ratio_low=low, ratio_high=high, where=pinching(spec, high))
    out.say("files")


def pinching(spec: FingerSpec, ratio: float) -> str:
    """Where on the straight distal pad a pinch holds at any torque, in words.

    Args:
        spec: with the body.
        ratio: largest φ₂/φ₁ with straight DIP.
    """
    body, end = spec.body, spec.body.distal - spec.body.rim
    # From φ₂/φ₁ ≤ k₂ / (k₂ + l).
    least = body.intermediate * ratio / (1 - ratio) if ratio < 1 else math.inf
    if least <= end:
        return f"so from k₂ = {least:.0f} mm on at any torque"
    return f"which no contact on the pad (k₂ up to {end:g} mm) keeps at every PIP"


def draw_section(finger: Finger) -> Figure:
    """The section of the straight finger, to scale, with everything that was designed."""
    drawing, scene = draw_straight(finger, height=3.4), finger.scene()
    [axis] = drawing.axes
    for ends in np.asarray(scene.mirrors):
        axis.plot(*ends.T, color=MIRROR, linewidth=2.5, label="mirrors")
    position, direction = np.asarray(scene.camera.position), float(scene.camera.direction)
    axis.plot(*position, "^", color=CAMERA, markersize=8, label="camera")
    end = position + 5 * np.array([np.cos(direction), np.sin(direction)])
    axis.annotate("", tuple(end), tuple(position), arrowprops={"arrowstyle": "->", "color": CAMERA})
    return drawing
