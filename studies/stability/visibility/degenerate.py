"""Families of scenes in which places lie exactly on lines, ends coincide, or all is one point.

Coordinates are whole numbers and quarters in six directions, so that what is on a line is so after
rounding as well. A surface hides nothing if it is seen edge-on or goes through the camera, nor does
one beside a mirror on its line. What is seen of pads that lie on one another, or on a blocker,
means nothing; it has to be finite.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from studies.stability.visibility.exact import ExactScene, Piece, met
from studies.stability.visibility.families import (
    Family,
    between,
    direct,
    in_mirror,
    nothing,
    row,
    stacked,
    whole,
)

DIRECTIONS = (1, 1j, 3 + 4j, -5 + 2j, -2 - 1j, 1 - 3j)
ORIGIN = 2 - 3j

POSITIONS = (-3.0, -1.0, 0.0, 1.0, 2.0)
"""Of a camera on the line of a segment from 0 to 1, but not within it."""
WITHIN = (0.25, 0.5, 0.75)
"""The same within the segment."""

BESIDE = (
    *((1, 2), (1.5, 2.5), (-1, 0), (-2, -1)),  # along the mirror's line, touching it or not
    *((1, 1 - 1j), (-1j, 0), (3 + 2j, 4 + 3j)),  # from its ends, or the pad's, away from the view
)
"""Blockers that hide nothing of a mirror from 0 to 1."""


def families(count: int) -> Iterator[Family]:
    """All of these, as many scenes each; directions and the surfaces that play a part vary."""
    for case, positions in (("line", POSITIONS), ("body", WITHIN)):
        for what, make, formula in (
            ("mirror", _at_mirror, whole),
            ("pad", _at_pad, nothing),
            ("blocker", _at_blocker, whole),
        ):
            rows = stacked(make(i, positions[i % len(positions)]) for i in range(count))
            yield Family(f"camera on a {what}'s {case}", rows, formula, smooth=False)
    for case, make, formula in (
        ("blockers beside a mirror, and from its ends or the pad's", _beside, _mirror_view),
        ("a blocker that rises from a mirror's end", _rising, _up_to_post),
        ("blockers that coincide", _coinciding, _around),
        ("all in one point", _one_point, nothing),
    ):
        rows = stacked(make(index) for index in range(count))
        yield Family(case, rows, formula, smooth=False)
    for case, make in (("pads that coincide", _twice), ("pads that lie on blockers", _on_blocker)):
        rows = stacked(make(index) for index in range(count))
        yield Family(case, rows, whole, clear=0.0, smooth=False)


def _placed(index: int, *places: complex) -> list[complex]:
    """Places along and across direction number ``index``, about some origin."""
    along = DIRECTIONS[index % len(DIRECTIONS)]
    return [ORIGIN + along * place for place in places]


def _turn(index: int) -> float:
    return float(np.angle(DIRECTIONS[index % len(DIRECTIONS)]))


def _at_mirror(index: int, position: float) -> np.ndarray:
    camera, first, last, *pad = _placed(index, position, 0, 1, 2 + 2j, -1 + 2j)
    surfaces = {f"m{index % 3}": (first, last), "p0": pad}
    toward = _turn(index) + np.pi / 2
    return row(camera, surfaces, direction=toward, field_of_view=3.0, absent=last)


def _at_pad(index: int, position: float) -> np.ndarray:
    camera, *pad = _placed(index, position, 0, 1)
    toward = _turn(index) + np.pi * (position > 0.5)
    return row(camera, {f"p{index % 2}": pad}, direction=toward, absent=3 + 3j)


def _at_blocker(index: int, position: float) -> np.ndarray:
    """A blocker seen edge-on, and one that ends in the camera."""
    camera, first, last, *pad = _placed(index, position, 0, 1, 4 - 2j, 4 + 2j)
    blockers = {f"b{index % 4}": (first, last), f"b{(index + 1) % 4}": (camera, first)}
    return row(camera, {**blockers, "p0": pad}, direction=_turn(index), absent=first)


def _mirror_view(scene: ExactScene) -> list[Piece]:
    return [*whole(scene), in_mirror(scene)]


def _beside(index: int) -> np.ndarray:
    camera, *places = _placed(index, 0.5 + 1j, 0, 1, 3 + 2j, -2 + 2j, *BESIDE[index % len(BESIDE)])
    surfaces = {"m0": places[:2], "p0": places[2:4], f"b{index % 4}": places[4:]}
    return row(camera, surfaces, direction=_turn(index), field_of_view=6.0, absent=places[-1])


def _up_to_post(scene: ExactScene) -> list[Piece]:
    view = in_mirror(scene)
    bound = met(scene["p0"], view.source, scene["b0"][1])
    return [*whole(scene), Piece(view.word, view.source, bound, view.end)]


def _rising(index: int) -> np.ndarray:
    camera, *places = _placed(index, 0.5 + 1j, 0, 1, 3 + 2j, -2 + 2j, 1 + 0.5j)
    surfaces = {"m0": places[:2], "p0": places[2:4], "b0": (places[1], places[4])}
    return row(camera, surfaces, direction=_turn(index), field_of_view=6.0, absent=places[0])


def _around(scene: ExactScene) -> list[Piece]:
    first, last = between(scene, "b0")
    return direct(scene, (0, first), (last, 1))


def _coinciding(index: int) -> np.ndarray:
    camera, *places = _placed(index, 0, 1 - 0.5j, 1 + 0.5j, 2 - 2j, 2 + 2j)
    surfaces = {f"b{i}": places[:2] for i in range(4)} | {"p0": places[2:]}
    return row(camera, surfaces, direction=_turn(index), absent=places[0])


def _twice(index: int) -> np.ndarray:
    camera, *pad = _placed(index, 0, 2 - 2j, 2 + 2j)
    return row(camera, {"p0": pad, "p1": pad}, direction=_turn(index), absent=camera)


def _on_blocker(index: int) -> np.ndarray:
    """Places on the blocker's line to rounding alone: directions of no whole numbers."""
    turn = 0.1 + index
    camera, *places = (
        ORIGIN + np.exp(1j * turn) * at for at in (0, 2 - 0.7j, 2 + 1j, 2 - 2j, 2 + 2j)
    )
    surfaces = {"p0": places[:2], f"b{index % 4}": places[2:]}
    return row(camera, surfaces, direction=turn, absent=camera)


def _one_point(index: int) -> np.ndarray:
    place = (1, 1 + 1j, 1e8 - 1e8j, 1e-150j, 0)[index % 5]
    return row(place, {}, direction=_turn(index), absent=place)
