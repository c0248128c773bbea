"""Surfaces of four kinds, and the height at which a round pad rides them."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from perception.chamber import SurfaceKind

KINDS = (SurfaceKind.FLAT, SurfaceKind.CONCAVE, SurfaceKind.CONVEX, SurfaceKind.ROUGH)
"""The paper's four."""

SAGITTA = 2.0, 6.0
"""Of curved surfaces, mm."""

SHOULDERED = 0.6, 0.9
"""Part of the slide that is curved where a curved surface has flat shoulders; half of them have."""

FLAT_RMS, FLAT_WAVES = (0.0, 0.05), (15.0, 40.0)
"""Of the waviness of flat surfaces, which curved ones have too, mm; over the slide."""

ROUGH_RMS, ROUGH_WAVES = (0.4, 0.8), (5.0, 15.0)
"""Of rough surfaces, mm."""

WAVES = 8
"""Sinusoids of a wavy surface."""

TILT_DEG = 1.0
"""Every surface lies tilted by up to so much."""

STEP = 0.02
"""Of the grid on which the pad's contact is sought, mm: a height is too low by less than its
square over 4 mm, 1e-4 mm."""


@dataclass(frozen=True)
class Surface:
    """A profile: a circular arc, if any, and waves, tilted.

    Attributes:
        kind: which.
        sagitta: of the arc over its width, mm; positive if convex, 0 for none.
        width: of the arc, mm.
        middle: of the arc, mm.
        shoulders: whether it is flat beyond the arc; else the circle goes on.
        amplitudes: of its waves, mm.
        lengths: of the waves, mm.
        phases: of the waves at 0, in radians.
        slope: tangent of its tilt.
    """

    kind: SurfaceKind
    sagitta: float
    width: float
    middle: float
    shoulders: bool
    amplitudes: Float[np.ndarray, " waves"]
    lengths: Float[np.ndarray, " waves"]
    phases: Float[np.ndarray, " waves"]
    slope: float

    def height(self, x: Float[np.ndarray, "*any"]) -> Float[np.ndarray, "*any"]:
        """Of the bare surface at some places, mm."""
        level = self.slope * x + self._waves(x)
        if self.sagitta == 0:
            return level
        size, half = abs(self.sagitta), self.width / 2
        radius = (half**2 + size**2) / (2 * size)
        off = x - self.middle
        arc = np.sqrt(np.maximum(radius**2 - off**2, 0)) - (radius - size)
        if self.shoulders:
            arc = np.where(np.abs(off) < half, arc, 0.0)
        return level + math.copysign(1.0, self.sagitta) * arc

    def _waves(self, x: Float[np.ndarray, "*any"]) -> Float[np.ndarray, "*any"]:
        return np.sin(2 * np.pi * x[..., None] / self.lengths + self.phases) @ self.amplitudes

    def with_waves(self, rms: float, slide: float) -> Surface:
        """The same surface, with waves of this root mean square over the slide, mm."""
        scale = rms / float(self._waves(np.linspace(-slide / 2, slide / 2, 2001)).std())
        return replace(self, amplitudes=scale * self.amplitudes)

    def of_size(self, size: float, slide: float) -> Surface:
        """The same surface, but for its size.

        Args:
            size: of a curved surface the sagitta over the whole slide, without shoulders; of any
                other the root mean square of its waves, mm.
            slide: length, mm.
        """
        if not self.sagitta:
            return self.with_waves(size, slide)
        sagitta = math.copysign(size, self.sagitta)
        return replace(self, sagitta=sagitta, width=slide, middle=0.0, shoulders=False)

    def ridden(self, x: Float[np.ndarray, " places"], tip: float) -> Float[np.ndarray, " places"]:
        """Height at which a round pad of this radius touches, less the radius, mm.

        The surface dilated by the circle: the highest of all heights at which some part of the
        pad touches. On a convex circle of radius R the pad's middle follows one of R + r, in a
        concave one of R − r; what is narrower than the pad it does not reach.
        """
        off = np.linspace(-tip, tip, 2 * math.ceil(tip / STEP) + 1)
        pad = np.sqrt(np.maximum(tip**2 - off**2, 0)) - tip
        return (self.height(x[:, None] + off) + pad).max(axis=1)


def sample_surface(kind: SurfaceKind, slide: float, generator: np.random.Generator) -> Surface:
    """A random surface of a kind; the slide goes from −slide/2 to slide/2."""

    def between(bounds: tuple[float, float]) -> float:
        return float(generator.uniform(*bounds))

    rms, waves = (ROUGH_RMS, ROUGH_WAVES) if kind is SurfaceKind.ROUGH else (FLAT_RMS, FLAT_WAVES)
    lengths = generator.uniform(*waves, WAVES)
    phases = generator.uniform(0, 2 * math.pi, WAVES)
    amplitudes = generator.uniform(0.5, 1.0, WAVES)
    roughness = between(rms)
    curved = kind in (SurfaceKind.CONCAVE, SurfaceKind.CONVEX)
    shoulders = curved and bool(generator.random() < 0.5)
    part = between(SHOULDERED) if shoulders else 1.0
    return Surface(
        kind,
        sagitta=curved * (1 if kind is SurfaceKind.CONVEX else -1) * between(SAGITTA),
        width=part * slide,
        middle=(1 - part) / 4 * slide * between((-1.0, 1.0)),
        shoulders=shoulders,
        amplitudes=amplitudes,
        lengths=lengths,
        phases=phases,
        slope=math.tan(math.radians(TILT_DEG * between((-1.0, 1.0)))),
    ).with_waves(roughness, slide)
