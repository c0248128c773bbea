"""How pictures are taken: light, exposure, and what lens, sensor and file do to them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np

from studies.oracles.judge.contacts import Contact

LEVELS = 12
"""Pictures out of focus by so many radii, between which every pixel is interpolated."""

SHARP = 0.1
"""Discs of a smaller radius, px, blur nothing."""

VEIL_PX, GHOST_PX = 120.0, 12.0
"""Spreads of veiling glare and of the ghost."""

GHOST = 0.2
"""Its part of the flare."""

BRIGHTEST = 50.0
"""What flare takes of places that are brighter still, full scales."""


@dataclass(frozen=True)
class Capture:
    """How pictures are taken.

    Attributes:
        light: "even" is a membrane that is equally bright everywhere where it is flat; "lamps" are
            red, green and blue line lamps at greater columns, the end "from" and lesser columns.
        coupling: of lamps and layers, by a gap of air or without.
        walls: albedo of everything opaque.
        exposure: gray level, 0 to 1, of nearly the brightest place of all membranes (99 %).
        gamma: of the response, level = light^(1/gamma).
        noise: of photons, standard deviation at full scale; a fifth of it is everywhere.
        blur: standard deviation of the point spread, px.
        defocus: radius of the disc by 1/distance, px mm; 0 for a lens that is sharp everywhere.
        focus: distance that is sharp, mm.
        flare: part of the light that becomes veiling glare and a ghost.
        jpeg: quality, or none.
        contacts: what is pressed into membranes.
        heights: on a lamp, each of which is hidden or not by what is pressed in: its light changes
            in so many steps.
    """

    light: Literal["even", "lamps"] = "even"
    coupling: Literal["air", "coupled"] = "air"
    walls: float = 0.0
    exposure: float = 0.8
    gamma: float = 1.0
    noise: float = 0.01
    blur: float = 0.5
    defocus: float = 0.0
    focus: float = 25.0
    flare: float = 0.0
    jpeg: int | None = None
    contacts: tuple[Contact, ...] = ()
    heights: int = 3


def expose(
    light: np.ndarray, distance: np.ndarray, capture: Capture, generator: np.random.Generator
) -> np.ndarray:
    """The picture of an image of light.

    Args:
        light: full scales, shape (rows, columns, 3), or (rows, columns) without colors.
        distance: of what is seen, mm, ∞ where nothing is, shape (rows, columns).
        capture: how it is taken.
        generator: of noise.

    Returns:
        Gray levels, 8 bits, of the light's shape, red first.
    """
    image = light.astype(np.float32)
    if capture.defocus:
        image = _out_of_focus(image, capture.defocus * np.abs(1 / distance - 1 / capture.focus))
    if capture.blur:
        image = cv2.GaussianBlur(image, (0, 0), capture.blur)
    if capture.flare:
        bright = np.minimum(image, BRIGHTEST)
        veil, ghost = _spread(bright, VEIL_PX), _spread(bright[::-1, ::-1], GHOST_PX)
        image = (1 - capture.flare) * image + capture.flare * ((1 - GHOST) * veil + GHOST * ghost)
    photons, read = generator.standard_normal((2, *image.shape), np.float32)
    image = image + capture.noise * (np.sqrt(np.clip(image, 0, 1)) * photons + read / 5)
    levels = np.clip(image, 0, 1) ** (1 / capture.gamma)
    pixels = np.rint(255 * levels).astype(np.uint8)
    if capture.jpeg is None:
        return pixels
    swap = np.s_[..., ::-1] if pixels.ndim == 3 else np.s_[:]  # OpenCV has blue first
    swapped = np.ascontiguousarray(pixels[swap])
    _, file = cv2.imencode(".jpg", swapped, [cv2.IMWRITE_JPEG_QUALITY, capture.jpeg])
    stored = cv2.imdecode(file, cv2.IMREAD_UNCHANGED)
    assert stored is not None  # it has just been encoded
    return np.ascontiguousarray(stored[swap])


def _out_of_focus(image: np.ndarray, radius: np.ndarray) -> np.ndarray:
    """Every pixel the mean over a disc of its own radius, px."""
    steps = np.linspace(0, float(radius.max()), LEVELS)
    stack = [image if step < SHARP else cv2.filter2D(image, -1, _disc(step)) for step in steps]
    position = radius / max(steps[1], 1e-9)
    low = np.minimum(position.astype(int), LEVELS - 2)
    share = (position - low)[..., None].astype(np.float32)
    found = np.zeros_like(image)
    for i in range(LEVELS - 1):
        found += np.where((low == i)[..., None], (1 - share) * stack[i] + share * stack[i + 1], 0)
    return found


def _disc(radius: float) -> np.ndarray:
    """Shares of pixels in a disc; they sum to 1."""
    reach, fine = int(np.ceil(radius)), 8
    places = (np.arange((2 * reach + 1) * fine) + 0.5) / fine - reach - 0.5
    inside = (np.hypot(places[:, None], places) <= radius).astype(np.float32)
    size = 2 * reach + 1
    share = inside.reshape(size, fine, size, fine).mean(axis=(1, 3))
    return share / share.sum()


def _spread(image: np.ndarray, spread: float) -> np.ndarray:
    """Wide Gaussian blur, on a coarse grid."""
    scale = max(1, int(spread / 6))
    rows, columns = image.shape[:2]
    size = max(1, columns // scale), max(1, rows // scale)
    small = cv2.resize(np.ascontiguousarray(image), size, interpolation=cv2.INTER_AREA)
    small = cv2.GaussianBlur(small, (0, 0), spread / scale, borderType=cv2.BORDER_CONSTANT)
    return cv2.resize(small, (columns, rows), interpolation=cv2.INTER_LINEAR)
