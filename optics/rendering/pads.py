"""How a pad looks, in its own plane: coloured lights from its sides, imprints, and its outline."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from jaxtyping import Bool, Float

from optics.rendering.effects import Effects
from optics.rendering.imprints import Imprint, make_height_map

STEP = 0.1
"""From one sample of a pad to the next, mm."""

MARGIN = 2.0
"""How far the samples go on beyond the pad's edges, mm, as far as rough edges reach; lamps in view
are beside it."""

CORRELATION = 1.0
"""Length over which a rough edge wanders, mm."""

BRIGHT = 0.7
"""Of an evenly lit pad at gain 1, part of full scale."""

GREEN = 0.35
"""What the green channel gets of the side lights, red and blue, and of light along the pad."""

FAR, ELEVATION = 1000.0, np.deg2rad(25.0)
"""Distance of lights that are no line lamps, mm, and their elevation above the plane of the pad."""

GAP = 1.5
"""Lamps in view are beside a pad's edge, or at most so many mm from it."""

ROUNDING = 1e-9
"""What is higher by less, seen from a lamp, is not hidden."""

LAMP, BESIDE = 4.0, 0.25
"""Light of a lamp in view, part of full scale at gain 1; part of it that its other colours have."""


@dataclass(frozen=True)
class PadAppearance:
    """A pad, sampled every `STEP` from a margin before its edges to the same behind them.

    Rows go along the pad, columns across the section.

    Attributes:
        light: red, green and blue light, part of full scale.
        inside: distance inside the outline, mm; negative outside.
        length: of the pad, mm.
        width: of the pad, mm.
        margin: mm.
        lamps: red, green and blue light of the lamps in view beside it; ``None`` if none are.
    """

    light: Float[np.ndarray, "rows columns 3"]
    inside: Float[np.ndarray, "rows columns"]
    length: float
    width: float
    margin: float = MARGIN
    lamps: Float[np.ndarray, "rows columns 3"] | None = None

    def sample(
        self, along: Float[np.ndarray, "_ _"], across: Float[np.ndarray, "_ _"]
    ) -> tuple[Float[np.ndarray, "_ _ 3"], Float[np.ndarray, "_ _"]]:
        """Light, and distance inside the outline, at places of the pad, interpolated.

        Args:
            along: mm from the pad's first end.
            across: mm from the pad's middle across the section.
        """
        columns, rows = self._samples(along, across)

        def at(samples: np.ndarray) -> np.ndarray:
            return cv2.remap(
                samples, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
            )

        return at(self.light), at(self.inside)

    def sample_lamps(
        self, along: Float[np.ndarray, "_ _"], across: Float[np.ndarray, "_ _"]
    ) -> Float[np.ndarray, "_ _ 3"]:
        """Light of the lamps in view, as `sample` takes it; only where there are some."""
        assert self.lamps is not None
        return cv2.remap(self.lamps, *self._samples(along, across), cv2.INTER_LINEAR)

    def _samples(
        self, along: Float[np.ndarray, "_ _"], across: Float[np.ndarray, "_ _"]
    ) -> tuple[Float[np.ndarray, "_ _"], Float[np.ndarray, "_ _"]]:
        """Columns and rows of places among the samples."""
        columns = ((across + self.width / 2 + self.margin) / STEP - 0.5).astype(np.float32)
        return columns, ((along + self.margin) / STEP - 0.5).astype(np.float32)


@dataclass(frozen=True)
class ClearBody:
    """Clear layers on a pad, as far as they change how it looks in its own plane.

    A lamp beside a clear wall lights it through an air gap: what enters cannot leave at the top and
    is guided down to the membrane.

    Attributes:
        thickness: of all layers, mm.
        index: of refraction of the outermost one.
        guides: whether the walls are clear to which the red, the green and the blue lamp shine.
        mirrored: which edges bound nothing as clear walls stand on them: along the pad and across
            it, the first and the second end.
    """

    thickness: float
    index: float
    guides: tuple[bool, bool, bool]
    mirrored: tuple[tuple[bool, bool], tuple[bool, bool]]


def make_pad_appearance(
    length: float,
    width: float,
    effects: Effects,
    imprints: Sequence[Imprint] = (),
    *,
    brightness: float = 1.0,
    seed: Sequence[int] = (0,),
    body: ClearBody | None = None,
) -> PadAppearance:
    """How a pad looks.

    A red light shines from the side of greater columns, a blue one from the other, a weak green one
    along the pad from its first end. Where the gel is pressed in, a light's share is that of a
    matt surface (Lambert's cosine law) with the slope of the height map. Lamps are as long as the
    side that they are beside, as far beyond it as they are above the pad's plane, and matt.

    Args:
        length: along the pad, mm.
        width: across the section, mm.
        effects: of which ``led_falloff``, ``lamps``, ``shadows``, ``strips``, ``rounding`` and
            ``roughness`` matter here.
        imprints: what is pressed in; the deepest counts.
        brightness: of the lights.
        seed: of the rough edges, and of how far the lamps in view are beside them.
        body: clear layers over it; lamps in view are then in their walls, and none beside the pad.

    Example:
        >>> make_pad_appearance(20.0, 15.0, Effects()).light.shape[-1]  # red, green and blue
        3
    """
    margin = margin_beside(effects)
    along = _samples(length, margin)[:, None]
    across = _samples(width, margin)[None, :] - width / 2
    along, across = (np.ascontiguousarray(a) for a in np.broadcast_arrays(along, across))
    lost = effects.led_falloff * np.clip(0.5 + across / width, 0, 1)
    lights = (
        BRIGHT
        * brightness
        * np.stack([1 - effects.led_falloff + lost, np.full_like(lost, GREEN), 1 - lost], axis=-1)
    )
    distance, height = FAR, FAR * np.tan(ELEVATION)
    if effects.lamps:
        distance = height = lamp_distance(effects.lamps, width)
    # From each lamp, in the plane of the pad: red, green, blue.
    away = [width / 2 - across + distance, along + distance, width / 2 + across + distance]
    if effects.lamps:
        beside = [along, across + width / 2, along]
        sizes = [length, width, length]
        guides = (False,) * 3 if body is None else body.guides
        lights *= np.stack(
            [
                _guided(body, across - distance)
                if body and guided
                else _irradiance(across, place, size, height)
                for across, guided, place, size in zip(away, guides, beside, sizes, strict=True)
            ],
            axis=-1,
        )
    if imprints:
        depth = np.max([make_height_map(one, along, across, STEP) for one in imprints], axis=0)
        slants = [one / height if effects.lamps else 1 / np.tan(ELEVATION) for one in away]
        lights *= _shading(depth, slants)
        if effects.shadows:
            lights *= 1 - effects.shadows * _shadows(depth, away, height)
    return PadAppearance(
        lights.astype(np.float32),
        _inside(along, across, length, width, effects, seed, body).astype(np.float32),
        length,
        width,
        margin,
        _lamps_in_view(along, across, length, width, effects.strips, seed)
        if effects.strips and body is None
        else None,
    )


def margin_beside(effects: Effects) -> float:
    """How far beyond a pad's edges something of it is seen, mm."""
    return max(MARGIN, GAP + effects.strips + STEP) if effects.strips else MARGIN


def lamp_distance(excess: float, width: float) -> float:
    """Of a long line lamp beyond a pad's edge, and above its plane, mm.

    Its light on the plane falls with the square of the distance r from it: with a beyond and a
    above, r² is 2 a² at the edge and (a + w/2)² + a² in the middle, ``1 + excess`` times as much.

    Args:
        excess: by how many times its middle's light the edge is brighter than the middle.
        width: w, of the pad, mm.

    Example:
        >>> round(lamp_distance(9.0, 24.0), 2)
        3.57
    """
    return width * (1 + math.sqrt(1 + 2 * excess)) / (4 * excess)


def _irradiance(
    away: Float[np.ndarray, "rows columns"],
    beside: Float[np.ndarray, "rows columns"],
    size: float,
    height: float,
) -> Float[np.ndarray, "rows columns"]:
    """Light of a line lamp on the pad's plane, over that at the middle of its edge.

    Each point of the lamp sends h / r³ there; over the lamp's length s this is h / ρ² times the
    difference of s / r, ρ being the distance from the lamp's line.

    Args:
        away: distance from the lamp across it, in the plane, mm.
        beside: way along the lamp from its first end, mm.
        size: length of the lamp, mm.
        height: of the lamp above the plane, mm.
    """

    def sent(across: Any, along: Any) -> Any:
        squared = across**2 + height**2
        parts = [s / np.sqrt(squared + s**2) for s in (along, along - size)]
        return (parts[0] - parts[1]) / squared

    edge = sent(height, size / 2)
    return sent(np.maximum(away, height), beside) / edge


def _guided(
    body: ClearBody, away: Float[np.ndarray, "rows columns"]
) -> Float[np.ndarray, "rows columns"]:
    """Light that comes through an air gap and a clear wall, over that at the wall.

    Inside, the light rises or falls by at most the critical angle φ from the wall's normal, and the
    surface above reflects it all. A beam at φ has reached the membrane evenly until it has gone
    2 t / tan φ in a body of thickness t, so that at x from the wall the sum over all is in
    proportion to 1 − cos φ(x), φ(x) = arctan(2 t / x) at most. The membrane sends half of what
    stays within around again, evenly, and so on: as much again.

    Args:
        body: the layers.
        away: from the wall, mm.
    """
    nearest = 2 * body.thickness * np.sqrt(max(body.index**2 - 1, 0))
    way = np.maximum(away, nearest)
    direct = 1 - way / np.hypot(way, 2 * body.thickness)
    return (direct + direct.mean()) / (direct.max() + direct.mean())


def _samples(length: float, margin: float) -> Float[np.ndarray, " samples"]:
    return np.arange(round((length + 2 * margin) / STEP)) * STEP + STEP / 2 - margin


def _shading(
    depth: Float[np.ndarray, "rows columns"], slants: Sequence[np.ndarray | float]
) -> Float[np.ndarray, "rows columns 3"]:
    """Light that each side light sends into a pressed surface, over that of a flat one.

    Args:
        depth: to which it is pressed, mm.
        slants: way of red, green and blue light along the plane over that across it.
    """
    slope_along, slope_across = np.gradient(depth, STEP)
    norm = np.sqrt(1 + slope_along**2 + slope_across**2)
    # The surface is seen from inside: pressed in, it comes towards camera and lights.
    towards = [-slope_across, slope_along, slope_across]  # red, green, blue
    return np.stack(
        [np.maximum(s * slant + 1, 0) / norm for s, slant in zip(towards, slants, strict=True)],
        axis=-1,
    )


def _shadows(
    depth: Float[np.ndarray, "rows columns"], away: Sequence[np.ndarray], height: float
) -> Bool[np.ndarray, "rows columns 3"]:
    """Where a nearer place hides a lamp, across it.

    Seen from the lamp, what is farther on is seen at a higher and higher place, or is hidden.
    """
    red, green, blue = (np.clip((height - depth) / one, 0, None) for one in away)
    lowest = [
        np.minimum.accumulate(red[:, ::-1], axis=1)[:, ::-1],
        np.minimum.accumulate(green, axis=0),
        np.minimum.accumulate(blue, axis=1),
    ]
    return np.stack([red, green, blue], axis=-1) > np.stack(lowest, axis=-1) + ROUNDING


def _lamps_in_view(
    along: Float[np.ndarray, "rows columns"],
    across: Float[np.ndarray, "rows columns"],
    length: float,
    width: float,
    strips: float,
    seed: Sequence[int],
) -> Float[np.ndarray, "rows columns 3"]:
    """Light of the red and the blue lamp beside the pad, soft by a sample at their edges."""
    gaps = np.random.default_rng([*seed, 1]).uniform(0, GAP, 2)
    light = np.zeros((*along.shape, 3), np.float32)
    from_end = np.minimum(along, length - along)
    for gap, side, color in zip(gaps, (1, -1), (0, 2), strict=True):
        beyond = side * across - width / 2 - gap
        inside = np.minimum(np.minimum(beyond, strips - beyond), from_end)
        share = np.clip(0.5 + inside / STEP, 0, 1)
        light += share[..., None].astype(np.float32) * lamp_in_view(color)
    return light


def lamp_in_view(channel: int) -> Float[np.ndarray, "3"]:
    """Light of a lamp of a color, by its index: red, green and blue."""
    light = np.full(3, BESIDE * LAMP, np.float32)
    light[channel] = LAMP
    return light


def _inside(
    along: Float[np.ndarray, "rows columns"],
    across: Float[np.ndarray, "rows columns"],
    length: float,
    width: float,
    effects: Effects,
    seed: Sequence[int],
    body: ClearBody | None,
) -> Float[np.ndarray, "rows columns"]:
    """Distance inside a rectangle with round corners and rough edges."""
    radius = effects.rounding
    off = []
    edges = [(0.0, length), (-width / 2, width / 2)]
    mirrored = ((False, False),) * 2 if body is None else body.mirrored
    for place, (first, last), (before, behind) in zip(
        (along, across), edges, mirrored, strict=True
    ):
        # An edge that bounds nothing is far away.
        first, last = first - before * (length + width), last + behind * (length + width)
        off.append(np.abs(place - (first + last) / 2) - ((last - first) / 2 - radius))
    outside = np.hypot(*(np.maximum(one, 0) for one in off))
    inside = radius - outside - np.minimum(np.maximum(*off), 0)
    if effects.roughness == 0:
        return inside
    noise = np.random.default_rng(list(seed)).standard_normal(along.shape).astype(np.float32)
    smooth = cv2.GaussianBlur(noise, (0, 0), CORRELATION / STEP)
    return inside + effects.roughness * smooth / np.std(smooth)
