"""The coloured chamber of a soft finger and how its rings are imaged (paper A, §II.A).

The chamber's wall runs through the points A, B, C, D at distances 0, a, a+b and a+b+c along the
centre line; its regions are AB (red), BC (blue) and CD (yellow), and DE closes it. The offsets
Δl are signed: B and C lie above the centre line, D below it.

A point at distance s whose height above the reference ray through the pinhole is y has its image
at T = (f − v) y / (s + δ) (paper A, Eq. 1 and "similarly" its siblings). B and C lie at
y = h + Δl, D at y = h − Δl_D. As printed, h = Δl_A and δ = f. That Eq. 1 continues to C and D in
this way, and that D is counted downwards, are readings of the text and not quotations; Eq. 2
continued to D with its sign agrees with every row of Table I.

The image rings are Δd_b = T_B − T_C (blue), Δd_c = T_C − T_D (yellow) and Δd_d = T_D (the top),
and η = Δd_c / Δd_b (Eq. 3). Written out, every difference of image heights factors:

    Δd_b = (f − v) b W / ((s_B + δ)(s_C + δ) cos θ_BC)
    Δd_c = (f − v) Y / ((s_C + δ)(s_D + δ) cos θ_BC)
    W = (h + Δl_B) cos θ_BC + (s_B + δ) sin θ_BC
    Y = (c (h + Δl_C) + (Δl_C + Δl_D)(s_C + δ)) cos θ_BC

W is the distance of the pinhole from the line of the blue wall. These forms subtract no nearly
equal numbers; f − v and cos θ_BC leave η, which stays exact for f = v and for steep walls.
"""

from __future__ import annotations

import dataclasses

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from designopt.numerics import as_float, safe_arctan2, safe_divide
from designopt.solution import Solution, combine_checks


class ChamberResult(eqx.Enumeration):
    """What can be wrong with a chamber's image, or with a search for one of its dimensions."""

    successful = ""
    behind_pinhole = (
        "A wall point lies at or behind the pinhole plane and has no image: "
        "the pinhole offset must be larger than minus the red length."
    )
    no_length = (
        "A region has no length or a negative one, so it cannot be built: "
        "change the imaging ratio or another dimension until all three are positive."
    )
    blue_edge_on = (
        "The camera looks along the blue wall or at its back, so the blue ring has no width: "
        "turn the wall towards the camera or raise the reference height."
    )
    no_solution = (
        "No value of this dimension gives the imaging ratio asked for: "
        "change the ratio or another dimension."
    )
    hidden = (
        "The wall hides what was asked for, or it is behind the camera or has no radius: "
        "bend the finger less, or widen the chamber."
    )
    out_of_range = (
        "The answer or its slope does not fit this float type: use float64 or rescale the lengths."
    )
    not_converged = (
        "The iteration stopped before it reached the tolerance: "
        "loosen the tolerance or start nearer to the answer."
    )


class Chamber(eqx.Module):
    """A chamber with its camera. Lengths in mm, angles in radians; every field is an array leaf.

    Attributes:
        length_ab: a, length of the red region along the centre line.
        length_bc: b, length of the blue region.
        length_cd: c, length of the yellow region.
        offset_a: Δl_A, offset of the wall at the lens.
        offset_b: Δl_B, offset of the wall where red meets blue.
        wall_angle_bc: θ_BC, angle by which the blue wall falls towards the centre line; less than
            a right angle either way.
        offset_d: Δl_D, offset of the wall's end, counted to the other side of the centre line.
        focal_length: f.
        image_distance: v.
        reference_height: h, height of the centre line above the reference ray.
        pinhole_offset: δ, distance of the pinhole behind A.
    """

    length_ab: Float[Array, ""] = eqx.field(converter=as_float)
    length_bc: Float[Array, ""] = eqx.field(converter=as_float)
    length_cd: Float[Array, ""] = eqx.field(converter=as_float)
    offset_a: Float[Array, ""] = eqx.field(converter=as_float)
    offset_b: Float[Array, ""] = eqx.field(converter=as_float)
    wall_angle_bc: Float[Array, ""] = eqx.field(converter=as_float)
    offset_d: Float[Array, ""] = eqx.field(converter=as_float)
    focal_length: Float[Array, ""] = eqx.field(converter=as_float)
    image_distance: Float[Array, ""] = eqx.field(converter=as_float)
    reference_height: Float[Array, ""] = eqx.field(converter=as_float)
    pinhole_offset: Float[Array, ""] = eqx.field(converter=as_float)

    @property
    def offset_c(self) -> Float[Array, ""]:
        """Δl_C = Δl_B − b tan θ_BC, in mm (paper A, Eq. 2)."""
        return self.offset_b - self.length_bc * jnp.tan(self.wall_angle_bc)

    @property
    def wall_angle_cd(self) -> Float[Array, ""]:
        """θ_CD in radians: tan θ_CD = (Δl_C + Δl_D) / c (Eq. 2 continued to D with its sign)."""
        return safe_arctan2(self.offset_c + self.offset_d, self.length_cd)

    def with_wall_angle_cd(self, wall_angle_cd: ArrayLike) -> Chamber:
        """The chamber whose Δl_D gives this θ_CD (radians): Δl_D = c tan θ_CD − Δl_C."""
        offset_d = self.length_cd * jnp.tan(as_float(wall_angle_cd)) - self.offset_c
        return dataclasses.replace(self, offset_d=offset_d)

    def as_printed(self) -> Chamber:
        """The chamber with paper A's own camera constants: h = Δl_A and δ = f (Eq. 1)."""
        return dataclasses.replace(
            self, reference_height=self.offset_a, pinhole_offset=self.focal_length
        )

    @property
    def _lengths(self) -> Float[Array, "3"]:
        return jnp.stack([self.length_ab, self.length_bc, self.length_cd])

    @property
    def depths(self) -> Float[Array, "3"]:
        """Depths s + δ of B, C and D in mm: how far each lies in front of the pinhole plane."""
        depth_b = self.length_ab + self.pinhole_offset
        depth_c = depth_b + self.length_bc
        return jnp.stack([depth_b, depth_c, depth_c + self.length_cd])

    @property
    def blue_wall_distance(self) -> Float[Array, ""]:
        """W in mm: distance of the pinhole from the line of the blue wall; 0 if seen edge-on."""
        angle = self.wall_angle_bc
        along = self.depths[0] * jnp.sin(angle)
        return (self.reference_height + self.offset_b) * jnp.cos(angle) + along

    @property
    def _yellow(self) -> Float[Array, ""]:
        # Y of the module's docstring, in mm²; Δl_C cos θ_BC is written out to keep tan θ_BC away.
        cosine = jnp.cos(self.wall_angle_bc)
        offset_c = self.offset_b * cosine - self.length_bc * jnp.sin(self.wall_angle_bc)
        fall = (offset_c + self.offset_d * cosine) * self.depths[1]
        return self.length_cd * (self.reference_height * cosine + offset_c) + fall

    def imaging_ratio(self) -> Solution[Float[Array, ""]]:
        """η = Δd_c / Δd_b, the yellow ring's width over the blue ring's (paper A, Eq. 3).

        Returns:
            η, without unit; negative where D is imaged farther out than C, so that the yellow
            wall hides itself. ``margin`` (mm) is the least of the depths of B, C and D, of the
            three lengths, and of W: how far the nearest wall point is in front of the pinhole
            plane, how long the shortest region is, and how far the pinhole is in front of the
            blue wall.
        """
        depth_b, _, depth_d = self.depths
        wall_distance = self.blue_wall_distance
        perspective, perspective_fits = safe_divide(depth_b, depth_d)
        per_length, length_fits = safe_divide(self._yellow, self.length_bc)
        slope, slope_fits = safe_divide(per_length, wall_distance)
        ratio = perspective * slope
        margin, result = combine_checks(
            ChamberResult.successful,
            (jnp.min(self.depths), ChamberResult.behind_pinhole),
            (jnp.min(self._lengths), ChamberResult.no_length),
            (wall_distance, ChamberResult.blue_edge_on),
        )
        fits = perspective_fits & length_fits & slope_fits
        result = ChamberResult.where((margin > 0) & ~fits, ChamberResult.out_of_range, result)
        return Solution(ratio, margin, ring_residual(self, ratio), result)

    def image_heights(self) -> Solution[Float[Array, "3"]]:
        """Image heights T_B, T_C and T_D above the reference ray in mm (paper A, Eq. 1).

        ``margin`` (mm) is the least depth of a wall point in front of the pinhole.
        """
        offsets = jnp.stack([self.offset_b, self.offset_c, -self.offset_d])
        return self._imaged(self.reference_height + offsets, self.depths)

    def ring_widths(self) -> Solution[Float[Array, "3"]]:
        """Image widths Δd_b (blue), Δd_c (yellow) and Δd_d (top) in mm (paper A, Eqs. 1 and 3).

        Δd_d is T_D, the image height of D. ``margin`` is that of `image_heights`.
        """
        depth_b, depth_c, depth_d = self.depths
        foreshortened = depth_c * jnp.cos(self.wall_angle_bc)
        blue, _ = safe_divide(self.length_bc * self.blue_wall_distance, foreshortened)
        yellow, _ = safe_divide(self._yellow, foreshortened)
        top = self.reference_height - self.offset_d
        return self._imaged(jnp.stack([blue, yellow, top]), jnp.stack([depth_b, depth_d, depth_d]))

    def _imaged(
        self, heights: Float[Array, "3"], depths: Float[Array, "3"]
    ) -> Solution[Float[Array, "3"]]:
        slopes, fits = safe_divide(heights, depths)
        images = (self.focal_length - self.image_distance) * slopes
        margin, result = combine_checks(
            ChamberResult.successful, (jnp.min(self.depths), ChamberResult.behind_pinhole)
        )
        result = ChamberResult.where(
            (margin > 0) & ~jnp.all(fits), ChamberResult.out_of_range, result
        )
        # The images are explicit: no equation is left over.
        return Solution(images, margin, jnp.zeros_like(margin), result)


def ring_terms(chamber: Chamber, ratio: Float[Array, ""]) -> tuple[Float[Array, ""], ...]:
    """Both sides of η b W (s_D + δ) = Y (s_B + δ), which is Δd_c = η Δd_b without its divisions.

    Their difference is a polynomial of degree 2 at most in η, in every length and in every
    offset, and p cos θ_BC + q sin θ_BC with some p, q in the wall angle.
    """
    depth_b, _, depth_d = chamber.depths
    wanted = ratio * chamber.length_bc * chamber.blue_wall_distance * depth_d
    return wanted, chamber._yellow * depth_b


def ring_residual(chamber: Chamber, ratio: Float[Array, ""]) -> Float[Array, ""]:
    """What is left of Δd_c = η Δd_b, divided by the sum of both sides' magnitudes."""
    wanted, found = ring_terms(chamber, ratio)
    return safe_divide(wanted - found, jnp.abs(wanted) + jnp.abs(found))[0]
