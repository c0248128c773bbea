"""The study itself: linkage and, beside it, mirrors; then the grasp check.

The links lie beside the sensing pads' width (`studies.models.links`), so that mirrors have the
whole section between the faces.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

from designopt.design_kind import Design
from designopt.export.parts import Assembly
from designopt.export.sheet import draw_assembly
from designopt.plot.figures import PALETTE
from designopt.study.records import Records
from designopt.study.report import Report
from designopt.study.results import Results
from designopt.study.study import Context
from studies.finger.advice import Advice, advice_rows, advise
from studies.finger.designing import Designer, FingerDesign, requirements
from studies.finger.kind import FINGER, finger_explorer, finger_parametric
from studies.finger.spec import FingerSpec, SpringSpec
from studies.models.finger import Finger, camera_of
from studies.models.finger_file import packaged_or_designed, read_finger
from studies.models.finger_parts import AXES, PHALANGES, FingerSpring
from studies.models.grasp.figures import draw_sequences
from studies.models.linkage_design.coupling.judging import CoupledVerdict
from studies.models.linkage_design.figures import add_figures, draw_straight
from studies.models.linkage_design.tables import add_tables
from studies.models.linkage_kinds import KINDS
from studies.models.manufacture.parts import make_assembly
from studies.models.mirror_design.clearances import layer_outlines, mirror_outlines
from studies.models.mirror_design.figures import draw_views, drawn_postures
from studies.models.mirror_design.requirements import (
    add_requirements,
)
from studies.models.spec_files import finger_files
from studies.models.words import words_of

DECIDING = {"body", "linkage", "mirrors"}
"""The settings on which linkage and mirrors depend."""

WORDS = ("studies.finger", "studies.models.linkage_design", "studies.models.mirror_design")
"""Packages that have the words of the report."""

MIRROR, CAMERA, LAYER = PALETTE[4], PALETTE[1], "#cfe8e6"


def run(spec: FingerSpec, context: Context) -> Results:
    """Design a finger for its requirements, and check line by line which of them it meets.

    Raises:
        UserError: another float type than float64, or no room for a coupling bar.
    """
    context.require_float64("finger solves its requirements to 1e-8")
    out = Report(spec, words_of(*WORDS))
    designer = Designer(context)
    designer.require_room(spec)
    found = designer.finger(spec)
    lines = requirements(spec, found)
    add_metrics(out, found, lines)
    add_findings(out, spec, found, lines, context)
    if spec.advice and len(lines.where(met="no")):
        with context.step("Advice"):
            add_advice(out, advise(spec, designer))
    out.table("table_3_1", lines)
    out.table("dimensions", dimensions(found.finger))
    add_requirements(out, found.mirrors, found.share, spec.mirrors)
    add_tables(out, spec.linkage.limits, found.linkage)
    assembly = make_assembly(found.finger)
    out.table("bill", bill(assembly))
    out.figure("drawing", draw_section(found.finger), most=4)
    out.figure("parts", draw_assembly(assembly))
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
    """`finger_design`, explored and optimised with all that the settings ask for."""
    asked = {"limits": spec.linkage.limits, "motor": spec.linkage.motor, "mirrors": spec.mirrors}
    kind = replace(
        FINGER,
        explorer=partial(finger_explorer, **asked),
        parametric=partial(finger_parametric, **asked),
    )
    return Design(kind, finger_design(spec, folder))


def finger_design(spec: FingerSpec, folder: Path | None) -> Finger:
    """The finger that the study designs for these requirements.

    Args:
        spec: the requirements.
        folder: the ``specs`` of an earlier result with them; the package has those of the default
            body, linkage and mirrors.

    Raises:
        UserError: the folder lacks its files, or they have been spoilt; no room for a coupling bar.
    """

    def designed(context: Context) -> Finger:
        designer = Designer(context)
        designer.require_room(spec)
        _, mirrors, _ = designer.parts(spec)
        return mirrors.finger

    known = folder is not None
    finger = read_finger(folder) if known else packaged_or_designed(spec, DECIDING, designed)
    if not KINDS[spec.linkage.kind].springs:
        return finger
    return replace(finger, spring=spring_from(spec.spring))


def spring_from(spec: SpringSpec) -> FingerSpring:
    """Spring and motor of the settings."""
    return FingerSpring(spec.stiffness, spec.preload, spec.servo)


def dimensions(finger: Finger) -> Records:
    """Phalanges, camera, mirrors and spring; the pins have their own table."""
    body, camera = finger.body, camera_of(finger)
    dorsal, tilt = float(body.dorsal), math.degrees(camera.tilt)
    own = f"camera, from {AXES[camera.phalanx]} in the {camera.phalanx} phalanx"
    rows = [
        *((f"{name} phalanx", "length", getattr(body, name), "mm") for name in PHALANGES),
        ("all phalanges", "thickness", body.thickness, "mm"),
        ("all phalanges", "palmar face to axes", body.axis_height, "mm"),
        (own, "x", camera.along, "mm"),
        (own, "y", dorsal - camera.depth, "mm"),
        (own, "optical axis from straight down, counter-clockwise", tilt, "°"),
    ]
    names = finger.mirror_names
    for name, mirror in zip(names, finger.mirrors, strict=True):
        part = f"{name} mirror, from {AXES[mirror.phalanx]} in its phalanx"
        for end, (along, depth) in zip(("near", "far"), mirror.ends.tolist(), strict=True):
            rows += [
                (part, f"{end} end, x", along, "mm"),
                (part, f"{end} end, y", dorsal - depth, "mm"),
            ]
        rows.append((part, "mount behind it", float(mirror.mount), "mm"))
    if finger.spring is not None:
        for name, unit in (("stiffness", "N mm/rad"), ("preload", "rad")):
            part = "spring between distal phalanx and plate"
            rows.append((part, name, getattr(finger.spring, name), unit))
    parts, names, values, units = zip(*rows, strict=True)
    numbers = [float(value) for value in values]
    return Records({"part": parts, "dimension": names, "value": numbers, "unit": units})


def bill(assembly: Assembly) -> Records:
    """The bill of materials."""
    rows = Records()
    for row in assembly.bill():
        rows.add(**row._asdict())
    return rows


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


def add_findings(
    out: Report, spec: FingerSpec, found: FingerDesign, lines: Records, context: Context
) -> None:
    """What was found, most important first."""
    missed, search = lines.where(met="no"), found.linkage.search
    if len(missed):
        cells = (missed[name] for name in ("requirement", "required", "achieved"))
        words = map("{} ({} required, {} achieved)".format, *cells)
        out.say("missed", missed="; ".join(words))
        with context.step("Requirements that conflict"):
            conflict = search.conflict()
        if conflict:
            out.say("conflict", conflict=", ".join(conflict))
    else:
        out.say("met")
    if held := [one.words for one in search.held_by()[:4]]:
        out.say("held", held=", ".join(held))
    out.say("yield", low=100 * found.share.low)
    verdict = found.linkage.verdict
    if isinstance(verdict, CoupledVerdict):
        out.say("coupled", pip=verdict.pip_deg[-1], dip=verdict.dip_deg[-1])
    elif found.grasp is None:
        out.say("no-grasp")
    else:
        ratio = verdict.ratio[:, 0]
        low, high = float(ratio.min()), float(ratio.max())
        out.say("grasp", ratio_low=low, ratio_high=high, where=pinching(spec, high))
    out.say("files")


def add_advice(out: Report, advice: Sequence[Advice]) -> None:
    """The smallest single changes that would meet everything, each verified by a run."""
    if advice:
        out.say("advice", changes=", or ".join(one.words for one in advice))
        out.table("advice", advice_rows(advice))
    else:
        out.say("no-advice")


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
    straight = jnp.zeros(1)
    mounts = [mirror_outlines(finger, mirror, straight)[0] for mirror in finger.mirrors]
    solids = {
        "layers on pads": (np.concatenate(layer_outlines(finger)), LAYER),
        "mounts": (np.asarray(mounts), "0.6"),
        "body of the camera": (np.asarray(finger.camera_boxes()), CAMERA),
    }
    for label, (outlines, color) in solids.items():
        for corners in outlines:
            axis.fill(*corners.T, facecolor=color, edgecolor="0.3", linewidth=0.5, label=label)
    for ends in np.asarray(scene.mirrors):
        axis.plot(*ends.T, color=MIRROR, linewidth=1.5, label="mirrors")
    position, direction = np.asarray(scene.camera.position), float(scene.camera.direction)
    axis.plot(*position, "^", color=CAMERA, markersize=8, label="camera")
    end = position + 5 * np.array([np.cos(direction), np.sin(direction)])
    axis.annotate("", tuple(end), tuple(position), arrowprops={"arrowstyle": "->", "color": CAMERA})
    return drawing
