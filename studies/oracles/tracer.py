"""The reference for coverages: millions of rays, each followed to the nearest surface.

Neighbouring rays that reach one pad over the same mirrors form a run, and each stands for its share
of the field of view: the run is continued by half a step beyond its outermost rays. So its ends are
right to about half a step, whatever bounds it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from studies.oracles.rays import CHUNK, cast, union
from studies.oracles.scenes import Plain


class Seen(NamedTuple):
    """How much of each pad is seen.

    Attributes:
        coverage: part that is seen by any path.
        redundancy: number of paths by which a point is seen, on average.
    """

    coverage: np.ndarray
    redundancy: np.ndarray


def seen_by_fan(scene: Plain, rays: int) -> Seen:
    """What a fan of rays over the field of view shows of each pad."""
    steps = (2 * np.arange(rays) + 1) / rays - 1
    parts = [
        followed(scene, scene.axis * np.exp(1j * scene.half * steps[first : first + CHUNK]))
        for first in range(0, rays, CHUNK)
    ]
    label, along = map(np.concatenate, zip(*parts, strict=True))
    pads = len(scene.pads)
    spans, pad = _runs(label, along, pads)
    return Seen(
        union(spans, pad, pads), np.bincount(pad, spans[:, 1] - spans[:, 0], minlength=pads)
    )


def followed(scene: Plain, heading: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What rays from the camera see, from their directions of length 1.

    Returns:
        0 or a number for path and pad (`number_of`), and the coordinate on the pad.
    """
    ahead = np.real(heading), np.imag(heading)
    return cast(scene.surfaces, scene.camera, ahead, scene.layout.bounces)


def number_of(scene: Plain, word: Sequence[int], pad: int) -> int:
    """The number that stands for a pad, by its index among the pads, seen over some mirrors."""
    return scene.surfaces.number(word, pad)


def _runs(label: np.ndarray, along: np.ndarray, pads: int) -> tuple[np.ndarray, np.ndarray]:
    """Lower and upper end of what each run of rays sees, shape (runs, 2), and of which pad."""
    cuts = np.flatnonzero(np.diff(label)) + 1
    firsts, lasts = np.append(0, cuts), np.append(cuts, len(label)) - 1
    low, high = (which.reduceat(along, firsts) for which in (np.minimum, np.maximum))
    for end, inward in (
        (firsts, np.minimum(firsts + 1, lasts)),
        (lasts, np.maximum(lasts - 1, firsts)),
    ):
        beyond = np.clip(along[end] + (along[end] - along[inward]) / 2, 0, 1)
        low, high = np.minimum(low, beyond), np.maximum(high, beyond)
    seen = label[firsts] > 0
    return np.stack([low, high], axis=1)[seen], (label[firsts][seen] - 1) % pads
