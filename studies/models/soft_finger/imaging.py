"""What Eqs. 1-3 give for Table I: any set of constants, the identification, the choice of η."""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from designopt import Fit, Solution, least_squares
from optics import Chamber, solve_dimension_for_ratio
from studies.models.soft_finger import paper
from studies.models.soft_finger.spec import ChamberSpec


class Columns(NamedTuple):
    """Table I as one chamber gives it.

    Attributes:
        eta: from the printed θ_CD.
        delta_l_d_cm: from the printed η.
        theta_cd_deg: from the printed η.
    """

    eta: Float[Array, " rows"]
    delta_l_d_cm: Float[Array, " rows"]
    theta_cd_deg: Float[Array, " rows"]

    def deviations(self) -> Columns:
        """This minus the paper's table."""
        return Columns(*(mine - theirs for mine, theirs in zip(self, PRINTED, strict=True)))

    def matched(self) -> int:
        """Cells that agree with the paper's in every printed digit."""
        return sum(
            f"{mine:.{places}f}" == f"{printed:.{places}f}"
            for column, printed_column, places in zip(self, PRINTED, paper.PLACES, strict=True)
            for mine, printed in zip(column.tolist(), printed_column.tolist(), strict=True)
        )


PRINTED = tuple(map(np.array, (paper.ETA, paper.DELTA_L_D_CM, paper.THETA_CD_DEG)))
"""The paper's table, in the order of `Columns`."""


class Constants(eqx.Module):
    """A chamber with one set of camera constants, and the table it gives.

    Attributes:
        chamber: with Δl_D left at 0.
        table: Table I.
        slope: of Δl_D over η, in mm; the relation is exactly linear.
        intercept: Δl_D at η = 0, in mm.
    """

    chamber: Chamber
    table: Columns
    slope: Float[Array, ""]
    intercept: Float[Array, ""]


class Imaging(eqx.Module):
    """What Eqs. 1-3 say about one reading of the chamber's lengths.

    Attributes:
        printed: with the paper's camera constants.
        fit: the constants h and δ that Table I follows, in mm.
        identified: with those constants.
        choice: the largest η that leaves the stated clearance.
        chosen: the identified chamber at that η.
        paper_clearance: what the paper's own η leaves inside Δl_A, in mm.
    """

    printed: Constants
    fit: Fit
    identified: Constants
    choice: Solution[Float[Array, ""]]
    chosen: Chamber
    paper_clearance: Float[Array, ""]


@jax.jit
def solve(printed: Chamber, clearance: Float[Array, ""]) -> Imaging:
    """Table I with the printed and the identified constants, and the choice of η.

    Args:
        printed: the chamber with the paper's constants.
        clearance: what |Δl_D| is to leave inside Δl_A, in mm.
    """
    fit = identify(printed)
    identified = with_constants(printed, fit.solution.value)
    choice = largest_ratio(identified, clearance)
    return Imaging(
        printed=_tabulated(printed),
        fit=fit,
        identified=_tabulated(identified),
        choice=choice,
        chosen=with_ratio(identified, choice.value),
        paper_clearance=clearance_at(identified, jnp.full_like(clearance, paper.CHOSEN_ETA)),
    )


def _tabulated(chamber: Chamber) -> Constants:
    intercept, end = (
        with_ratio(chamber, jnp.full_like(chamber.offset_d, ratio)).offset_d for ratio in (0, 1)
    )
    return Constants(chamber, columns(chamber), end - intercept, intercept)


def printed_chamber(spec: ChamberSpec) -> Chamber:
    """The chamber with the paper's own camera constants, h = Δl_A and δ = f; Δl_D is left at 0."""
    printed = dict(spec)
    angle = np.deg2rad(printed.pop("wall_angle_bc_deg"))
    unset = dict.fromkeys(("offset_d", "reference_height", "pinhole_offset"), 0.0)
    return Chamber(**printed, wall_angle_bc=angle, **unset).as_printed()


def with_constants(chamber: Chamber, constants: Float[Array, "2"]) -> Chamber:
    """The chamber with the camera constants h and δ, in mm."""
    return dataclasses.replace(chamber, reference_height=constants[0], pinhole_offset=constants[1])


def with_ratio(chamber: Chamber, ratio: Float[Array, ""]) -> Chamber:
    """The chamber whose Δl_D gives this η."""
    offset_d = solve_dimension_for_ratio(chamber, "offset_d", ratio).value
    return dataclasses.replace(chamber, offset_d=offset_d)


def lengths_and_angles(
    chamber: Chamber, ratios: Float[Array, " rows"]
) -> tuple[Float[Array, " rows"], Float[Array, " rows"]]:
    """Δl_D in cm and θ_CD in degrees for each η."""
    chambers = jax.vmap(lambda ratio: with_ratio(chamber, ratio))(ratios)
    angles = jax.vmap(lambda each: each.wall_angle_cd)(chambers)
    return chambers.offset_d / 10, jnp.rad2deg(angles)


def columns(chamber: Chamber) -> Columns:
    """Table I as this chamber gives it."""

    def ratio(angle: Float[Array, ""]) -> Float[Array, ""]:
        return chamber.with_wall_angle_cd(angle).imaging_ratio().value

    ratios = jax.vmap(ratio)(jnp.deg2rad(jnp.asarray(paper.THETA_CD_DEG)))
    return Columns(ratios, *lengths_and_angles(chamber, jnp.asarray(paper.ETA)))


def identify(chamber: Chamber) -> Fit:
    """The camera constants h and δ that Table I follows, in mm.

    Least squares over the Δl_D and θ_CD columns; each deviation is divided by the standard
    deviation of the printed rounding. The residuals are those of Δl_D, then those of θ_CD.
    """

    def residuals(constants: Float[Array, "2"], chamber: Chamber) -> Float[Array, " cells"]:
        found = lengths_and_angles(with_constants(chamber, constants), jnp.asarray(paper.ETA))
        printed = (paper.DELTA_L_D_CM, paper.THETA_CD_DEG)
        deviations = jnp.concatenate(
            [mine - jnp.asarray(theirs) for mine, theirs in zip(found, printed, strict=True)]
        )
        return deviations / paper.ROUNDING_DEVIATION

    guess = jnp.stack([chamber.reference_height, chamber.pinhole_offset])
    return least_squares(residuals, guess, chamber)


def largest_ratio(chamber: Chamber, clearance: Float[Array, ""]) -> Solution[Float[Array, ""]]:
    """The largest η at which |Δl_D| stays inside Δl_A by ``clearance`` (mm).

    Δl_D is linear in η, so |Δl_D| ≤ Δl_A − clearance is an interval of η, and its largest η lies
    at one end or the other as the line rises or falls.
    """
    room = chamber.offset_a - clearance

    def ratio(offset_d: Float[Array, ""]) -> Solution[Float[Array, ""]]:
        return dataclasses.replace(chamber, offset_d=offset_d).imaging_ratio()

    ends = jax.vmap(ratio)(jnp.stack([room, -room]))
    return jax.tree.map(lambda leaf: leaf[jnp.argmax(ends.value)], ends)


def clearance_at(chamber: Chamber, ratio: Float[Array, ""]) -> Float[Array, ""]:
    """Δl_A − |Δl_D| in mm at this η."""
    return chamber.offset_a - jnp.abs(with_ratio(chamber, ratio).offset_d)
