"""The study itself: settings are varied step by step, and each design begins with a neighbour's.

That is continuation of the constrained problem: of all objectives but one the value is a
constraint, whose bound is moved (ε-constraint method: Y. Y. Haimes, L. S. Lasdon, D. A. Wismer,
IEEE Trans. Syst. Man Cybern. 1, 1971, 296).
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure

from designopt.compilation_cache import forget_programs_if_many
from designopt.io.spec import SpecFile
from designopt.plot.figures import MARKERS, PALETTE, new_figure
from designopt.study.records import Records
from designopt.study.report import Report
from designopt.study.results import Results
from designopt.study.study import Context
from studies.benchmarks.measuring import listed
from studies.finger.advice import value_of, with_value
from studies.finger.designing import (
    Designer,
    missed_by_linkage,
    missed_by_mirrors,
    with_linkage,
)
from studies.finger.front import VARIED, FingerFrontSpec
from studies.finger.spec import FingerSpec
from studies.models.finger import Finger
from studies.models.finger_file import format_finger
from studies.models.linkage_design.analysis import LinkageDesign
from studies.models.mirror_design.design import MirrorDesign
from studies.models.mirror_design.requirements import COVERAGE, SHARPNESS
from studies.models.mirror_design.yields import Yield

COLUMNS = {
    "transmission": "transmission_deg",
    "clearance": "clearance_mm",
    "thickness": "thickness_mm",
    "resolution": "resolution_px_per_mm",
    "yield": "yield",
    "layers": "layers_mm",
    "coverage": "coverage",
}
"""Columns of the objectives."""

LESS = {"thickness"}
"""Objectives of which less is better."""

REQUIREMENTS = {
    "transmission": "transmission angles",
    "resolution": SHARPNESS,
    "yield": "yield",
    "coverage": COVERAGE,
}
"""Requirements that an objective takes the place of: a point may miss them."""

TITLES = {
    "transmission": "least transmission angle (°)",
    "clearance": "clearance of the linkage (mm)",
    "thickness": "thickness of the finger (mm)",
    "resolution": "least resolution (px/mm)",
    "yield": "yield with errors of assembly",
    "layers": "thickness of the layers (mm)",
    "coverage": "least coverage",
}


class Point(NamedTuple):
    """A finger of the front.

    Attributes:
        spec: its settings.
        linkage: its linkage.
        mirrors: camera and mirrors.
        share: its yield.
    """

    spec: FingerSpec
    linkage: LinkageDesign
    mirrors: MirrorDesign
    share: Yield

    @property
    def finger(self) -> Finger:
        """All of it."""
        return with_linkage(self.mirrors.finger, self.linkage.finger)

    @property
    def values(self) -> dict[str, float]:
        """Of every objective."""
        verdict = self.mirrors.verdict
        return {
            "transmission": self.linkage.verdict.least_deg,
            "clearance": self.spec.linkage.limits.clearance,
            "thickness": self.spec.body.thickness,
            "resolution": verdict.worst_px_per_mm,
            "yield": self.share.value,
            "layers": sum(self.spec.mirrors.pads.thickness),
            "coverage": verdict.worst_coverage,
        }

    def missed(self, objectives: Sequence[str]) -> list[str]:
        """Requirements that it misses and no objective takes the place of."""
        traded = {REQUIREMENTS.get(one) for one in objectives}
        unmet = missed_by_linkage(self.spec, self.linkage)
        unmet += missed_by_mirrors(self.spec, self.mirrors, self.share)
        return [name for name in unmet if name not in traded]


def run(spec: FingerFrontSpec, context: Context) -> Results:
    """Design the fingers of a front.

    Raises:
        UserError: another float type than float64, or no room for a coupling bar.
    """
    context.require_float64("finger-front solves its requirements to 1e-8")
    out = Report(spec, package="studies.finger.front")
    designer, base = Designer(context), spec.finger()
    designer.require_room(base)
    first = Point(base, *designer.parts(base))
    rows, files = Records(), []
    for number, (changed, point) in enumerate(find_points(spec, first, designer), 1):
        name = f"finger-{number:02d}.toml"
        if point is None:
            rows.add(**_row(spec, changed, None), missed="settings refused", file="")
            continue
        missed = "; ".join(point.missed(spec.objectives))
        rows.add(**_row(spec, changed, point), missed=missed, file=name)
        title = f"point {number} of the front, for `designopt explore` and `designopt export`"
        files.append(SpecFile(name, title, format_finger(point.finger)))
    best = is_best(rows, spec.objectives)
    rows = rows | {"front": np.where(best, "yes", "no")}
    out.values(points=len(rows), names=listed(spec.objectives))
    out.metrics(on_front=int(np.sum(best)), feasible=len(rows.where(missed="")))
    out.say("main")
    out.table("front", rows)
    out.figure("front", draw_front(rows, spec.objectives))
    for file in files:
        out.file(file)
    return out.results()


def find_points(
    spec: FingerFrontSpec, first: Point, designer: Designer
) -> list[tuple[dict[str, Any], Point | None]]:
    """The fingers with all combinations of what is varied, each designed from its neighbour's.

    Args:
        spec: which objectives, and the values of those that are varied.
        first: the finger with the settings as they are, where all begins.
        designer: of the fingers.

    Returns:
        In the order of the values: what was changed, by setting, and the point; ``None`` where
        these settings are refused.
    """
    axes = [_changes(spec, one, first) for one in spec.objectives if one in VARIED]
    places = [*itertools.product(*(range(len(axis)) for axis in axes))]
    scaled = {
        place: np.array([axes[i][at].distance for i, at in enumerate(place)]) for place in places
    }
    found: dict[tuple[int, ...], Point | None] = {}
    begun: dict[tuple[int, ...], Point] = {}
    is_done = designer.context.count(len(places))
    # From the finger as it is outwards, so that a neighbour on the way is there already.
    for place in sorted(places, key=lambda place: (float(np.sum(np.abs(scaled[place]))), place)):
        forget_programs_if_many()
        changed: FingerSpec | None = first.spec
        for i, at in enumerate(place):
            setting, value = axes[i][at].setting, axes[i][at].value
            changed = None if changed is None else with_value(changed, setting, value)
        near = [
            (other, float(np.sum(np.abs(scaled[place] - scaled[at]))))
            for at, other in found.items()
            if other is not None
        ]
        near.append((first, float(np.sum(np.abs(scaled[place])))))
        start = begun[place] = min(near, key=lambda one: one[1])[0]
        with designer.context.step(f"Point {len(found) + 1} of {len(places)}"):
            found[place] = None if changed is None else designed_near(changed, start, designer)
        is_done()
    _retry(found, begun, spec.objectives, designer)
    named = [
        {axes[i][at].setting: axes[i][at].value for i, at in enumerate(place)} for place in places
    ]
    return [(one, found[place]) for one, place in zip(named, places, strict=True)]


def _retry(
    found: dict[tuple[int, ...], Point | None],
    begun: Mapping[tuple[int, ...], Point],
    objectives: Sequence[str],
    designer: Designer,
) -> None:
    """Points whose search went astray, once more from another neighbour that misses less.

    Args:
        found: the points by their places in the lists; better ones take their places.
        begun: where each began.
        objectives: what is traded.
        designer: of the fingers.
    """

    def missed(point: Point) -> int:
        return len(point.missed(objectives))

    for place, point in found.items():
        beside = [
            other
            for at, other in found.items()
            if np.sum(np.abs(np.subtract(place, at))) == 1 and other is not begun[place]
        ]
        start = min((other for other in beside if other is not None), key=missed, default=None)
        if point is None or start is None or missed(start) >= missed(point):
            continue
        with designer.context.step("A point once more"):
            found[place] = min(point, designed_near(point.spec, start, designer), key=missed)


def designed_near(spec: FingerSpec, start: Point, designer: Designer) -> Point:
    """A finger for other settings, from that for some: linkage and mirrors from where these are."""
    linkage = designer.linkage_from(spec, start.spec, start.linkage)
    mirrors, share = designer.mirrors_from(spec, start.spec, (start.mirrors, start.share))
    return Point(spec, linkage, mirrors, share)


class Change(NamedTuple):
    """A setting with a value, and how far it is from what it is, in steps."""

    setting: str
    value: Any
    distance: float


def _changes(spec: FingerFrontSpec, objective: str, first: Point) -> list[Change]:
    """Values of an objective that is varied, in rising order."""
    given = sorted({*getattr(spec, VARIED[objective])})
    setting, values, now = _setting(objective, given, first)
    # A step is one place in the list; what it is lies somewhere between two.
    at = float(np.interp(now, given, range(len(given)))) if len(given) > 1 else 0.0
    return [Change(setting, value, number - at) for number, value in enumerate(values)]


def _setting(objective: str, given: Sequence[float], first: Point) -> tuple[str, list[Any], float]:
    """The setting that stands behind an objective, its values, and what it is among those given."""
    match objective:
        case "clearance":
            return "linkage.limits.clearance", [*given], first.spec.linkage.limits.clearance
        case "thickness":
            now = first.spec.body.thickness
            return "body.thickness", [round(now + change, 9) for change in given], 0.0
        case "resolution":
            now = first.mirrors.verdict.worst_px_per_mm
            return "mirrors.floor", [round(now * part, 3) for part in given], 1.0
        case _:
            now = value_of(first.spec, "mirrors.pads.thickness")
            values = [[round(one * part, 9) for one in now] for part in given]
            return "mirrors.pads.thickness", values, 1.0


def _row(spec: FingerFrontSpec, changed: dict[str, Any], point: Point | None) -> dict[str, Any]:
    """The objectives' values of a point; what is asked for where there is none."""
    if point is not None:
        return {COLUMNS[one]: point.values[one] for one in spec.objectives}
    asked = {"clearance": "linkage.limits.clearance", "thickness": "body.thickness"}
    return {COLUMNS[one]: changed.get(asked.get(one, ""), np.nan) for one in spec.objectives}


def is_best(rows: Records, objectives: Sequence[str]) -> np.ndarray:
    """Which rows meet all else, and no such row is better in one objective and as good in all.

    Example:
        >>> rows = Records({"yield": [0.9, 0.8, 0.7], "resolution_px_per_mm": [3.0, 4.0, 3.5]})
        >>> is_best(rows | {"missed": ""}, ["yield", "resolution"]).tolist()
        [True, True, False]
    """
    signs = np.array([-1.0 if one in LESS else 1.0 for one in objectives])
    values = np.column_stack([np.asarray(rows[COLUMNS[one]], float) for one in objectives]) * signs
    free = np.asarray(rows["missed"]) == ""
    worse = [
        any(
            free[other] and np.all(values[other] >= own) and np.any(values[other] > own)
            for other in range(len(values))
        )
        for own in values
    ]
    return free & ~np.array(worse, bool)


def draw_front(rows: Records, objectives: Sequence[str]) -> Figure:
    """The first objective over the second, for every value of the third."""
    figure, axes = new_figure(height=3.6)
    axis, (y, x, *more) = axes[0, 0], objectives
    groups = rows.group(COLUMNS[more[0]]) if more else {"": rows}
    for number, (value, part) in enumerate(groups.items()):
        color, marker = PALETTE[number % len(PALETTE)], MARKERS[number % len(MARKERS)]
        across, up = (np.asarray(part[COLUMNS[one]], float) for one in (x, y))
        best, missing = np.asarray(part["front"]) == "yes", np.asarray(part["missed"]) != ""
        order = np.argsort(across[best])
        label = f"{TITLES[more[0]]}: {value:g}" if more else "on the front"
        axis.plot(across[best][order], up[best][order], f"{marker}-", color=color, label=label)
        hollow = {"color": color, "fillstyle": "none", "linestyle": ""}
        axis.plot(across[~best & ~missing], up[~best & ~missing], marker, **hollow)
        axis.plot(across[missing], up[missing], "x", color=color)
    others = {"color": "black", "fillstyle": "none", "linestyle": ""}
    if np.any((rows["front"] == "no") & (rows["missed"] == "")):
        axis.plot([], [], MARKERS[0], **others, label="worse than another")
    if np.any(rows["missed"] != ""):
        axis.plot([], [], "x", **others, label="misses a requirement besides")
    axis.set(xlabel=TITLES[x], ylabel=TITLES[y])
    return figure
