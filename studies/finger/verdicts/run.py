"""The study itself: random fingers are designed and judged by others; advice for some of them."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from pydantic import ValidationError
from scipy.stats import qmc

from designopt.compilation_cache import forget_programs_if_many
from designopt.study.records import Records
from designopt.study.report import Report
from designopt.study.results import Results
from designopt.study.study import Context
from optics import find_coverage
from studies.finger.advice import advise, with_value
from studies.finger.designing import Designer, FingerDesign, requirements
from studies.finger.spec import FingerSpec
from studies.finger.verdicts import FingerVerdictsSpec
from studies.models.finger import Finger
from studies.models.finger_file import write_finger
from studies.models.linkage_design.clearances import (
    find_face_meetings,
    find_free_meetings,
    name_of,
)
from studies.models.linkage_design.judging import STEP_DEG
from studies.models.linkage_design.problem import grids
from studies.models.mirror_design.clearances import clearance_checks
from studies.models.path_tracer import require_mitsuba
from studies.oracles.clearances import PolygonClearances, polygon_clearances
from studies.oracles.traced_coverage import traced_coverage

BOUNDS = {
    "thickness": (16.0, 30.0),
    "proximal": (20.0, 50.0),
    "intermediate": (20.0, 50.0),
    "distal": (20.0, 50.0),
    "pip_deg": (60.0, 100.0),
    "dip_deg": (60.0, 100.0),
    "fov_deg": (90.0, 200.0),
    "mirrors": (0.0, 4.0),
}
"""What is drawn, and between which bounds; mirrors are the whole part."""

CARRIERS = ("distal", "proximal", "distal")
"""Phalanges of the mirrors; a finger with fewer has the first ones."""

INSIDE, FROM = " inside the ", " from "
"""In the names of requirements that keep pins from faces and ends, and parts from each other."""

WITHIN_MM, WITHIN = 1e-3, 1e-3
"""By how much polygons (mm) and rays (parts of a pad) may differ from the verdict."""


class Drawn(NamedTuple):
    """Requirements that were drawn.

    Attributes:
        numbers: by the names of `BOUNDS`.
        spec: settings with them; ``None`` where they are refused.
        refusal: why, in one line.
    """

    numbers: dict[str, float]
    spec: FingerSpec | None
    refusal: str = ""


class Unmet(NamedTuple):
    """A finger that misses something.

    Attributes:
        number: of the drawn one.
        missed: names of the requirements that it misses.
        spec: its settings.
        designer: what designed it.
    """

    number: int
    missed: list[str]
    spec: FingerSpec
    designer: Designer


def run(spec: FingerVerdictsSpec, context: Context) -> Results:
    """Draw fingers and compare the verdict on each with what polygons and rays find.

    Raises:
        UserError: Mitsuba is not installed, or another float type than float64.
    """
    context.require_float64("finger-verdicts solves requirements to 1e-8")
    require_mitsuba("finger-verdicts")
    out, rows, changes = Report(spec, package=__package__), Records(), Records()
    unmet: list[Unmet] = []
    # One after the other those of as many mirrors, for they share compiled programs.
    fingers = [*enumerate(draw(spec.fingers, context.seed))]
    is_done = context.count(len(fingers))
    for number, drawn in sorted(fingers, key=lambda one: one[1].numbers["mirrors"]):
        row: dict[str, Any] = {"finger": number} | drawn.numbers
        if drawn.spec is None:
            rows.add(**row, verdict="refused", missed=drawn.refusal, **columns())
            is_done()
            continue
        forget_programs_if_many()
        with context.step(f"Finger {number}"):
            # One for each, so that no linkage keeps the parts apart that another one needs.
            designer = Designer(context)
            found = designer.finger(drawn.spec)
            missed = [*requirements(drawn.spec, found).where(met="no")["requirement"]]
            with context.step("Polygons and rays"):
                judged = judge(drawn.spec, found, spec, context.seed)
        verdict = "missed" if missed else "met"
        rows.add(**row, verdict=verdict, missed="; ".join(missed), **columns(*judged))
        if missed:
            unmet.append(Unmet(number, missed, drawn.spec, designer))
        is_done()
    out.table("fingers", rows)
    least = sorted(unmet, key=lambda one: len(one.missed))[: spec.advised]
    for one in context.each(least, lambda one: f"Advice for finger {one.number}"):
        for change in advise(one.spec, one.designer):
            then = with_value(one.spec, change.setting, change.needed)
            assert then is not None  # as it was designed
            designed = one.designer.with_own_linkages().finger(then)
            judged = judge(then, designed, spec, context.seed)
            changes.add(finger=one.number, **change.row, **columns(*judged))
    if len(changes):
        out.table("changes", changes)
    infeasible = int(np.sum(rows["verdict"] != "met"))
    agree = [*rows["agree"], *(changes["agree"] if len(changes) else [])]
    out.values(looked_at=len(least), suggested=len(changes))
    out.metrics(
        contradicted=agree.count("no"),
        infeasible=infeasible,
        helped=len(set(changes["finger"].tolist())) if len(changes) else 0,
    )
    out.say("verdicts", met=len(rows) - infeasible)
    return out.results()


def draw(count: int, seed: int) -> Iterator[Drawn]:
    """Requirements from a scrambled Sobol sequence, the rest as the defaults have it."""
    low, high = np.array(list(BOUNDS.values())).T
    power = max(count - 1, 0).bit_length()
    points = qmc.Sobol(len(low), rng=np.random.default_rng(seed)).random_base2(power)[:count]
    for point in (low + points * (high - low)).round(1):
        numbers = dict(zip(BOUNDS, point.tolist(), strict=True))
        numbers["mirrors"] = float(min(int(numbers["mirrors"]), len(CARRIERS)))
        body = {name: numbers[name] for name in ("thickness", "proximal", "intermediate", "distal")}
        body |= {"range_deg": numbers["pip_deg"], "dip_range_deg": numbers["dip_deg"]}
        mirrors = {
            "camera": {"fov_deg": numbers["fov_deg"]},
            "phalanges": list(CARRIERS[: int(numbers["mirrors"])]),
            # Membranes of bodies of any length.
            "least_membrane": 1.0,
        }
        try:
            spec = FingerSpec.model_validate({"body": body, "mirrors": mirrors})
        except ValidationError as error:
            yield Drawn(numbers, None, str(error.errors()[0]["msg"]))
        else:
            yield Drawn(numbers, spec)


class Compared(NamedTuple):
    """A verdict beside what another way finds.

    Attributes:
        own: what the verdict rests on.
        other: the same by polygons or by rays.
        agree: whether they agree in all that can be compared.
    """

    own: float
    other: float
    agree: bool


NOTHING = Compared(float("nan"), float("nan"), agree=True)
"""Where there is nothing to compare."""


def judge(
    drawn: FingerSpec, found: FingerDesign, spec: FingerVerdictsSpec, seed: int
) -> tuple[Compared, Compared, Compared]:
    """The verdict on a finger beside polygons and traced rays, which have nothing but its file.

    Returns:
        Least distances of bars, see `compare_bars`, and of mirrors, see `compare_mirrors`, mm; and
        least coverage, see `compare_coverage`.
    """
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "finger.toml"
        write_finger(found.finger, path)
        # In the verdict's own postures: the least over others would differ by more than rounding.
        pip, dip = (np.rad2deg(angles) for angles in grids(found.finger.body, STEP_DEG))
        polygons = polygon_clearances(path, degrees=(pip, dip))
        degrees = checked_postures(found, spec.postures, seed)
        rays = traced_coverage(path, degrees)
    bars, mirrors = compare_bars(drawn, found, polygons), compare_mirrors(drawn, found, polygons)
    return bars, mirrors, compare_coverage(found, degrees, rays)


def compare_bars(drawn: FingerSpec, found: FingerDesign, polygons: PolygonClearances) -> Compared:
    """Least distance of bars from all that they can meet and from the outline, mm.

    They agree if the linkage assembles in every posture or in both does not; if every two parts
    keep the same distance; if that from the outline is no more than polygons find, for the
    verdict's is a lower bound; and if both have enough room or neither. NaN where the linkage does
    not assemble in every posture.
    """
    finger, verdict = found.finger, found.linkage.verdict
    if not verdict.assembles:
        return NOTHING._replace(agree=not np.all(polygons.assembled))
    names = {name_of(one) for one in find_free_meetings(finger) + find_face_meetings(finger)}
    meetings = [check for check in verdict.checks if check.name in names]
    # To faces and ends it is asked from pins, by half a bar's width and the shell more.
    asked = drawn.linkage.limits.clearance
    edge = asked + min(check.slack for check in verdict.checks if INSIDE in check.name)
    own = min(edge, *(one.achieved for one in meetings))
    other = min(polygons.bars_apart, polygons.bars_inside)
    agree = [same_distance(one.achieved, between(polygons, one.name)) for one in meetings]
    agree += [no_more(edge, polygons.bars_inside), same_side(own, other, asked)]
    return Compared(own, other, bool(np.all(polygons.assembled)) and all(agree))


def compare_mirrors(
    drawn: FingerSpec, found: FingerDesign, polygons: PolygonClearances
) -> Compared:
    """Least distance of mirrors with their mounts from all else, mm; NaN without mirrors.

    They agree as those of bars do, and if the camera keeps as much from the wall of the back.
    """
    *checks, camera = clearance_checks(found.finger, drawn.mirrors.room.clearance)
    agree = [no_more(camera.achieved, float(np.min(polygons.inside["camera"])))]
    if not checks:
        return NOTHING._replace(agree=all(agree))
    apart = [one for one in checks if FROM in one.name]
    edge = min(one.achieved for one in checks if FROM not in one.name)
    agree += [same_distance(one.achieved, between(polygons, one.name)) for one in apart]
    # The polygons' faces are the inner sides of the shell.
    shell = drawn.linkage.links.shell
    names = [f"{name} mirror" for name in found.finger.mirror_names]
    faces = min(float(np.min(polygons.inside[name])) for name in names) + shell
    parts = min(
        float(np.min(each))
        for pair, each in polygons.apart.items()
        if not {*names}.isdisjoint(pair)
    )
    own, other = min(one.achieved for one in checks), min(faces, parts)
    agree += [no_more(edge, faces), same_side(own, other, drawn.mirrors.room.clearance)]
    return Compared(own, other, all(agree))


def compare_coverage(
    found: FingerDesign,
    degrees: Float[np.ndarray, "poses 2"],
    rays: Float[np.ndarray, "poses pads"],
) -> Compared:
    """Least coverage of any pad.

    They agree if rays find the verdict's, and in every posture what the library computes.

    Args:
        found: the finger.
        degrees: PIP and DIP, among them those in which the least is seen.
        rays: what these find there.
    """
    own, other = found.mirrors.verdict.worst_coverage, float(np.min(rays))
    off = float(np.max(np.abs(rays - coverage_of(found.finger, degrees))))
    return Compared(own, other, off < WITHIN and abs(own - other) < WITHIN)


def between(polygons: PolygonClearances, name: str) -> float:
    """Least distance of the two parts that a line is named for, by polygons, mm."""
    one, other = name.split(FROM)
    other = other.removeprefix("the ").removeprefix("pin ")
    other = {"PIP axle": "A", "DIP axle": "B"}.get(other, other)
    pair = (one, other) if (one, other) in polygons.apart else (other, one)
    return float(np.min(polygons.apart[pair]))


def same_distance(own: float, other: float) -> bool:
    """Whether two distances are the same, mm; of overlaps each measures something else."""
    return abs(own - other) < WITHIN_MM or max(own, other) < 0


def no_more(own: float, other: float) -> bool:
    """Whether a lower bound of a distance is one, mm."""
    return own < other + WITHIN_MM


def same_side(own: float, other: float, asked: float) -> bool:
    """Whether two distances are both enough or both too little, mm."""
    return abs(own - other) < WITHIN_MM or (own >= asked) == (other >= asked)


def columns(
    bars: Compared = NOTHING, mirrors: Compared = NOTHING, coverage: Compared = NOTHING
) -> dict[str, Any]:
    """Columns of a table from what `judge` returns; by default those of a refused finger."""
    agree = bars.agree and mirrors.agree and coverage.agree
    return {
        "bars_mm": bars.own,
        "bars_polygons_mm": bars.other,
        "mirrors_mm": mirrors.own,
        "mirrors_polygons_mm": mirrors.other,
        "coverage": coverage.own,
        "coverage_by_rays": coverage.other,
        "agree": "yes" if agree else "no",
    }


def checked_postures(found: FingerDesign, count: int, seed: int) -> Float[np.ndarray, "poses 2"]:
    """Random postures, and those in which the least is seen, PIP and DIP in degrees."""
    worst, ends = found.mirrors.verdict.worst, np.array(found.finger.body.ranges_deg)
    assert worst is not None  # as it is over all pairs of angles
    random = np.random.default_rng(seed).uniform(0.0, 1.0, (count, 2)) * ends
    return np.concatenate([random, [(one.pip_deg, one.dip_deg) for one in worst.coverage]])


def coverage_of(finger: Finger, degrees: Float[np.ndarray, "poses 2"]) -> np.ndarray:
    """Coverage of every pad by the library."""
    return np.asarray(find_coverage(finger.scene(), jnp.deg2rad(jnp.asarray(degrees))).value)
