"""The study itself: the finger's parts are written, read by others, and these compared."""

from __future__ import annotations

import tempfile
import tomllib
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float

from designopt.errors import UserError
from designopt.export.sheet import draw_assembly
from designopt.io.spec import SpecFile
from designopt.study.records import Records
from designopt.study.report import Report
from designopt.study.results import Results
from designopt.study.study import Context
from studies.finger.solids import FingerSolidsSpec
from studies.models.finger import camera_of
from studies.models.finger_file import packaged_finger, read_finger, write_finger
from studies.models.links import OUTLINES
from studies.models.manufacture.parts import make_assembly
from studies.models.path_tracer import require_mitsuba
from studies.oracles.judge.solids import Face
from studies.oracles.traced_coverage import traced_coverage

DIGITS = 6
"""Of thicknesses, mm: 1.2 mm between faces of the kernel are 1.2 mm but for rounding."""

SHARED = 1e-3
"""Volume in common, mm³, from which two parts are in each other's way: below it they touch."""

NEAREST = 40
"""Rows of the table of the parts that come nearest to each other."""


def run(spec: FingerSolidsSpec, context: Context) -> Results:
    """Write a finger's solids and have them judged.

    Raises:
        UserError: the CAD kernel or Mitsuba is missing, or the finger lacks what its parts need.
    """
    context.require_float64("finger-solids compares volumes to 1e-6")
    require_mitsuba("finger-solids")
    try:
        from designopt.export.solids import make_solid, step_text
        from studies.oracles.clearances import postures
        from studies.oracles.solid_faces import solid_faces
        from studies.oracles.solids import (
            find_meetings,
            is_watertight,
            least_wall,
            read_solids,
            volume_of,
        )
    except ModuleNotFoundError as error:
        raise UserError(
            "finger-solids: the package cadquery-ocp-novtk is missing; install designopt[cad,judge]"
        ) from error
    out = Report(spec, package="studies.finger.solids")
    finger = read_finger(spec.finger) if spec.finger else packaged_finger()
    camera_of(finger)
    assembly = make_assembly(finger)
    with tempfile.TemporaryDirectory() as folder, context.step("Solids"):
        step, own = Path(folder) / "finger.step", Path(folder) / "finger.toml"
        step.write_text(step_text(finger.name, assembly.parts), encoding="utf-8")
        write_finger(finger, own)
        tables = tomllib.loads(own.read_text(encoding="utf-8"))
        solids, parts = read_solids(step), Records()
        for part in assembly.parts:
            solid, wall = solids[part.name], None
            if part.shell or part.item in OUTLINES:
                wall = round(least_wall(solid).thickness, DIGITS)
            before, after = volume_of(make_solid(part)), volume_of(solid)
            parts.add(
                part=part.name,
                volume_mm3=after,
                watertight="yes" if is_watertight(solid) else "no",
                least_wall_mm=wall,
                change=abs(after / before - 1),
            )
        with context.step("Parts apart"):
            found = find_meetings(solids, own, spec.steps)
        with context.step("Rays"):
            degrees = np.array(postures(tables, spec.traced))
            compared = coverage(own, degrees, solid_faces(step, own))
        content = step.read_text(encoding="utf-8")
    meetings = Records()
    for one in sorted(found, key=lambda one: (-one.shared, one.distance)):
        first, second = one.parts
        pip, dip = one.degrees
        meetings.add(
            first=first,
            second=second,
            distance_mm=one.distance,
            shared_mm3=one.shared,
            pip_deg=pip,
            dip_deg=dip,
            postures=one.postures,
        )
    moving = meetings.where(meetings["postures"] > 1)
    walls = [wall for wall in parts["least_wall_mm"] if wall is not None]
    out.values(parts=len(parts), pairs=len(meetings), postures=len(postures(tables, spec.steps)))
    out.metrics(
        not_watertight=len(parts.where(watertight="no")),
        least_wall_mm=min(walls),
        interpenetrating=int(np.sum(meetings["shared_mm3"] > SHARED)),
        least_distance_mm=float(np.min(moving["distance_mm"])),
        volume_change=float(np.max(parts["change"])),
        coverage_change=float(np.max(np.abs(compared["solids"] - compared["section"]))),
        step_kB=len(content.encode()) / 1000,
    )
    out.say("main")
    out.table("parts", parts)
    listed = meetings.where((meetings["postures"] > 1) | (meetings["shared_mm3"] > SHARED))
    out.table("nearest", listed.where(np.arange(len(listed)) < NEAREST))
    out.table("coverage", compared)
    out.figure("parts", draw_assembly(assembly))
    out.file(SpecFile("finger.step", "the solids, for any CAD program", content))
    return out.results()


def coverage(
    path: Path,
    degrees: Float[np.ndarray, "postures 2"],
    faces: Callable[[float, float], Sequence[Face]],
) -> Records:
    """Coverage of every pad by rays among the solids, and by rays in the section."""
    section, solid = (traced_coverage(path, degrees, one) for one in (None, faces))
    rows = Records()
    for pose, (flat, full) in enumerate(zip(section, solid, strict=True)):
        for pad, name in enumerate(("proximal", "intermediate", "distal")):
            at = {"pip_deg": degrees[pose, 0], "dip_deg": degrees[pose, 1], "pad": name}
            rows.add(**at, section=flat[pad], solids=full[pad])
    return rows
