"""A designed linkage: its search, its verdict, and draws with errors of fabrication."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from studies.models.checks import Check
from studies.models.finger import Finger, links_of
from studies.models.link_layers import Links, Meeting
from studies.models.linkage_design.coupling.judging import CoupledVerdict, judge_coupled
from studies.models.linkage_design.coupling.searching import search_coupling
from studies.models.linkage_design.coupling.tolerance import least_coupled_angles
from studies.models.linkage_design.judging import Verdict, judged
from studies.models.linkage_design.searching import Search, search, search_on
from studies.models.linkage_design.spec import FingerLinkageSpec, LimitsSpec, MotorSpec
from studies.models.linkage_design.tolerance import least_angles
from studies.models.linkage_kinds import KindName


@dataclass(frozen=True)
class LinkageDesign:
    """A linkage that was designed, and what it comes to.

    Attributes:
        finger: the design: body and pins, these rounded.
        search: how it was found.
        verdict: over all postures.
        width: of the finger, for all its layers.
        drawn: the least angle of fingers with errors, degrees.
    """

    finger: Finger
    search: Search
    verdict: Verdict | CoupledVerdict
    width: Check
    drawn: Float[np.ndarray, " draws"]

    @property
    def unmet(self) -> list[Check]:
        """Requirements that are not met, but for the transmission angle."""
        return [check for check in (*self.verdict.checks, self.width) if not check.met]


class Methods(NamedTuple):
    """How linkages of a kind are designed and judged.

    Attributes:
        search: from settings, a seed, and the parts to keep apart (see `searching.search`).
        search_on: from settings, a search for others (see `searching.search_on`), and a seed.
        judge: a finger over all postures.
        draw: the least angle of finger after finger with errors, degrees.
    """

    search: Callable[[FingerLinkageSpec, int, Sequence[Meeting] | None], Search]
    search_on: Callable[[FingerLinkageSpec, Search, int], Search]
    judge: Callable[[Finger, LimitsSpec, MotorSpec], Verdict | CoupledVerdict]
    draw: Callable[[Finger, float, int, int], Float[np.ndarray, " draws"]]


METHODS: dict[KindName, Methods] = {
    "six-bar": Methods(search, lambda spec, found, _: search_on(spec, found), judged, least_angles),
    # Searched anew it takes little time.
    "coupled": Methods(
        lambda spec, seed, _: search_coupling(spec, seed),
        lambda spec, _, seed: search_coupling(spec, seed),
        judge_coupled,
        least_coupled_angles,
    ),
}


def design_linkage(
    spec: FingerLinkageSpec, seed: int, near: Sequence[Meeting] | None = None
) -> LinkageDesign:
    """The best linkage for a spec, judged.

    Args:
        spec: the study's settings.
        seed: of the search's starts and of the tolerance study's draws.
        near: see `searching.search`.
    """
    return _judged(spec, search_linkage(spec, seed, near), seed)


def search_linkage(
    spec: FingerLinkageSpec, seed: int, near: Sequence[Meeting] | None = None
) -> Search:
    """The best linkage of the kind that a spec asks for; arguments as of `design_linkage`."""
    return METHODS[spec.kind].search(spec, seed, near)


def design_nearby(spec: FingerLinkageSpec, found: Search, seed: int) -> LinkageDesign:
    """The best linkage near one that was found for other settings, judged.

    Args:
        spec: the study's settings.
        found: see `searching.search_on`.
        seed: as in `design_linkage`.
    """
    return _judged(spec, METHODS[spec.kind].search_on(spec, found, seed), seed)


def _judged(spec: FingerLinkageSpec, found: Search, seed: int) -> LinkageDesign:
    methods, finger = METHODS[spec.kind], found.finger
    verdict = methods.judge(finger, spec.limits, spec.motor)
    width = layers_fit(spec.limits, links_of(finger))
    drawn = methods.draw(finger, spec.tolerance, spec.draws, seed)
    return LinkageDesign(finger, found, verdict, width, drawn)


def layers_fit(limits: LimitsSpec, links: Links) -> Check:
    """The width of the layers of both sides, pads between them."""
    return Check("width of the finger", limits.width, float(links.width), at_least=False)
