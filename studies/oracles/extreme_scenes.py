"""Extreme scenes and what they show: nearly degenerate, degenerate, tiny, huge and far away.

Each formula names the lines that bound its views; the brute force agrees with all of them where its
rays are fine enough. In the degenerate scenes places lie exactly on lines, ends coincide, or all is
one point: coordinates are whole numbers and quarters in six directions, so that what is on a line
is so after rounding as well. A surface hides nothing if it is seen edge-on or goes through the
camera, nor does one beside a mirror on its line. What is seen of pads that lie on one another, or
on a blocker, means nothing; it has to be finite.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import mpmath
import numpy as np

from studies.oracles.rays import Structure
from studies.oracles.visibility import (
    ExactScene,
    Formula,
    Piece,
    around,
    between,
    crossing,
    direct,
    in_mirror,
    met,
    mirrored,
    nothing,
    whole,
)

STRUCTURE = Structure(mirrors=3, pads=2, sides=(1, 0, -1, 1, 0, 0, 1, -1, 0))
"""Of all scenes: what one lacks is in it with zero length."""

SMALLEST = 1e-12
"""How near to degenerate the families go, in units of the scene."""

PAD = (2 - 1j, 2 + 1j)
"""A pad across the x axis that looks back at the origin."""

Surfaces = Mapping[str, Sequence[complex]]
"""Ends of surfaces, by their names."""

CORNER: Surfaces = {"m0": (-1, 4), "m1": (-1j, 4j), "p0": (3 + 1j, 2 + 3j)}
"""Two mirrors that cross at a right angle, and a pad that looks into the corner."""

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


class Family(NamedTuple):
    """Scenes that are extreme in one respect.

    Attributes:
        case: what is extreme in them.
        rows: shape (cases, inputs), float64.
        formula: what they show.
        clear: of each, how far it is from where its views change, of its size; infinite where
            the answer holds at once.
        smooth: whether it has derivatives: not where surfaces or views just touch.
        steepness: by how much a small relative change of the inputs, counted from the camera, is
            enlarged in the gradient.
    """

    case: str
    rows: np.ndarray
    formula: Formula
    clear: np.ndarray | float = np.inf
    smooth: bool = True
    steepness: np.ndarray | float = 1.0


def row(
    camera: complex,
    surfaces: Surfaces,
    *,
    direction: float = 0.0,
    field_of_view: float = 2.0,
    grazing: float = 0.0,
    absent: complex = 0j,
) -> np.ndarray:
    """One scene; surfaces that are not named lie at one place and have no length."""
    names = STRUCTURE.names
    places = [place for name in names for place in surfaces.get(name, (absent, absent))]
    flat = np.array([*places, camera], complex).view(float)
    return np.concatenate([flat, [direction, field_of_view], np.full(STRUCTURE.pads, grazing)])


def families(dtype: str, count: int) -> Iterator[Family]:
    """All families.

    Args:
        dtype: float type for which they are meant.
        count: scenes in each family.
    """
    steps = np.logspace(-1, np.log10(SMALLEST), count)
    for group in (_grazing, _corners, _openings, _limits):
        yield from (_stacked(*parts) for parts in group(steps))
    yield from _sizes(dtype, count)
    yield from degenerate(count)


def _stacked(case: str, rows: Iterable[np.ndarray], *rest: Any) -> Family:
    return Family(case, np.stack(list(rows)), *rest)


def _grazing(steps: np.ndarray) -> Iterator[tuple[Any, ...]]:
    """Heights h above pads and mirrors of length 1, seen from a distance of 1."""

    def post(scene: ExactScene) -> list[Piece]:
        foot = met(scene["p0"], *scene["b0"])
        return direct(scene, (0, foot), (between(scene, "b0")[1], 1))

    def behind(scene: ExactScene) -> list[Piece]:
        near, far = between(scene, "m0")
        return direct(scene, (0, far), (near, 1))

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

    def sharp(scene: ExactScene) -> list[Piece]:
        return direct(scene, (met(scene["p1"], *scene["m0"]), 1), pad=1)

    posts = (
        row(-1 + 1j * h, {"p0": (0, 1), "b0": (0.25 - 1j * h, 0.25 + 0.25j * h)}) for h in steps
    )
    yield "a post on a pad, seen at 1e-1 to 1e-12 rad", posts, post, steps / 4
    for case, side, formula in (
        ("a mirror, seen at 1e-1 to 1e-12 rad", 1, _mirror_view),
        ("a mirror from behind, at 1e-1 to 1e-12 rad", -1, behind),
    ):
        rows = (row(-1 + side * 1j * h, {"m0": (0, 1), "p0": (2, 2 + 4j * h)}) for h in steps)
        yield case, rows, formula, steps / 4
    case = "two mirrors that face each other, 1e-1 to 1e-12 apart"
    yield case, map(facing, steps), channel, steps / 16
    case = "a pad that crosses a mirror at 1e-1 to 1e-12 rad"
    rows = (row(-1 + 1j, {"m0": (0, 4), "p1": (1 - 1j * h, 3 + 1j * h)}) for h in steps)
    yield case, rows, sharp, steps / 16, True, 1 / steps


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


def _corners(steps: np.ndarray) -> Iterator[tuple[Any, ...]]:
    count, touching = len(steps), (np.inf, False)
    rows = (_corner(CORNER, h * (1 + 0.75j)) for h in steps)
    yield "camera to 1e-12 from a corner of mirrors", rows, _in_corner, steps / 4, True, 1 / steps
    ends = 4j * np.exp(1j * np.linspace(-0.1, 0.1, count))
    yield "mirrors that cross", (_corner({**CORNER, "m1": (-e, e)}) for e in ends), _in_corner

    def shared(index: int) -> np.ndarray:
        """Of both mirrors, or of one where it meets the other, the corner is an end."""
        mirrors = {"m0": (-(index % 2), 4), "m1": (-1j * (index % 4 == 2), 4j)}
        return _corner({**CORNER, **mirrors}, absent=(0, 3 + 1j)[index % 3 == 0])

    yield "mirrors that share a corner", map(shared, range(count)), _in_corner, *touching
    places = (1 + 0.75j, 0, 3 + 1j, 2 + 3j, 2 + 1.5j, 4, 1, 2.5 + 2j)
    rows = (_corner(CORNER, absent=places[i % len(places)]) for i in range(count))
    case = "a mirror, a pad and blockers of zero length in the way"
    yield case, rows, _in_corner, *touching
    points = ({"m0": (i / 8, i / 8), "m1": (1j * i, 1j * i)} for i in range(count))
    yield "mirrors of zero length alone", (_corner({**CORNER, **some}) for some in points), whole
    rows = (_corner({**CORNER, "p0": (2 + 1j * i / 8,) * 2}) for i in range(count))
    yield "pads of zero length", rows, nothing


def _openings(steps: np.ndarray) -> Iterator[tuple[Any, ...]]:
    """Slits and shadows of width w."""

    def slit(width: float) -> np.ndarray:
        low, high = (1 - 2j, 1 - 0.5j * width), (1 + 0.5j * width, 1 + 2j)
        return row(0, {"p0": PAD, "b0": low, "b3": high})

    def opening(scene: ExactScene) -> list[Piece]:
        return direct(scene, (between(scene, "b0")[1], between(scene, "b3")[0]))

    yield "a slit of 1e-1 to 1e-12", map(slit, steps), opening, steps / 2
    closed = map(slit, np.append(0.0, -steps[1:]))
    yield "a slit closed by 0 to 1e-1", closed, nothing, np.inf, False
    rows = (row(0, {"p0": PAD, "b0": (1, 1.5 + 1j * width)}) for width in steps)
    yield "a blocker along the line of sight to 1e-12", rows, around, steps / 4


def _limits(steps: np.ndarray) -> Iterator[tuple[Any, ...]]:
    """Fields of view and least grazing angles that open, close or pass half a turn."""

    def at_limits(scene: ExactScene) -> list[Any]:
        return [met(scene["p0"], scene.camera, scene.camera + limit) for limit in scene.limits]

    def within(scene: ExactScene) -> list[Piece]:
        return direct(scene, tuple(at_limits(scene)))

    def away(direction: float, gap: float) -> np.ndarray:
        return row(0, {"p0": PAD}, direction=direction, field_of_view=2 * np.pi - gap)

    def all_but_back(scene: ExactScene) -> list[Piece]:
        last, first = at_limits(scene)
        return direct(scene, (0, first), (last, 1))

    def steep(scene: ExactScene) -> list[Piece]:
        start, end = scene["p0"]
        foot = (scene.camera - start) / (end - start)
        reach = abs(foot.imag) * mpmath.cot(scene.grazing)
        return direct(scene, (foot.real - reach, foot.real + reach))

    rows = (row(0, {"p0": PAD}, direction=0.1, field_of_view=width) for width in steps)
    yield "field of view of 1e-1 to 1e-12 rad", rows, within, steps / 2
    rows = (away(np.pi, gap) for gap in steps)
    yield "field of view to 1e-12 rad from a full turn", rows, all_but_back, steps / 8
    rows = (away(turn, 0.0) for turn in np.linspace(-4, 4, len(steps)))
    yield "field of view of a full turn", rows, whole, np.inf, False
    over = {"p0": (1 + 1j, -1 + 1j)}
    beyond = np.append(0.0, steps[1:]) * np.resize([1, -1], len(steps))
    rows = (row(0, over, field_of_view=np.pi + more) for more in beyond)
    case = "field of view to 1e-12 rad from half a turn, and of half a turn"
    yield case, rows, lambda scene: direct(scene, (0, at_limits(scene)[1]))
    down = {"direction": -np.pi / 2}
    rows = (row(0.1 + 1j, {"p0": (-1, 1)}, **down, grazing=np.pi / 2 - 5 * at) for at in steps)
    yield "least grazing angle to 1e-12 rad from a right angle", rows, steep, steps


def _sizes(dtype: str, count: int) -> Iterator[Family]:
    """The corner, far away, tiny and huge, as far as the float type goes."""
    corner = _corner(CORNER)
    coordinates = np.arange(len(corner)) < STRUCTURE.camera.stop
    decades, far = (150, 1e8) if dtype == "float64" else (15, 1e3)
    scales = np.logspace(-decades, decades, count)[:, None]
    rows = np.where(coordinates, corner * scales, corner)
    yield Family(f"all coordinates 1e-{decades} to 1e{decades}", rows, _in_corner)
    turns = np.linspace(0, 2 * np.pi, count)
    shifts = np.zeros((count, len(corner)))
    shifts[:, 0 : STRUCTURE.camera.stop : 2] = far * np.cos(turns)[:, None]
    shifts[:, 1 : STRUCTURE.camera.stop : 2] = far * np.sin(turns)[:, None]
    yield Family(f"origin {far:.0e} away", corner + shifts, _in_corner)


def degenerate(count: int) -> Iterator[Family]:
    """Degenerate scenes, as many of each; directions and the surfaces that play a part vary."""
    cases: list[tuple[str, Callable[[int], np.ndarray], Formula, float]] = []
    for case, positions in (("line", POSITIONS), ("body", WITHIN)):
        for what, make, formula in (
            ("mirror", _at_mirror, whole),
            ("pad", _at_pad, nothing),
            ("blocker", _at_blocker, whole),
        ):

            def at(i: int, make: Any = make, positions: Sequence[float] = positions) -> np.ndarray:
                return make(i, positions[i % len(positions)])

            cases.append((f"camera on a {what}'s {case}", at, formula, np.inf))
    cases += [
        ("blockers beside a mirror, and from its ends or the pad's", _beside, _mirror_view, np.inf),
        ("a blocker that rises from a mirror's end", _rising, _up_to_post, np.inf),
        ("blockers that coincide", _coinciding, around, np.inf),
        ("all in one point", _one_point, nothing, np.inf),
        ("pads that coincide", _twice, whole, 0.0),
        ("pads that lie on blockers", _on_blocker, whole, 0.0),
    ]
    for case, make, formula, clear in cases:
        yield _stacked(case, map(make, range(count)), formula, clear, False)


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


def _up_to_post(scene: ExactScene) -> list[Piece]:
    view = in_mirror(scene)
    bound = met(scene["p0"], view.source, scene["b0"][1])
    return [*whole(scene), Piece(view.word, view.source, bound, view.end)]


def _beside(index: int) -> np.ndarray:
    camera, *places = _placed(index, 0.5 + 1j, 0, 1, 3 + 2j, -2 + 2j, *BESIDE[index % len(BESIDE)])
    surfaces = {"m0": places[:2], "p0": places[2:4], f"b{index % 4}": places[4:]}
    return row(camera, surfaces, direction=_turn(index), field_of_view=6.0, absent=places[-1])


def _rising(index: int) -> np.ndarray:
    camera, *places = _placed(index, 0.5 + 1j, 0, 1, 3 + 2j, -2 + 2j, 1 + 0.5j)
    surfaces = {"m0": places[:2], "p0": places[2:4], "b0": (places[1], places[4])}
    return row(camera, surfaces, direction=_turn(index), field_of_view=6.0, absent=places[0])


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
