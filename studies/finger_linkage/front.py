"""The front of the least transmission angle against the bound on φ₂/φ₁."""

from __future__ import annotations

from dataclasses import dataclass

from matplotlib.figure import Figure

from designopt.compilation_cache import forget_programs_if_many
from designopt.optimize import find_active_set
from designopt.plot.figures import MARKERS, PALETTE, new_figure
from designopt.study.records import Records
from designopt.study.report import Report
from studies.benchmarks.measuring import listed
from studies.models.linkage_design.judging import Verdict, judged
from studies.models.linkage_design.searching import Search, exact, search, search_on
from studies.models.linkage_design.spec import FingerLinkageSpec, is_usual_but

PLAIN = {
    "limits": {"pinch_force": 0.0, "tip_force": 0.0},
    "motor": {"parallelogram": False},
    "links": {"shell": 0.7},
}
"""Settings without the motor's parallelogram and without forces, with the walls of that search."""

ELSEWHERE = {0.3: 17.51, 0.4: 39.24}
"""Least angles by bounds with these settings, degrees, by an independent search:
``find_design(Asked(ratio=0.3, allowance=0.02, shell=0.7), 0).least_deg``, and the same with 0.4, of
`studies.oracles.finger_search`."""

NEIGHBOUR, STARTS = "neighbour", "many starts"
"""From where a design of the front was found."""


@dataclass(frozen=True)
class Point:
    """The best design that was found for a bound.

    Attributes:
        bound: greatest φ₂/φ₁ that was asked for.
        search: how it was found.
        verdict: over all postures.
        begun: `NEIGHBOUR` or `STARTS`.
    """

    bound: float
    search: Search
    verdict: Verdict
    begun: str

    @property
    def feasible(self) -> bool:
        """Whether every requirement but that on the transmission angle is met."""
        return all(check.met for check in self.verdict.checks)

    @property
    def binding(self) -> str:
        """What holds it most, by its multiplier; the worst requirement if some are missed."""
        last = self.search.rounds[-1].problem
        if self.feasible and (held := find_active_set(exact(last), self.search.best)):
            return held[0].words
        return min(self.verdict.checks, key=lambda one: one.slack / abs(one.required or 1)).name


def find_front(spec: FingerLinkageSpec, found: Search, seed: int) -> Records:
    """The best designs for all bounds of ``spec.front``.

    Each begins with the design of its looser neighbour, the first with the study's own, and then
    once more with that of its tighter one, whose design meets its requirements, too. For each bound
    there is a search from many starts besides, for designs nearby get stuck.

    Args:
        spec: the study's settings.
        found: a search with them.
        seed: of the Sobol points.

    Returns:
        Columns ``bound``, in rising order; ``least_deg`` and ``ratio``, the least angle and the
        largest φ₂/φ₁ of all postures; ``binding``, ``begun`` and ``feasible`` as `Point` has them.
    """
    bounds = sorted(set(spec.front), reverse=True)
    front: list[Point] = []
    near = found
    for bound in bounds:
        forget_programs_if_many()
        asked = bounded(spec, bound)
        best = _point(asked, bound, search_on(asked, near), NEIGHBOUR)
        best = _better(best, _point(asked, bound, search(asked, seed, found.near), STARTS))
        front.append(best)
        near = best.search
    for place in reversed(range(len(front) - 1)):
        forget_programs_if_many()
        looser, tighter = front[place], front[place + 1]
        again = search_on(bounded(spec, looser.bound), tighter.search)
        front[place] = _better(
            looser, _point(bounded(spec, looser.bound), looser.bound, again, NEIGHBOUR)
        )
    rows = Records()
    for one in reversed(front):
        rows.add(
            bound=one.bound,
            least_deg=one.verdict.least_deg,
            ratio=one.verdict.ratio.max(),
            binding=one.binding,
            begun=one.begun,
            feasible="yes" if one.feasible else "no",
        )
    return rows


def bounded(spec: FingerLinkageSpec, bound: float) -> FingerLinkageSpec:
    """The settings with a bound on φ₂/φ₁."""
    return spec.model_copy(update={"limits": spec.limits.model_copy(update={"force_ratio": bound})})


def _point(spec: FingerLinkageSpec, bound: float, found: Search, begun: str) -> Point:
    return Point(bound, found, judged(found.finger, spec.limits, spec.motor), begun)


def _better(one: Point, other: Point) -> Point:
    return max(one, other, key=lambda each: (each.feasible, each.verdict.least_deg))


def elsewhere(spec: FingerLinkageSpec) -> dict[float, float]:
    """Least angles of the independent search by bounds, degrees; none for settings it had not."""
    return ELSEWHERE if is_usual_but(spec, PLAIN) else {}


def add_front(out: Report, spec: FingerLinkageSpec, rows: Records) -> None:
    """Table, figure and findings of what `find_front` gives; nothing of an empty front."""
    if not len(rows):
        return
    other = elsewhere(spec)
    out.table("front", rows)
    met = rows.where(feasible="yes")
    out.figure("front", draw_front(met, other), most=2)
    if len(met):
        pairs = zip(met["least_deg"], met["bound"], strict=True)
        out.say("front", angles=listed([f"{least:.1f}° at {bound:g}" for least, bound in pairs]))
    if len(met) < len(rows):
        missed = rows.where(feasible="no")["bound"]
        out.say("front_unmet", bounds=listed([f"{bound:g}" for bound in missed]))
    ahead = [
        (least - other[bound], bound)
        for bound, least in zip(met["bound"], met["least_deg"], strict=True)
        if bound in other
    ]
    if ahead:
        found = listed([f"{gap:+.2f}° at {bound:g}" for gap, bound in ahead])
        out.say("front_elsewhere", ahead=found)


def draw_front(rows: Records, other: dict[float, float]) -> Figure:
    """Least angles over the bound, with those of the independent search."""
    drawing, [[axis]] = new_figure(1, 1, height=3.2)
    styles = zip(MARKERS, PALETTE, strict=False)
    marker, color = next(styles)
    axis.plot(rows["bound"], rows["least_deg"], marker=marker, color=color, label="this search")
    if other:
        marker, color = next(styles)
        hollow = {"marker": marker, "color": color, "markerfacecolor": "none", "linestyle": ""}
        axis.plot(*zip(*sorted(other.items()), strict=True), label="independent search", **hollow)
        axis.legend()
    axis.set(xlabel="bound on φ₂/φ₁", ylabel="least transmission angle (°)")
    return drawing
