"""What the study holds of a finger that it has designed."""

from __future__ import annotations

from dataclasses import dataclass

from studies.models.finger import Finger
from studies.models.grasp.analysis import Analysis
from studies.models.grasp.check import GraspCheck
from studies.models.linkage_design.analysis import LinkageDesign
from studies.models.mirror_design.design import MirrorDesign
from studies.models.mirror_design.yields import Yield


@dataclass(frozen=True)
class FingerDesign:
    """A finger that was designed.

    Attributes:
        finger: itself.
        linkage: its linkage.
        mirrors: its camera and mirrors.
        share: part of the fingers with errors of assembly that show everything.
        grasp: what it does when it closes; ``None`` where its linkage does not assemble in every
            posture, for then there is no closing to compute.
        closings: the states behind that.
    """

    finger: Finger
    linkage: LinkageDesign
    mirrors: MirrorDesign
    share: Yield
    grasp: GraspCheck | None
    closings: Analysis | None
