"""Settings of ``designopt run finger``.

Apart from the package itself, so that reading a design's file does not load them.
"""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator

from designopt.io.spec import Spec
from designopt.study.settings import setting
from designopt.study.study import Study, lazily
from studies.models.body import BodySpec
from studies.models.linkage_design.spec import FingerLinkageSpec, LinkageSpec, SpringSpec
from studies.models.mirror_design.spec import FingerMirrorsSpec, MirrorSpec

Diameter = Annotated[float, Field(ge=1, le=500)]


class ClosingSpec(SpringSpec):
    """What closes the finger, what keeps it straight, and what it closes on."""

    diameters: list[Diameter] = setting(
        [20.0, 40.0, 60.0], "circles to close on (mm)", min_length=1
    )


class FingerSpec(Spec):
    """All settings of ``designopt run finger``: the requirements of Table 3.1 and text (§3).

    Targets are what the settings require, so they apply whatever these are.
    """

    body: BodySpec = setting(BodySpec(), "the phalanges", free=True)
    linkage: LinkageSpec = setting(LinkageSpec(), "requirements and search", free=True)
    mirrors: MirrorSpec = setting(MirrorSpec(), "requirements and search", free=True)
    spring: ClosingSpec = setting(ClosingSpec(), "spring, motor and circles", free=True)
    yield_draws: int = setting(
        1000, "random draws of the errors of assembly", free=True, ge=10, le=100_000
    )
    advice: bool = setting(
        True,
        "where requirements are missed, look for the smallest single changes that meet them all; "
        "each is designed anew, which takes minutes",
        free=True,
    )

    @model_validator(mode="after")
    def _parts_fit(self) -> FingerSpec:
        self.linkage_spec()
        # Both parts check that the body has room for them.
        given = self.mirrors.model_dump()
        FingerMirrorsSpec.model_validate(given | {"body": self.body.model_dump(), "thin": 0.0})
        room, wall = self.mirrors.room.clearance, self.linkage.links.shell
        if self.mirrors.phalanges and room < wall:
            raise ValueError(
                f"mirrors.room.clearance ({room:g} mm) puts mirrors into the walls "
                f"(linkage.links.shell, {wall:g} mm); make it {wall:g} or more"
            )
        return self

    def linkage_spec(self) -> FingerLinkageSpec:
        """The settings of the linkage's own study for this body."""
        spring = self.spring.model_dump(include=set(SpringSpec.model_fields))
        given = {"body": self.body.model_dump(), "spring": spring, "precision": False}
        return FingerLinkageSpec.model_validate(self.linkage.model_dump() | given)


STUDY = Study(
    name="finger",
    purpose="Requirements in, finger out: paper B's linkage, mirrors and camera, and its grasp",
    spec=FingerSpec,
    run=lazily("studies.finger.run:run"),
    design=lazily("studies.finger.run:design"),
)
