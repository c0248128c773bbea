"""How a pad looks, in its own plane: coloured lights from its sides, imprints, and its outline."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float

from optics.rendering.effects import Effects
from optics.rendering.imprints import Imprint, make_height_map

STEP = 0.1
"""From one sample of a pad to the next, mm."""

MARGIN = 2.0
"""How far the samples go on beyond the pad's edges, mm: as far as rough edges reach."""

CORRELATION = 1.0
"""Length over which a rough edge wanders, mm."""

BRIGHT = 0.7
"""Of an evenly lit pad at gain 1, part of full scale."""

GREEN = 0.35
"""What the green channel gets of the side lights, red and blue, and of light along the pad."""

ELEVATION = np.deg2rad(25.0)
"""Of the lights above the plane of the pad."""


@dataclass(frozen=True)
class PadAppearance:
    """A pad, sampled every `STEP` from `MARGIN` before its edges to `MARGIN` behind them.

    Rows go along the pad, columns across the section.

    Attributes:
        light: red, green and blue light, part of full scale.
        inside: distance inside the outline, mm; negative outside.
        length: of the pad, mm.
        width: of the pad, mm.
    """

    light: Float[np.ndarray, "rows columns 3"]
    inside: Float[np.ndarray, "rows columns"]
    length: float
    width: float

    def sample(
        self, along: Float[np.ndarray, "_ _"], across: Float[np.ndarray, "_ _"]
    ) -> tuple[Float[np.ndarray, "_ _ 3"], Float[np.ndarray, "_ _"]]:
        """Light, and distance inside the outline, at places of the pad, interpolated.

        Args:
            along: mm from the pad's first end.
            across: mm from the pad's middle across the section.
        """
        columns = ((across + self.width / 2 + MARGIN) / STEP - 0.5).astype(np.float32)
        rows = ((along + MARGIN) / STEP - 0.5).astype(np.float32)

        def at(samples: np.ndarray) -> np.ndarray:
            return cv2.remap(
                samples, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
            )

        return at(self.light), at(self.inside)


def make_pad_appearance(
    length: float,
    width: float,
    effects: Effects,
    imprints: Sequence[Imprint] = (),
    *,
    brightness: float = 1.0,
    seed: Sequence[int] = (0,),
) -> PadAppearance:
    """How a pad looks.

    A red light shines from the side of greater columns, a blue one from the other, a weak green one
    along the pad from its first end. Where the gel is pressed in, a light's share is that of a
    matt surface (Lambert's cosine law) with the slope of the height map.

    Args:
        length: along the pad, mm.
        width: across the section, mm.
        effects: of which ``led_falloff``, ``rounding`` and ``roughness`` matter here.
        imprints: what is pressed in; the deepest counts.
        brightness: of the lights.
        seed: of the rough edges.

    Example:
        >>> make_pad_appearance(20.0, 15.0, Effects()).light.shape[-1]  # red, green and blue
        3
    """
    along = _samples(length)[:, None]
    across = _samples(width)[None, :] - width / 2
    along, across = (np.ascontiguousarray(a) for a in np.broadcast_arrays(along, across))
    lost = effects.led_falloff * np.clip(0.5 + across / width, 0, 1)
    lights = (
        BRIGHT
        * brightness
        * np.stack([1 - effects.led_falloff + lost, np.full_like(lost, GREEN), 1 - lost], axis=-1)
    )
    if imprints:
        depth = np.max([make_height_map(one, along, across, STEP) for one in imprints], axis=0)
        lights *= _shading(depth)
    return PadAppearance(
        lights.astype(np.float32),
        _inside(along, across, length, width, effects, seed).astype(np.float32),
        length,
        width,
    )


def _samples(length: float) -> Float[np.ndarray, " samples"]:
    return np.arange(round((length + 2 * MARGIN) / STEP)) * STEP + STEP / 2 - MARGIN


def _shading(depth: Float[np.ndarray, "rows columns"]) -> Float[np.ndarray, "rows columns 3"]:
    """Light that each side light sends into a pressed surface, over that of a flat one."""
    slope_along, slope_across = np.gradient(depth, STEP)
    norm = np.sqrt(1 + slope_along**2 + slope_across**2)
    # The surface is seen from inside: pressed in, it comes towards camera and lights.
    lean, rise = np.cos(ELEVATION), np.sin(ELEVATION)
    towards = [-slope_across, slope_along, slope_across]  # red, green, blue
    return np.stack([np.maximum(lean * s + rise, 0) / (rise * norm) for s in towards], axis=-1)


def _inside(
    along: Float[np.ndarray, "rows columns"],
    across: Float[np.ndarray, "rows columns"],
    length: float,
    width: float,
    effects: Effects,
    seed: Sequence[int],
) -> Float[np.ndarray, "rows columns"]:
    """Distance inside a rectangle with round corners and rough edges."""
    radius = effects.rounding
    from_middle = np.abs(along - length / 2) - (length / 2 - radius)
    beside = np.abs(across) - (width / 2 - radius)
    outside = np.hypot(np.maximum(from_middle, 0), np.maximum(beside, 0))
    inside = radius - outside - np.minimum(np.maximum(from_middle, beside), 0)
    if effects.roughness == 0:
        return inside
    noise = np.random.default_rng(list(seed)).standard_normal(along.shape).astype(np.float32)
    smooth = cv2.GaussianBlur(noise, (0, 0), CORRELATION / STEP)
    return inside + effects.roughness * smooth / np.std(smooth)
