"""What makes an endoscope's picture worse than the geometry: effects whose size can be 0."""

from __future__ import annotations

from dataclasses import dataclass, replace

from optics.rendering.effects import checked, scaled


@dataclass(frozen=True)
class ChamberEffects:
    """Sizes of the effects; what is 0 is off.

    Attributes:
        gain: exposure; 1 images a white wall at B, where red meets blue, at full scale.
        flicker: standard deviation of the exposure's logarithm from frame to frame.
        falloff: power with which light falls with the distance from the lens.
        lamp: part of the light that does not fall by that power, but as that of a lamp at the lens
            on walls that light each other (`optics.rendering.chamber_light`).
        gloss: part of a clear silicone coat's reflection that walls have; 1 is all of it. They then
            show mirror images of each other, and highlights where they face the lens.
        roughness: of the coat; it widens highlights and blurs mirror images.
        speckles: mean number of grains of white dust on the walls in view.
        uneven: part of the light that is lost from the side nearest to the lamp to the other.
        vignetting: part of the light that the lens loses in the image's corners.
        glare: brightness of the lamp's mirror image on the wet wall, part of full scale.
        shake: standard deviation of the camera's pointing to either side, px.
        roll_deg: standard deviation of its turning about its axis.
        blur: standard deviation of the point spread, px.
        noise: standard deviation of a sample's photon noise at full scale, part of full scale; it
            falls with the square root of the light. A fifth of it is added everywhere.
    """

    gain: float = 1.0
    flicker: float = 0.0
    falloff: float = 1.0
    lamp: float = 0.0
    gloss: float = 0.0
    roughness: float = 0.1
    speckles: float = 0.0
    uneven: float = 0.0
    vignetting: float = 0.0
    glare: float = 0.0
    shake: float = 0.0
    roll_deg: float = 0.0
    blur: float = 0.0
    noise: float = 0.0

    @classmethod
    def graded(cls, severity: float, gain: float = 1.0) -> ChamberEffects:
        """Effects of soft light: none (severity 0), of a good finger (1), of a poor one (2)."""
        soft = replace(TYPICAL, **dict.fromkeys(REAL, 0.0))
        return replace(scaled(soft, checked(severity), KEPT), gain=gain)

    @classmethod
    def real(cls, severity: float = 1.0, gain: float = 1.0) -> ChamberEffects:
        """Those of `graded` in the light of a lamp at the lens, on walls that shine and are dusty.

        Gloss and dust grow with the severity, up to a whole coat at 1, whose highlights are the
        glare.

        Example:
            >>> ChamberEffects.real().lamp
            1.0
        """
        graded = cls.graded(severity, gain)
        gloss, speckles = min(severity, 1.0) * TYPICAL.gloss, severity * TYPICAL.speckles
        return replace(graded, lamp=TYPICAL.lamp, gloss=gloss, speckles=speckles, glare=0.0)


REAL = ("lamp", "gloss", "speckles")
"""Effects of a lamp at the lens, and of walls that shine and are dusty."""

KEPT = frozenset({"gain", "falloff", "roughness"})
"""What is no fault of a picture."""

TYPICAL = ChamberEffects(
    flicker=0.15,
    lamp=1.0,
    gloss=1.0,
    speckles=20.0,
    uneven=0.2,
    vignetting=0.3,
    glare=0.3,
    shake=0.5,
    roll_deg=0.2,
    blur=0.8,
    noise=0.02,
)
"""A well-made finger; chosen, as the paper gives no numbers."""
