"""From the postures that pictures show to the diameters of the bottles that they hold."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from perception.posture import PostureEstimate, PostureEstimator, fit_bend
from studies.models.soft_finger.samples import MARKERS
from studies.object_size.grasp import Hand, diameter_of

diameters_of = jax.jit(jax.vmap(diameter_of))


@dataclass(frozen=True)
class Reader:
    """All that an estimate takes but the picture.

    Attributes:
        estimator: reads the finger's posture.
        hand: with every bottle in its one place.
        largest_residual: root mean square distance of markers from the arc that fits them best,
            mm. A network answers to postures that it was never shown too, with markers that lie
            on no arc.
    """

    estimator: PostureEstimator
    hand: Hand
    largest_residual: float


@dataclass(frozen=True)
class Estimates:
    """What is said of some pictures; it follows from these alone.

    Attributes:
        markers: places by the network, mm; NaN where the picture shows no chamber.
        seen: whether it shows one, and the markers are places of a finger's.
        bends: of the finger, from the markers, in radians; 0 where it is not seen.
        residuals: root mean square distance of the markers from the arc that fits them best, mm;
            likewise.
        known: whether there is an answer: the chamber is seen, the markers lie on an arc, and its
            bend is one of a finger that holds something.
        diameters: of the bottle, mm; 0 where there is no answer.
    """

    markers: Float[np.ndarray, "pictures 3 2"]
    seen: Bool[np.ndarray, " pictures"]
    bends: Float[np.ndarray, " pictures"]
    residuals: Float[np.ndarray, " pictures"]
    known: Bool[np.ndarray, " pictures"]
    diameters: Float[np.ndarray, " pictures"]


def estimated(postures: Sequence[PostureEstimate], reader: Reader) -> Estimates:
    """Diameters from postures."""
    nothing = np.full((3, 2), np.nan)
    markers = np.stack([nothing if one.markers is None else one.markers for one in postures])
    length = float(reader.hand.length)
    first, second, third, last = (part * length for part in MARKERS)
    fit = fit_bend(markers, (first, second, third, last), length)
    hands = jax.tree.map(lambda value: jnp.full(len(postures), value), reader.hand)
    found = diameters_of(hands, jnp.asarray(fit.bend))
    known = fit.known & (fit.residual <= reader.largest_residual) & np.asarray(found.ok)
    diameters = np.where(known, np.asarray(found.value), 0.0)
    return Estimates(markers, fit.known, fit.bend, fit.residual, known, diameters)
