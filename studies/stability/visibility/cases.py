"""Families of extreme scenes: on the way to degenerate ones, and of extreme sizes.

Each formula says by which lines its views are bounded; the brute force agrees with all of them
where its rays are fine enough.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import mpmath
import numpy as np

from studies.stability.visibility import degenerate
from studies.stability.visibility.exact import ExactScene, Piece, crossing, met, mirrored
from studies.stability.visibility.families import (
    Family,
    Surfaces,
    between,
    direct,
    in_mirror,
    nothing,
    row,
    stacked,
    whole,
)
from studies.stability.visibility.scenes import CAMERA

SMALLEST = 1e-12
"""How near to degenerate the families go, in units of the scene."""

PAD = (2 - 1j, 2 + 1j)
"""A pad across the x axis that looks back at the origin."""


def families(dtype: str, count: int) -> Iterator[Family]:
    """All families.

    Args:
        dtype: float type for which they are meant.
        count: scenes in each family.
    """
    steps = np.logspace(-1, np.log10(SMALLEST), count)
    yield from _grazing(steps)
    yield from _corners(steps)
    yield from _openings(steps)
    yield from _limits(steps)
    yield from _sizes(dtype, count)
    yield from degenerate.families(count)


def _grazing(steps: np.ndarray) -> Iterator[Family]:
    """Heights h above pads and mirrors of length 1, seen from a distance of 1."""

    def post(scene: ExactScene) -> list[Piece]:
        foot = met(scene["p0"], *scene["b0"])
        return direct(scene, (0, foot), (between(scene, "b0")[1], 1))

    yield Family(
        "a post on a pad, seen at 1e-1 to 1e-12 rad",
        stacked(
            row(-1 + 1j * h, {"p0": (0, 1), "b0": (0.25 - 1j * h, 0.25 + 0.25j * h)}) for h in steps
        ),
        post,
        steps / 4,
    )

    def before(scene: ExactScene) -> list[Piece]:
        return [*whole(scene), in_mirror(scene)]

    def behind(scene: ExactScene) -> list[Piece]:
        near, far = between(scene, "m0")
        return direct(scene, (0, far), (near, 1))

    for case, side, formula in (
        ("a mirror, seen at 1e-1 to 1e-12 rad", 1, before),
        ("a mirror from behind, at 1e-1 to 1e-12 rad", -1, behind),
    ):
        rows = (row(-1 + side * 1j * h, {"m0": (0, 1), "p0": (2, 2 + 4j * h)}) for h in steps)
        yield Family(case, stacked(rows), formula, steps / 4)

    def channel(scene: ExactScene) -> list[Piece]:
        low, high, pad = scene["m0"], scene["m1"], scene["p0"]
        images: dict[tuple[int, ...], Any] = {(): scene.camera}
        for word in ((0,), (1,), (0, 1), (1, 0)):
            images[word] = mirrored(images[word[:-1]], (low, high)[word[-1]])
        # Ray by ray the far ends of both mirrors, and once the near end of the lower.
        bounding = dict.fromkeys(images, (low[1], high[1]))
        bounding[0, 1] = (mirrored(low[0], high), high[1])
        return [
            Piece(word, images[word], *(met(pad, images[word], place) for place in places))
            for word, places in bounding.items()
        ]

    def facing(apart: float) -> np.ndarray:
        up = 1j * apart
        mirrors = {"m0": (0, 4), "m1": (up, 4 + up)}
        return row(-1 + 0.3 * up, mirrors | {"p0": (5 - up, 5 + 2 * up)})

    yield Family(
        "two mirrors that face each other, 1e-1 to 1e-12 apart",
        stacked(map(facing, steps)),
        channel,
        steps / 16,
    )

    def sharp(scene: ExactScene) -> list[Piece]:
        return direct(scene, (met(scene["p1"], *scene["m0"]), 1), pad=1)

    yield Family(
        "a pad that crosses a mirror at 1e-1 to 1e-12 rad",
        stacked(row(-1 + 1j, {"m0": (0, 4), "p1": (1 - 1j * h, 3 + 1j * h)}) for h in steps),
        sharp,
        steps / 16,
        steepness=1 / steps,
    )


CORNER: Surfaces = {"m0": (-1, 4), "m1": (-1j, 4j), "p0": (3 + 1j, 2 + 3j)}
"""Two mirrors that cross at a right angle, and a pad that looks into the corner."""


def _corner(surfaces: Surfaces, camera: complex = 1 + 0.75j, absent: complex = 2 + 2j) -> Any:
    return row(camera, surfaces, direction=-1.6, field_of_view=6.2, absent=absent)


def _in_corner(scene: ExactScene) -> list[Piece]:
    """A pad seen directly, in each of two mirrors, and in both up to where these cross."""
    first, second, pad = scene["m0"], scene["m1"], scene["p0"]
    images = [mirrored(scene.camera, mirror) for mirror in (first, second)]
    both = [mirrored(images[0], second), mirrored(images[1], first)]
    place, one = crossing(first, second), mpmath.mpf(1)
    return [
        *whole(scene),
        *(Piece((i,), images[i], 0 * one, one) for i in (0, 1)),
        Piece((0, 1), both[0], met(pad, both[0], place), one),
        Piece((1, 0), both[1], 0 * one, met(pad, both[1], place)),
    ]


def _corners(steps: np.ndarray) -> Iterator[Family]:
    count = len(steps)
    yield Family(
        "camera to 1e-12 from a corner of mirrors",
        stacked(_corner(CORNER, h * (1 + 0.75j)) for h in steps),
        _in_corner,
        steps / 4,
        steepness=1 / steps,
    )
    ends = 4j * np.exp(1j * np.linspace(-0.1, 0.1, count))
    rows = stacked(_corner({**CORNER, "m1": (-end, end)}) for end in ends)
    yield Family("mirrors that cross", rows, _in_corner)

    def shared(index: int) -> np.ndarray:
        """Of both mirrors, or of one where it meets the other, the corner is an end."""
        mirrors = {"m0": (-(index % 2), 4), "m1": (-1j * (index % 4 == 2), 4j)}
        return _corner({**CORNER, **mirrors}, absent=(0, 3 + 1j)[index % 3 == 0])

    rows = stacked(map(shared, range(count)))
    yield Family("mirrors that share a corner", rows, _in_corner, smooth=False)

    places = (1 + 0.75j, 0, 3 + 1j, 2 + 3j, 2 + 1.5j, 4, 1, 2.5 + 2j)
    rows = stacked(_corner(CORNER, absent=places[i % len(places)]) for i in range(count))
    case = "a mirror, a pad and blockers of zero length in the way"
    yield Family(case, rows, _in_corner, smooth=False)
    points = ({"m0": (i / 8, i / 8), "m1": (1j * i, 1j * i)} for i in range(count))
    rows = stacked(_corner({**CORNER, **some}) for some in points)
    yield Family("mirrors of zero length alone", rows, whole)
    rows = stacked(_corner({**CORNER, "p0": (2 + 1j * i / 8,) * 2}) for i in range(count))
    yield Family("pads of zero length", rows, nothing)


def _openings(steps: np.ndarray) -> Iterator[Family]:
    """Slits and shadows of width w."""

    def slit(width: float) -> np.ndarray:
        low, high = (1 - 2j, 1 - 0.5j * width), (1 + 0.5j * width, 1 + 2j)
        return row(0, {"p0": PAD, "b0": low, "b3": high})

    def opening(scene: ExactScene) -> list[Piece]:
        return direct(scene, (between(scene, "b0")[1], between(scene, "b3")[0]))

    yield Family("a slit of 1e-1 to 1e-12", stacked(map(slit, steps)), opening, steps / 2)
    rows = stacked(map(slit, np.append(0.0, -steps[1:])))
    yield Family("a slit closed by 0 to 1e-1", rows, nothing, smooth=False)

    def around(scene: ExactScene) -> list[Piece]:
        first, last = between(scene, "b0")
        return direct(scene, (0, first), (last, 1))

    rows = stacked(row(0, {"p0": PAD, "b0": (1, 1.5 + 1j * width)}) for width in steps)
    yield Family("a blocker along the line of sight to 1e-12", rows, around, steps / 4)


def _limits(steps: np.ndarray) -> Iterator[Family]:
    """Fields of view and least grazing angles that open, close or pass half a turn."""

    def at_limits(scene: ExactScene) -> list[Any]:
        return [met(scene["p0"], scene.camera, scene.camera + limit) for limit in scene.limits]

    yield Family(
        "field of view of 1e-1 to 1e-12 rad",
        stacked(row(0, {"p0": PAD}, direction=0.1, field_of_view=width) for width in steps),
        lambda scene: direct(scene, tuple(at_limits(scene))),
        steps / 2,
    )

    def away(direction: float, gap: float) -> np.ndarray:
        return row(0, {"p0": PAD}, direction=direction, field_of_view=2 * np.pi - gap)

    def all_but_back(scene: ExactScene) -> list[Piece]:
        last, first = at_limits(scene)
        return direct(scene, (0, first), (last, 1))

    rows = stacked(away(np.pi, gap) for gap in steps)
    yield Family("field of view to 1e-12 rad from a full turn", rows, all_but_back, steps / 8)
    rows = stacked(away(turn, 0.0) for turn in np.linspace(-4, 4, len(steps)))
    yield Family("field of view of a full turn", rows, whole, smooth=False)

    over = {"p0": (1 + 1j, -1 + 1j)}
    beyond = np.append(0.0, steps[1:]) * np.resize([1, -1], len(steps))
    yield Family(
        "field of view to 1e-12 rad from half a turn, and of half a turn",
        stacked(row(0, over, field_of_view=np.pi + more) for more in beyond),
        lambda scene: direct(scene, (0, at_limits(scene)[1])),
    )

    def steep(scene: ExactScene) -> list[Piece]:
        start, end = scene["p0"]
        foot = (scene.camera - start) / (end - start)
        reach = abs(foot.imag) * mpmath.cot(scene.grazing)
        return direct(scene, (foot.real - reach, foot.real + reach))

    yield Family(
        "least grazing angle to 1e-12 rad from a right angle",
        stacked(
            row(0.1 + 1j, {"p0": (-1, 1)}, direction=-np.pi / 2, grazing=np.pi / 2 - 5 * angle)
            for angle in steps
        ),
        steep,
        steps,
    )


def _sizes(dtype: str, count: int) -> Iterator[Family]:
    """The corner, far away, tiny and huge, as far as the float type goes."""
    corner = _corner(CORNER)
    coordinates = np.arange(len(corner)) < CAMERA.stop
    decades, far = (150, 1e8) if dtype == "float64" else (15, 1e3)
    scales = np.logspace(-decades, decades, count)[:, None]
    rows = np.where(coordinates, corner * scales, corner)
    yield Family(f"all coordinates 1e-{decades} to 1e{decades}", rows, _in_corner)
    turns = np.linspace(0, 2 * np.pi, count)
    shifts = np.zeros((count, len(corner)))
    shifts[:, 0 : CAMERA.stop : 2] = far * np.cos(turns)[:, None]
    shifts[:, 1 : CAMERA.stop : 2] = far * np.sin(turns)[:, None]
    yield Family(f"origin {far:.0e} away", corner + shifts, _in_corner)
