"""From light on the sensor to a stored picture: blur, exposure, noise, compression."""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from optics.rendering.effects import Effects

READ_NOISE = 0.2
"""Noise without light, over that at full scale."""


def exposed(
    light: Float[np.ndarray, "rows columns 3"], effects: Effects, generator: np.random.Generator
) -> UInt8[np.ndarray, "rows columns 3"]:
    """The picture that a camera stores.

    Photon noise is normal with a variance in proportion to the light, the limit of its Poisson
    distribution for many photons; amplifier noise is the same everywhere.

    Args:
        light: part of full scale at gain 1; red, green, blue; it may be overwritten.
        effects: of which ``blur``, ``gain``, ``noise`` and ``jpeg`` matter here.
        generator: of the noise.
    """
    light = np.asarray(light, np.float32)
    if effects.blur:
        light = cv2.GaussianBlur(light, (0, 0), effects.blur)
    if effects.gain != 1:
        light *= np.float32(effects.gain)
    if effects.noise:
        spread = cv2.sqrt(np.maximum(light + np.float32(READ_NOISE**2), 0))
        noise = generator.standard_normal(light.shape, np.float32)
        light = cv2.scaleAdd(cv2.multiply(noise, spread), effects.noise, light)
    pixels = cv2.convertScaleAbs(np.maximum(light, 0), alpha=255)
    if effects.jpeg:
        quality = [cv2.IMWRITE_JPEG_QUALITY, round(100 - effects.jpeg)]
        stored = cv2.imencode(".jpg", cv2.cvtColor(pixels, cv2.COLOR_RGB2BGR), quality)[1]
        restored = cv2.imdecode(stored, cv2.IMREAD_COLOR)
        assert restored is not None  # it has just been encoded
        pixels = cv2.cvtColor(restored, cv2.COLOR_BGR2RGB)
    return pixels
