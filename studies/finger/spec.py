"""The settings of the study: the requirements of paper B's Table 3.1 and text (§3)."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator

from designopt.io.spec import Spec
from studies.models.body import BodySpec
from studies.models.linkage_design.spec import FingerLinkageSpec, LinkageSpec
from studies.models.mirror_design.spec import FingerMirrorsSpec, MirrorSpec

Stiffness = Annotated[float, Field(ge=1e-6, le=1e6)]


class SpringSpec(Spec):
    """What closes the finger and what keeps it straight."""

    stiffness: Stiffness = Field(
        default=30.0, description="torsion spring between distal phalanx and plate (N mm/rad)"
    )
    preload: Annotated[float, Field(ge=0, le=3)] = Field(
        default=0.3, description="how far it is wound in the straight finger (rad)"
    )
    servo: Stiffness = Field(default=300.0, description="stiffness of the motor (N mm/rad)")
    diameters: Annotated[list[Annotated[float, Field(ge=1, le=500)]], Field(min_length=1)] = Field(
        default=[20.0, 40.0, 60.0], description="circles to close on (mm)"
    )


class FingerSpec(Spec):
    """All settings of ``designopt run finger``."""

    body: BodySpec = BodySpec()
    linkage: LinkageSpec = LinkageSpec()
    mirrors: MirrorSpec = MirrorSpec()
    spring: SpringSpec = SpringSpec()
    yield_draws: Annotated[int, Field(ge=10, le=100_000)] = Field(
        default=1000, description="random draws of the errors of assembly"
    )

    @model_validator(mode="after")
    def _parts_fit(self) -> FingerSpec:
        self.linkage_spec()
        # Both parts check that the body has room for them.
        given = self.mirrors.model_dump()
        FingerMirrorsSpec.model_validate(given | {"body": self.body.model_dump(), "thin": 0.0})
        return self

    def linkage_spec(self) -> FingerLinkageSpec:
        """The settings of the linkage's own study for this body."""
        return FingerLinkageSpec.model_validate(
            self.linkage.model_dump() | {"body": self.body.model_dump(), "precision": False}
        )
