"""A designed linkage: its search, its verdict, and draws with errors of fabrication."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

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
from studies.models.linkage_design.spec import FingerLinkageSpec, LimitsSpec
from studies.models.linkage_design.tolerance import least_angles
from studies.models.linkage_kinds import COUPLED


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


def design_linkage(
    spec: FingerLinkageSpec, seed: int, near: Sequence[Meeting] | None = None
) -> LinkageDesign:
    """The best linkage for a spec, judged.

    Args:
        spec: the study's settings.
        seed: of the search's starts and of the tolerance study's draws.
        near: see `searching.search`.
    """
    return judged_design(spec, search_linkage(spec, seed, near), seed)


def search_linkage(
    spec: FingerLinkageSpec, seed: int, near: Sequence[Meeting] | None = None
) -> Search:
    """The best linkage of the kind that a spec asks for; arguments as of `design_linkage`."""
    if spec.kind == COUPLED.name:
        return search_coupling(spec, seed)
    return search(spec, seed, near)


def design_nearby(spec: FingerLinkageSpec, found: Search, seed: int) -> LinkageDesign:
    """The best linkage near one that was found for other settings, judged.

    That of a coupled finger is searched anew, which takes little time.

    Args:
        spec: the study's settings.
        found: see `searching.search_on`.
        seed: as in `design_linkage`.
    """
    if spec.kind == COUPLED.name:
        return design_linkage(spec, seed)
    return judged_design(spec, search_on(spec, found), seed)


def judged_design(spec: FingerLinkageSpec, found: Search, seed: int) -> LinkageDesign:
    """What was found, judged.

    Args:
        spec: the study's settings.
        found: a search with them.
        seed: of the tolerance study's draws.
    """
    judge, least = judged, least_angles
    if spec.kind == COUPLED.name:
        judge, least = judge_coupled, least_coupled_angles
    verdict = judge(found.finger, spec.limits, spec.motor)
    width = layers_fit(spec.limits, links_of(found.finger))
    drawn = least(found.finger, spec.tolerance, spec.draws, seed)
    return LinkageDesign(found.finger, found, verdict, width, drawn)


def layers_fit(limits: LimitsSpec, links: Links) -> Check:
    """The width of the layers of both sides, pads between them."""
    return Check("width of the finger", limits.width, float(links.width), at_least=False)
