"""What the study finds out, before any measurement of how."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from designopt import UserError
from designopt.design_kind import Design
from optics.chamber.chamber import Chamber
from optics.chamber.designed import DesignedChamber
from optics.design import CHAMBER
from optics.scene.thin_lens import LensImage, ThinLens
from studies.models.soft_finger import imaging
from studies.models.soft_finger.imaging import Imaging
from studies.models.soft_finger.spec import ChamberSpec
from studies.table1 import Table1Spec

OTHER_READING = ChamberSpec(length_ab=30, length_bc=40, length_cd=30, wall_angle_bc_deg=1.5)
"""Reads the text's lengths in another order, with a θ_BC that is as much in its range of 1-2°."""


class RealLens(eqx.Module):
    """The printed camera as a real thin lens.

    Attributes:
        lens: with its sensor at the printed image distance.
        distances: of B, C and D from it, in mm: s + f, as in Eq. 1.
        images: of B, C and D.
        refocused: the same lens with its sensor where C is sharp.
        depth_of_field: of the refocused lens, as vergences (1/mm).
        hyperfocal_distance: in mm.
    """

    lens: ThinLens
    distances: Float[Array, "3"]
    images: LensImage
    refocused: ThinLens
    depth_of_field: Float[Array, "2"]
    hyperfocal_distance: Float[Array, ""]


class Analysis(NamedTuple):
    """Everything that the study tabulates and draws.

    Attributes:
        imaging: of the chamber in the spec.
        other_reading: of the other reading of the text; only beside the paper's own chamber.
        lens: the printed camera as a real lens.
    """

    imaging: Imaging
    other_reading: Imaging | None
    lens: RealLens


def analyze(spec: Table1Spec) -> Analysis:
    """Solve for everything that the spec asks for.

    Raises:
        UserError: the table follows no camera constants with this chamber.
    """
    clearance = jnp.asarray(spec.clearance)
    printed = imaging.printed_chamber(spec.chamber)
    solved = imaging.solve(printed, clearance)
    if not bool(solved.fit.solution.ok):
        raise UserError(
            "--set chamber: no camera constants bring this chamber near Table I (the fit did not "
            "converge); choose dimensions nearer to the paper's"
        )
    other = None
    if spec.chamber == ChamberSpec():
        other = imaging.solve(imaging.printed_chamber(OTHER_READING), clearance)
    lens = real_lens(printed, jnp.asarray(spec.f_number), jnp.asarray(spec.blur))
    return Analysis(solved, other, lens)


@jax.jit
def real_lens(printed: Chamber, f_number: Float[Array, ""], blur: Float[Array, ""]) -> RealLens:
    """The printed camera as a thin lens.

    Args:
        printed: the chamber with the paper's constants.
        f_number: of the lens; the paper gives none.
        blur: diameter of a spot that counts as sharp, in mm.
    """
    lens = ThinLens(
        focal_length=printed.focal_length,
        aperture=printed.focal_length / f_number,
        sensor_distance=printed.image_distance,
    )
    distances = printed.depths  # as printed, δ = f
    images = jax.vmap(lens.image)(distances).value
    refocused = dataclasses.replace(lens, sensor_distance=1 / images.vergence[1])
    return RealLens(
        lens,
        distances,
        images,
        refocused,
        refocused.depth_of_field(blur).value,
        lens.hyperfocal_distance(blur).value,
    )


def solve_batch(specs: Sequence[Table1Spec]) -> list[Imaging]:
    """The `Analysis.imaging` of many specs in one program, unchecked."""
    chambers = [imaging.printed_chamber(spec.chamber) for spec in specs]
    stacked = jax.tree.map(lambda *leaves: jnp.stack(leaves), *chambers)
    clearances = jnp.asarray([spec.clearance for spec in specs])
    # As NumPy arrays: taking one spec's numbers out of them compiles and copies nothing.
    solved = jax.tree.map(np.asarray, _solve(stacked, clearances))
    return [jax.tree.map(lambda leaf, i=i: leaf[i], solved) for i in range(len(specs))]


@jax.jit
def _solve(chambers: Chamber, clearances: Float[Array, " specs"]) -> Imaging:
    # One fit after another: side by side, rounding ends some a step earlier than alone, and the
    # constants differ in their eighth digit; a fit is so short that nothing is gained by it.
    return jax.lax.map(lambda one: imaging.solve(*one), (chambers, clearances))


def design(spec: Table1Spec, folder: Path | None) -> Design:
    """The chamber with the identified camera constants, at the largest η that leaves the clearance.

    Args:
        spec: the study's settings.
        folder: of an earlier result; not needed, for the chamber follows from the settings.

    Raises:
        UserError: the table follows no camera constants with this chamber, or no η is left.
    """
    del folder
    found = analyze(spec).imaging
    if not bool(found.choice.ok):
        raise UserError(f"--set chamber: no η could be chosen: {found.choice.messages()[0]}")
    return Design(CHAMBER, DesignedChamber("table1", found.chosen))
