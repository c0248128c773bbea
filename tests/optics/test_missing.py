"""By how much pads are missed: against a scan over directions, and as a way to see them."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from optics import find_views, parse_scene
from tests.optics.scenes import (
    LAYOUT,
    MIRRORS,
    PADS,
    SURFACES,
    WORDS,
    Case,
    Posed,
    answers,
    item,
    mirrored,
    posed_cases,
    random_cases,
)

ROUNDING = 1e-12
"""A few units of rounding of angles, enlarged by near and by short surfaces."""

DIRECTIONS = np.linspace(-np.pi, np.pi, 20_001)
"""From the virtual camera, counted from the middle of what is in front of the last mirror."""

STEP = DIRECTIONS[1] - DIRECTIONS[0]
"""A gap is twice as wide as its middle is far from what must not be met. This distance changes no
faster than the direction, so the best of all is at most half a step better than the best sample."""


def left_by(places: Any, line: np.ndarray) -> Any:
    """Positive left of the line through two places; all are complex numbers."""
    return ((places - line[0]) * np.conj(line[1] - line[0])).imag


def part_beside(segment: np.ndarray | None, line: np.ndarray, side: float) -> np.ndarray | None:
    """The part of a segment on one side (+1 left, −1 right) of the line through two places."""
    if segment is None:
        return None
    start, end = side * left_by(segment, line)
    if max(start, end) <= 0:
        return None
    meeting = segment[0] + (segment[1] - segment[0]) * start / (start - end) if start != end else 0
    return np.array([segment[0] if start >= 0 else meeting, segment[1] if end >= 0 else meeting])


class View(NamedTuple):
    """One pad by one path, all of it mirrored behind the last mirror one mirror after the other."""

    case: Posed
    word: Sequence[int]
    pad: int

    @property
    def mirrors(self) -> list[np.ndarray]:
        """Ends of the mirrors along the path."""
        return [self.case.ends[mirror] for mirror in self.word]

    @property
    def sources(self) -> list[complex]:
        """The camera and its images, one for every leg."""
        found = [self.case.position]
        for mirror in self.mirrors:
            found.append(mirrored(found[-1], mirror))
        return found

    def behind(self, places: Any, leg: int) -> Any:
        """Places of a leg behind the last mirror."""
        for mirror in self.mirrors[leg:]:
            places = mirrored(places, mirror)
        return places

    def side_of(self, order: int) -> float:
        """On which side (+1 left, −1 right) of a mirror the view comes to it."""
        return np.sign(left_by(self.sources[order], self.mirrors[order]))

    @property
    def surface(self) -> np.ndarray:
        return self.case.ends[MIRRORS + self.pad]

    def shown(self, surface: int, leg: int) -> np.ndarray | None:
        """The part of a surface on a leg in front of the mirrors that begin and end that leg."""
        part = self.case.ends[surface]
        for order in (leg - 1, leg):
            if 0 <= order < len(self.word):
                part = part_beside(part, self.mirrors[order], self.side_of(order))
        return part

    def blockers(self) -> list[np.ndarray]:
        """What of surfaces stands in the way before the pad's line."""
        word, sources, found = self.word, self.sources, []
        above = np.sign(left_by(sources[-1], self.surface))
        for leg, source in enumerate(sources):
            apart = {*word[max(leg - 1, 0) : leg + 1]}
            if leg == len(word):
                apart.add(MIRRORS + self.pad)
            for surface in set(range(SURFACES)) - apart:
                passes = np.sign(left_by(source, self.case.ends[surface])) != LAYOUT.sides[surface]
                part = self.shown(surface, leg)
                if part is not None and not (LAYOUT.one_way[surface] and passes):
                    found.append(part_beside(self.behind(part, leg), self.surface, above))
        return [part for part in found if part is not None]


def seen_from(source: complex, segment: np.ndarray) -> tuple[complex, float]:
    """The direction of a segment's middle and half the angle that it takes."""
    first, last = segment - source
    half = np.angle(last / first) / 2
    return first * np.exp(1j * half), abs(half)


def rise(over: np.ndarray, other: np.ndarray, side: float) -> float:
    """Angle at a segment's first end by which another, in part, rises above its line."""
    arrows = (other - over[0]) * np.conj(over[1] - over[0])
    return float(np.arctan2(side * arrows.imag, np.abs(arrows.real)).max())


def elevation(view: View) -> float:
    """The least by which mirrors and pad rise above the lines of mirrors that they must clear."""
    found = [np.pi / 2]
    for leg, mirror in enumerate(view.mirrors, start=1):
        over = view.behind(mirror, leg)
        beyond = -np.sign(left_by(view.sources[-1], over))
        if leg == len(view.word):
            found.append(rise(over, view.surface, beyond))
        else:
            next_one = view.behind(view.mirrors[leg], leg)
            before = np.sign(left_by(view.sources[-1], next_one))
            found += [rise(over, next_one, beyond), rise(next_one, over, before)]
    return min(found)


def best_sampled(view: View) -> float:
    """The width of the gap about the best of many directions, between all that must not be met."""
    case, pad, source = view.case, view.surface, view.sources[-1]
    above = np.sign(left_by(source, pad))
    side = LAYOUT.sides[MIRRORS + view.pad]
    shown = view.shown(MIRRORS + view.pad, len(view.word))
    assert shown is not None
    middle, half = seen_from(source, shown)
    must = [(middle, half if side in (0, above) else -half)]
    foot = -1j * above * (pad[1] - pad[0])
    must.append((foot, np.pi / 2 - case.grazing[view.pad]))
    avoid = []
    axis = view.behind(case.position + np.exp(1j * case.direction), 0) - source
    if case.field_of_view <= np.pi:
        must.append((axis, case.field_of_view / 2))
    else:
        avoid.append((-axis, np.pi - case.field_of_view / 2))
    for order, mirror in enumerate(view.word):
        part = view.mirrors[order]
        for other in (order - 1, order + 1):
            if 0 <= other < len(view.word):
                part = part_beside(part, view.mirrors[other], view.side_of(other))
        assert part is not None
        towards, half = seen_from(source, view.behind(part, order + 1))
        away = LAYOUT.sides[mirror] == -view.side_of(order)
        must.append((towards, -half if away else half))
    avoid += [seen_from(source, part) for part in view.blockers()]
    best = np.full(DIRECTIONS.shape, np.inf)
    for intervals, sign in ((must, 1), (avoid, -1)):
        for towards, half in intervals:
            inside = half - np.abs(DIRECTIONS - np.angle(towards / middle))
            best = np.minimum(best, sign * inside)
    return 2 * float(best.max())


@pytest.mark.parametrize(
    ("seed", "count"), [(30, 6), pytest.param(31, 500, marks=pytest.mark.nightly)]
)
def test_margins_are_those_of_the_best_of_many_directions(seed, count):
    cases = random_cases(seed, count)
    found, posed = answers(cases), posed_cases(cases)
    cleared = 0
    for i, path, pad in np.ndindex(count, len(WORDS), PADS):
        view, margin = View(posed[i], WORDS[path], pad), found.views.margin[i, path, pad]
        rises = elevation(view)
        if rises < 0:
            assert margin <= rises + ROUNDING
            continue
        cleared += 1
        sampled = best_sampled(view)
        assert sampled - ROUNDING <= margin <= sampled + STEP + ROUNDING, (i, path, pad)
    assert cleared > count * len(WORDS) * PADS / 2


def test_margins_are_positive_where_a_view_succeeds():
    found = answers(random_cases(32, 64))
    clear = np.abs(found.views.margin) > ROUNDING
    np.testing.assert_array_equal(found.ok[clear], found.views.margin[clear] > 0)
    assert found.ok.sum() > 50


@pytest.mark.parametrize("least", [0.0, 5.0], ids="least grazing {}°".format)
@pytest.mark.parametrize(("field", "axis"), [(170, 80), (220, 105), (360, 180)])
def test_a_pad_in_line_with_the_camera_is_missed_as_one_beside_it(field, axis, least):
    # It appears under no angle, and the axis may point away from it.
    camera = {"position": [0.0, 0.0], "direction_deg": axis, "fov_deg": field, "pixels": 1000}
    pad = {"name": "p", "from": [10.0, 0.0], "to": [20.0, 0.0], "side": "left"}
    tables = {
        "camera": camera | {"projection": "equidistant"},
        "pads": [pad | {"min_grazing_deg": least}],
    }
    scene = parse_scene(tables)

    def margin(height: jax.Array) -> jax.Array:
        place = replace(scene.camera, position=jnp.stack([jnp.zeros_like(height), height]))
        return find_views(replace(scene, camera=place), jnp.zeros(0)).margin[0, 0]

    heights = jnp.array([-1e-9, 0.0, 1e-9])
    margins, slopes = jax.jit(jax.vmap(jax.value_and_grad(margin)))(heights)
    np.testing.assert_allclose(margins, np.full(3, -np.deg2rad(least)), atol=1e-9)
    # A least angle leaves a kink; its slope is that of one side, or between them.
    assert slopes[0] - 1e-6 <= slopes[1] <= slopes[2] + 1e-6


GOAL, STEPS, VIEWS = 0.1, 20, 64
"""Where the steps aim, rad, how many they are, and how many hidden views they start from."""

OPENED = [0.9, 0.7, 0.3]
"""Least share of views that open, direct and by one and two mirrors."""

FREE = ("ends", "position", "direction", "field_of_view")
"""What they move."""


def test_the_derivative_of_the_margin_leads_to_a_view():
    # Steps as B. T. Polyak's for functions with kinks (USSR Computational Mathematics and
    # Mathematical Physics 9, 1969): along the derivative, so far that it would reach the goal were
    # the margin linear. It is not concave, so that not all of them arrive.
    cases, rng = random_cases(40, 64), np.random.default_rng(40)
    hidden = np.argwhere(~answers(cases).ok)
    hidden = hidden[rng.choice(len(hidden), VIEWS, replace=False)]
    cases, left = item(cases, hidden[:, 0]), hidden
    for _ in range(STEPS):
        views = np.arange(len(left)), left[:, 1], left[:, 2]
        weights = np.zeros((len(left), len(WORDS), PADS))
        weights[views] = 1
        found = answers(cases, {"margin": weights})
        assert all(np.isfinite(slope).all() for slope in found.slopes)
        closed = ~found.ok[views]
        wanted = GOAL - np.asarray(found.views.margin[views])
        cases = item(stepped(cases, found.slopes, wanted), closed)
        left = left[closed]
    lengths = np.array([len(word) for word in WORDS])
    first, last = (np.bincount(lengths[paths], minlength=3) for paths in (hidden[:, 1], left[:, 1]))
    shares = 1 - last / first
    assert (shares >= OPENED).all(), shares


def stepped(cases: Case, slopes: Case, wanted: np.ndarray) -> Case:
    """The cases moved along slopes, by what would change the margin as wanted were it linear."""
    rows = [getattr(slopes, name).reshape(len(wanted), -1) for name in FREE]
    squares = np.sum(np.concatenate(rows, axis=1) ** 2, axis=1)
    lengths = wanted / np.where(squares > 0, squares, 1)

    def moved(name: str) -> np.ndarray:
        slope = getattr(slopes, name)
        return getattr(cases, name) + lengths.reshape(-1, *[1] * (slope.ndim - 1)) * slope

    return cases._replace(**{name: moved(name) for name in FREE})
