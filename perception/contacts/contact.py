"""What is known of a contact."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True, eq=False)
class Contact:
    """Something that is pressed into a pad, where its membrane leaves it.

    Attributes:
        pad: name of the pad.
        paths: names of the paths by which it was seen.
        center: along the pad from its first end and across it from its middle, mm.
        diameter: of the contact's edge: of the circle along which the membrane leaves what presses,
            where it is steepest, mm.
        covariance: of the center's two coordinates and of the diameter, mm².
        outline: of the contact, a closed polygon without its first point again, mm.
        depth: by which the membrane is lifted, mm; a rough estimate.
        strength: how far the change of light is above noise.
    """

    pad: str
    paths: tuple[str, ...]
    center: Float[np.ndarray, "2"]
    diameter: float
    covariance: Float[np.ndarray, "3 3"]
    outline: Float[np.ndarray, "points 2"]
    depth: float
    strength: float

    @property
    def deviations(self) -> Float[np.ndarray, "3"]:
        """Standard deviations of the center's two coordinates and of the diameter, mm."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def measured(self) -> Float[np.ndarray, "3"]:
        """The center's two coordinates and the diameter, mm."""
        return np.array([*self.center, self.diameter])
