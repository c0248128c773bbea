"""The study ``visibility-precision``: its references, its contenders, and a tiny run."""

from __future__ import annotations

import csv
import functools
import json
import math
import time

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from designopt import cli
from designopt.study.benchmark import BenchmarkMethod, benchmark
from designopt.study.results import PrecisionRow
from optics import parse_scene
from studies.benchmarks.visibility import (
    STUDY,
    camera_rays,
    contenders,
    exact,
    finger_grid,
    left_out,
    measuring,
    peers,
    sampling,
    statements,
    tracers,
)
from studies.benchmarks.visibility.cases import (
    bent,
    flexion,
    gallery,
    parts_of,
    spoilt_finger,
    with_parts,
)
from studies.benchmarks.visibility.spec import VisibilityPrecisionSpec
from studies.oracles import tracer as numpy_rays
from studies.oracles.scenes import rounded

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
    fan = numpy_rays.seen_by_fan(rounded(scene, scene.pose()), RAYS)
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
    fan = numpy_rays.seen_by_fan(rounded(scene, scene.pose()), RAYS)
    np.testing.assert_allclose(fan.coverage, [covered], atol=2e-5)
    # Its lower end moves the edge, its upper end does not; nor does, as much, all of it.
    lower_x, lower_y, upper_x, upper_y = exact.gradient(scene, scene.pose())[:4]
    np.testing.assert_allclose([lower_y, upper_y], [-slope / 1700, 0], rtol=1e-14)
    nearer = (1600 - 810) * (eye - 1000) / eye**2 / 1700
    np.testing.assert_allclose(lower_x + upper_x, nearer, atol=1e-17)


def test_the_reference_reflects_in_a_curved_mirror():
    """Rays from a parabola's focus at θ from its axis leave it r tan(θ / 2) beside that axis."""
    scene = eqx.tree_at(lambda s: s.pads, gallery("parabola"), jnp.asarray([PARABOLA_PAD]))
    fan = numpy_rays.seen_by_fan(rounded(scene, scene.pose()), RAYS)
    wide = 2 * float(scene.radii[0]) * math.tan(math.radians(160 / 2 / 2))
    np.testing.assert_allclose(fan.coverage, [wide / 240], atol=2e-5)


def test_the_exact_gradient_of_a_shadow():
    """Its ends are those of the post, seen from the camera: at 2 b − c for a camera at (c, 0)."""
    scene = parse_scene(SHADOW)
    # Of position and direction: a step towards the post widens its shadow, a turn does nothing.
    np.testing.assert_allclose(exact.gradient(scene, scene.pose()), [0, -0.25, 0], atol=1e-15)


def test_the_references_agree_on_the_finger():
    scene = spoilt_finger()
    fan = numpy_rays.seen_by_fan(rounded(scene, bent(scene)), RAYS)
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
    blocks = jnp.asarray(points // block)
    found = find(scene, scene.pose()[None], blocks, jnp.asarray(1.0))[0]
    np.testing.assert_allclose(found, expected, atol=2 / points)  # four ends, half a point each
    seen = jax.jit(functools.partial(camera_rays.coverage, rays=rays))(scene, scene.pose())
    np.testing.assert_allclose(seen, expected, atol=2e-2)
    assert np.all(seen <= expected + 1e-12)  # what lies beside a run of rays is not counted


def test_a_sigmoid_sharpens_into_the_hard_test():
    margin = jnp.asarray([-0.1, -1e-3, 1e-3, 0.1])
    steep = sampling.soft(margin, jnp.asarray(1e5))
    np.testing.assert_allclose(steep, sampling.hard(margin, jnp.asarray(1.0)), atol=1e-40)
    gentle = sampling.soft(margin, jnp.asarray(10.0))
    np.testing.assert_allclose(gentle, 1 / (1 + np.exp(-10 * np.asarray(margin))), rtol=1e-14)


@pytest.fixture(scope="module")
def gradient_work():
    scene = spoilt_finger()
    return contenders.Workload(scene, bent(scene)[None], True, RAYS)


def test_many_points_and_a_steep_sigmoid_reach_the_exact_gradient():
    scene = parse_scene(BEHIND)
    points, alpha = 16384, 2500.0
    block = sampling.block_of(points)
    find = jax.jit(functools.partial(sampling.gradient, sampling.soft, block))
    args = parts_of(scene), scene, scene.pose()[None], jnp.asarray(points // block)
    mean, slopes = find(*args, jnp.asarray(alpha))
    np.testing.assert_allclose(mean, exact.coverage(scene, scene.pose())[0], rtol=1e-6)
    found, expected = (
        np.concatenate([np.ravel(x) for x in slopes]),
        exact.gradient(scene, scene.pose()),
    )
    np.testing.assert_allclose(found, expected, atol=1e-6 * np.max(np.abs(expected)))


def test_a_wrong_contender_is_seen(gradient_work):
    expected = exact.gradient(gradient_work.scene, gradient_work.poses[0])
    error = contenders.gradient_error(gradient_work)
    mirrors, position, direction = expected[:8].reshape(2, 2, 2), expected[8:10], expected[10]
    assert error((0.0, (mirrors, position, direction))) < 1e-15
    assert error((0.0, (-mirrors, position, direction))) == pytest.approx(2)
    assert error((0.0, (mirrors, position, direction * 1.01))) > 1e-3
    assert math.isnan(error((0.0, (mirrors * math.nan, position, direction))))
    work = gradient_work._replace(gradient=False)
    right = exact.coverage(work.scene, work.poses[0])
    error = contenders.coverage_error(work)
    assert error(right) < 2e-5
    assert error(right + np.array([0.0, 1e-3, 0.0])) == pytest.approx(1e-3, rel=0.02)


def test_the_sweep_is_judged_against_fifty_digits():
    scene = spoilt_finger()
    work = contenders.Workload(scene, flexion(scene)[::9], False, RAYS)
    expected = np.stack([exact.coverage(scene, pose) for pose in work.poses])
    assert contenders.coverage_error(work)(expected) == 0
    assert work.panel == "coverage, 3 poses"


FOLDING = {
    "camera": camera(),
    "pads": [pad([-1, 2], [0, 2], body="left"), pad([0, 2], [1, 2], name="other", body="right")],
    "frames": {
        "left": {"hinge": [-1, 2], "angle": "left"},
        "right": {"hinge": [1, 2], "angle": "right"},
    },
}


def test_the_sweeps_say_the_same_where_each_joint_moves_its_own_pad():
    assert finger_grid.disagreement(parse_scene(FOLDING), 4) < 1e-15


def test_a_view_that_depends_on_another_joint_is_found():
    screen = {"name": "screen", "from": [1, 1], "to": [-1, 1], "body": "right"}
    assert finger_grid.disagreement(parse_scene(FOLDING | {"blockers": [screen]}), 4) > 0.1


@pytest.mark.slow
@pytest.mark.parametrize("scene", [gallery("finger"), spoilt_finger()], ids=["gallery", "spoilt"])
def test_the_sweeps_of_the_finger_say_the_same(scene):
    assert finger_grid.disagreement(scene, 10) < 1e-12


def test_tracers_end_where_the_unfolded_rays_do():
    positions, directions = tracers.bundle(50, 0)
    args = tracers.zigzag(), jnp.asarray(positions), jnp.asarray(directions)
    for legs in measuring.LEGS:
        right = tracers.expected(positions, directions, legs)
        mirrors = np.asarray(args[0].mirrors)
        for found in (
            jax.jit(functools.partial(tracers.traced, legs))(*args),
            tracers.numpy_trace(mirrors, positions, directions, legs),
        ):
            for part, wanted in zip(found, right, strict=True):
                np.testing.assert_allclose(part, wanted, atol=1e-11)


@pytest.mark.parametrize("name", ["optiland", "rayoptics"])
@pytest.mark.filterwarnings("ignore")  # what the peers warn of is theirs
def test_other_tracers_end_there_too(name):
    if not peers.installed(name):
        pytest.skip(f"{name} is not installed; the extra 'peers' brings it")
    make = {"optiland": peers.optiland_tracer, "rayoptics": peers.rayoptics_tracer}[name]
    rays = tracers.bundle(50, 0)
    call, read = make(np.asarray(tracers.zigzag().mirrors), *rays)
    for _ in range(2):  # a second call starts afresh
        for part, wanted in zip(
            read(call()), tracers.expected(*rays, tracers.MIRRORS), strict=True
        ):
            np.testing.assert_allclose(part, wanted, atol=1e-11)


def test_claims_can_be_proved_wrong():
    def row(method, error, seconds):
        return PrecisionRow(method, "", "p", error, seconds, 0.9 * seconds, 1.1 * seconds, 0.0)

    ours = row(contenders.OURS, 1e-15, 1.0)
    assert statements.undominated_claim([ours, row("x", 1e-3, 0.1)]).holds
    assert not statements.undominated_claim([ours, row("x", 1e-16, 0.1)]).holds


def test_the_rival_is_the_fastest_that_is_accurate_enough():
    def entered(method, error, seconds):
        return BenchmarkMethod(method, "", "p", lambda: time.sleep(seconds), lambda _: error)

    soft = contenders.SOFT[1000]
    all_of_them = [
        entered(contenders.OURS, 1e-15, 1e-3),
        entered(soft, 1e-3, 1e-3),
        entered(soft, 4e-4, 2e-2),
        entered(contenders.BEST, 1e-5, 4e-2),
        entered(contenders.EDGES, 1e-15, 5e-3),
    ]
    rows = benchmark(all_of_them, repeats=3)
    (rival,) = measuring.fastest_sigmoid(rows)
    assert (rival.row.method, rival.row.error) == (soft, 4e-4)
    assert 5 < rival.ratio.value < 30
    assert list(measuring.fastest_sigmoid(rows[:2])) == []


QUICK = ["samples=64", "reference_rays=20000", "repeats=3", "flexion=false", "edge_refined=false"]
QUICK += ["gallery=false", "grid=false", "peers=false", "left_out=false"]


@pytest.mark.slow
def test_the_study_end_to_end(tmp_path, capsys):
    out = tmp_path / "out"
    arguments = [part for assignment in QUICK for part in ("--set", assignment)]
    assert cli.run(["run", STUDY.name, "--out", str(out), *arguments]) == 0, capsys.readouterr().err
    document = json.loads((out / "results.json").read_text(encoding="utf-8"))
    metrics = document["metrics"]
    assert metrics["exact_error_coverage_1_pose"]["value"] < 1e-3  # 20,000 rays
    assert metrics["exact_error_gradient_1_pose"]["value"] < 1e-12
    errors = {
        row["method"]: row["error"]
        for row in document["precision"]
        if row["panel"] == "gradient, 1 pose"
    }
    assert errors[contenders.HARD] == 1.0  # it is 0
    assert errors[contenders.CAMERA] > 0.1  # it is that of the hits, not of the edges
    softened = [errors[method] for method in contenders.SOFT.values()]
    assert errors[contenders.BEST] <= min(softened)
    assert metrics["gallery_exact_deviation"]["value"] is None
    assert metrics["sigmoid_over_exact_gradient_1_pose"]["value"] is None  # 64 points are too few
    assert metrics["tracer_over_numpy_1_leg"]["value"] > 0
    assert metrics["throughput_over_optiland"]["value"] is None
    # A target is one of the stated sizes.
    assert all(metric["target"] is None for metric in metrics.values())
    assert {row["panel"] for row in document["precision"]} == {
        "coverage, 1 pose",
        "gradient, 1 pose",
    }
    with (out / "tables" / "tracers.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert {row["method"] for row in rows} == {tracers.OURS, tracers.NUMPY}
    assert all(float(row["error_mm"]) < 1e-11 for row in rows)
    assert (out / "figures" / "precision.png").stat().st_size > 10_000
    assert any("no sigmoid sampling" in finding for finding in document["findings"])


@pytest.mark.slow
def test_every_scene_carries_only_its_own_stages():
    for row in left_out.operations():
        assert 0 < row.scene_operations < row.general_operations, row.asked


@pytest.mark.nightly
@pytest.mark.parametrize("name", [*measuring.gallery_of(VisibilityPrecisionSpec())])
def test_the_gallery_agrees_with_the_reference(name):
    assert measuring.deviation(name, 1_000_000).coverage < 4e-5


@pytest.mark.parametrize(
    "assignment", ["samples=100", "reference_rays=10", "repeats=2", "peers=maybe", "ray=10"]
)
def test_faulty_settings_are_one_line(tmp_path, capsys, assignment):
    arguments = ["run", STUDY.name, "--out", str(tmp_path / "out"), "--set", assignment]
    assert cli.run(arguments) == 2
    shown = capsys.readouterr().err
    assert f"--set {assignment.split('=')[0]}" in shown
    assert shown.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_workloads_follow_the_spec():
    def panels(**settings):
        return [work.panel for work in measuring.workloads(VisibilityPrecisionSpec(**settings))]

    one = ["coverage, 1 pose", "gradient, 1 pose"]
    assert panels(flexion=False) == one
    assert panels() == [*one, "coverage, 19 poses", "gradient, 19 poses"]
