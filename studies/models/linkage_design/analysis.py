"""A designed linkage: its search, its verdict, and draws with errors of fabrication."""

from __future__ import annotations

from dataclasses import dataclass

import networkx as nx
import numpy as np
from jaxtyping import Float

from studies.models.finger import Finger
from studies.models.linkage_design.judging import Check, Verdict, judged
from studies.models.linkage_design.problem import LINKS
from studies.models.linkage_design.searching import Search, search
from studies.models.linkage_design.spec import FingerLinkageSpec, SensorSpec
from studies.models.linkage_design.tolerance import least_angles


@dataclass(frozen=True)
class LinkageDesign:
    """A linkage that was designed, and what it comes to.

    Attributes:
        finger: the design: body and pins, these rounded.
        search: how it was found.
        verdict: over all postures.
        room: the room that the links leave for the sensor.
        drawn: the least angle of fingers with errors, degrees.
    """

    finger: Finger
    search: Search
    verdict: Verdict
    room: Check
    drawn: Float[np.ndarray, " draws"]

    @property
    def unmet(self) -> list[Check]:
        """Requirements that are not met, but for the transmission angle."""
        return [check for check in (*self.verdict.checks, self.room) if not check.met]


def design_linkage(spec: FingerLinkageSpec, seed: int) -> LinkageDesign:
    """The best linkage for a spec, judged.

    Args:
        spec: the study's settings.
        seed: of the search's starts and of the tolerance study's draws.
    """
    found = search(spec, seed)
    verdict, room = judged(found.finger, spec.limits), sensor_room(spec.sensor)
    drawn = least_angles(found.finger, spec.tolerance, spec.draws, seed)
    return LinkageDesign(found.finger, found, verdict, room, drawn)


def sensor_room(sensor: SensorSpec) -> Check:
    """The width between the links of both sides, in which pads, mirrors and camera lie.

    Links that share a pin lie beside each other, others may lie in one layer: as many layers as
    the graph of links that share pins has colours. (An argument: paper B asks for enough space
    inside the phalanges, §3.1.2, and has its links at both sides of a 34 mm finger with pads of
    24 mm.)
    """
    sharing = nx.Graph(
        (one, other)
        for one, pins in LINKS.items()
        for other, others in LINKS.items()
        if one != other and set(pins) & set(others)
    )
    layers = 1 + max(nx.greedy_color(sharing, strategy="DSATUR").values())
    free = sensor.finger_width - 2 * layers * sensor.link_thickness
    return Check("width between the links", sensor.pad_width, free)
