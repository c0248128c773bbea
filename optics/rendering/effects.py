"""What makes an image worse than the geometry: named effects, each with a size that can be 0."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any, TypeVar

AnyEffects = TypeVar("AnyEffects", bound=Any)


@dataclass(frozen=True)
class Effects:
    """Sizes of the effects; what is 0 is off and costs nothing. A response of 1 is off, too.

    Attributes:
        gain: exposure; 1 images the brightest place of a pad at 0.7 of full scale.
        gamma: response of the camera: the picture has light to the power of one over it.
        led_falloff: part of a side light that is lost from its edge of the pad to the other.
        lamps: by how many times its middle's light a pad's edge is brighter than its middle, beside
            a line lamp.
        shadows: part of a lamp's light that is lost where an imprint stands in its way.
        strips: width of the lamps where they are in view beside the pads, saturated, mm.
        dim_outer: part of the light that pads on other phalanges than the camera's lack.
        mirror_loss: part of the light that a reflection loses.
        vignetting: part of the light that is lost at 90° from the axis, growing as 1 − cos θ.
        ambient: light that the finger's inside and leaks send, part of full scale.
        walls: part of the lamps' light that grey walls of the finger's inside reflect.
        flare: part of the light that the lens scatters, as a veil and as a ghost.
        rounding: radius of the pads' corners, mm.
        roughness: standard deviation of the pads' edges from straight lines, mm.
        blur: standard deviation of the point spread, px.
        defocus: radius of the disc over which a point at distance d is spread, over
            abs(1 / d - 1 / `FOCUS`), px mm.
        noise: standard deviation of a sample at full scale, part of full scale; photon noise, so
            that it falls with the square root of the light, and a fifth of it everywhere.
        jpeg: how much JPEG compression loses: 100 minus its quality.
    """

    gain: float = 1.0
    gamma: float = 1.0
    led_falloff: float = 0.0
    lamps: float = 0.0
    shadows: float = 0.0
    strips: float = 0.0
    dim_outer: float = 0.0
    mirror_loss: float = 0.0
    vignetting: float = 0.0
    ambient: float = 0.0
    walls: float = 0.0
    flare: float = 0.0
    rounding: float = 0.0
    roughness: float = 0.0
    blur: float = 0.0
    defocus: float = 0.0
    noise: float = 0.0
    jpeg: float = 0.0

    @classmethod
    def graded(cls, severity: float, gain: float = 1.0) -> Effects:
        """All effects of soft light: none (severity 0), a good finger (1), a poor one (2).

        What line lamps, grey walls and defocus add has severities of its own (`Effects.of`).
        """
        return cls.of(dict.fromkeys(SOFT, severity), gain)

    @classmethod
    def of(cls, severities: Mapping[str, float], gain: float = 1.0, gamma: float = 1.0) -> Effects:
        """Effects by name, each of its own severity, as in `graded`; others are off.

        Example:
            >>> Effects.of({"lamps": 2, "jpeg": 0.5}, gamma=2.2).jpeg
            4.0
        """
        sizes = {name: checked(one) * getattr(TYPICAL, name) for name, one in severities.items()}
        return cls(gain=gain, gamma=gamma, **sizes)


TYPICAL = Effects(
    led_falloff=0.4,
    lamps=4.0,
    shadows=0.5,
    strips=1.0,
    dim_outer=0.3,
    mirror_loss=0.1,
    vignetting=0.25,
    ambient=0.05,
    walls=0.04,
    flare=0.02,
    rounding=0.8,
    roughness=0.05,
    blur=0.8,
    defocus=20.0,
    noise=0.02,
    jpeg=8.0,
)
"""A well-made finger; chosen, as neither paper gives numbers."""

FOCUS = 25.0
"""Distance at which the camera is in focus, mm."""

SOFT = (
    "led_falloff", "dim_outer", "mirror_loss", "vignetting", "ambient",
    "rounding", "roughness", "blur", "noise", "jpeg",
)  # fmt: skip
"""Effects of a finger with diffuse light, dark walls and a picture in focus."""


def scaled(
    effects: AnyEffects, factor: float, kept: frozenset[str] = frozenset({"gain", "gamma"})
) -> AnyEffects:
    """All sizes times a factor, but for those that are kept."""
    sizes = {
        field.name: factor * getattr(effects, field.name)
        for field in fields(effects)
        if field.name not in kept
    }
    return replace(effects, **sizes)


def checked(severity: float) -> float:
    """A severity, which is 0 to 2.

    Raises:
        ValueError: it is not.
    """
    if not 0 <= severity <= 2:
        raise ValueError(f"severity is {severity:g}; give 0 (perfect) to 2 (poor)")
    return severity
