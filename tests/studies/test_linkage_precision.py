"""The study ``linkage-precision``: its reference, its methods, and a short run."""

import json
import math
from functools import partial

import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest

import designopt
from designopt.study.stability import DIGITS
from studies.benchmarks import measuring
from studies.benchmarks.linkage import LinkagePrecisionSpec, iterations, run, walks
from studies.benchmarks.linkage import methods as by
from studies.benchmarks.linkage.cases import (
    CASES,
    dimensions,
    drawn,
    linkage_of,
    numbers_of,
    sizes_of,
    with_dimensions,
)
from studies.oracles import linkages as exact

POSES = 48
each_case = pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)


def exactly(case):
    return by.exact_places(case, POSES, POSES).astype(float)


def solve_all(method, case, *setting):
    angles = jnp.asarray(case.angles(POSES))
    solve = jax.jit(partial(method, case, case.joints))
    return by.stacked(solve(linkage_of(case), angles, *setting))


@each_case
def test_the_reference_keeps_every_length_and_the_side(case):
    """In 50 digits; the lengths are read from the linkage, the sides from its sketch."""
    with mpmath.workdps(DIGITS):
        sizes = numbers_of(case, mpmath.mpf)
        for found in exact.poses(case, sizes, exact.digits(case.angles(12))):
            places = sizes.pins | dict(zip(case.joints, found, strict=True))
            places = {name: mpmath.mpc(*place) for name, place in places.items()}
            links = [("O2", "A", "crank")]
            links += [(dyad.start, dyad.joint, dyad.link) for dyad in case.dyads]
            links += [(dyad.end, dyad.joint, dyad.arm) for dyad in case.dyads if dyad.arm]
            for start, end, body in links:
                assert abs(abs(places[end] - places[start]) / sizes.lengths[body] - 1) < 1e-45
            for dyad in case.dyads:
                way = places[dyad.joint] - places[dyad.start]
                if not dyad.arm:
                    x, y, along = sizes.line
                    off = (places[dyad.joint] - mpmath.mpc(x, y)) * mpmath.expj(-along)
                    assert abs(off.imag) < 1e-45
                    assert way.real > 0
                    continue
                base = places[dyad.end]
                assert dyad.side * (way / (base - places[dyad.start])).imag > 0
                if dyad.carries:
                    frame = (places[dyad.joint] - base) / sizes.lengths[dyad.arm]
                    carried = (places[dyad.carries] - base) / frame
                    assert abs(carried - mpmath.mpc(*sizes.carried[dyad.arm])) < 1e-43


def test_the_reference_gives_nortons_four_bar():
    """R. L. Norton, Design of Machinery, Example 4-1: 20.298° and 57.325° at a crank of 40°."""
    with mpmath.workdps(DIGITS):
        sizes = numbers_of(CASES[0], mpmath.mpf)
        [places] = exact.poses(CASES[0], sizes, np.array([mpmath.radians(40)]))
    a, b = (complex(*place) for place in places)
    np.testing.assert_allclose(np.angle([b - a, b - 100], deg=True), [20.298, 57.325], atol=5e-4)


@each_case
def test_the_mean_of_a_long_sweep_is_that_of_its_poses(case, monkeypatch):
    poses = 450
    with mpmath.workdps(DIGITS):
        sizes = numbers_of(case, mpmath.mpf)
        integrated = exact.mean_square(case, poses, sizes)
        monkeypatch.setattr(exact, "SUMMED", poses)
        summed = exact.mean_square(case, poses, sizes)
        # What is left is the next term of the end corrections, of the sixth order in the step,
        # and the rounding of the summed angles.
        assert 0 < abs(integrated / summed - 1) < 1e-12


@each_case
def test_batched_methods_agree_with_the_reference(case):
    tolerance = 1e-12 * max(numbers_of(case).lengths.values())
    closed = solve_all(iterations.closed_form, case)
    fixed = solve_all(partial(iterations.newton, False), case, jnp.asarray(8))
    adaptive = solve_all(partial(iterations.newton, True), case, jnp.asarray(1e-13))
    for found in (closed, fixed, adaptive):
        np.testing.assert_allclose(found, exactly(case), atol=tolerance)


def test_blocks_change_nothing(monkeypatch):
    whole = solve_all(partial(iterations.newton, False), CASES[2], jnp.asarray(8))
    monkeypatch.setattr(iterations, "BLOCK", POSES // 3)
    parts = solve_all(partial(iterations.newton, False), CASES[2], jnp.asarray(8))
    np.testing.assert_allclose(parts, whole, rtol=1e-13)


@pytest.mark.parametrize("method", by.OPTIMISTIX)
def test_optimistix_solves_the_same_equations(method):
    case = CASES[1]  # from its sketch every method reaches every pose
    found = solve_all(by.OPTIMISTIX[method], case, jnp.asarray(1e-13))
    np.testing.assert_allclose(found, exactly(case), atol=1e-9)


@each_case
def test_gradients_agree_with_the_reference(case):
    """Of the closed form, of Newton's method, implicit, and by differences of SciPy's fsolve."""
    work = by.Workload(case, POSES, gradient=True)
    linkage, angles = linkage_of(case), jnp.asarray(case.angles(POSES))
    expected = by.exact_gradient(case, POSES)
    scale = np.max(np.abs(expected))
    for method, *setting in ((by.OURS,), (by.ADAPTIVE, jnp.asarray(1e-13))):
        slopes = jax.jit(jax.grad(by.mean_square(work, method)))
        parts = slopes(dimensions(linkage), linkage, angles, *setting)
        found = jax.tree.leaves(sizes_of(with_dimensions(drawn(case), parts)))
        np.testing.assert_allclose(found, expected, atol=1e-12 * scale)
    # In steps of 15 degrees fsolve ends in the slider-crank's other assembly; not in these.
    found = walks.gradient_by_differences(walks.fsolve_walk, case, case.angles(POSES), 1e-12)
    np.testing.assert_allclose(found, expected, atol=1e-7 * scale)


@each_case
@pytest.mark.parametrize("name", by.SEQUENTIAL)
@pytest.mark.filterwarnings("ignore")  # what the peers warn of is theirs
def test_other_tools_solve_the_same_sweep(case, name):
    tool = by.SEQUENTIAL[name]
    if not measuring.installed(tool.package):
        pytest.skip(f"{tool.package} is not installed; the extra 'peers' brings it")
    call, read = tool.walk(case, numbers_of(case), case.angles(POSES), 1e-12)
    for _ in range(2):  # a second call starts afresh
        assert by.position_error(case, POSES, POSES, read, call()) < 1e-8


def test_an_error_is_found_where_there_is_one():
    found = exactly(CASES[0])
    error = partial(by.position_error, CASES[0], POSES, POSES, np.asarray)
    assert error(found) < 1e-15
    found[7, 1, 0] += 1.2
    np.testing.assert_allclose(error(found), 1.2 / 120, rtol=1e-9)
    found[7, 1, 0] = np.nan
    assert error(found) == math.inf


def test_the_six_bar_is_driven_within_its_limits():
    ends = jnp.deg2rad(jnp.asarray([-66.0, -62.0, 159.0, 163.0]))
    solve = jax.jit(partial(iterations.closed_form, CASES[2], ("D",)))
    _, (ok, _) = solve(linkage_of(CASES[2]), ends)
    np.testing.assert_array_equal(ok, [False, True, True, False])


@pytest.mark.slow
def test_the_study_end_to_end(tmp_path):
    quick = {"poses": 20, "repeats": 3, "linkage": "slider-crank"}
    quick |= dict.fromkeys(("peers", "first_call", "float32", "optimistix"), False)
    results = designopt.run_study(
        "linkage-precision", LinkagePrecisionSpec(**quick), out=tmp_path / "out"
    )
    document = json.loads((tmp_path / "out" / "results.json").read_text(encoding="utf-8"))
    metrics = document["metrics"]
    assert metrics["closed_form_worst_error"]["met"]
    assert metrics["four_bar_over_mechanism"]["value"] is None
    assert metrics["slider_crank_gradient_over_value"]["value"] > 0
    # The other targets belong to the longest sweep.
    judged = {name for name, metric in metrics.items() if metric["target"] is not None}
    assert judged == {"closed_form_worst_error"}
    panels = {row["panel"] for row in document["precision"]}
    assert panels == {"slider-crank, 20 poses", "slider-crank, gradient over 20 poses"}
    [table] = [table for table in results.tables if table.name == "all_rows"]
    columns = dict(zip(table.columns, zip(*table.rows, strict=True), strict=True))
    assert set(columns["poses"]) == {1, 20}
    for row in document["left_out"]:
        assert 0 < row["scene_operations"] < row["general_operations"]
    assert len(document["claims"]) == 2


def test_the_first_call_is_timed_in_a_fresh_process(monkeypatch):
    monkeypatch.setattr(measuring, "FRESH_PROCESSES", 1)
    assert len(run.first_call("four-bar")) == 1  # it raises where the process fails


def test_workloads_follow_the_spec():
    assert len(run.workloads(LinkagePrecisionSpec())) == 3 * (3 + 4)
    short = LinkagePrecisionSpec(poses=360, gradients=False, float32=False)
    panels = [work.panel for work in run.workloads(short)]
    assert panels[:2] == ["four-bar, 1 pose", "four-bar, 360 poses"]
