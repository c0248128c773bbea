"""A scene in a pose as plain complex numbers, and what millions of rays show of it.

It is placed in 50 digits, apart from the library's own `place`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import mpmath
import numpy as np
from jaxtyping import Array, Float

from studies.oracles.rays import CHUNK, Surfaces, cast, union

DIGITS = 50
"""In which scenes are placed."""

Number = Any
"""A real or complex number of mpmath."""


class Plain(NamedTuple):
    """A scene in a pose; a place is x + iy.

    Attributes:
        camera: position of the camera, mm.
        axis: its optical axis, of length 1.
        half: half the field of view, rad.
        surfaces: what rays meet.
        bounces: most reflections of a path.
    """

    camera: Number
    axis: Number
    half: Number
    surfaces: Surfaces
    bounces: int

    @property
    def pads(self) -> list[tuple[Number, Number]]:
        """Ends of the pads."""
        first = self.surfaces.mirrors
        return list(self.surfaces.ends[first : first + len(self.surfaces.grazing)])

    def follow(self, heading: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """What rays from the camera see (`cast`), from their directions of length 1."""
        return cast(self.surfaces, self.camera, (np.real(heading), np.imag(heading)), self.bounces)


def entries(scene: Any) -> list[Number]:
    """Mirrors, camera position and direction as one row, exactly as in double precision."""
    parts = (scene.mirrors, scene.camera.position, scene.camera.direction)
    row = np.concatenate([np.ravel(part).astype(float) for part in parts])
    return [mpmath.mpf(x) for x in row.tolist()]


def plain(
    scene: Any, angles: Float[Array | np.ndarray, " joints"], values: Sequence[Number]
) -> Plain:
    """The scene in a pose with given `entries`, in the precision that mpmath works in."""
    layout, count = scene.layout, 4 * len(scene.layout.mirrors)
    turns = np.asarray(angles, float).tolist()

    def moved(frame: int, place: Number) -> Number:
        while frame >= 0:  # negative: the world
            part = layout.frames[frame]
            hinge = mpmath.mpc(*np.asarray(scene.hinges, float)[frame].tolist())
            place = hinge + mpmath.expj(part.sign * turns[part.angle]) * (place - hinge)
            frame = part.parent
        return place

    fixed = np.concatenate([np.ravel(scene.pads), np.ravel(scene.blockers)]).astype(float)
    corners = [*values[:count], *fixed.tolist()]
    places = [mpmath.mpc(*corners[i : i + 2]) for i in range(0, len(corners), 2)]
    pairs = zip(layout.surfaces, places[::2], places[1::2], strict=True)
    ends = [(moved(part.frame, start), moved(part.frame, end)) for part, start, end in pairs]
    x, y, direction = values[count:]
    eye = mpmath.mpc(x, y)
    ahead = moved(layout.camera_frame, eye + mpmath.expj(direction))
    camera = moved(layout.camera_frame, eye)
    arcs = np.stack([scene.radii, scene.conics], axis=-1).astype(float)
    surfaces = Surfaces(
        ends,
        [surface.side for surface in layout.surfaces],
        len(layout.mirrors),
        [mpmath.mpf(angle) for angle in np.asarray(scene.grazing, float).tolist()],
        {
            index: (radius, conic)
            for index, (radius, conic) in zip(layout.curved, arcs, strict=True)
        },
    )
    half = mpmath.mpf(float(scene.camera.field_of_view)) / 2
    return Plain(camera, ahead - camera, half, surfaces, layout.bounces)


def rounded(scene: Any, angles: Float[Array | np.ndarray, " joints"]) -> Plain:
    """The scene in a pose in double precision, rounded once."""
    with mpmath.workdps(DIGITS):
        return in_floats(plain(scene, angles, entries(scene)))


def in_floats(scene: Plain) -> Plain:
    """The same in double precision."""
    surfaces = scene.surfaces._replace(
        ends=[(complex(start), complex(end)) for start, end in scene.surfaces.ends],
        grazing=[float(angle) for angle in scene.surfaces.grazing],
    )
    return Plain(
        complex(scene.camera), complex(scene.axis), float(scene.half), surfaces, scene.bounces
    )


class Seen(NamedTuple):
    """How much of each pad is seen.

    Attributes:
        coverage: part that is seen by any path.
        redundancy: number of paths by which a point is seen, on average.
    """

    coverage: np.ndarray
    redundancy: np.ndarray


def seen_by_fan(scene: Plain, rays: int) -> Seen:
    """What a fan of rays over the field of view shows of each pad.

    Neighbouring rays that reach one pad over the same mirrors form a run, and each stands for its
    share of the field of view: the run is continued by half a step beyond its outermost rays. So
    its ends are right to about half a step, whatever bounds it.
    """
    steps = (2 * np.arange(rays) + 1) / rays - 1
    parts = [
        scene.follow(scene.axis * np.exp(1j * scene.half * steps[first : first + CHUNK]))
        for first in range(0, rays, CHUNK)
    ]
    label, along = map(np.concatenate, zip(*parts, strict=True))
    pads = len(scene.pads)
    spans, pad = _runs(label, along, pads)
    return Seen(
        union(spans, pad, pads), np.bincount(pad, spans[:, 1] - spans[:, 0], minlength=pads)
    )


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
