"""The study ``linkage-precision``: its reference, its iterations, its timing, and a tiny run."""

import csv
import json
import math
from functools import partial

import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest
from jax.flatten_util import ravel_pytree

from designopt import cli
from designopt.study.results import PrecisionRow
from studies.benchmarks.linkage import (
    STUDY,
    contenders,
    exact,
    iterations,
    measuring,
    peers,
    sequential,
    statements,
)
from studies.benchmarks.linkage.cases import (
    CASES,
    dimensions,
    drawn,
    gaps,
    linkage_of,
    sizes_of,
    with_dimensions,
)
from studies.benchmarks.linkage.spec import LinkagePrecisionSpec

POSES = 90
NAMES = [case.name for case in CASES]
each_case = pytest.mark.parametrize("case", CASES, ids=NAMES)


def stacked(joints):
    return np.stack([np.stack(pair, -1) for pair in joints], 1)


def exactly(case, poses=POSES):
    reference = exact.positions(case, poses, poses)
    assert len(reference.checked) == poses
    return reference.places.astype(float)


@pytest.fixture(scope="module")
def closed_form():
    def solve(case):
        angles = jnp.asarray(case.angles(POSES))
        return jax.jit(partial(contenders.poses_of, case))(linkage_of(case), angles[:, None])

    return {case.name: stacked(solve(case)[0]) for case in CASES}


@each_case
def test_the_reference_keeps_every_length_and_the_side(case):
    """In 50 digits; the lengths are read from the linkage, the sides from its sketch."""
    with mpmath.workdps(exact.DIGITS):
        sizes = exact.exact_sizes(case)
        for angle in case.angles(12):
            found = exact.pose(case, sizes, mpmath.mpf(float(angle)))
            places = sizes.pins | dict(zip(case.joints, found, strict=True))

            def way(a, b, places=places):
                return [places[b][i] - places[a][i] for i in (0, 1)]

            def error(a, b, length, way=way):
                return abs(mpmath.hypot(*way(a, b)) / length - 1)

            assert error("O2", "A", sizes.lengths["crank"]) < 1e-45
            for dyad in case.dyads:
                assert error(dyad.start, dyad.joint, sizes.lengths[dyad.link]) < 1e-45
                if dyad.end is None:
                    x, y, along = sizes.lines[0]
                    off = places[dyad.joint][0] - x, places[dyad.joint][1] - y
                    cross = mpmath.cos(along) * off[1] - mpmath.sin(along) * off[0]
                    assert abs(cross) < 1e-45
                    assert places[dyad.joint][0] > places[dyad.start][0]
                    continue
                assert error(dyad.end, dyad.joint, sizes.lengths[dyad.arm]) < 1e-45
                base, link = way(dyad.start, dyad.end), way(dyad.start, dyad.joint)
                assert dyad.side * (base[0] * link[1] - base[1] * link[0]) > 0
                if dyad.carries is not None:
                    along, across = sizes.carried[dyad.arm]
                    arm, carried = way(dyad.end, dyad.joint), way(dyad.end, dyad.carries)
                    length = mpmath.hypot(*arm)
                    dot = arm[0] * carried[0] + arm[1] * carried[1]
                    cross = arm[0] * carried[1] - arm[1] * carried[0]
                    assert abs(dot / length - along) < 1e-45 * length
                    assert abs(cross / length - across) < 1e-45 * length


def test_the_reference_gives_nortons_four_bar():
    """R. L. Norton, Design of Machinery, Example 4-1: 20.298° and 57.325° at a crank of 40°."""
    with mpmath.workdps(exact.DIGITS):
        sizes = exact.exact_sizes(CASES[0])
        a, b = exact.pose(CASES[0], sizes, mpmath.radians(40))
    coupler = math.degrees(math.atan2(b[1] - a[1], b[0] - a[0]))
    rocker = math.degrees(math.atan2(b[1], b[0] - 100))
    assert abs(coupler - 20.298) < 5e-4
    assert abs(rocker - 57.325) < 5e-4


@each_case
def test_the_mean_of_a_long_sweep_is_that_of_its_poses(case):
    poses = 450
    assert poses > exact.SUMMED
    with mpmath.workdps(exact.DIGITS):
        sizes = exact.exact_sizes(case)
        start, end = (mpmath.mpf(float(limit)) for limit in np.deg2rad(case.sweep_deg))
        angles = [start + (end - start) * i / poses for i in range(poses)]
        last = [exact.pose(case, sizes, angle)[-1] for angle in angles]
        summed = mpmath.fsum(x * x + y * y for x, y in last) / poses
        # What is left is the next term of the end corrections, of the sixth order in the step.
        assert abs(exact.mean_square(case, sizes, poses) / summed - 1) < 1e-12


@each_case
def test_the_exact_gradient_is_that_of_the_loop_equations(case):
    """Implicit differentiation of the loops at the exact poses, by hand in double precision."""
    poses = 24
    angles = case.angles(poses)
    linkage, unknowns = linkage_of(case), []
    for found in exactly(case, poses):
        places = dict(zip(case.joints, found, strict=True))
        pins = {name: np.array(at) for name, at in sizes_of(drawn(case)).pins.items()}
        places |= pins
        row = []
        for dyad in case.dyads:
            way = places[dyad.joint] - places[dyad.start]
            row.append(np.arctan2(way[1], way[0]))
            if dyad.end is None:
                x, _, _ = sizes_of(drawn(case)).lines[0]
                row.append(places[dyad.joint][0] - x)
            else:
                way = places[dyad.joint] - places[dyad.end]
                row.append(np.arctan2(way[1], way[0]))
        unknowns.append(row)

    def walk(parts, unknowns, angle):
        joints, left = gaps(jnp, case, sizes_of(with_dimensions(linkage, parts)), angle, unknowns)
        x, y = joints[case.joints[-1]]
        return jnp.stack(left), x * x + y * y

    def slope(unknowns, angle):
        parts = dimensions(linkage)
        flat, rebuild = ravel_pytree(parts)
        by_unknowns, direct = jax.jacfwd(lambda u: walk(parts, u, angle), has_aux=False)(unknowns)
        by_parts, own = jax.jacfwd(lambda p: walk(rebuild(p), unknowns, angle))(flat)
        return own - direct @ jnp.linalg.solve(by_unknowns, by_parts)

    slopes = jax.vmap(slope)(jnp.asarray(unknowns), jnp.asarray(angles))
    expected = np.mean(np.asarray(slopes), axis=0)
    scale = np.max(np.abs(expected))
    np.testing.assert_allclose(exact.gradient(case, poses), expected, atol=1e-12 * scale)


@each_case
def test_newton_agrees_with_the_closed_form(case, closed_form):
    linkage, angles = linkage_of(case), jnp.asarray(case.angles(POSES))
    size = float(max(float(link.length) for link in linkage.links.values()))
    for advance, setting in ((iterations.fixed_steps, 8), (iterations.until, 1e-13)):
        solve = jax.jit(partial(iterations.newton, case, advance))
        found = stacked(solve(linkage, angles, jnp.asarray(setting)))
        np.testing.assert_allclose(found, closed_form[case.name], atol=1e-12 * size)
    np.testing.assert_allclose(closed_form[case.name], exactly(case), atol=1e-12 * size)


def test_blocks_change_nothing(monkeypatch):
    case = CASES[2]
    linkage, angles = linkage_of(case), jnp.asarray(case.angles(POSES))
    whole = iterations.newton(case, iterations.fixed_steps, linkage, angles, jnp.asarray(8))
    monkeypatch.setattr(iterations, "BLOCK", 30)
    parts = iterations.newton(case, iterations.fixed_steps, linkage, angles, jnp.asarray(8))
    np.testing.assert_allclose(stacked(parts), stacked(whole), rtol=1e-13)


@pytest.mark.parametrize("method", iterations.OPTIMISTIX)
def test_optimistix_solves_the_same_equations(method):
    case = CASES[1]  # from its sketch every method reaches every pose
    solve = jax.jit(partial(iterations.solve_by_optimistix, case, method))
    angles = jnp.asarray(case.angles(POSES))
    found = stacked(solve(linkage_of(case), angles, jnp.asarray(1e-13)))
    np.testing.assert_allclose(found, exactly(case), atol=1e-9)


@each_case
def test_gradients_agree_with_the_reference(case):
    poses = 24
    linkage, angles = linkage_of(case), jnp.asarray(case.angles(poses))
    expected = exact.gradient(case, poses)
    scale = np.max(np.abs(expected))

    def iterated(parts):
        solve = partial(iterations.newton, case, iterations.until)
        x, y = solve(with_dimensions(linkage, parts), angles, jnp.asarray(1e-13))[-1]
        return jnp.mean(x * x + y * y)

    def ours(parts):
        return contenders.path_square(case, with_dimensions(linkage, parts), angles[:, None])

    for function in (ours, iterated):
        found, _ = ravel_pytree(jax.jit(jax.grad(function))(dimensions(linkage)))
        np.testing.assert_allclose(found, expected, atol=1e-12 * scale)
    walk = sequential.fsolve_walk(1e-12)
    # In steps of 15 degrees fsolve ends in the slider-crank's other assembly; not in these.
    found = sequential.gradient_by_differences(walk, case, drawn(case), case.angles(POSES))
    np.testing.assert_allclose(found, exact.gradient(case, POSES), atol=1e-7 * scale)


PEERS = {
    "mechanism": ("mechanism", peers.mechanism_walk),
    "pylinkage": ("pylinkage", peers.pylinkage_walk),
    "pylinkage, numba": ("pylinkage", peers.pylinkage_fast_walk),
    "fsolve": ("scipy", sequential.fsolve_walk(1e-12)),
}


@each_case
@pytest.mark.parametrize("name", PEERS)
@pytest.mark.filterwarnings("ignore")  # what the peers warn of is theirs
def test_other_tools_solve_the_same_sweep(case, name):
    package, walk = PEERS[name]
    if not peers.installed(package):
        pytest.skip(f"{package} is not installed; the extra 'peers' brings it")
    walker = walk(case, drawn(case), case.angles(POSES))
    for _ in range(2):  # a second call starts afresh
        found = walker.read(walker.call())
        assert exact.positions(case, POSES, POSES).error(found) < 1e-8


def test_an_error_is_found_where_there_is_one():
    reference = exact.positions(CASES[0], POSES, POSES)
    right = exactly(CASES[0])
    assert reference.error(right) < 1e-15
    wrong = right.copy()
    wrong[7, 1, 0] += 1.2
    np.testing.assert_allclose(reference.error(wrong), 1.2 / 120, rtol=1e-9)
    wrong[7, 1, 0] = np.nan
    assert reference.error(wrong) == math.inf


def test_claims_can_be_proved_wrong():
    def row(method, error, seconds):
        return PrecisionRow(method, "", "p", error, seconds, 0.9 * seconds, 1.1 * seconds, 0.0)

    ours = row(contenders.OURS, 1e-15, 1.0)
    floor = row(contenders.FLOOR, 1e-16, 0.1)
    assert statements.closed_form_claim(20, [ours, floor, row("x", 1e-14, 0.1)]).holds
    assert not statements.closed_form_claim(20, [ours, floor, row("x", 1e-16, 0.1)]).holds


def test_the_six_bar_is_driven_within_its_limits():
    linkage = linkage_of(CASES[2])
    ends = jnp.deg2rad(jnp.asarray([-66.0, -62.0, 159.0, 163.0]))
    _, ok, _ = jax.jit(partial(contenders.poses_of, CASES[2]))(linkage, ends[:, None])
    np.testing.assert_array_equal(ok, [False, True, True, False])


@pytest.mark.slow
def test_the_study_end_to_end(tmp_path, capsys):
    out = tmp_path / "out"
    quick = ["poses=20", "repeats=3", "peers=false", "first_call=false", "float32=false"]
    quick += ["linkage=slider-crank", "optimistix=false"]
    arguments = [part for assignment in quick for part in ("--set", assignment)]
    assert cli.run(["run", STUDY.name, "--out", str(out), *arguments]) == 0, capsys.readouterr().err
    document = json.loads((out / "results.json").read_text(encoding="utf-8"))
    metrics = document["metrics"]
    assert metrics["closed_form_worst_error"]["met"]
    assert metrics["four_bar_over_mechanism"]["value"] is None
    assert metrics["four_bar_first_call_s"]["value"] is None
    assert metrics["slider_crank_gradient_over_value"]["value"] > 0
    # A target is one of the stated sweep.
    judged = {name for name, metric in metrics.items() if metric["target"] is not None}
    assert judged == {"closed_form_worst_error"}
    assert {row["panel"] for row in document["precision"]} == {
        "slider-crank, 20 poses",
        "slider-crank, gradient over 20 poses",
    }
    with (out / "tables" / "all_rows.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert {row["poses"] for row in rows} == {"1", "20"}
    for row in rows:
        if row["method"] == contenders.OURS:
            assert float(row["error"]) < 1e-12
    for name in ("precision", "precision_short", "throughput"):
        assert (out / "figures" / f"{name}.png").stat().st_size > 10_000
    for row in document["left_out"]:
        assert 0 < row["scene_operations"] < row["general_operations"]
    assert len(document["claims"]) == 2
    assert any("not measured" in finding for finding in document["findings"])


def test_the_first_call_is_timed_in_a_fresh_process():
    assert 0 < measuring.first_call("four-bar") < math.inf


@pytest.mark.parametrize(
    "assignment", ["poses=9", "poses=5000000", "repeats=2", "peers=maybe", "pose=10"]
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
        return [work.panel for work in measuring.workloads(LinkagePrecisionSpec(**settings))]

    assert len(panels()) == 3 * (3 + 4)
    assert panels(poses=360, gradients=False, float32=False)[:2] == [
        "four-bar, 1 pose",
        "four-bar, 360 poses",
    ]
