"""Whether there is room for a camera's module: clear of its own view, and of all surfaces."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from optics.scene.camera_module import CameraModule
from optics.scene.file import CameraTable, MirrorTable, SurfaceTable

CHORDS = 64
"""Chords that stand for a curved mirror."""

TOUCH = 1e-6
"""What reaches less deep into the module touches it only, mm."""


def module_faults(
    camera: CameraTable, module: CameraModule, kinds: Mapping[str, Sequence[SurfaceTable]]
) -> Iterator[str]:
    """Where the camera's module cannot be: in its own sight, or in what else there is.

    Args:
        camera: as in a file.
        module: its body.
        kinds: the mirrors, pads and blockers of the file.
    """
    boxes = np.asarray(module.boxes(), float)
    own = np.asarray(module.outline(jnp.zeros(2), jnp.zeros(())), float)
    inside = np.degrees(np.abs(np.arctan2(own[..., 1], own[..., 0]))).min()
    if inside < camera.section_fov_deg / 2:
        yield (
            f"camera.module: it begins {inside:.4g}° from the optical axis, within the field of "
            f"view, which ends at {camera.section_fov_deg / 2:.4g}°; make 'pupil_depth' less or "
            "'lens_diameter' more"
        )
    turn = np.exp(-1j * math.radians(camera.direction_deg))
    hit = [
        f"{kind[:-1]} '{part.name}'"
        for kind, parts in kinds.items()
        for part in parts
        if any(_meet(box, line) for box in boxes for line in _lines(part, camera.position, turn))
    ]
    if hit:
        yield (
            f"camera.module: {', '.join(hit)} would reach into it in the reference pose; move the "
            "camera, or correct the module's size"
        )


def _lines(
    part: SurfaceTable, origin: tuple[float, float], turn: complex
) -> Float[np.ndarray, "lines 2 2"]:
    """Straight pieces of a surface in the camera's own axes, mm."""
    start, end = complex(*part.start), complex(*part.end)
    places = np.array([start, end])
    if isinstance(part, MirrorTable) and part.radius is not None:
        half, radius, conic = abs(end - start) / 2, part.radius, part.conic or 0.0
        along = np.linspace(-half, half, CHORDS + 1)
        sag = along**2 / (
            radius * (1 + np.sqrt(np.maximum(0.0, 1 - (1 + conic) * (along / radius) ** 2)))
        )
        places = (start + end) / 2 + (along + 1j * (sag - sag[0])) * (end - start) / (2 * half)
    places = (places - complex(*origin)) * turn
    corners = np.stack([places.real, places.imag], axis=-1)
    return np.stack([corners[:-1], corners[1:]], axis=1)


def _meet(box: Float[np.ndarray, "2 2"], line: Float[np.ndarray, "2 2"]) -> bool:
    """Whether a line is within a box anywhere, not counting what only touches it."""
    low, high = np.sort(box, axis=1).T + TOUCH * np.array([[1], [-1]])
    step = line[1] - line[0]
    step = np.where(step == 0, np.finfo(float).tiny, step)
    with np.errstate(over="ignore"):
        parts = np.sort([(low - line[0]) / step, (high - line[0]) / step], axis=0)
    return bool(max(parts[0].max(), 0.0) < min(parts[1].min(), 1.0))
