"""The study itself: random fingers are designed and judged by others; advice for some of them."""

from __future__ import annotations

import math
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
from studies.finger import FingerSpec
from studies.finger.advice import advise
from studies.finger.designing import Designer, FingerDesign, requirements
from studies.finger.verdicts import FingerVerdictsSpec
from studies.models.finger import Finger
from studies.models.finger_file import write_finger
from studies.models.linkage_design.clearances import (
    find_face_meetings,
    find_free_meetings,
    name_of,
)
from studies.models.mirror_design.clearances import clearance_checks
from studies.models.path_tracer import require_mitsuba
from studies.oracles.clearances import polygon_clearances
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

INSIDE = " inside the "
"""In the names of requirements that keep pins from faces and ends."""

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
    fingers = enumerate(draw(spec.fingers, context.seed))
    for number, drawn in sorted(fingers, key=lambda one: one[1].numbers["mirrors"]):
        row: dict[str, Any] = {"finger": number} | drawn.numbers
        if drawn.spec is None:
            rows.add(**row, verdict="refused", missed=drawn.refusal, **nothing_judged())
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
        rows.add(**row, verdict=verdict, missed="; ".join(missed), **judged)
        if missed:
            unmet.append(Unmet(number, missed, drawn.spec, designer))
    out.table("fingers", rows)
    least = sorted(unmet, key=lambda one: len(one.missed))[: spec.advised]
    for one in least:
        with context.step(f"Advice for finger {one.number}"):
            for change in advise(one.spec, one.designer):
                changes.add(finger=one.number, **change._asdict())
    if len(changes):
        out.table("changes", changes)
    infeasible = int(np.sum(rows["verdict"] != "met"))
    out.values(looked_at=len(least))
    out.metrics(
        contradicted=int(np.sum(rows["agree"] == "no")),
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


def nothing_judged() -> dict[str, Any]:
    """The columns of `judge` where no finger was designed."""
    numbers = ("links_mm", "polygons_mm", "optics_mm", "optics_polygons_mm", "coverage", "off")
    return dict.fromkeys(numbers, float("nan")) | {"agree": "yes"}


def judge(
    drawn: FingerSpec, found: FingerDesign, spec: FingerVerdictsSpec, seed: int
) -> dict[str, Any]:
    """What polygons and traced rays find in a finger, beside the verdict.

    Returns:
        Least distance of bars from all that they can meet and from the outline, by the verdict and
        by polygons, mm; that of mirrors with their mounts, likewise; least coverage by the verdict,
        and the largest difference of the rays' coverage from the library's; and whether they agree.
    """
    finger, verdict = found.finger, found.linkage.verdict
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "finger.toml"
        write_finger(finger, path)
        polygons = polygon_clearances(path, spec.steps)
        degrees = checked_postures(found, spec.postures, seed)
        off = float(np.max(np.abs(traced_coverage(path, degrees) - coverage_of(finger, degrees))))
    meetings = [*find_free_meetings(finger), *find_face_meetings(finger)]
    names = {name_of(one) for one in meetings}
    # To faces and ends it is asked from pins, by half a bar's width and the shell more.
    links = drawn.linkage.limits.clearance + min(
        check.slack for check in verdict.checks if check.name in names or INSIDE in check.name
    )
    bars = min(polygons.bars_apart, polygons.bars_inside)
    mirrors = [one.achieved for one in clearance_checks(finger, 0.0)[:-1]]
    optics = min(mirrors, default=math.inf)
    others = [
        float(np.min(each)) for pair, each in polygons.apart.items() if "mirror" in " ".join(pair)
    ]
    # The polygons' faces are the inner sides of the shell.
    shell = drawn.linkage.links.shell
    others += [
        float(np.min(each)) + shell for part, each in polygons.inside.items() if "mirror" in part
    ]
    by_polygons = min(others, default=math.inf)
    agree = verdict.assembles == bool(np.all(polygons.assembled)) and off < WITHIN
    if verdict.assembles:
        agree &= same_distance(links, bars)
    agree &= same_distance(optics, by_polygons)
    return {
        "links_mm": links,
        "polygons_mm": bars,
        "optics_mm": optics,
        "optics_polygons_mm": by_polygons,
        "coverage": found.mirrors.verdict.worst_coverage,
        "off": off,
        "agree": "yes" if agree else "no",
    }


def same_distance(own: float, other: float) -> bool:
    """Whether two distances are the same, mm; of overlaps each measures something else."""
    return own == other or abs(own - other) < WITHIN_MM or max(own, other) < 0


def checked_postures(found: FingerDesign, count: int, seed: int) -> Float[np.ndarray, "poses 2"]:
    """Random postures, and those in which the least is seen, PIP and DIP in degrees."""
    worst, ends = found.mirrors.verdict.worst, np.array(found.finger.body.ranges_deg)
    assert worst is not None  # as it is over all pairs of angles
    random = np.random.default_rng(seed).uniform(0.0, 1.0, (count, 2)) * ends
    return np.concatenate([random, [(one.pip_deg, one.dip_deg) for one in worst.coverage]])


def coverage_of(finger: Finger, degrees: Float[np.ndarray, "poses 2"]) -> np.ndarray:
    """Coverage of every pad by the library."""
    return np.asarray(find_coverage(finger.scene(), jnp.deg2rad(jnp.asarray(degrees))).value)
