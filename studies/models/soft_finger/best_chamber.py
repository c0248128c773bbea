"""The link back to the design: which chamber's image moves most when the finger bends."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from designopt import Records, UserError, as_float
from designopt.optimize import (
    Evaluation,
    Problem,
    Requirement,
    draw_sobol_starts,
    explain_conflict,
    find_active_set,
    minimize,
)
from optics.chamber import Endoscope, find_extreme_points, solve_image_rates
from optics.chamber.chamber import Chamber
from studies.models.soft_finger import imaging, paper
from studies.models.soft_finger.finger import DOWN, SoftFinger
from studies.models.soft_finger.spec import ChamberSpec

WALL_ANGLES_DEG = (1.0, 2.0)
"""Range of θ_BC in the paper's text (§II.A)."""

STARTS = 8

INSIDE = 20.0
"""How far, px, the straight chamber's blue outline must stay inside the image."""

OWN, BEST = "as in the spec", "moves most"
"""Names of the first and of the last design."""

OUTLINES = ("blue", "yellow", "top")


class Dimensions(eqx.Module):
    """What is chosen of a chamber, the rest of which is Table I's.

    Attributes:
        eta: η, which sets Δl_D.
        offset_b: Δl_B in mm.
        wall_angle_bc: θ_BC in radians.
    """

    eta: Float[Array, ""] = eqx.field(converter=as_float)
    offset_b: Float[Array, ""] = eqx.field(converter=as_float)
    wall_angle_bc: Float[Array, ""] = eqx.field(converter=as_float)

    @classmethod
    def of(cls, chamber: Chamber) -> Dimensions:
        """Those of a chamber."""
        return cls(chamber.imaging_ratio().value, chamber.offset_b, chamber.wall_angle_bc)

    def applied_to(self, chamber: Chamber) -> Chamber:
        """The chamber with these."""
        changed = dataclasses.replace(
            chamber, offset_b=self.offset_b, wall_angle_bc=self.wall_angle_bc
        )
        return imaging.with_ratio(changed, self.eta)


def rates(dimensions: Dimensions, chamber: Chamber, endoscope: Endoscope) -> Float[Array, "3"]:
    """Px per degree by which the outlines of blue, yellow and top start to move downwards."""
    own = dimensions.applied_to(chamber)
    return solve_image_rates(own, endoscope, DOWN).value * (jnp.pi / 180)


@eqx.filter_jit
def _rates_and_slopes(
    dimensions: Dimensions, chamber: Chamber, endoscope: Endoscope
) -> tuple[Float[Array, "3"], Dimensions]:
    slopes = jax.jacfwd(rates)(dimensions, chamber, endoscope)
    return rates(dimensions, chamber, endoscope), slopes


@dataclass(frozen=True)
class Design:
    """A chamber and how its image moves.

    Attributes:
        name: what it is.
        finger: it, with its camera.
        dimensions: what was chosen.
        rates: px per degree of the outlines of blue, yellow and top.
        slopes: their derivatives with respect to η, Δl_B (mm) and θ_BC (degrees).
    """

    name: str
    finger: SoftFinger
    dimensions: Dimensions
    rates: Float[np.ndarray, "3"]
    slopes: Float[np.ndarray, "3 dimensions"]

    @classmethod
    def of(cls, name: str, finger: SoftFinger) -> Design:
        """A finger's."""
        own = Dimensions.of(finger.chamber)
        moved, slopes = _rates_and_slopes(own, finger.chamber, finger.endoscope)
        columns = (slopes.eta, slopes.offset_b, slopes.wall_angle_bc * (jnp.pi / 180))
        return cls(name, finger, own, np.asarray(moved), np.stack(columns, axis=1))


def tabulate(designs: Sequence[Design]) -> Records:
    """A row for each outline of each design."""
    rows = Records()
    for design in designs:
        by_eta, by_offset, by_angle = design.slopes.T
        rows.add(
            chamber=design.name,
            eta=design.dimensions.eta,
            offset_b_mm=design.dimensions.offset_b,
            theta_bc_deg=np.rad2deg(design.dimensions.wall_angle_bc),
            offset_d_mm=design.finger.chamber.offset_d,
            outline=OUTLINES,
            rate_px_per_deg=design.rates,
            slope_eta_px_per_deg=by_eta,
            slope_offset_b_px_per_deg_mm=by_offset,
            slope_theta_bc_px_per_deg2=by_angle,
        )
    return rows


def clearance(chamber: Chamber) -> Float[Array, ""]:
    """Δl_A − |Δl_D| in mm: what the paper wants to be left inside the chamber's mouth."""
    return chamber.offset_a - jnp.abs(chamber.offset_d)


def problem(finger: SoftFinger) -> Problem:
    """The largest mean displacement per degree of the three outlines, within Table I's limits.

    Limits, a reading: η as in the table's rows, θ_BC as in the text, Δl_B between the centre line
    and Δl_A, and |Δl_D| as far inside Δl_A as in the paper's own choice, η = 0.6 in its chamber.
    Besides, the straight chamber's blue outline stays inside the image.
    """
    printed = ChamberSpec()
    chosen = Dimensions(paper.CHOSEN_ETA, printed.offset_b, np.deg2rad(printed.wall_angle_bc_deg))
    least = clearance(chosen.applied_to(finger.chamber))

    def terms(
        dimensions: Dimensions, chamber: Chamber, endoscope: Endoscope, least: Float[Array, ""]
    ) -> Evaluation:
        own = dimensions.applied_to(chamber)
        lowest = find_extreme_points(own, endoscope, 0.0, DOWN).value[0, 1]
        return Evaluation(
            objective=-jnp.mean(rates(dimensions, chamber, endoscope)),
            inequalities={
                "room": clearance(own) - least,
                "image": (endoscope.rows - 1 - INSIDE - lowest) / endoscope.rows,
            },
        )

    flattest, steepest = np.deg2rad(WALL_ANGLES_DEG)
    rows = finger.endoscope.rows
    return Problem(
        terms,
        lower=Dimensions(min(paper.ETA), 0.0, flattest),
        upper=Dimensions(max(paper.ETA), finger.chamber.offset_a, steepest),
        requirements={
            "room": Requirement(lambda _: "|Δl_D| inside Δl_A as in the paper's choice", "mm"),
            "image": Requirement(lambda _: "blue's outline inside the image", "px", rows),
        },
        parameters={
            "offset_b": Requirement(lambda _: "Δl_B", "mm"),
            "wall_angle_bc": Requirement(lambda _: "θ_BC", "°", math.degrees(1)),
            "eta": Requirement(lambda _: "η"),
        },
        data=(finger.chamber, finger.endoscope, least),
    )


def find_best_chamber(finger: SoftFinger, seed: int) -> tuple[list[Design], list[str]]:
    """The chamber whose image moves most, and what each of its dimensions adds to that.

    Returns:
        Designs: the finger's own; with one dimension each as in the best chamber; that chamber.
        And the limits that hold it, in words.

    Raises:
        UserError: no chamber is within the limits.
    """
    posed = problem(finger)
    found = minimize(posed, draw_sobol_starts(posed, STARTS, seed=seed)).best
    if not found.feasible:
        raise UserError(
            "--set endoscope: no chamber within Table I's limits shows all of its blue ring ("
            f"{'; '.join(explain_conflict(posed, found))}); choose a wider field of view"
        )
    own, best = Dimensions.of(finger.chamber), found.parameters
    changed = {"Δl_B": "offset_b", "θ_BC": "wall_angle_bc", "η": "eta"}
    others = {
        f"{word} alone": dataclasses.replace(own, **{name: getattr(best, name)})
        for word, name in changed.items()
    } | {BEST: best}
    designs = [Design.of(OWN, finger)] + [
        Design.of(name, dataclasses.replace(finger, chamber=one.applied_to(finger.chamber)))
        for name, one in others.items()
    ]
    return designs, [active.words for active in find_active_set(posed, found)]
