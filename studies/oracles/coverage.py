"""Coverage and its gradient in 50 digits: the reference without the steps of a fan.

Whatever the view of a pad begins or ends with, it does so in one of finitely many places: where the
line of sight over some path passes an end of a surface or the place where one meets the line of a
mirror, where a surface meets the pad, at the limits of the field of view and of the grazing angle.
They cut the pad into parts that are seen as a whole or not at all, and one ray to the middle of
each part tells which. The places are computed in 50 digits, the rays in double precision.
Derivatives are central differences of the sum, with steps so short that 30 digits are right.

For straight mirrors; places that coincide leave parts without length, which do not count.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import Any, NamedTuple

import mpmath
import numpy as np
from jaxtyping import Array, Float

from studies.oracles.rays import Word, words
from studies.oracles.scenes import DIGITS, Number, Plain, entries, in_floats, plain

STEP = 1e-20
"""Of the central differences, mm or rad; their error is of the order of its square."""

NEAR = 1e-9
"""A ray ends where it was sent if it meets the pad so near to it, in pad coordinates."""

Segment = tuple[Number, Number]


class View(NamedTuple):
    """A path, unfolded behind its last mirror.

    Attributes:
        word: its mirrors.
        eye: the virtual camera.
        lines: through which two places a line of sight passes that may bound a view, or along
            which surface a pad may be met.
    """

    word: Word
    eye: Number
    lines: list[Segment]


def coverage(scene: Any, angles: Float[Array, " joints"]) -> np.ndarray:
    """Part of each pad that is seen by any path."""
    with mpmath.workdps(DIGITS):
        found = _coverage(plain(scene, angles, entries(scene)))
        return np.array([float(part) for part in found])


def gradient(scene: Any, angles: Float[Array, " joints"]) -> np.ndarray:
    """Derivatives of the mean coverage with respect to all `entries`."""
    with mpmath.workdps(DIGITS):
        values, step = entries(scene), mpmath.mpf(STEP)

        def mean(index: int, change: Number) -> Number:
            moved = [*values[:index], values[index] + change, *values[index + 1 :]]
            found = _coverage(plain(scene, angles, moved))
            return mpmath.fsum(found) / len(found)

        slopes = [(mean(i, step) - mean(i, -step)) / (2 * step) for i in range(len(values))]
        return np.array([float(slope) for slope in slopes])


def _coverage(scene: Plain) -> list[Number]:
    rounded, surfaces = in_floats(scene), scene.surfaces
    views = [_view(scene, word) for word in words(surfaces.mirrors, scene.bounces)]
    found = []
    for pad in range(len(scene.pads)):
        cuts = {at for view in views for at in _cuts(scene, view, pad) if 0 < at < 1}
        parts = list(itertools.pairwise([0, *sorted(cuts), 1]))
        middles = np.array([float((low + high) / 2) for low, high in parts])
        seen = np.any([_seen(rounded, view, pad, middles) for view in views], axis=0)
        found.append(mpmath.fsum(itertools.compress((b - a for a, b in parts), seen)))
    return found


def _view(scene: Plain, word: Word) -> View:
    eye, ahead = (_unfolded(scene, word, z) for z in (scene.camera, scene.camera + scene.axis))
    lines = [(eye, eye + (ahead - eye) * mpmath.expj(k * scene.half)) for k in (-1, 1)]
    for leg in range(len(word) + 1):
        mirrors = [scene.surfaces.ends[index] for index in word[max(leg - 1, 0) : leg + 1]]
        for start, end in scene.surfaces.ends:
            meetings = [at for mirror in mirrors for at in _met((start, end), mirror)]
            places = [start, end, *(start + at * (end - start) for at in meetings)]
            unfolded = [_unfolded(scene, word[leg:], place) for place in places]
            lines += [(unfolded[0], unfolded[1]), *((eye, place) for place in unfolded)]
    return View(word, eye, lines)


def _cuts(scene: Plain, view: View, pad: int) -> Iterator[Number]:
    """Pad coordinates at which a view may begin or end."""
    start, end = scene.pads[pad]
    for line in view.lines:
        yield from _met((start, end), line)
    foot, slope = (view.eye - start) / (end - start), mpmath.tan(scene.surfaces.grazing[pad])
    if slope:
        yield from (foot.real + k * abs(foot.imag) / slope for k in (-1, 1))


def _unfolded(scene: Plain, word: Word, place: Number) -> Number:
    """A place mirrored in one mirror after the other."""
    for index in word:
        start, end = scene.surfaces.ends[index]
        place = start + (end - start) * mpmath.conj((place - start) / (end - start))
    return place


def _met(segment: Segment, line: Segment) -> Iterator[Number]:
    """Coordinate along a segment at which a line meets it; nothing if they are parallel."""
    first, step = line[0], line[1] - line[0]
    below, above = (mpmath.im(mpmath.conj(step) * (place - first)) for place in segment)
    if below != above:
        yield below / (below - above)


def _seen(scene: Plain, view: View, pad: int, coordinates: np.ndarray) -> np.ndarray:
    """Which points of a pad are seen over a path, in double precision: by rays sent to them."""
    start, end = scene.pads[pad]
    heading = start + coordinates * (end - start) - complex(view.eye)
    for index in reversed(view.word):
        first, last = scene.surfaces.ends[index]
        heading = (last - first) * np.conj(heading / (last - first))
    heading /= np.abs(heading)
    inside = np.abs(np.angle(heading / scene.axis)) <= scene.half
    label, along = scene.follow(heading)
    number = scene.surfaces.number(view.word, pad)
    arrives = (label == number) & (np.abs(along - coordinates) < NEAR)
    return inside & arrives
