"""The settings of the study; defaults are paper B's requirements as this project reads them."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import Field, model_validator

from designopt.io.spec import Spec
from designopt.study.settings import setting
from studies.models.body import BodySpec
from studies.models.body import Length as Positive
from studies.models.linkage_kinds import KINDS, KindName
from studies.models.links import LinksTable

DECIDING = {"kind", "body", "limits", "links", "motor", "search"}
"""The settings on which the design depends; the others decide how it is judged."""

Stiffness = Annotated[float, Field(ge=1e-6, le=1e6)]


class LimitsSpec(Spec):
    """What every posture must leave. Lengths in mm."""

    clearance: float = setting(
        0.5, "between moving parts, and from them to the faces and ends (mm)", ge=0, le=100
    )
    width: Positive = setting(34.0, "greatest width of the finger (mm)")
    spacing: Positive = setting(6.0, "least distance of two pins on a link (mm)")
    crank_offset: Positive = setting(8.0, "least |AF| (mm); at 0 the crank turns about PIP")
    crank_length: Positive = setting(22.0, "greatest |EF| (mm)")
    crank_range_deg: float = setting(
        100.0,
        "greatest turn of the crank; at 100 the motor's parallelogram, whose transmission angle is "
        "the crank's angle, can keep 40 (degrees)",
        gt=0,
        le=180,
    )
    assembly: Positive = setting(1.0, "least distance of a dyad from stretching or folding (mm)")
    turn: float = setting(0.01, "least turn of crank and plate per turn of a joint", gt=0, le=1)
    force_ratio: Annotated[float, Field(gt=0, le=10)] | None = setting(
        None, "greatest φ₂/φ₁, which decides whether a pinch holds; any if none"
    )
    transmission_deg: float = setting(40.0, "least transmission angle (degrees)", gt=0, lt=90)
    pinch_force: float = setting(
        5.0, "least force that the straight distal pad holds at pinch_at; 0: any (N)", ge=0, le=1e4
    )
    pinch_at: Positive = setting(20.0, "k₂, place of that pinch from the DIP axis (mm)")
    tip_force: float = setting(
        5.0, "least force at the tip of the distal pad with the motor's moment (N)", ge=0, le=1e4
    )
    dip_error_deg: float = setting(
        1.0,
        "of a coupled finger: greatest error of DIP where PIP is at its end (degrees)",
        gt=0,
        le=45,
    )
    closing_s: Positive = setting(1.0, "greatest time in which the motor closes the finger (s)")
    safety: float = setting(
        2.0, "least strength over stress in bars and pins at tip_force", ge=0, le=100
    )


class MotorSpec(Spec):
    """The motor behind the finger, which turns the crank through a parallelogram. Lengths in mm."""

    moment: Positive = setting(500.0, "moment of the motor (N mm)")
    speed_deg: Annotated[float, Field(gt=0, le=1e5)] = setting(
        200.0, "speed of the motor (degrees/s)"
    )
    parallelogram: bool = setting(True, "whether there is one; else the motor is at the crank")
    behind: Positive = setting(8.0, "motor axis behind the rear end of the finger (mm)")
    arm: Positive = setting(12.0, "|FK|, arm of the crank on which the motor pulls (mm)")
    above: float = setting(0.0, "motor axis over that of the crank (mm)", ge=-100, le=100)


class SpringSpec(Spec):
    """What keeps the distal phalanx straight, and how stiff the motor is."""

    stiffness: Stiffness = setting(
        30.0, "torsion spring between distal phalanx and plate (N mm/rad)"
    )
    preload: float = setting(0.3, "how far it is wound in the straight finger (rad)", ge=0, le=3)
    servo: Stiffness = setting(300.0, "stiffness of the motor (N mm/rad)")


class SearchSpec(Spec):
    """How the optimum is searched."""

    starts: int = setting(32, "local solves, from the most promising Sobol points", ge=1, le=256)
    among: int = setting(16384, "Sobol points looked at", ge=1, le=2**20)
    step_deg: float = setting(15.0, "step of the first solve's postures (degrees)", ge=1, le=45)
    exchanges: int = setting(4, "most further solves, with the worst postures added", ge=0, le=20)
    finalists: int = setting(4, "different optima of the first solve, solved on", ge=1, le=64)
    allowance: float = setting(
        0.02, "kept beyond every length, for rounding and between postures (mm)", ge=0, le=1
    )
    rounding: float = setting(0.01, "dimensions are multiples of it (mm)", gt=0, le=1)


class LinkageSpec(Spec):
    """What `design_linkage` is given besides the body.

    Targets are what the settings require, so they apply whatever these are.
    """

    kind: KindName = setting(
        "six-bar",
        "paper B's underactuated 'six-bar', or 'coupled': one bar makes DIP follow PIP, which "
        "needs higher axes and a shorter arm, such as body.axis_height 9.5 and motor.arm 11",
        free=True,
    )
    limits: LimitsSpec = setting(LimitsSpec(), "what every posture must leave", free=True)
    links: LinksTable = setting(LinksTable(), "widths and layers of the links", free=True)
    motor: MotorSpec = setting(MotorSpec(), "the motor and its parallelogram", free=True)
    search: SearchSpec = setting(SearchSpec(), "how the optimum is searched", free=True)
    tolerance: float = setting(
        0.1, "error of every coordinate of a pin, 1 σ (mm)", free=True, ge=0, le=10
    )
    draws: int = setting(2000, "draws of the tolerance study", free=True, ge=10, le=1_000_000)

    @model_validator(mode="before")
    @classmethod
    def _layers_by_kind(cls, data: Any) -> Any:
        """Layers are those of the kind of linkage where none or the usual ones are given.

        The usual ones of another kind are in files whose kind was changed and nothing else.
        """
        if not isinstance(data, dict):
            return data
        links = data.get("links", {})
        usual = {kind.name: [list(parts) for parts in kind.layers] for kind in KINDS.values()}
        kind = data.get("kind")
        if not isinstance(kind, str) or kind not in usual or not isinstance(links, dict):
            return data
        if links.get("layers") not in (None, *usual.values()):
            return data
        return data | {"links": links | {"layers": usual[kind]}}

    @model_validator(mode="after")
    def _links_of_the_kind(self) -> LinkageSpec:
        if self.links.kind.name != self.kind:
            raise ValueError(
                f"links.layers are of a {self.links.kind.name} linkage and kind is {self.kind}: "
                "correct 'layers', or leave them out"
            )
        return self


class FingerLinkageSpec(LinkageSpec):
    """All settings of ``designopt run finger-linkage``."""

    body: BodySpec = setting(BodySpec(), "the phalanges", free=True)
    spring: SpringSpec = setting(SpringSpec(), "spring and motor", free=True)
    front: list[Annotated[float, Field(gt=0, le=10)]] = setting(
        [0.25, 0.3, 0.35, 0.4, 0.45, 0.5],
        "bounds on φ₂/φ₁ for each of which the linkage is designed; none: []",
        free=True,
    )
    precision: bool = setting(True, "measure error against run time", free=True)
    evolution_seconds: float = setting(
        20.0, "time given to differential evolution, the yardstick (s)", scales=True, gt=0, le=3600
    )

    @model_validator(mode="after")
    def _room_for_pins(self) -> FingerLinkageSpec:
        links = self.links
        keep = links.bar_width / 2 + links.shell + self.limits.clearance + self.search.allowance
        if self.body.thickness <= 2 * keep:
            raise ValueError(
                f"thickness ({self.body.thickness:g} mm) leaves no room between the faces for pins "
                f"that keep {keep:g} mm from either: half of links.bar_width, links.shell and "
                "limits.clearance; make it thicker, or one of these less"
            )
        return self


def is_usual_but(spec: FingerLinkageSpec, changes: dict[str, Any]) -> bool:
    """Whether the settings that decide are the defaults but for some.

    Example:
        >>> without = {"limits": {"pinch_force": 0.0}}
        >>> is_usual_but(FingerLinkageSpec(), without)
        False
        >>> is_usual_but(FingerLinkageSpec.model_validate(without | {"front": []}), without)
        True
    """
    same = FingerLinkageSpec.model_validate(changes)
    return spec.model_dump(include=DECIDING) == same.model_dump(include=DECIDING)
