"""Other people's ray tracers on the same mirrors: optiland and rayoptics, where installed.

Both are made for lenses: rays meet the surfaces in the order in which these are given. Their z and
y axes are the section's x and y.
"""

from __future__ import annotations

import importlib.util
import itertools
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np


class Ends(NamedTuple):
    """Where rays end: on the last mirror that they meet, reflected.

    Attributes:
        places: mm.
        headings: unit vectors.
        lengths: of the paths, mm.
    """

    places: Any
    headings: Any
    lengths: Any


Tracer = tuple[Callable[[], Any], Callable[[Any], Ends]]
"""What traces all rays, and what reads its answer."""


def installed(package: str) -> bool:
    """Whether a package can be imported; the extra ``peers`` brings both."""
    return importlib.util.find_spec(package) is not None


def optiland_tracer(mirrors: np.ndarray, positions: np.ndarray, directions: np.ndarray) -> Tracer:
    """`optiland`: all rays at once in NumPy, nothing recorded on the way.

    Args:
        mirrors: their ends in the order in which they are met, mm, shape (mirrors, 2, 2).
        positions: where the rays start, mm.
        directions: rad.
    """
    from optiland.optic import Optic  # pyright: ignore[reportMissingImports]
    from optiland.rays import RealRays  # pyright: ignore[reportMissingImports]

    system = Optic()
    system.surfaces.add(index=0, thickness=np.inf)
    for number, (start, end) in enumerate(mirrors, start=1):
        (x, y), (dx, dy) = (start + end) / 2, end - start
        tilt = np.pi / 2 - np.arctan2(dy, dx)
        place = {"x": 0.0, "y": y, "z": x, "rx": tilt}
        system.surfaces.add(
            index=number, radius=np.inf, material="mirror", is_stop=number == 1, **place
        )
    zero, one = np.zeros(len(positions)), np.ones(len(positions))
    x, y = positions.T
    across, along = np.sin(directions), np.cos(directions)

    def call() -> Any:
        # It moves the rays that it is given.
        given = [leaf.copy() for leaf in (zero, y, x, zero, across, along)]
        return system.surfaces.trace(RealRays(*given, one, one), skip=1, record=False)

    def read(rays: Any) -> Ends:
        places, headings = (rays.z, rays.y), (rays.N, rays.M)
        return Ends(np.stack(places, axis=-1), np.stack(headings, axis=-1), rays.opd)

    return call, read


def rayoptics_tracer(mirrors: np.ndarray, positions: np.ndarray, directions: np.ndarray) -> Tracer:
    """`rayoptics`: its function for one ray, called for each; otherwise as `optiland_tracer`."""
    from rayoptics.elem.profiles import Spherical  # pyright: ignore[reportMissingImports]
    from rayoptics.elem.surface import Surface  # pyright: ignore[reportMissingImports]
    from rayoptics.raytr.raytrace import trace_raw  # pyright: ignore[reportMissingImports]

    # Of every surface, axes as rows and origin: y along the mirror, z in the sense of the light.
    frames = [(np.eye(3), np.zeros(3))]
    for number, (start, end) in enumerate(mirrors):
        dx, dy = (end - start) / np.linalg.norm(end - start)
        x = np.array([-1.0 if number % 2 == 0 else 1.0, 0.0, 0.0])
        y = np.array([0.0, dy, dx])
        middle = (start + end) / 2
        frames.append((np.stack([x, y, np.cross(x, y)]), np.array([0.0, middle[1], middle[0]])))
    first, last = Surface(interact_mode="dummy"), frames[-1]
    plane = Surface(profile=Spherical(c=0.0), interact_mode="reflect")
    path = [
        (first if number == 0 else plane, None, (turn @ axes.T, axes @ (origin - here)), 1.0, 1.0)
        for number, ((axes, here), (turn, origin)) in enumerate(itertools.pairwise([*frames, last]))
    ]
    zero = np.zeros(len(positions))
    starts = np.stack([zero, positions[:, 1], positions[:, 0]], axis=-1)
    headings = np.stack([zero, np.sin(directions), np.cos(directions)], axis=-1)

    def call() -> list[Any]:
        pairs = zip(starts, headings, strict=True)
        return [trace_raw(iter(path), *pair, 550.0, intersect_obj=False) for pair in pairs]

    def read(traced: list[Any]) -> Ends:
        axes, origin = last
        places, headings = (
            np.array([ray[-1][part] for ray, _, _ in traced]) @ axes for part in (0, 1)
        )
        places = places + origin
        lengths = [sum(segment[2] for segment in ray) for ray, _, _ in traced]
        return Ends(places[:, [2, 1]], headings[:, [2, 1]], np.array(lengths))

    return call, read
