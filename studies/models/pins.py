"""Where the pins of the linkage are in the straight finger."""

from __future__ import annotations

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

from designopt.io.spec import Spec
from designopt.numerics import as_float, optional_float
from designopt.vectors import Vector, vector


class Pins(eqx.Module):
    """Pins of the linkage in the straight finger, mm, by paper B's names (Fig. 3.3); H is its G'.

    Attributes:
        F: axis of the crank, on the proximal phalanx.
        E: crank and rod.
        D: rod and plate.
        C: plate and distal phalanx.
        G: bar and intermediate phalanx.
        H: bar and plate.
        K: crank and the coupler of the motor's parallelogram; ``None`` without one.
    """

    F: Float[Array, "*batch 2"] = eqx.field(converter=as_float)
    E: Float[Array, "*batch 2"] = eqx.field(converter=as_float)
    D: Float[Array, "*batch 2"] = eqx.field(converter=as_float)
    C: Float[Array, "*batch 2"] = eqx.field(converter=as_float)
    G: Float[Array, "*batch 2"] = eqx.field(converter=as_float)
    H: Float[Array, "*batch 2"] = eqx.field(converter=as_float)
    K: Float[Array, "*batch 2"] | None = eqx.field(default=None, converter=optional_float)

    @classmethod
    def of(cls, table: Spec) -> Pins:
        """Those of a file or of settings, whose keys are the pins' names."""
        return cls(**{pin: np.array(place) for pin, place in table if place is not None})

    @property
    def names(self) -> str:
        """Names of the pins that there are."""
        return "FEDCGH" if self.K is None else "FEDCGHK"

    def places(self) -> dict[str, Vector]:
        """The places by the names of their pins."""
        return {name: vector(getattr(self, name)) for name in self.names}


def pin_name(pin: str) -> str:
    """A pin's name in files and for people: the paper's."""
    return "G'" if pin == "H" else pin
