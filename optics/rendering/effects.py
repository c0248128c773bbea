"""What makes an image worse than the geometry: named effects, each with a size that can be 0."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any, TypeVar

AnyEffects = TypeVar("AnyEffects", bound=Any)


@dataclass(frozen=True)
class Effects:
    """Sizes of the effects; what is 0 is off and costs nothing.

    Attributes:
        gain: exposure; 1 images the brightest place of an evenly lit pad at 0.7 of full scale.
        led_falloff: part of a side light that is lost from its edge of the pad to the other.
        dim_outer: part of the light that pads on other phalanges than the camera's lack.
        mirror_loss: part of the light that a reflection loses.
        vignetting: part of the light that is lost at 90° from the axis, growing as 1 − cos θ.
        ambient: light that the finger's inside and leaks send, part of full scale.
        rounding: radius of the pads' corners, mm.
        roughness: standard deviation of the pads' edges from straight lines, mm.
        blur: standard deviation of the point spread, px.
        noise: standard deviation of a sample at full scale, part of full scale; photon noise, so
            that it falls with the square root of the light, and a fifth of it everywhere.
        jpeg: how much JPEG compression loses: 100 minus its quality.
    """

    gain: float = 1.0
    led_falloff: float = 0.0
    dim_outer: float = 0.0
    mirror_loss: float = 0.0
    vignetting: float = 0.0
    ambient: float = 0.0
    rounding: float = 0.0
    roughness: float = 0.0
    blur: float = 0.0
    noise: float = 0.0
    jpeg: float = 0.0

    @classmethod
    def graded(cls, severity: float, gain: float = 1.0) -> Effects:
        """All effects, from none (severity 0) over those of a good finger (1) to a poor one (2)."""
        return replace(scaled(TYPICAL, checked(severity)), gain=gain)


TYPICAL = Effects(
    led_falloff=0.4,
    dim_outer=0.3,
    mirror_loss=0.1,
    vignetting=0.25,
    ambient=0.05,
    rounding=0.8,
    roughness=0.05,
    blur=0.8,
    noise=0.02,
    jpeg=8.0,
)
"""A well-made finger; chosen, as neither paper gives numbers."""


def scaled(
    effects: AnyEffects, factor: float, kept: frozenset[str] = frozenset({"gain"})
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
