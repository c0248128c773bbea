"""Kinds of linkage that a finger can have: who is joined to whom, and what lies in which layer."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

KindName = Literal["six-bar", "coupled"]


@dataclass(frozen=True, eq=False)
class LinkageKind:
    """A kind of linkage. Pins are by their keys in `pins`: H is paper B's G'.

    Attributes:
        name: in settings.
        pins: all but those of the motor's parallelogram, in order.
        bodies: the pins of every body, its origin and direction first; without the parallelogram.
        outlines: the pins at the corners of every bar.
        walls: the pins in the side walls of the phalanges.
        crank: the body that the motor turns.
        shaft: the pin about which it turns.
        inputs: by what drives them, each its name, its body and the one relative to which it is.
        springs: pairs of bodies between which there is a spring, where the crank drives.
        layers: what lies in each layer by default, from the middle of the finger.
        hosts: the phalanx beside which each pin lies, in whose frame it is looked at.
    """

    name: KindName
    pins: str
    bodies: Mapping[str, str]
    outlines: Mapping[str, str]
    walls: Mapping[str, str]
    crank: str
    shaft: str
    inputs: Mapping[str, tuple[tuple[str, str, str], ...]]
    springs: tuple[tuple[str, str], ...]
    layers: tuple[tuple[str, ...], ...]
    hosts: Mapping[str, str]

    @property
    def freedoms(self) -> int:
        """Degrees of freedom."""
        return len(self.inputs["joints"])

    @property
    def crank_title(self) -> str:
        """The body that the motor turns, in words."""
        return self.crank if self.crank in self.outlines else f"{self.crank} phalanx"


PARALLELOGRAM = {"driver": "MN", "coupler": "NK"}
"""Bars of the motor's parallelogram, without which there is no K."""

SIX_BAR = LinkageKind(
    name="six-bar",
    pins="FEDCGH",
    bodies={
        "proximal": "OAF",
        "intermediate": "ABG",
        "distal": "BTC",
        "plate": "CDH",
        "rod": "DE",
        "crank": "FE",
        "bar": "GH",
    },
    outlines={"crank": "FEK", "rod": "ED", "plate": "CDH", "bar": "GH", **PARALLELOGRAM},
    walls={"proximal": "AFM", "intermediate": "ABG", "distal": "BC"},
    crank="crank",
    shaft="F",
    inputs={
        "joints": (("pip", "intermediate", "proximal"), ("dip", "distal", "intermediate")),
        "crank": (("theta", "crank", "world"), ("gamma", "plate", "distal")),
    },
    springs=(("distal", "plate"),),
    layers=(
        ("pads", "mirrors", "camera"),
        ("proximal", "distal", "LED strips"),
        ("crank", "plate", "driver"),
        ("rod", "bar", "coupler"),
        ("intermediate",),
    ),
    hosts={
        "F": "proximal",
        "E": "proximal",
        "D": "intermediate",
        "G": "intermediate",
        "H": "intermediate",
        "C": "distal",
        "K": "proximal",
    },
)
"""Paper B's underactuated six-bar. (Hosts are an argument from the pins' motions: F, G and C are
fixed in their phalanx, E and K swing beside the proximal one, D and G' beside the intermediate.)

The order of its layers is the only one in which all pins but the axles join neighbouring layers,
for the bars need two layers (plate and rod share a pin) and plate and crank hang on the walls of
the outer phalanges, the bar on that of the intermediate one; but for turning it inside out."""

COUPLED = LinkageKind(
    name="coupled",
    pins="PQ",
    bodies={"proximal": "OAP", "intermediate": "AB", "distal": "BTQ", "coupling": "PQ"},
    outlines={"coupling": "PQ", **PARALLELOGRAM},
    walls={"proximal": "APM", "intermediate": "ABK", "distal": "BQ"},
    crank="intermediate",
    shaft="A",
    inputs={
        "joints": (("pip", "intermediate", "proximal"),),
        "crank": (("theta", "intermediate", "world"),),
    },
    springs=(),
    layers=(
        ("pads", "mirrors", "camera"),
        ("proximal", "distal", "LED strips"),
        ("coupling", "driver"),
        ("coupler",),
        ("intermediate",),
    ),
    hosts={"P": "proximal", "Q": "distal", "K": "proximal"},
)
"""Four-bar A-B-Q-P: one bar from the proximal to the distal phalanx makes DIP follow PIP. The motor
turns the intermediate phalanx."""

KINDS: dict[KindName, LinkageKind] = {kind.name: kind for kind in (SIX_BAR, COUPLED)}


def kind_of_layers(layers: Sequence[Sequence[str]]) -> LinkageKind:
    """The kind of linkage whose parts lie in layers: the one with a coupling bar, if there is one.

    Example:
        >>> kind_of_layers(SIX_BAR.layers).name
        'six-bar'
    """
    return COUPLED if any("coupling" in parts for parts in layers) else SIX_BAR
