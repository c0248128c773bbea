"""The study ``visibility-precision``: its references, its methods, and a short run."""

from __future__ import annotations

import functools
import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from designopt.study.results import PrecisionRow
from optics import parse_scene
from studies.benchmarks.measuring import installed
from studies.benchmarks.visibility import VisibilityPrecisionSpec, grid, run, sampling, tracers
from studies.benchmarks.visibility import methods as by
from studies.benchmarks.visibility.cases import (
    bent,
    gallery,
    parts_of,
    spoilt_finger,
    with_parts,
)
from studies.oracles import coverage as exact
from studies.oracles.scenes import rounded, seen_by_fan
from tests.studies.quick import quick_run

RAYS = 200_000


def camera(**given):
    return {"position": [0, 0], "direction_deg": 90, "fov_deg": 120, "pixels": 100} | given


def pad(start, end, **given):
    return {"name": "pad", "from": start, "to": end, "side": "right"} | given


SHADOW = {
    "camera": camera(),
    "pads": [pad([-1, 2], [1, 2])],
    "blockers": [{"name": "post", "from": [-0.25, 1], "to": [0.25, 1]}],
}
SLIVER = {"camera": camera(fov_deg=60), "pads": [pad([-2, 2], [2, 2])]}
GRAZED = {"camera": camera(fov_deg=170), "pads": [pad([-6, 2], [6, 2], min_grazing_deg=30)]}
# In the mirror the pad appears 7 before the camera, where the mirror's edges pass ± 7 / 6.
BEHIND = {
    "camera": camera(),
    "mirrors": [{"name": "mirror", "from": [-0.5, 3], "to": [0.5, 3], "side": "right"}],
    "pads": [pad([-2, -1], [2, -1], side="left")],
}
PARABOLA_PAD = [[400.0, 220.0], [400.0, 460.0]]

# By hand: the post's shadow is 1 wide; the field of view is 2 tan 30° to either side; at 30° rays
# meet the pad 2 / tan 30° from the foot.
CLOSED_FORMS = {
    "shadow": (SHADOW, 0.5),
    "field of view": (SLIVER, math.tan(math.pi / 6)),
    "grazing angle": (GRAZED, 2 * math.sqrt(3) / 6),
    "mirror": (BEHIND, 7 / 12),
}


@pytest.mark.parametrize("name", CLOSED_FORMS)
def test_the_references_give_closed_forms(name):
    data, covered = CLOSED_FORMS[name]
    scene = parse_scene(data)
    np.testing.assert_allclose(exact.coverage(scene, scene.pose()), [covered], rtol=1e-14)
    fan = seen_by_fan(rounded(scene, scene.pose()), RAYS)
    np.testing.assert_allclose(fan.coverage, [covered], atol=2e-5)
    np.testing.assert_allclose(fan.redundancy, fan.coverage, rtol=1e-12)


def test_the_references_look_into_mirrors():
    """The textbook's mirror with its lower end raised by 10 mm: 20 mm of the feet are gone."""
    scene = gallery("half-height-mirror")
    scene = with_parts(scene, (scene.mirrors.at[0, 0, 1].add(10.0), *parts_of(scene)[1:]))
    eye = 999.9
    slope = (eye + 1000) / eye
    covered = 1 - (1600 - (1600 - 810) * slope) / 1700
    np.testing.assert_allclose(exact.coverage(scene, scene.pose()), [covered], rtol=1e-14)
    fan = seen_by_fan(rounded(scene, scene.pose()), RAYS)
    np.testing.assert_allclose(fan.coverage, [covered], atol=2e-5)
    # Its lower end moves the edge, its upper end does not; nor does, as much, all of it.
    lower_x, lower_y, upper_x, upper_y = exact.gradient(scene, scene.pose())[:4]
    np.testing.assert_allclose([lower_y, upper_y], [-slope / 1700, 0], rtol=1e-14)
    nearer = (1600 - 810) * (eye - 1000) / eye**2 / 1700
    np.testing.assert_allclose(lower_x + upper_x, nearer, atol=1e-17)


def test_the_reference_reflects_in_a_curved_mirror():
    """Rays from a parabola's focus at θ from its axis leave it r tan(θ / 2) beside that axis."""
    scene = eqx.tree_at(lambda s: s.pads, gallery("parabola"), jnp.asarray([PARABOLA_PAD]))
    fan = seen_by_fan(rounded(scene, scene.pose()), RAYS)
    wide = 2 * float(scene.radii[0]) * math.tan(math.radians(160 / 2 / 2))
    np.testing.assert_allclose(fan.coverage, [wide / 240], atol=2e-5)


def test_the_exact_gradient_of_a_shadow():
    """Its ends are those of the post, seen from the camera: at 2 b − c for a camera at (c, 0)."""
    scene = parse_scene(SHADOW)
    # Of position and direction: a step towards the post widens its shadow, a turn does nothing.
    np.testing.assert_allclose(exact.gradient(scene, scene.pose()), [0, -0.25, 0], atol=1e-15)


def test_the_references_agree_on_the_finger():
    scene = spoilt_finger()
    fan = seen_by_fan(rounded(scene, bent(scene)), RAYS)
    np.testing.assert_allclose(fan.coverage, exact.coverage(scene, bent(scene)), atol=2e-5)
    assert np.all(fan.coverage < 0.9)  # so that an error shows on every pad


ONE_SIDED = {
    "scene": {"bounces": 2},
    "camera": camera(direction_deg=0, fov_deg=60),
    "mirrors": [
        {"name": "lower", "from": [75, -25], "to": [125, 25], "side": "left"},
        {"name": "upper", "from": [75, 275], "to": [125, 325], "side": "right"},
    ],
    "pads": [
        {"name": "far", "from": [400, 220], "to": [400, 380], "side": "left"},
        {"name": "near", "from": [60, 10], "to": [60, 60], "side": "left"},
    ],
    "blockers": [
        {"name": "lets pass", "from": [200, 200], "to": [200, 330], "side": "right"},
        {"name": "blocks", "from": [300, 290], "to": [300, 310], "side": "left"},
    ],
}


def test_points_and_rays_come_close_to_the_exact_coverage():
    """Over two mirrors, and past blockers that let light pass from one side."""
    scene = parse_scene(ONE_SIDED)
    expected = exact.coverage(scene, scene.pose())
    assert np.all((expected > 0.1) & (expected < 0.9))
    points = rays = 4096
    block = sampling.block_of(points)
    find = jax.jit(functools.partial(sampling.coverage, sampling.hard, block))
    [found] = find(scene, scene.pose()[None], jnp.asarray(points // block), jnp.asarray(1.0))
    np.testing.assert_allclose(found, expected, atol=2 / points)  # four ends, half a point each
    [seen] = jax.jit(functools.partial(by.by_camera_rays, rays))(scene, scene.pose()[None])
    np.testing.assert_allclose(seen, expected, atol=2e-2)
    assert np.all(seen <= expected + 1e-12)  # what lies beside a run of rays is not counted


def test_a_sigmoid_sharpens_into_the_hard_test():
    margin = jnp.asarray([-0.1, -1e-3, 1e-3, 0.1])
    steep = sampling.soft(margin, jnp.asarray(1e5))
    np.testing.assert_allclose(steep, sampling.hard(margin, jnp.asarray(1.0)), atol=1e-40)
    gentle = sampling.soft(margin, jnp.asarray(10.0))
    np.testing.assert_allclose(gentle, 1 / (1 + np.exp(-10 * np.asarray(margin))), rtol=1e-14)


def test_many_points_and_a_steep_sigmoid_reach_the_exact_gradient():
    scene = parse_scene(BEHIND)
    points, alpha = 16384, 2500.0
    block = sampling.block_of(points)
    find = jax.jit(functools.partial(sampling.gradient, sampling.soft, block))
    args = parts_of(scene), scene, scene.pose()[None], jnp.asarray(points // block)
    mean, slopes = find(*args, jnp.asarray(alpha))
    np.testing.assert_allclose(mean, exact.coverage(scene, scene.pose())[0], rtol=1e-6)
    found = np.concatenate([np.ravel(x) for x in slopes])
    expected = exact.gradient(scene, scene.pose())
    np.testing.assert_allclose(found, expected, atol=1e-6 * np.max(np.abs(expected)))


def test_an_error_is_found_where_there_is_one():
    scene = parse_scene(BEHIND)
    work = by.Workload(scene, scene.pose()[None], True, RAYS)
    expected, error = exact.gradient(scene, work.poses[0]), by.slopes_error(work)
    mirrors, position, direction = expected[:4].reshape(1, 2, 2), expected[4:6], expected[6]
    assert error((0.0, (mirrors, position, direction))) < 1e-15
    assert error((0.0, (-mirrors, position, direction))) == pytest.approx(2)
    wrong = np.max(np.abs(mirrors)) * by.REACH_MM / 10  # an angle counts as the arc that it moves
    assert error((0.0, (mirrors, position, direction + wrong))) == pytest.approx(0.1)
    assert math.isnan(error((0.0, (mirrors * math.nan, position, direction))))
    right, error = exact.coverage(scene, work.poses[0]), by.coverage_error(work)
    assert error(right) < 2e-5
    assert error(right + 1e-3) == pytest.approx(1e-3, rel=0.02)


FOLDING = {
    "camera": camera(),
    "pads": [pad([-1, 2], [0, 2], body="left"), pad([0, 2], [1, 2], name="other", body="right")],
    "frames": {
        "left": {"hinge": [-1, 2], "angle": "left"},
        "right": {"hinge": [1, 2], "angle": "right"},
    },
}


def test_sweeps_suffice_where_each_joint_moves_its_own_pad():
    assert grid.disagreement(parse_scene(FOLDING), 4) < 1e-15
    screen = {"name": "screen", "from": [1, 1], "to": [-1, 1], "body": "right"}
    assert grid.disagreement(parse_scene(FOLDING | {"blockers": [screen]}), 4) > 0.1


@pytest.mark.slow
def test_the_sweeps_of_the_finger_suffice():
    """It is the gallery's with a cable, shorter mirrors and a narrower lens: more can hide."""
    assert grid.disagreement(spoilt_finger(), 6) < 1e-12


@pytest.mark.parametrize("legs", [1, tracers.MIRRORS])
def test_tracers_end_where_the_unfolded_rays_do(legs):
    scene, rays = tracers.zigzag(), tracers.bundle(50, 0)
    ours = jax.jit(functools.partial(tracers.traced, legs))(scene, *map(jnp.asarray, rays))
    call, read = tracers.numpy_tracer(legs, scene, *rays)
    for found in (ours, read(call())):
        for part, wanted in zip(found, tracers.expected(*rays, legs), strict=False):
            np.testing.assert_allclose(part, wanted, atol=1e-11)


@pytest.mark.parametrize("name", ["optiland", "rayoptics"])
@pytest.mark.filterwarnings("ignore")  # what the peers warn of is theirs
def test_other_tracers_end_there_too(name):
    if not installed(name):
        pytest.skip(f"{name} is not installed; the extra 'peers' brings it")
    rays = tracers.bundle(50, 0)
    call, read = getattr(tracers, f"{name}_tracer")(tracers.zigzag(), *rays)
    right = tracers.expected(*rays, tracers.MIRRORS)
    for _ in range(2):  # a second call starts afresh
        for part, wanted in zip(read(call()), right, strict=True):
            np.testing.assert_allclose(part, wanted, atol=1e-11)


def test_the_rival_is_the_fastest_that_is_accurate_enough():
    def row(method, error, seconds):
        return PrecisionRow(method, "", "p", error, seconds, seconds, seconds, 0.0)

    soft = by.SOFT[1000]
    wrong, wanted = row(soft, 1e-3, 1e-3), row(soft, 4e-4, 2e-2)
    others = [row(by.OURS, 1e-15, 1e-3), row(by.BEST, 1e-5, 4e-2), row(by.EDGES, 1e-15, 5e-3)]
    assert run.fastest_sigmoid([wrong, *others, wanted]) is wanted
    assert run.fastest_sigmoid([wrong]) is None


@pytest.mark.slow
def test_the_study_end_to_end(tmp_path):
    # The targets belong to the default numbers of points and rays.
    done = quick_run("visibility-precision", tmp_path)
    metrics, precision = done.measured, done.document["precision"]
    assert metrics["exact_error_coverage_1_pose"] < 1e-3  # 20,000 rays
    assert metrics["exact_error_gradient_1_pose"] < 1e-12
    gradients = [row for row in precision if row["panel"] == "gradient, 1 pose"]
    errors = {row["method"]: row["error"] for row in gradients}
    assert errors[by.HARD] == 1.0  # it is 0
    assert errors[by.CAMERA] > 0.1  # it is that of the hits, not of the edges
    assert errors[by.BEST] <= min(errors[method] for method in by.SOFT.values())
    assert metrics["gallery_exact_deviation"] is None
    assert metrics["sigmoid_over_exact_gradient_1_pose"] is None  # 64 points are too few
    assert metrics["tracer_over_numpy_1_leg"] > 0
    assert {row["panel"] for row in precision} == {"coverage, 1 pose", "gradient, 1 pose"}
    columns = done.table("tracers")
    assert set(columns["method"]) == {tracers.OURS, tracers.NUMPY}
    assert max(columns["error_mm"]) < 1e-11


@pytest.mark.slow
def test_every_scene_carries_only_its_own_stages():
    for row in run.operations():
        assert 0 < row.scene_operations < row.general_operations, row.asked


@pytest.mark.nightly
@pytest.mark.parametrize("name", run.gallery_of(VisibilityPrecisionSpec()))
def test_the_gallery_agrees_with_the_reference(name):
    assert run.deviation(name, 1_000_000)["coverage_error"] < 4e-5


def test_workloads_follow_the_spec():
    works = run.workloads(VisibilityPrecisionSpec())
    one = ["coverage, 1 pose", "gradient, 1 pose"]
    assert [work.panel for work in works] == [*one, "coverage, 19 poses", "gradient, 19 poses"]
