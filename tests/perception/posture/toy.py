"""A toy chamber: rings along an arc of constant curvature, drawn as a pinhole would see them."""

from __future__ import annotations

import math

import cv2
import numpy as np
from jaxtyping import Float, Float32, UInt8

from perception.posture import make_boundary_image, shrink

LENGTH, RADIUS = 100.0, 12.0
"""Of the chamber, mm."""

BEND = math.radians(100)
RINGS = (0.2, 0.4, 0.65)
"""Where along the chamber a region ends."""


def markers_of(bend: float, length: float) -> Float[np.ndarray, "3 2"]:
    """Markers at thirds of the chamber, mm."""
    return np.array([along(bend, length * part) for part in (1 / 3, 2 / 3, 1.0)])


def along(bend: float, distance: float) -> tuple[float, float]:
    """A point of the arc that bends by ``bend`` over ``LENGTH``."""
    curvature = max(bend, 1e-6) / LENGTH
    turned = curvature * distance
    return (1 - math.cos(turned)) / curvature, math.sin(turned) / curvature


def regions(
    bend: float, length: float, shift: tuple[float, float], size: tuple[int, int]
) -> UInt8[np.ndarray, "rows columns"]:
    """Labels 0 to 3 from the camera inwards; a ring is seen only through those before it."""
    columns, rows = size
    focal = 0.8 * rows
    labels = np.zeros((rows, columns), np.uint8)
    seen_through = np.full((rows, columns), 255, np.uint8)
    for ring, part in enumerate(RINGS, 1):
        aside, ahead = along(bend, length * part)
        center = (
            columns * 0.35 + focal * (aside + shift[0]) / ahead,
            rows / 2 + focal * shift[1] / ahead,
        )
        turned = bend * part
        half = focal * RADIUS / ahead
        axes = (2 * half * max(math.cos(turned), 0.1), 2 * half)
        inside = np.zeros_like(labels)
        cv2.ellipse(inside, (center, axes, 0.0), 255, cv2.FILLED)
        seen_through &= inside
        labels[seen_through > 0] = ring
    return labels


def samples(
    count: int, size: tuple[int, int], seed: int
) -> tuple[Float32[np.ndarray, "images rows columns"], Float[np.ndarray, "images 3 2"]]:
    """Shrunk boundary images and markers: any bend, and a length and a shift of the camera, mm."""
    generator = np.random.default_rng(seed)
    images, markers = [], []
    for _ in range(count):
        bend, length = generator.uniform(0, BEND), LENGTH * generator.uniform(0.95, 1.05)
        shift = (generator.uniform(-1, 1), generator.uniform(-1, 1))
        labels = regions(bend, length, shift, (640, 480))
        images.append(shrink(make_boundary_image(labels), size))
        markers.append(markers_of(bend, length))
    return np.stack(images), np.stack(markers)
