"""The link back to the design: which chamber's image moves most when the finger bends."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from designopt.optimising import Optimum, Problem, Requirement, Terms, minimise, sobol_starts
from optics.chamber import Chamber
from optics.soft_finger import Endoscope, image_rates
from studies.chamber_images.making import DOWN, SoftFinger
from studies.table1 import imaging, paper

RATIOS = (min(paper.ETA), max(paper.ETA))
"""Table I's range of η."""

WALL_ANGLES_DEG = (1.0, 2.0)
"""Range of θ_BC in the paper's text (§II.A)."""

STARTS = 8

OUTLINES = ("blue", "yellow", "top")


class Knobs(eqx.Module):
    """What is chosen of a chamber, the rest of which is Table I's.

    Attributes:
        eta: η, which sets Δl_D.
        offset_b: Δl_B in mm.
        wall_angle_bc: θ_BC in radians.
    """

    eta: Float[Array, ""]
    offset_b: Float[Array, ""]
    wall_angle_bc: Float[Array, ""]

    @classmethod
    def of(cls, chamber: Chamber) -> Knobs:
        """Those of a chamber."""
        return cls(chamber.imaging_ratio().value, chamber.offset_b, chamber.wall_angle_bc)

    def turned(self, chamber: Chamber) -> Chamber:
        """The chamber with these."""
        changed = dataclasses.replace(
            chamber, offset_b=self.offset_b, wall_angle_bc=self.wall_angle_bc
        )
        return imaging.with_ratio(changed, self.eta)


def rates(knobs: Knobs, chamber: Chamber, endoscope: Endoscope) -> Float[Array, "3"]:
    """Px per degree by which the outlines of blue, yellow and top start to move downwards."""
    return image_rates(knobs.turned(chamber), endoscope, DOWN).value * (jnp.pi / 180)


@eqx.filter_jit
def _rates_and_slopes(
    knobs: Knobs, chamber: Chamber, endoscope: Endoscope
) -> tuple[Float[Array, "3"], Knobs]:
    slopes = jax.jacfwd(rates)(knobs, chamber, endoscope)
    return rates(knobs, chamber, endoscope), slopes


@dataclass(frozen=True)
class Design:
    """A chamber and how its image moves.

    Attributes:
        name: what it is.
        finger: it, with its camera.
        knobs: what was chosen.
        rates: px per degree of the outlines of blue, yellow and top.
        slopes: their derivatives with respect to η, Δl_B (mm) and θ_BC (degrees).
    """

    name: str
    finger: SoftFinger
    knobs: Knobs
    rates: Float[np.ndarray, "3"]
    slopes: Float[np.ndarray, "3 knobs"]

    @classmethod
    def of(cls, name: str, finger: SoftFinger) -> Design:
        """A finger's."""
        knobs = Knobs.of(finger.chamber)
        moved, slopes = _rates_and_slopes(knobs, finger.chamber, finger.endoscope)
        columns = (slopes.eta, slopes.offset_b, slopes.wall_angle_bc * (jnp.pi / 180))
        return cls(name, finger, knobs, np.asarray(moved), np.stack(columns, axis=1))


def clearance(chamber: Chamber) -> Float[Array, ""]:
    """Δl_A − |Δl_D| in mm: what the paper wants to be left inside the chamber's mouth."""
    return chamber.offset_a - jnp.abs(chamber.offset_d)


def problem(finger: SoftFinger) -> Problem:
    """The largest mean displacement per degree of the three outlines, within Table I's limits.

    Limits, a reading: η as in the table's rows, θ_BC as in the text, Δl_B between the centre line
    and Δl_A, and |Δl_D| as far inside Δl_A as in the paper's own choice, η = 0.6 in its chamber.
    """
    least = imaging.clearance_at(
        dataclasses.replace(
            finger.chamber, offset_b=jnp.asarray(2.0), wall_angle_bc=jnp.deg2rad(jnp.asarray(2.0))
        ),
        jnp.asarray(paper.CHOSEN_ETA),
    )

    def terms(
        knobs: Knobs, chamber: Chamber, endoscope: Endoscope, least: Float[Array, ""]
    ) -> Terms:
        room = clearance(knobs.turned(chamber)) - least
        return Terms(
            objective=-jnp.mean(rates(knobs, chamber, endoscope)), inequalities={"room": room}
        )

    angles = jnp.deg2rad(jnp.asarray(WALL_ANGLES_DEG))
    return Problem(
        terms,
        lower=Knobs(jnp.asarray(RATIOS[0]), jnp.zeros_like(least), angles[0]),
        upper=Knobs(jnp.asarray(RATIOS[1]), finger.chamber.offset_a, angles[1]),
        requirements={
            "room": Requirement(lambda _: "|Δl_D| inside Δl_A as in the paper's choice", "mm")
        },
        data=(finger.chamber, finger.endoscope, least),
    )


def best(finger: SoftFinger, seed: int) -> tuple[SoftFinger, Optimum]:
    """The finger whose chamber's image moves most, and what the solver says of it."""
    asked = problem(finger)
    starts = sobol_starts(asked, STARTS, seed=seed)
    found = minimise(asked, starts).best
    chamber = found.parameters.turned(finger.chamber)
    return dataclasses.replace(finger, chamber=chamber), found
