"""Random scenes against an independent ray shooter, which follows rays to the ends of views too."""

import itertools
from functools import cache
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from optics.visibility import coverage
from optics.visibility.coverage import find_coverage
from studies.oracles.rays import bounds, follow
from tests.helpers import assert_same
from tests.optics.scenes import (
    DIRECT,
    LAYOUT,
    MIRRORS,
    PADS,
    WORDS,
    Answers,
    Case,
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

STEP = 1e-6
"""Of central differences, rad; they err by no more of themselves."""

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
    [(0, 128), *(pytest.param(seed, 2048, marks=pytest.mark.nightly) for seed in range(1, 5))],
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


@jax.jit
@jax.vmap
def camera_of(case: Case, pixel: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Angle of the ray to a pixel, and pixels per rad there."""
    camera = scene_of(case).camera
    angle = camera.angle(pixel)
    return angle, camera.pixels_per_radian(angle)


def test_rays_from_the_pixels_of_the_ends_of_views_land_on_these_ends():
    """By the same mirrors, on a way as long and as sharply as is said."""
    drawn, rays = sample(), np.zeros(len(WORDS), int)
    fans, pieces = fans_of(drawn.posed), drawn.answers.pieces
    for (path, word), pad in itertools.product(enumerate(WORDS), range(PADS)):
        scene, piece = np.nonzero((pieces.present & (pieces.path == path))[:, pad])
        some, rays[path] = fans.part(scene), rays[path] + len(scene)
        long = np.hypot(*np.diff(some.ends[:, MIRRORS + pad], axis=1)[:, 0].T)
        for end, where in enumerate((pieces.start, pieces.end)):
            at = scene, pad, piece
            turn, per_radian = camera_of(item(drawn.cases, scene), pieces.pixels[at][:, end])
            turn, per_radian = np.asarray(turn), np.asarray(per_radian)
            hit, length, mirrors = follow(STRUCTURE, some, turn, word, pad)
            beside = [follow(STRUCTURE, some, turn + by, word, pad)[0] for by in (-STEP, STEP)]
            slope = np.abs(beside[1] - beside[0]) / (2 * STEP)
            np.testing.assert_allclose((hit - where[at]) / slope, 0, atol=ROUNDING)
            np.testing.assert_allclose(length, pieces.distance[at][:, end], rtol=1e-9)
            spans = pieces.spans[at][:, :, end]
            np.testing.assert_allclose(mirrors, spans[:, : len(word)], atol=ROUNDING)
            np.testing.assert_array_equal(spans[:, len(word) :], 0)
            sharpness = per_radian / (slope * long)
            np.testing.assert_allclose(pieces.px_per_mm[at][:, end], sharpness, rtol=STEP)
    assert (np.bincount(LENGTHS, rays) > 5).all(), rays


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
    assert_same(slopes, wanted, rtol=1e-9, atol=1e-9)
