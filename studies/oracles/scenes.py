"""A scene in a pose as plain complex numbers: what the references are made from.

It is placed in 50 digits, apart from the library's own `place`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import mpmath
import numpy as np
from jaxtyping import Array, Float

from studies.oracles.rays import Surfaces

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
        ends: of all surfaces, mirrors before pads before blockers, mm.
        arcs: of the curved mirrors, by index: radius at the vertex, mm, and conic constant.
        grazing: least angle between each pad and a ray that shows it, rad.
        layout: what is structural.
    """

    camera: Number
    axis: Number
    half: Number
    ends: list[tuple[Number, Number]]
    arcs: dict[int, tuple[float, float]]
    grazing: list[Number]
    layout: Any

    @property
    def pads(self) -> range:
        """Indices of the pads among all surfaces."""
        first = len(self.layout.mirrors)
        return range(first, first + len(self.layout.pads))

    @property
    def sides(self) -> list[int]:
        """Of all surfaces, the side that reflects, senses or blocks."""
        return [surface.side for surface in self.layout.surfaces]

    @property
    def surfaces(self) -> Surfaces:
        """What rays meet, once it is rounded."""
        return Surfaces(self.ends, self.sides, len(self.layout.mirrors), self.grazing, self.arcs)

    def rounded(self) -> Plain:
        """The same in double precision."""
        return self._replace(
            camera=complex(self.camera),
            axis=complex(self.axis),
            half=float(self.half),
            ends=[(complex(start), complex(end)) for start, end in self.ends],
            grazing=[float(angle) for angle in self.grazing],
        )


def entries(scene: Any) -> list[Number]:
    """Mirrors, camera position and direction as one row, exactly as in double precision."""
    parts = (scene.mirrors, scene.camera.position, scene.camera.direction)
    row = np.concatenate([np.ravel(part).astype(float) for part in parts])
    return [mpmath.mpf(x) for x in row.tolist()]


def plain(scene: Any, angles: Float[Array, " joints"], values: Sequence[Number]) -> Plain:
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
    x, y, direction = values[count:]
    eye = mpmath.mpc(x, y)
    ahead = moved(layout.camera_frame, eye + mpmath.expj(direction))
    camera = moved(layout.camera_frame, eye)
    arcs = np.stack([scene.radii, scene.conics], axis=-1).astype(float).tolist()
    return Plain(
        camera,
        ahead - camera,
        mpmath.mpf(float(scene.camera.field_of_view)) / 2,
        [(moved(part.frame, start), moved(part.frame, end)) for part, start, end in pairs],
        {
            index: (radius, conic)
            for index, (radius, conic) in zip(layout.curved, arcs, strict=True)
        },
        [mpmath.mpf(angle) for angle in np.asarray(scene.grazing, float).tolist()],
        layout,
    )


def rounded(scene: Any, angles: Float[Array, " joints"]) -> Plain:
    """The scene in a pose in double precision, rounded once."""
    with mpmath.workdps(DIGITS):
        return plain(scene, angles, entries(scene)).rounded()
