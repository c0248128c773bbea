"""What the study finds out, before any measurement of how."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from designopt.errors import UserError
from optics.chamber.chamber import Chamber
from optics.scene.thin_lens import LensImage, ThinLens
from studies.models.soft_finger import imaging
from studies.models.soft_finger.chamber_spec import ChamberSpec
from studies.models.soft_finger.imaging import Imaging
from studies.table1.spec import Table1Spec

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


@dataclass(frozen=True)
class Analysis:
    """Everything the study says, tabulates and draws.

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
