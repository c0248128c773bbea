"""Run time of an image's outlines: rings as apertures, ever more of them, against very many."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from designopt.study.benchmark import benchmark, compile_methods
from designopt.study.results import PrecisionRow
from optics.chamber import Apertures, Posture, Rings, find_apertures, press_wall
from studies.models.soft_finger.finger import DOWN, SoftFinger

PER_REGION = (5, 10, 20, 40, 80)
"""Rings in every region; pictures are painted with 20."""

REFERENCE = 640
"""Errors fall with the square of the number: this many leave 1/64 of the last one's."""

FRAMES = 32
"""Postures worked out at once: bends from 0 to 120°, half of them pressed."""

ANGLES = 192
SLACK = 0.3
"""Of a power fitted to five points."""


def measure_rings(finger: SoftFinger) -> list[PrecisionRow]:
    """Outlines of some postures: how far off they are, and how long they take.

    Errors are of the ends of what is seen of blue, yellow and top in the plane of bending, px.
    """
    outlines, postures = _outlines(finger, REFERENCE)
    error = functools.partial(_worst, finger, *_ends(finger, jax.jit(outlines)(postures)))
    name, panel, rows = "rings as apertures", "outlines of one frame", []
    for number in PER_REGION:
        [method] = compile_methods(name, panel, error, *_outlines(finger, number))
        setting = f"{number} rings per region"
        rows += benchmark([replace(method, setting=setting, scale=1 / FRAMES)], repeats=9)
    return rows


def fit_powers(rows: Sequence[PrecisionRow]) -> tuple[str, bool]:
    """The powers of the number of rings with which error and time go, and whether they hold."""
    both = np.log([(row.error, row.seconds) for row in rows])
    order, cost = np.polyfit(np.log(PER_REGION), both, 1)[0].tolist()
    each = "; ".join(
        f"{row.setting}: {row.error:.2g} px in {1e3 * row.seconds:.2f} ms" for row in rows
    )
    evidence = (
        f"The error goes with the number to the power of {order:.2f}, the time to that of "
        f"{cost:.2f}: {each}."
    )
    return evidence, abs(order + 2) < SLACK and cost < 1 + SLACK


def _worst(
    finger: SoftFinger,
    true: Float[np.ndarray, "frames 3 2"],
    shown: Bool[np.ndarray, "frames 3"],
    answer: Apertures,
) -> float:
    """Largest error of an end, px; of what is seen wrongly or not at all, its width."""
    found, seen = _ends(finger, answer)
    off = np.abs(found - true).max(axis=-1)
    width = np.abs(np.where(seen[..., None], found, true) @ np.array([-1.0, 1.0]))
    return float(np.where(seen & shown, off, np.where(seen | shown, width, 0)).max())


def _outlines(finger: SoftFinger, number: int) -> tuple[Callable[[Posture], Apertures], Posture]:
    """What finds outlines with so many rings per region, and the postures."""
    rings = Rings.of(finger.chamber, number)
    bends = jnp.deg2rad(jnp.linspace(0.0, 120.0, FRAMES))
    press = functools.partial(press_wall, rings.arc, jnp.asarray(60.0), jnp.asarray(25.0))
    depths = jnp.asarray(np.tile([0.0, 2.0], FRAMES // 2))

    def outlines(postures: Posture) -> Apertures:
        return jax.vmap(lambda posture: find_apertures(rings, posture, ANGLES))(postures)

    return outlines, Posture(bends, jnp.full(FRAMES, DOWN), jax.vmap(press)(depths))


def _ends(
    finger: SoftFinger, answer: Apertures
) -> tuple[Float[np.ndarray, "frames 3 2"], Bool[np.ndarray, "frames 3"]]:
    """Both ends, in the plane of bending, of blue's, yellow's and the top's outline, px."""
    per_region = answer.seen.shape[1] // 3
    which = per_region * np.arange(1, 4) - 1
    outlines = float(finger.endoscope.focal_px) * np.asarray(answer.outline)[:, which]
    # The finger bends down: the first point is the lowest, that half way around the highest.
    return outlines[:, :, [ANGLES // 2, 0], 1], np.asarray(answer.seen)[:, which]
