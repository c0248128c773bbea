"""Scenes built in code, one program that sees them all, and the same scenes for other methods.

All scenes but the finger have one structure, so that the engine is compiled once for all tests. A
surface that a scene does not need has no length there.
"""

from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from designopt.solution import Solution
from optics.scene.camera import Camera, KannalaBrandt
from optics.scene.scene import WORLD, Frame, Layout, Scene, Surface
from optics.visibility.coverage import find_views
from optics.visibility.unfolding import paths_of
from optics.visibility.views import Pieces
from studies.oracles.rays import Fans, Structure
from studies.oracles.scenes import rounded

LAYOUT = Layout(
    name="test",
    mirrors=(Surface("left", 1, 0), Surface("both", 0), Surface("right", -1, 0)),
    curved=(),
    pads=(Surface("left", 1), Surface("both", 0, 1), Surface("right", -1)),
    blockers=(
        Surface("left", 1, 1),
        Surface("wall", 0),
        Surface("lid", 0),
        Surface("right", -1, 1),
    ),
    frames=(Frame("first", WORLD, 0, 1), Frame("second", 0, 1, -1)),
    angles=("bend", "curl"),
    camera_frame=0,
    bounces=2,
)

MIRRORS, PADS, SURFACES = len(LAYOUT.mirrors), len(LAYOUT.pads), len(LAYOUT.surfaces)
LEFT, BOTH, RIGHT = range(3)
"""The mirrors, and the pads, by the side that reflects or senses."""

WORDS = paths_of(LAYOUT, LAYOUT.bounces)
DIRECT = WORDS.index(())

Segment = Sequence[Sequence[float]]


class Case(NamedTuple):
    """The numbers of a scene of `LAYOUT` in a pose, or of a batch of them.

    Attributes:
        ends: of all surfaces, shape (surfaces, 2, 2).
        position: of the camera.
        direction: of its axis.
        field_of_view: of the camera.
        coefficients: of its projection.
        grazing: least grazing angles of the pads.
        hinges: of the frames.
        angles: of the joints.
    """

    ends: Any
    position: Any
    direction: Any
    field_of_view: Any
    coefficients: Any
    grazing: Any
    hinges: Any
    angles: Any


PIXELS = 1000.0


def scene_of(case: Case) -> Scene:
    """The scene of a single case, in the reference pose."""
    mirrors, pads, blockers = jnp.split(jnp.asarray(case.ends), [MIRRORS, MIRRORS + PADS])
    projection = KannalaBrandt(case.coefficients)
    camera = Camera(case.position, case.direction, case.field_of_view, PIXELS, projection)
    none = jnp.zeros(0)
    return Scene(
        camera,
        mirrors,
        none,
        none,
        pads,
        jnp.asarray(case.grazing),
        blockers,
        jnp.asarray(case.hinges),
        LAYOUT,
    )


def made_pieces(start: Any, end: Any, path: Any, reflections: int = 0, **fields: Any) -> Pieces:
    """Pieces by hand: where they begin and end (elsewhere there are none), paths, other fields."""
    start, end = jnp.asarray(start, float), jnp.asarray(end, float)
    none, pair = jnp.zeros(start.shape, int), jnp.zeros((*start.shape, 2))
    given = {"present": end > start, "path": jnp.asarray(path), "start": start, "end": end}
    given |= {"start_label": none, "end_label": none, "pixels": pair, "px_per_mm": pair}
    given |= {"distance": pair, "spans": jnp.zeros((*start.shape, reflections, 2))}
    return Pieces(**(given | fields))


def random_cases(seed: int, count: int) -> Case:
    """Segments, camera and pose at random; seen and hidden views of every kind occur."""
    rng = np.random.default_rng(seed)
    center = rng.uniform(-1, 1, (count, SURFACES, 1, 2))
    turn = rng.uniform(0, 2 * np.pi, (count, SURFACES, 1, 1))
    longest = np.repeat([0.9, 0.6, 0.3], [MIRRORS, PADS, SURFACES - MIRRORS - PADS])
    half = rng.uniform(0.1, 1, (count, SURFACES, 1, 1)) * longest[:, None, None]
    arrow = half * np.concatenate([np.cos(turn), np.sin(turn)], axis=-1)
    return Case(
        ends=np.concatenate([center - arrow, center + arrow], axis=2),
        position=rng.uniform(-1, 1, (count, 2)),
        direction=rng.uniform(-np.pi, np.pi, count),
        field_of_view=rng.uniform(0.5, 6.2, count),
        coefficients=rng.uniform(-0.01, 0.01, (count, 4)) * [1, 0.1, 0.01, 0.001],
        grazing=rng.uniform(0.01, 0.2, (count, PADS)),
        hinges=rng.uniform(-0.3, 0.3, (count, 2, 2)),
        angles=rng.uniform(-np.pi, np.pi, (count, 2)),
    )


def case_of(
    position: Sequence[float] = (0, 0),
    direction: float = 0.0,
    field_of_view: float = np.pi,
    *,
    mirrors: Mapping[str, Segment] | None = None,
    pads: Mapping[str, Segment] | None = None,
    blockers: Mapping[str, Segment] | None = None,
    grazing: float = 0.0,
) -> Case:
    """A scene by hand in the reference pose, with an equidistant lens; surfaces by their names."""
    ends = np.tile(np.asarray(position, float), (SURFACES, 2, 1))
    first = 0
    for given, known in (
        (mirrors, LAYOUT.mirrors),
        (pads, LAYOUT.pads),
        (blockers, LAYOUT.blockers),
    ):
        names = [surface.name for surface in known]
        for name, segment in (given or {}).items():
            ends[first + names.index(name)] = segment
        first += len(known)
    return Case(
        ends,
        np.asarray(position, float),
        np.asarray(float(direction)),
        np.asarray(float(field_of_view)),
        np.zeros(4),
        np.full(PADS, float(grazing)),
        np.zeros((2, 2)),
        np.zeros(2),
    )


def batch_of(cases: Sequence[Case]) -> Case:
    """Single cases as a batch."""
    return jax.tree.map(lambda *leaves: np.stack(leaves), *cases)


def item(tree: Any, index: Any) -> Any:
    """Some of a batch, or one of it."""
    return jax.tree.map(lambda leaf: leaf[index], tree)


Weights = dict[str, Any]


class Answers(NamedTuple):
    """What the engine says of a batch of cases, in NumPy.

    Attributes:
        views: the answer itself.
        ok: which views succeeded, shape (cases, paths, pads).
        numbers: all its floating-point results by name.
        seen: part of each pad seen by each path, shape (cases, paths, pads).
        slopes: derivative of the weighted sum of the numbers with respect to the case.
    """

    views: Solution[Pieces]
    ok: Any
    numbers: dict[str, Any]
    seen: Any
    slopes: Case

    @property
    def pieces(self) -> Pieces:
        """The pieces."""
        return self.views.value

    @property
    def messages(self) -> list[str]:
        """Why nothing is seen, of every view."""
        return jax.tree.map(jnp.asarray, self.views).messages()


BATCH = 16
"""Cases per run: a program for every size would be compiled anew, and one case alone is as dear."""


def answers(cases: Case, weights: Weights | None = None) -> Answers:
    """What the engine says of a batch of cases.

    Args:
        cases: the batch.
        weights: of the results named, one for each case; the others weigh nothing.
    """
    count = len(cases.direction)
    given = weights or {}
    full = {
        name: given.get(name, np.broadcast_to(0.0, (count, *shape)))
        for name, shape in shapes().items()
    }
    parts = []
    for first in range(0, count, BATCH):
        which = np.arange(first, first + BATCH).clip(max=count - 1)
        part = _answers(*item((cases, full), which))
        parts.append(item(jax.tree.map(np.asarray, part), np.arange(min(BATCH, count - first))))
    return jax.tree.map(lambda *leaves: np.concatenate(leaves), *parts)


@cache
def shapes() -> dict[str, tuple[int, ...]]:
    """Shapes of the named results of one case."""
    case = item(random_cases(0, 1), 0)
    numbers = jax.eval_shape(lambda case: _answer(case)[1].numbers, case)
    return {name: number.shape for name, number in numbers.items()}


def _answer(case: Case, weights: Weights | None = None) -> tuple[Array, Answers]:
    views = find_views(scene_of(case), case.angles)
    pieces = views.value
    numbers = {
        "coverage": pieces.coverage(),
        "redundancy": pieces.redundancy(),
        "margin": views.margin,
        "ends": jnp.stack([pieces.start, pieces.end], axis=-1),
        "pixels": pieces.pixels,
        "px_per_mm": pieces.px_per_mm,
        "distance": pieces.distance,
        "spans": pieces.spans,
    }
    seen = jnp.stack([pieces.seen(path) for path in range(len(WORDS))])
    total = sum(
        (jnp.sum(weight * numbers[name]) for name, weight in (weights or {}).items()),
        jnp.zeros_like(case.direction),
    )
    return total, Answers(views, views.ok, numbers, seen, case)


def answers_traced(cases: Case, weights: Weights) -> Answers:
    """As `answers`, to be compiled: for all weights, and a batch of any size."""

    def one(case: Case, weights: Weights) -> Answers:
        slopes, answer = jax.grad(_answer, has_aux=True)(case, weights)
        return answer._replace(slopes=slopes)

    return jax.vmap(one)(cases, weights)


_answers = jax.jit(answers_traced)


class Posed(NamedTuple):
    """A scene in a pose, for methods that are not the library's; its fields are those of `Fans`.

    Attributes:
        ends: of all surfaces, complex, shape (surfaces, 2).
        position: of the camera, complex.
        direction: of its axis, rad.
        field_of_view: of the camera, rad.
        grazing: least grazing angles of the pads, rad.
    """

    ends: np.ndarray
    position: complex
    direction: float
    field_of_view: float
    grazing: np.ndarray


def posed(scene: Scene, angles: Any) -> Posed:
    """A scene in a pose, placed in 50 digits (`studies.oracles.scenes`)."""
    plain = rounded(scene, angles)
    ends, grazing = np.array(plain.surfaces.ends), np.array(plain.surfaces.grazing, float)
    return Posed(ends, plain.camera, float(np.angle(plain.axis)), 2 * plain.half, grazing)


def pairs(places: Any) -> np.ndarray:
    """The x and y of complex numbers."""
    return np.stack([np.real(places), np.imag(places)], axis=-1)


def structure_of(layout: Layout) -> Structure:
    """What a layout is to the oracle that shoots rays."""
    return Structure(len(layout.mirrors), len(layout.pads), tuple(layout.sides.tolist()))


def fans_of(scenes: Sequence[Posed]) -> Fans:
    """Scenes in their poses, for the oracle that shoots rays."""
    ends, position, *others = (np.stack(parts) for parts in zip(*scenes, strict=True))
    return Fans(pairs(ends), pairs(position), *others)


def posed_cases(cases: Case) -> list[Posed]:
    """The cases of a batch, each in its pose."""
    return [
        posed(scene_of(case), case.angles)
        for case in (item(cases, i) for i in range(len(cases.direction)))
    ]


def mirrored(place: Any, mirror: np.ndarray) -> Any:
    """Image of places in the line through two others; all are complex numbers."""
    start, step = mirror[0], mirror[1] - mirror[0]
    return start + np.conj((place - start) / step) * step
