"""From light on the sensor to a stored picture: blur, flare, exposure, noise, response, JPEG."""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from optics.rendering.effects import Effects

COARSE, VEIL = 16, 150.0
"""Flare is found on pixels so many times as large; standard deviation of the veil, px."""

GHOST = 0.25
"""Part of the flare that is a ghost: the image turned about its middle, as lenses mirror it."""

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
        effects: of which ``blur``, ``flare``, ``gain``, ``noise``, ``gamma`` and ``jpeg`` matter
            here.
        generator: of the noise.
    """
    light = np.asarray(light, np.float32)
    if effects.blur:
        light = cv2.GaussianBlur(light, (0, 0), effects.blur)
    if effects.flare:
        light = _with_flare(light, effects.flare)
    if effects.gain != 1:
        light *= np.float32(effects.gain)
    if effects.noise:
        spread = cv2.sqrt(np.maximum(light + np.float32(READ_NOISE**2), 0))
        noise = generator.standard_normal(light.shape, np.float32)
        light = cv2.scaleAdd(cv2.multiply(noise, spread), effects.noise, light)
    light = np.maximum(light, 0)
    if effects.gamma != 1:
        light = cv2.pow(light, 1 / effects.gamma)
    pixels = cv2.convertScaleAbs(light, alpha=255)
    if effects.jpeg:
        stored = np.frombuffer(encode_picture(pixels, round(100 - effects.jpeg)), np.uint8)
        restored = cv2.imdecode(stored, cv2.IMREAD_COLOR)
        assert restored is not None  # it has just been encoded
        pixels = cv2.cvtColor(restored, cv2.COLOR_BGR2RGB)
    return pixels


def encode_picture(
    pixels: UInt8[np.ndarray, "rows columns 3"], quality: int | None = None
) -> bytes:
    """The file of a picture: JPEG of a quality, or PNG, which loses nothing.

    Args:
        pixels: red, green, blue.
        quality: of JPEG, 0 to 100; PNG without one.

    Example:
        >>> import numpy as np
        >>> encode_picture(np.zeros((2, 3, 3), np.uint8))[1:4]
        b'PNG'
    """
    jpeg = [cv2.IMWRITE_JPEG_QUALITY, quality] if quality is not None else []
    ending = ".jpg" if jpeg else ".png"
    return cv2.imencode(ending, cv2.cvtColor(pixels, cv2.COLOR_RGB2BGR), jpeg)[1].tobytes()


def _with_flare(
    light: Float[np.ndarray, "rows columns 3"], flare: float
) -> Float[np.ndarray, "rows columns 3"]:
    """Light of which a part is scattered: most of it broadly, some to the opposite place."""
    rows, columns = light.shape[:2]
    size = (max(columns // COARSE, 1), max(rows // COARSE, 1))
    coarse = cv2.resize(light, size, interpolation=cv2.INTER_AREA)
    coarse = cv2.GaussianBlur(coarse, (0, 0), VEIL / COARSE, borderType=cv2.BORDER_CONSTANT)
    veil = cv2.resize(coarse, (columns, rows), interpolation=cv2.INTER_LINEAR)
    ghost = cv2.flip(light, -1)
    scattered = cv2.addWeighted(veil, 1 - GHOST, ghost, GHOST, 0)
    return cv2.addWeighted(light, 1 - flare, scattered, flare, 0)
