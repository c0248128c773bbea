"""Where the pins of the linkage are in the straight finger."""

from __future__ import annotations

from typing import ClassVar, TypeVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from designopt.io.spec import Spec
from designopt.numerics import as_float, optional_float
from designopt.vectors import Vector, vector
from studies.models.linkage_kinds import COUPLED, SIX_BAR, KindName, LinkageKind

Place = Float[Array, "*batch 2"]
Kind = TypeVar("Kind", bound="LinkagePins")


class LinkagePins(eqx.Module):
    """Pins of a linkage of some kind in the straight finger, mm."""

    kind: ClassVar[LinkageKind]

    @classmethod
    def of(cls: type[Kind], table: Spec) -> Kind:
        """Those of a file or of settings, whose keys are the pins' names."""
        return cls(**{pin: np.array(place) for pin, place in table if place is not None})

    @property
    def names(self) -> str:
        """Names of the pins that there are."""
        return self.kind.pins + ("" if getattr(self, "K", None) is None else "K")

    def places(self) -> dict[str, Vector]:
        """The places by the names of their pins."""
        return {name: vector(getattr(self, name)) for name in self.names}


class Pins(LinkagePins):
    """Pins of the six-bar, by paper B's names (Fig. 3.3); H is its G'.

    Attributes:
        F: axis of the crank, on the proximal phalanx.
        E: crank and rod.
        D: rod and plate.
        C: plate and distal phalanx.
        G: bar and intermediate phalanx.
        H: bar and plate.
        K: crank and the coupler of the motor's parallelogram; ``None`` without one.
    """

    kind: ClassVar[LinkageKind] = SIX_BAR
    F: Place = eqx.field(converter=as_float)
    E: Place = eqx.field(converter=as_float)
    D: Place = eqx.field(converter=as_float)
    C: Place = eqx.field(converter=as_float)
    G: Place = eqx.field(converter=as_float)
    H: Place = eqx.field(converter=as_float)
    K: Place | None = eqx.field(default=None, converter=optional_float)

    @property
    def crank_axis(self) -> Place:
        """The axis about which the motor turns the crank, F."""
        return self.F


class CouplingPins(LinkagePins):
    """Pins of the four-bar A-B-Q-P, whose coupling bar P-Q makes DIP follow PIP.

    Attributes:
        P: coupling bar and proximal phalanx.
        Q: coupling bar and distal phalanx.
        K: intermediate phalanx and the coupler of the motor's parallelogram; ``None`` without one.

    Example:
        >>> CouplingPins(np.array([7.9, -2.1]), np.array([25.2, -6.3])).names
        'PQ'
    """

    kind: ClassVar[LinkageKind] = COUPLED
    P: Place = eqx.field(converter=as_float)
    Q: Place = eqx.field(converter=as_float)
    K: Place | None = eqx.field(default=None, converter=optional_float)

    @property
    def crank_axis(self) -> Place:
        """The axis about which the motor turns the intermediate phalanx, A."""
        return jnp.zeros_like(self.P)


AnyPins = Pins | CouplingPins

PINS: dict[KindName, type[AnyPins]] = {one.kind.name: one for one in (Pins, CouplingPins)}
"""The pins of every kind of linkage."""


def pin_name(pin: str) -> str:
    """A pin's name in files and for people: the paper's."""
    return "G'" if pin == "H" else pin
