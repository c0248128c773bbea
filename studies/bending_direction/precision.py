"""What an image costs: rings as apertures, ever more of them, against very many."""

from __future__ import annotations

import functools
import itertools
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from designopt.precision import Contender, compile_timed, measure
from designopt.results import Claim, PrecisionRow
from optics.soft_finger import Posture, Rings, Spans, apertures, pressed_by, spans
from studies.chamber_images.making import DOWN, SoftFinger

PER_REGION = (5, 10, 20, 40, 80)
"""Rings in every region; pictures are painted with 20."""

REFERENCE = 640
"""Errors fall with the square of the number: this many leave 1/64 of the last one's."""

FRAMES = 32
"""Postures worked out at once: bends from 0 to 120°, half of them pressed."""

ANGLES = 192
METHOD = "rings as apertures"


def measured(finger: SoftFinger) -> list[PrecisionRow]:
    """Outlines of some postures: how far off they are, and how long they take.

    Errors are of the ends of what is seen of blue, yellow and top in the plane of bending, px.
    """
    focal = float(finger.endoscope.focal_px)
    true, shown = _ends(finger, REFERENCE)
    rows = []
    for number in PER_REGION:
        call, seconds = _compiled(finger, number)
        found, seen = _ends(finger, number)
        off = np.where((seen & shown)[..., None], found - true, 0)
        contender = Contender(
            METHOD,
            f"{number} rings per region",
            "outlines of one frame",
            call,
            functools.partial(_worst, focal * off),
            compile_seconds=seconds,
            scale=1 / FRAMES,
        )
        rows.append(measure(contender, repeats=9))
    return rows


def _worst(off: Float[np.ndarray, "frames 3 2"], _: object) -> float:
    return float(np.abs(off).max())


def claim(rows: list[PrecisionRow]) -> Claim:
    """What the rows show."""
    errors = [row.error for row in rows]
    return Claim(
        "The error falls with the square of the number of rings, the time grows in proportion to "
        "it.",
        "Between two rings the wall bulges past their common tangents by a part of their distance "
        "squared over the radius of the bend; every ring is one ellipse and two lines in closed "
        "form, without iteration.",
        [
            "; ".join(
                f"{row.setting}: {row.error:.2g} px in {1e3 * row.seconds:.2f} ms" for row in rows
            )
            + "."
        ],
        all(after < before / 2 for before, after in itertools.pairwise(errors)),
    )


def _posed(finger: SoftFinger, number: int) -> tuple[Rings, Posture]:
    rings = Rings.of(finger.chamber, number)
    bends = jnp.deg2rad(jnp.linspace(0.0, 120.0, FRAMES))
    press = functools.partial(pressed_by, rings.arc, jnp.asarray(60.0), jnp.asarray(25.0))
    depths = jnp.asarray(np.tile([0.0, 2.0], FRAMES // 2))
    return rings, Posture(bends, jnp.full(FRAMES, DOWN), jax.vmap(press)(depths))


def _compiled(finger: SoftFinger, number: int) -> tuple[Callable[[], object], float]:
    rings, postures = _posed(finger, number)

    def outlines(postures: Posture) -> Float[Array, "frames rings angles 2"]:
        return jax.vmap(lambda posture: apertures(rings, posture, ANGLES).outline)(postures)

    program, seconds = compile_timed(outlines, postures)
    return lambda: program(postures), seconds


def _ends(
    finger: SoftFinger, number: int
) -> tuple[Float[np.ndarray, "frames 3 2"], Bool[np.ndarray, "frames 3"]]:
    """Both ends of what is seen of blue, yellow and top, and whether anything is."""
    rings, postures = _posed(finger, number)

    @jax.jit
    @jax.vmap
    def spanned(posture: Posture) -> Spans:
        return spans(rings, posture.bend, posture.pressed)

    seen, which = spanned(postures), np.array(rings.ends)
    low, high = np.asarray(seen.seen_low)[:, which], np.asarray(seen.seen_high)[:, which]
    return np.stack([low, high], axis=-1), high > low
