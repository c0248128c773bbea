"""The soft finger as designed and as made, and its images by the thousand."""

from __future__ import annotations

import dataclasses
import functools
import math
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from designopt.errors import UserError
from optics.chamber import Endoscope, Posture, Rings, compute_wall_radii, find_apertures
from optics.chamber.chamber import Chamber
from optics.rendering import ChamberEffects, ChamberImage, ChamberRenderer
from optics.rendering.chamber_renderer import CHUNK, COLORS
from studies.models.soft_finger import imaging
from studies.models.soft_finger.spec import WIDEST_DEG, ChamberImagesSpec, ChamberSpec, MadeSpec

Looked = TypeVar("Looked")

DOWN = math.pi / 2
"""Direction in the image of a finger that bends down."""


@functools.cache
def _identified() -> tuple[float, float]:
    """The camera constants h and δ that Table I follows with the paper's chamber, mm."""
    paper = imaging.printed_chamber(ChamberSpec())
    height, offset = jax.jit(imaging.identify)(paper).solution.value.tolist()
    return height, offset


class SoftFinger(eqx.Module):
    """A chamber and its camera: one pytree, from the chamber's dimensions to places in the image.

    Attributes:
        chamber: of the straight finger.
        endoscope: its camera.
        severity: of everything that makes its pictures worse.

    Example:
        >>> finger = SoftFinger.of(ChamberImagesSpec())
        >>> straight = Posture(jnp.zeros(()), jnp.zeros(()), jnp.zeros(len(finger.arc)))
        >>> radius = lambda one: one.outlines(straight, 4)[-1, 0, 0] - one.endoscope.center[0]
        >>> slope = jax.grad(radius)(finger)  # of the top's outline, px per mm
        >>> bool(slope.chamber.offset_d < 0 < slope.chamber.reference_height)
        True
    """

    chamber: Chamber
    endoscope: Endoscope
    severity: float = eqx.field(static=True, default=0.0)

    @classmethod
    def of(cls, spec: ChamberImagesSpec) -> SoftFinger:
        """The finger of a study: Table I's chamber with its identified camera constants.

        Raises:
            UserError: no chamber follows from the settings.
        """
        printed = imaging.printed_chamber(spec.chamber)
        constants = imaging.with_constants(printed, jnp.asarray(_identified()))
        chamber = imaging.with_ratio(constants, jnp.asarray(spec.eta))
        if not (
            bool(chamber.imaging_ratio().ok) and bool(jnp.all(compute_wall_radii(chamber) > 0))
        ):
            raise UserError(
                f"--set eta={spec.eta:g}: no chamber with these dimensions gives this ratio; "
                "choose another eta, or dimensions nearer to the paper's"
            )
        endoscope = Endoscope(
            math.radians(spec.endoscope.field_of_view_deg), spec.endoscope.distortion
        )
        return cls(chamber, endoscope, spec.severity)

    def outlines(self, posture: Posture, angles: int = 256) -> Float[Array, "rings angles 2"]:
        """Where the camera images what it sees through every ring; differentiable in every leaf.

        Args:
            posture: of one frame.
            angles: points of an outline, evenly around, the first on the side of a positive bend.

        Returns:
            Columns and rows, px; without the light, which only `renderer` has.
        """
        through = find_apertures(Rings.of(self.chamber), posture, angles)
        return self.endoscope.image(through.outline)

    @property
    def length(self) -> float:
        """Of the chamber along its centre line, mm."""
        return float(self.chamber.length_ab + self.chamber.length_bc + self.chamber.length_cd)

    def renderer(
        self,
        seed: int | Sequence[int],
        *,
        gain: float = 1.0,
        severity: float | None = None,
        colors: Float[np.ndarray, "4 3"] = COLORS,
        real: bool = False,
    ) -> ChamberRenderer:
        """A camera in this finger, its pictures as bad as the study's by default.

        Their light falls off by a power of the distance, or as that of a real lamp at the lens, on
        walls that shine and are dusty.
        """
        severity = self.severity if severity is None else severity
        graded = ChamberEffects.real if real else ChamberEffects.graded
        effects = graded(severity, gain)
        return ChamberRenderer(self.chamber, self.endoscope, effects, seed=seed, colors=colors)

    def postures(
        self,
        bends: Float[np.ndarray, " frames"],
        directions: Float[np.ndarray, " frames"] | float,
        pressed: Float[np.ndarray, "frames rings"] | None = None,
    ) -> Posture:
        """Postures of this finger, not pressed by default; angles in radians."""
        directions = np.broadcast_to(directions, bends.shape)
        pressed = np.zeros((len(bends), len(self.arc))) if pressed is None else pressed
        return Posture(jnp.asarray(bends), jnp.asarray(directions), jnp.asarray(pressed))

    @property
    def arc(self) -> Float[np.ndarray, " rings"]:
        """Places of the rings along the centre line, mm."""
        return np.asarray(Rings.of(self.chamber).arc)

    def made(self, errors: MadeSpec, generator: np.random.Generator) -> SoftFinger:
        """This finger as one of many is made; no camera sees wider than settings allow."""

        def off(deviation: float) -> float:
            return deviation * float(generator.standard_normal())

        chamber = self.chamber
        deviations = dict.fromkeys(("length_ab", "length_bc", "length_cd"), errors.length)
        deviations |= dict.fromkeys(("offset_a", "offset_b", "offset_d"), errors.offset)
        changed = {name: getattr(chamber, name) + off(size) for name, size in deviations.items()}
        view = self.endoscope.field_of_view + math.radians(off(errors.field_of_view_deg))
        view = jnp.minimum(view, math.radians(WIDEST_DEG))
        return dataclasses.replace(
            self,
            chamber=dataclasses.replace(chamber, **changed),
            endoscope=dataclasses.replace(self.endoscope, field_of_view=view),
        )


def looked_at(
    renderer: ChamberRenderer,
    postures: Posture,
    look: Callable[[int, ChamberImage], Looked],
    first: int = 0,
) -> list[Looked]:
    """What is found on a picture of every posture; pictures are not kept.

    Args:
        renderer: makes the pictures.
        postures: one batch axis.
        look: from the number of a posture and its picture to what is found; called in threads.
        first: number of the first frame (`ChamberRenderer.render`).
    """
    leaves = jax.tree.map(np.asarray, postures)
    count = len(leaves.bend)

    def chunk(start: int) -> list[Looked]:
        some = jax.tree.map(lambda leaf: leaf[start : start + CHUNK], leaves)
        images = renderer.render(some, first + start)
        return [look(start + i, image) for i, image in enumerate(images)]

    with ThreadPoolExecutor(min(os.cpu_count() or 1, 8)) as pool:
        found = pool.map(chunk, range(0, count, CHUNK))
        return [one for some in found for one in some]
