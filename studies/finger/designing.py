"""A finger designed for its requirements, and these line by line."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import NamedTuple

import numpy as np

from designopt import UserError
from designopt.batching import side_by_side
from designopt.study.records import Records
from designopt.study.study import Context
from kinematics.io.assembling import Equations
from kinematics.io.sketch import parse_sketch
from kinematics.io.sketch_geometry import measure_sketch
from studies.finger.spec import FingerSpec
from studies.models.checks import Check
from studies.models.finger import Finger, camera_of
from studies.models.finger_parts import PHALANGES
from studies.models.grasp.analysis import Analysis, GraspCheck, analyze, summary
from studies.models.grasp.spec import GraspSpec
from studies.models.linkage_design.analysis import LinkageDesign, design_linkage, design_nearby
from studies.models.linkage_design.coupling.judging import DIP_ERROR, CoupledVerdict
from studies.models.linkage_design.problem import TIP
from studies.models.linkage_design.searching import blank_finger
from studies.models.linkage_kinds import KINDS
from studies.models.mirror_design.design import MirrorDesign, design_mirrors, first_placements
from studies.models.mirror_design.judging import percent_at_least
from studies.models.mirror_design.placement import Placement
from studies.models.mirror_design.requirements import (
    COVERAGE,
    MEMBRANE,
    SHARPNESS,
    SPARE,
    optical_checks,
)
from studies.models.mirror_design.yields import Yield, monte_carlo

PINCHES = 6
"""Places on the distal pad at which it pinches."""

SHORT_DEG = 2.0
"""How far before the end of PIP's range free closing may begin to bend DIP, degrees."""

OPTICAL = {
    "yield": "yield with errors of assembly",
    "blur": "largest blur spot",
    "transmission": "light through layers",
    MEMBRANE: "membranes together",
}
"""Requirements on the optics that have lines of their own, and what these are called."""


DEMANDS = ("floor", "least_yield", "least_membrane")
"""Settings of the mirrors that ask for something and are no part of a finger."""


class FingerDesign(NamedTuple):
    """A finger that was designed.

    Attributes:
        finger: itself.
        linkage: its linkage.
        mirrors: its camera and mirrors.
        share: part of the fingers with errors of assembly that show everything.
        closings: how it closes; ``None`` where its linkage does not assemble in every posture,
            for then there is no closing to compute, and of a coupled finger, whose closing is one
            curve.
        grasp: what these come to.
    """

    finger: Finger
    linkage: LinkageDesign
    mirrors: MirrorDesign
    share: Yield
    closings: Analysis | None
    grasp: GraspCheck | None


@dataclass
class Designer:
    """Designs fingers; what two of them have in common is designed once.

    Attributes:
        context: seed and progress of the run.
    """

    context: Context
    _linkages: dict[str, LinkageDesign] = field(default_factory=dict)
    _mirrors: dict[str, tuple[MirrorDesign, Yield]] = field(default_factory=dict)
    _nearby: dict[tuple[str, str], tuple[MirrorDesign, Yield]] = field(default_factory=dict)

    def linkage(self, spec: FingerSpec) -> LinkageDesign:
        """The linkage for its requirements."""
        key = spec.linkage_spec().model_dump_json()
        if key not in self._linkages:
            # The first one's parts: others then need no compiled program of their own.
            known = next(iter(self._linkages.values()), None)
            near = None if known is None else known.search.near
            with self.context.step("Linkage"):
                linkage = design_linkage(spec.linkage_spec(), self.context.seed, near)
            self._linkages[key] = linkage
        return self._linkages[key]

    def require_room(self, spec: FingerSpec) -> None:
        """Look for a coupling bar before all else: where there is no room, the finger is none.

        A search for what cannot be met may end anywhere, also for want of force: the bar is looked
        for once more without clearances and force.

        Raises:
            UserError: the best bar runs through an axle or a face.
        """
        if "coupling" not in KINDS[spec.linkage.kind].outlines:
            return
        free = spec.linkage.limits.model_copy(update={"clearance": 0.0, "tip_force": 0.0})
        linkage = spec.linkage.model_copy(update={"limits": free})
        for settings in (spec, spec.model_copy(update={"linkage": linkage})):
            checks = self.linkage(settings).verdict.checks
            between = [check for check in checks if check.name.startswith("coupling from ")]
            worst = min(between, key=lambda check: check.achieved)
            if worst.achieved >= 0:
                return
        raise UserError(
            f"finger: there is no room for a coupling bar P-Q: the best one runs "
            f"{-worst.achieved:.2g} mm into {worst.name.removeprefix('coupling from ')}; raise "
            f"body.axis_height from {spec.body.axis_height:g} mm (9.5 with linkage.motor.arm=11 "
            "fits the other default settings)"
        )

    def mirrors(self, spec: FingerSpec, finger: Finger) -> tuple[MirrorDesign, Yield]:
        """Camera and mirrors in a finger's body, and their yield."""
        key = _optics(spec)
        if key not in self._mirrors:
            self._mirrors[key] = self._designed(spec)
        found, share = self._mirrors[key]
        return replace(found, finger=with_linkage(found.finger, finger)), share

    def _designed(self, spec: FingerSpec) -> tuple[MirrorDesign, Yield]:
        """From the first start; from the others, too, if that is not enough."""
        blank, seed = blank_finger(spec.linkage_spec()), self.context.seed
        first, *others = first_placements(blank, spec.mirrors, seed)
        found = self._searched(spec, [first])
        # How long the membranes are is the body's alone.
        if {*missed_by_mirrors(spec, *found)} <= {MEMBRANE}:
            return found
        return max(found, self._searched(spec, others), key=partial(_worth, spec))

    def _searched(
        self, spec: FingerSpec, starts: Sequence[Placement]
    ) -> tuple[MirrorDesign, Yield]:
        """In a body without pins: of the links the optics need nothing but the wall beside them."""
        blank = blank_finger(spec.linkage_spec())
        found = design_mirrors(blank, spec.mirrors, self.context, starts)
        with self.context.step("Yield of the mirrors"):
            errors, seed = spec.mirrors.tolerances, self.context.seed
            share = monte_carlo(found.finger, errors, draws=spec.yield_draws, seed=seed)
        return found, share

    def parts(self, spec: FingerSpec) -> tuple[LinkageDesign, MirrorDesign, Yield]:
        """Linkage, and camera and mirrors with their yield; the latter have the whole finger."""
        blank = blank_finger(spec.linkage_spec())
        side_by_side([lambda: self.linkage(spec), lambda: self.mirrors(spec, blank)])
        linkage = self.linkage(spec)
        return linkage, *self.mirrors(spec, linkage.finger)

    def finger(self, spec: FingerSpec) -> FingerDesign:
        """Linkage, mirrors and grasp of a finger for its requirements."""
        linkage, mirrors, share = self.parts(spec)
        finger = mirrors.finger
        if isinstance(linkage.verdict, CoupledVerdict) or not linkage.verdict.assembles:
            return FingerDesign(finger, linkage, mirrors, share, None, None)
        body = spec.body
        settings = GraspSpec(
            body=body,
            diameters=spec.spring.diameters,
            pinch_pip_deg=[body.ranges_deg[0] / 3, 2 * body.ranges_deg[0] / 3],
            pinch_at=np.linspace(body.gaps[1], body.distal - body.rim, PINCHES).tolist(),
        )
        with self.context.step("Grasp"):
            closings = analyze(finger, settings, polygon=False)
        return FingerDesign(finger, linkage, mirrors, share, closings, summary(closings))

    def missed(self, spec: FingerSpec) -> list[str]:
        """Names of the requirements that a run misses; those of the mirrors once the links meet."""
        if missed := missed_by_linkage(spec, self.linkage(spec)):
            return missed
        lines = requirements(spec, self.finger(spec))
        return list(lines.where(met="no")["requirement"])

    def with_own_linkages(self) -> Designer:
        """Another one, that has these mirrors but designs its linkages as a run does."""
        return Designer(self.context, _mirrors=self._mirrors)

    def meets_near(self, spec: FingerSpec, start: FingerSpec) -> bool:
        """Whether a design that begins with that for other settings meets these.

        It is far quicker than `missed`, and may miss what a search from many starts finds.
        """
        linkage = self.linkage_from(spec, start, self.linkage(start))
        if missed_by_linkage(spec, linkage):
            return False
        return not missed_by_mirrors(spec, *self.mirrors_near(spec, start))

    def mirrors_near(self, spec: FingerSpec, start: FingerSpec) -> tuple[MirrorDesign, Yield]:
        """`mirrors_from` those that were designed for other settings, without a linkage."""
        known = self.mirrors(start, blank_finger(start.linkage_spec()))
        key = _optics(spec), _optics(start)
        if key not in self._nearby:
            self._nearby[key] = self.mirrors_from(spec, start, known)
        return self._nearby[key]

    def linkage_from(
        self, spec: FingerSpec, start: FingerSpec, known: LinkageDesign
    ) -> LinkageDesign:
        """A linkage searched from that for other settings; it itself where these agree."""
        own = spec.linkage_spec()
        if own == start.linkage_spec():
            return known
        with self.context.step("Linkage nearby"):
            return design_nearby(own, known.search, self.context.seed)

    def mirrors_from(
        self, spec: FingerSpec, start: FingerSpec, known: tuple[MirrorDesign, Yield]
    ) -> tuple[MirrorDesign, Yield]:
        """Camera and mirrors searched from those for other settings, without a linkage.

        They are these where no more than `DEMANDS` differ, if they meet them as they are.
        """
        if _optics(spec) == _optics(start):
            return known
        demands = {name: getattr(spec.mirrors, name) for name in DEMANDS}
        same = start.model_copy(update={"mirrors": start.mirrors.model_copy(update=demands)})
        if _optics(spec) == _optics(same) and not missed_by_mirrors(spec, *known):
            return known
        return self._searched(spec, [known[0].trials[known[0].chosen].placement])

    def could_help(self, spec: FingerSpec, other: FingerSpec) -> bool:
        """Whether other settings bring all parts that miss something with these nearer.

        Linkage and grasp may come nearer if they are concerned. Camera and mirrors do if, searched
        from those that were found, they miss fewer of the other requirements, or hide half as much
        at most: searched from all starts takes several times as long.
        """
        linkage, same_links = self.linkage(spec), spec.linkage_spec() == other.linkage_spec()
        if missed_by_linkage(spec, linkage) and same_links:
            return False
        now = self.mirrors(spec, linkage.finger)
        unmet = missed_by_mirrors(spec, *now)
        if not unmet:
            return not same_links or spec.spring != other.spring
        if _optics(spec) == _optics(other) or (MEMBRANE in unmet and spec.body == other.body):
            return False
        then = self.mirrors_near(other, spec)
        hidden, left = (1 - found.verdict.worst_coverage for found, _ in (now, then))
        missed, others = (len(missed_by_mirrors(other, *one)) for one in (now, then))
        return others < missed or left <= hidden / 2


def missed_by_linkage(spec: FingerSpec, linkage: LinkageDesign) -> list[str]:
    """Names of the requirements that a linkage misses."""
    least = spec.linkage.limits.transmission_deg
    angle = [] if linkage.verdict.least_deg > least else ["transmission angles"]
    return angle + [check.name for check in linkage.unmet]


def missed_by_mirrors(spec: FingerSpec, mirrors: MirrorDesign, share: Yield) -> list[str]:
    """Names of the requirements that camera and mirrors miss."""
    checks = optical_checks(mirrors.finger, mirrors.verdict, share, spec.mirrors)
    return [check.name for check in checks if not check.met]


def _worth(spec: FingerSpec, design: tuple[MirrorDesign, Yield]) -> tuple[float, ...]:
    """Greater is better: what is met, then what is seen, how sharply, and how often with errors."""
    mirrors, share = design
    unmet = missed_by_mirrors(spec, mirrors, share)
    return -len(unmet), *mirrors.verdict.quality(spec.mirrors.floor), share.value


def _optics(spec: FingerSpec) -> str:
    """All settings that concern camera and mirrors, as one key."""
    return f"{spec.body!r} {spec.mirrors!r} {spec.linkage.links.shell}"


def with_linkage(finger: Finger, other: Finger) -> Finger:
    """A finger with the pins, spring, links and motor of another of the same body."""
    names = "pins", "spring", "links", "motor", "assembly"
    return replace(finger, **{name: getattr(other, name) for name in names})


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
    kind, freedoms = found.finger.kind, degrees_of_freedom(found.finger)
    met = freedoms == kind.freedoms
    line("degrees of freedom", "Geometry", str(kind.freedoms), str(freedoms), met)
    line("motors", "Hardware", "1", f"1, at the {kind.crank_title} (by construction)", True)
    host = camera_of(found.finger).phalanx
    line("cameras", "Hardware", "1", f"1, in the {host} phalanx (by construction)", True)
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
    amounts = [f"{one.name} {one.achieved:.4g} mm" for one in rooms if not one.met]
    asked, kept = f"≥ {spec.mirrors.room.clearance:g} mm, camera inside", "every clearance kept"
    reached = "; ".join(amounts) or kept
    line("clearance of mirrors, mounts and camera", "this project", asked, reached, not amounts)
    asked, least = f"> {limits.transmission_deg:g}°", linkage.least_deg
    met = least > limits.transmission_deg
    line("transmission angles", "Transmission", asked, f"{least:.2f}°", met)
    pip, dip = spec.body.ranges_deg
    ends = f"{end:g}° each" if pip == dip else f"{pip:g}° and {dip:g}°"
    reached = ends if linkage.assembles else "not in every posture"
    asked = f"0 to {end:g}°" if pip == dip else f"0 to {pip:g}° and 0 to {dip:g}°"
    line("range of motion of each joint", "Transmission", asked, reached, linkage.assembles)
    asked, crank = f"≤ {limits.crank_range_deg:g}°", linkage.crank_range_deg
    line("range of the crank", "§3.1.2", asked, f"{crank:.1f}°", crank <= limits.crank_range_deg)
    asked, reached = f"≤ {width.required:g} mm", f"{width.achieved:g} mm"
    line("width with pads, LED strips, walls and links", "§3.1", asked, reached, width.met)
    name = "links inside the phalanges, apart, away from lock-up"
    amounts = [f"{one.name} {one.achieved:.4g} {one.unit}".strip() for one in unmet]
    line(name, "§3.1.2", "every limit kept", "; ".join(amounts) or "every limit kept", not unmet)
    if isinstance(linkage, CoupledVerdict):
        off = linkage.check(DIP_ERROR)
        asked = f"{dip:g}° ± {off.required:g}°"
        reached = f"{linkage.dip_deg[-1]:.1f}°, {linkage.dip_deg[-1] / pip:.2f} of PIP's"
        line("DIP where PIP is at its end", "this project", asked, reached, off.met)
        force = linkage.check(TIP)
        name = "force at the tip of the distal pad, with the motor's moment"
        line(name, "this project", *in_words(force), force.met)
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
