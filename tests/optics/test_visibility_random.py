"""Random scenes against an independent ray shooter, step by step, moved, scaled and mirrored."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from optics.visibility import coverage
from optics.visibility.coverage import find_coverage
from optics.visibility.views import Pieces
from studies.oracles.rays import bounds, find_runs
from tests.optics.scenes import (
    DIRECT,
    LAYOUT,
    MIRRORS,
    PADS,
    PIXELS,
    SURFACES,
    WORDS,
    Answers,
    Case,
    Images,
    Posed,
    answers,
    fans_of,
    item,
    posed_cases,
    random_cases,
    scene_of,
    structure_of,
)

ROUNDING = 1e-10
"""A few units of rounding of coordinates of order one, enlarged by short pads and small angles."""

SLOPE_ROUNDING = 1e-6
"""The same of a difference quotient whose step is a cube root of rounding."""

RAYS, MORE = 2000, 200
"""A view between two rays may be missed; then as many times more rays have to find it."""

STRUCTURE = structure_of(LAYOUT)
assert STRUCTURE.words(LAYOUT.bounces) == WORDS

LENGTHS = np.array([len(word) for word in WORDS])


class Sample(NamedTuple):
    """Random scenes, what the library says of them, and the same for other methods."""

    cases: Case
    answers: Answers
    posed: list[Posed]


@cache
def sample(seed: int = 0, count: int = 128) -> Sample:
    cases = random_cases(seed, count)
    return Sample(cases, answers(cases), posed_cases(cases))


def misses(drawn: Sample, scenes: np.ndarray, rays: int) -> np.ndarray:
    """By how much the parts seen, by any and by every path, exceed the bounds of shot rays."""
    shot = bounds(STRUCTURE, fans_of(drawn.posed).part(scenes), rays, LAYOUT.bounces)
    worst = np.zeros(len(scenes))
    for (least, most), said in (
        (shot.coverage[:, -1], drawn.answers.numbers["coverage"]),
        (shot.seen, drawn.answers.seen),
    ):
        beyond = np.maximum(least - said[scenes], said[scenes] - most)
        worst = np.maximum(worst, beyond.reshape(len(scenes), -1).max(axis=1))
    return worst


@pytest.mark.parametrize(
    ("seed", "count"),
    [
        (0, 128),
        *(pytest.param(seed, 2048, marks=pytest.mark.nightly) for seed in range(1, 5)),
    ],
)
def test_what_is_seen_lies_between_the_bounds_of_shot_rays(seed, count):
    drawn, scenes = sample(seed, count), np.arange(count)
    assert drawn.answers.numbers["coverage"].max() > 0.5
    for rays in (RAYS, MORE * RAYS):
        scenes = scenes[misses(drawn, scenes, rays) > ROUNDING]
    assert scenes.size == 0, scenes


@jax.jit
def direct(cases: Case) -> jax.Array:
    return jax.vmap(lambda case: find_coverage(scene_of(case), case.angles, bounces=0).value)(cases)


def test_fewer_reflections_leave_the_other_views_as_they_are():
    np.testing.assert_allclose(
        direct(sample().cases), sample().answers.seen[:, DIRECT], atol=ROUNDING
    )


def test_many_poses_go_in_blocks_and_give_what_each_gives_alone(monkeypatch):
    case, poses = item(sample().cases, 0), sample().cases.angles
    monkeypatch.setattr(coverage, "TABLE", 5000)  # a block of 13 poses
    find = jax.jit(lambda poses: find_coverage(scene_of(case), poses, bounces=0).value)
    together = find(poses.reshape(2, -1, 2)).reshape(-1, PADS)
    same = jax.tree.map(lambda leaf: np.broadcast_to(leaf, (len(poses), *np.shape(leaf))), case)
    np.testing.assert_allclose(together, direct(same._replace(angles=poses)), atol=ROUNDING)
    assert np.ptp(together) > 0.1


class Seen(NamedTuple):
    """One piece that is seen.

    Attributes:
        at: indices of its scene, pad and place among the pieces.
        word: the mirrors that show it.
        case: its scene.
        piece: itself.
    """

    at: tuple[int, int, int]
    word: tuple[int, ...]
    case: Posed
    piece: Pieces

    def pad(self) -> np.ndarray:
        return self.case.complex_ends[MIRRORS + self.at[1]]

    def place(self, coordinate: Any) -> complex:
        """A place on the pad."""
        start, end = self.pad()
        return start + coordinate * (end - start)

    def virtual(self, place: complex) -> complex:
        """Mirrored in all mirrors of the path, one after the other."""
        return Images(self.case.complex_ends, place, self.word).sources[-1]

    def angle(self, coordinate: Any) -> float:
        """Of the ray to a place of the pad: from the axis, counter-clockwise at the camera."""
        position = self.case.complex_position
        eye, ahead = (
            self.virtual(z) for z in (position, position + np.exp(1j * self.case.direction))
        )
        turn = np.angle((self.place(coordinate) - eye) / (ahead - eye))
        return float(turn) * (-1) ** len(self.word)


def all_seen() -> Iterator[Seen]:
    drawn = sample()
    pieces = drawn.answers.pieces
    for at in np.argwhere(pieces.present).tolist():
        piece = item(pieces, tuple(at))
        scene, pad, place = at
        yield Seen((scene, pad, place), WORDS[int(piece.path)], drawn.posed[scene], piece)


def test_paths_of_every_length_are_seen():
    counts = np.bincount([len(seen.word) for seen in all_seen()])
    assert (counts > 5).all(), counts


def test_rays_to_the_ends_of_views_go_step_by_step_where_they_should():
    for seen in all_seen():
        ends = seen.case.complex_ends
        for k, coordinate in enumerate((seen.piece.start, seen.piece.end)):
            place, length = seen.case.complex_position, 0.0
            heading = np.exp(1j * (seen.case.direction + seen.angle(coordinate)))
            for i, surface in enumerate((*seen.word, MIRRORS + seen.at[1])):
                start, end = ends[surface]
                across = ((end - start) * np.conj(heading)).imag
                at = -((start - place) * np.conj(heading)).imag / across
                hit = start + at * (end - start)
                length += abs(hit - place)
                wanted = seen.piece.spans[i, k] if i < len(seen.word) else coordinate
                # A ray at a small angle to the surface magnifies the rounding of its heading.
                spread = abs(hit - place) / abs(across) + abs(end - start) / abs(across)
                assert abs(at - wanted) <= ROUNDING * max(1.0, spread), seen.at
                place = start + wanted * (end - start)
                turn = (end - start) / abs(end - start)
                heading = turn**2 * np.conj(heading)
            np.testing.assert_allclose(seen.piece.distance[k], length, rtol=1e-9)
            unused = seen.piece.spans[len(seen.word) :, k]
            np.testing.assert_array_equal(unused, 0)


def lens(case: Case, angle: float) -> float:
    """Image height at an angle, in focal lengths: the polynomial of Kannala and Brandt."""
    return angle * (1 + np.dot(case.coefficients, np.power(angle, [2, 4, 6, 8])))


def pixel(seen: Seen, coordinate: Any) -> float:
    case = item(sample().cases, seen.at[0])
    focal = PIXELS / 2 / lens(case, case.field_of_view / 2)
    return PIXELS / 2 - focal * lens(case, seen.angle(coordinate))


def test_pixels_are_those_of_the_virtual_camera():
    for seen in all_seen():
        wanted = [pixel(seen, at) for at in (seen.piece.start, seen.piece.end)]
        np.testing.assert_allclose(seen.piece.pixels, wanted, atol=PIXELS * ROUNDING)


def test_pixels_per_mm_is_how_fast_the_pixel_moves_along_the_pad():
    for seen in all_seen():
        start, end = seen.pad()
        eye = seen.virtual(seen.case.complex_position)
        above = abs(((eye - start) * np.conj(end - start)).imag) / abs(end - start)
        step = np.finfo(float).eps ** (1 / 3) * above
        for k, at in enumerate((seen.piece.start, seen.piece.end)):
            move = step / abs(end - start)
            slope = abs(pixel(seen, at + move) - pixel(seen, at - move)) / (2 * step)
            # Rounding of the angle, as the step and the grazing angle enlarge it.
            distance = abs(seen.place(at) - eye)
            rounding = SLOPE_ROUNDING * max(1.0, (distance / above) ** 2)
            np.testing.assert_allclose(seen.piece.px_per_mm[k], slope, rtol=rounding)


def test_a_ray_to_the_middle_of_every_view_arrives():
    every, rays = [*all_seen()], []
    for seen in every:
        angle = seen.angle((float(seen.piece.start) + float(seen.piece.end)) / 2)
        ray = {"direction": seen.case.direction + angle, "field_of_view": 1e-15}
        rays.append(seen.case._replace(**ray))
    runs = find_runs(STRUCTURE, fans_of(rays), 2, LAYOUT.bounces)
    np.testing.assert_array_equal(runs.scene, np.arange(len(every)))
    np.testing.assert_array_equal(runs.path, [seen.piece.path for seen in every])
    np.testing.assert_array_equal(runs.pad, [seen.at[1] for seen in every])


def by_path(pieces: Pieces) -> Pieces:
    """The pieces of each pad, ordered by path and then by where they begin; absent ones last."""
    order = np.lexsort((pieces.start, pieces.path, ~pieces.present))

    def ordered(leaf: np.ndarray) -> np.ndarray:
        index = order.reshape(order.shape + (1,) * (leaf.ndim - order.ndim))
        return np.take_along_axis(leaf, index, axis=2)

    return jax.tree.map(ordered, pieces)


def assert_same(found: Answers, wanted: Answers) -> None:
    """The same views."""
    clear = np.abs(wanted.views.margin) > ROUNDING
    np.testing.assert_array_equal(found.ok[clear], wanted.ok[clear])
    np.testing.assert_allclose(
        found.views.margin[wanted.ok], wanted.views.margin[wanted.ok], atol=ROUNDING
    )
    for name in ("coverage", "redundancy"):
        np.testing.assert_allclose(found.numbers[name], wanted.numbers[name], atol=ROUNDING)
    np.testing.assert_allclose(found.seen, wanted.seen, atol=ROUNDING)
    mine, theirs = by_path(found.pieces), by_path(wanted.pieces)
    np.testing.assert_array_equal(mine.present, theirs.present)
    np.testing.assert_array_equal(mine.path, theirs.path)
    for name in ("start", "end", "spans", "pixels", "distance", "px_per_mm"):
        number = np.asarray(getattr(theirs, name))
        relative = ROUNDING * np.maximum(1, np.abs(number))
        assert (np.abs(getattr(mine, name) - number) <= relative).all(), name


def test_moved_and_turned_the_scene_looks_the_same():
    cases, angle, shift = sample().cases, 0.7, np.array([3.0, -2.0])
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    moved = {name: getattr(cases, name) @ turn + shift for name in ("ends", "position", "hinges")}
    found = answers(cases._replace(**moved, direction=cases.direction + angle))
    assert_same(found, sample().answers)

    assert_as_far_away(found, sample().answers)


def assert_as_far_away(found: Answers, wanted: Answers) -> None:
    """What is hidden is hidden by as much.

    Not if surfaces are turned round: by how much a mirror is missed is counted at its first end.
    """
    np.testing.assert_allclose(found.views.margin, wanted.views.margin, atol=ROUNDING)


KINDS = np.split(np.arange(SURFACES), [MIRRORS, MIRRORS + PADS])
BACKWARDS = np.concatenate([kind[::-1] for kind in KINDS])
"""The surfaces of each kind in reverse order, which is that of swapped sides: see `LAYOUT`."""

PATHS_BACKWARDS = [WORDS.index(tuple(MIRRORS - 1 - m for m in word)) for word in WORDS]


def in_reverse_order(found: Answers) -> Answers:
    """What is said of a scene whose surfaces are in reverse order, in the order of the original."""

    def reordered(leaf: np.ndarray) -> np.ndarray:
        if leaf.shape[1:3] == (len(WORDS), PADS):
            return leaf[:, PATHS_BACKWARDS, ::-1]
        return leaf[:, ::-1]

    path = np.array(PATHS_BACKWARDS)[found.pieces.path]
    path = np.where(found.pieces.present, path, 0)
    found = with_pieces(found, path=path)
    views, ok, numbers, seen = jax.tree.map(reordered, found[:-1])
    return Answers(views, ok, numbers, seen, found.slopes)


def with_pieces(found: Answers, **fields: np.ndarray) -> Answers:
    """The same with other pieces."""
    names = list(fields)
    return eqx.tree_at(
        lambda answer: [getattr(answer.pieces, name) for name in names],
        found,
        [fields[name] for name in names],
    )


def test_surfaces_turned_round_with_swapped_sides_look_the_same():
    cases = sample().cases
    found = in_reverse_order(
        answers(cases._replace(ends=cases.ends[:, BACKWARDS, ::-1], grazing=cases.grazing[:, ::-1]))
    )
    pieces = found.pieces
    there, both = pieces.present, pieces.present[..., None]
    used = np.arange(2)[:, None] < LENGTHS[pieces.path][..., None, None]
    turned = with_pieces(
        found,
        start=np.where(there, 1 - pieces.end, 0),
        end=np.where(there, 1 - pieces.start, 0),
        spans=np.where(both[..., None] & used, 1 - pieces.spans[..., ::-1], 0),
        **{name: getattr(pieces, name)[..., ::-1] for name in ("pixels", "px_per_mm", "distance")},
    )
    assert_same(turned, sample().answers)


def test_in_a_mirror_the_scene_is_imaged_in_reverse():
    cases, flip = sample().cases, np.array([1.0, -1.0])
    image = cases._replace(
        ends=cases.ends[:, BACKWARDS] * flip,
        position=cases.position * flip,
        hinges=cases.hinges * flip,
        direction=-cases.direction,
        angles=-cases.angles,
    )
    # Grazing angles belong to the pads.
    found = in_reverse_order(answers(image._replace(grazing=cases.grazing[:, ::-1])))
    there = found.pieces.present[..., None]
    reversed_pixels = np.where(there, PIXELS - found.pieces.pixels, 0)
    assert_same(with_pieces(found, pixels=reversed_pixels), sample().answers)
    assert_as_far_away(found, sample().answers)
    assert LAYOUT.sides[BACKWARDS].tolist() == (-LAYOUT.sides).tolist()


@jax.jit
def covered(cases: Case, angles: jax.Array) -> tuple[jax.Array, Case]:
    """Coverage of all pads of a batch, by itself, and the derivatives of its sum."""

    def total(case: Case, angles: jax.Array) -> tuple[jax.Array, jax.Array]:
        found = find_coverage(scene_of(case), angles)
        return jnp.sum(found.value), found.value

    slopes, coverage = jax.vmap(jax.grad(total, has_aux=True))(cases, angles)
    return coverage, slopes


def test_coverage_alone_is_that_of_the_views():
    cases = item(sample().cases, np.arange(64))
    given = answers(cases, {"coverage": np.ones((64, PADS))})
    found, slopes = covered(jax.tree.map(jnp.asarray, cases), jnp.asarray(cases.angles))
    np.testing.assert_allclose(found, given.numbers["coverage"], atol=ROUNDING)
    wanted = given.slopes._replace(angles=np.zeros_like(cases.angles))
    for slope, other in zip(jax.tree.leaves(slopes), jax.tree.leaves(wanted), strict=True):
        np.testing.assert_allclose(slope, other, rtol=1e-9, atol=1e-9)
