"""The study ``linkage-precision``: its reference, its methods, and a short run."""

import math
from functools import partial

import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest

from designopt.study.stability import DIGITS
from studies.benchmarks import measuring
from studies.benchmarks.linkage import LinkagePrecisionSpec, iterations, run, walks
from studies.benchmarks.linkage import methods as by
from studies.benchmarks.linkage.cases import (
    CASES,
    dimensions,
    drawn,
    gaps,
    linkage_of,
    numbers_of,
    sizes_of,
    with_dimensions,
)
from studies.oracles import linkages as exact
from tests.studies.quick import quick_run

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
    """In 50 digits, by the loop equations; the sides are read from its sketch."""
    with mpmath.workdps(DIGITS):
        sizes, angles = numbers_of(case, mpmath.mpf), exact.digits(case.angles(12))
        for angle, found in zip(angles, exact.poses(case, sizes, angles), strict=True):
            places = sizes.pins | dict(zip(case.joints, found, strict=True))
            places = {name: mpmath.mpc(*place) for name, place in places.items()}
            unknowns = []
            for dyad in case.dyads:
                way = places[dyad.joint] - places[dyad.start]
                unknowns.append(mpmath.arg(way))
                if dyad.arm:
                    base = places[dyad.end]
                    unknowns.append(mpmath.arg(places[dyad.joint] - base))
                    assert dyad.side * (way / (base - places[dyad.start])).imag > 0
                else:
                    unknowns.append(abs(places[dyad.joint] - mpmath.mpc(*sizes.line[:2])))
                    assert way.real > 0
            joints, left = gaps(mpmath, case, sizes, angle, unknowns)
            assert max(map(abs, left)) < 1e-43
            assert max(abs(mpmath.mpc(*joints[name]) - places[name]) for name in joints) < 1e-43


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
    # The other targets belong to the longest sweep.
    done = quick_run("linkage-precision", tmp_path, judged={"closed_form_worst_error"})
    assert done.measured["four_bar_over_mechanism"] is None
    assert done.measured["slider_crank_gradient_over_value"] > 0
    panels = {row["panel"] for row in done.document["precision"]}
    assert panels == {"slider-crank, 20 poses", "slider-crank, gradient over 20 poses"}
    assert set(done.table("all_rows")["poses"]) == {1, 20}
    for row in done.document["left_out"]:
        assert 0 < row["scene_operations"] < row["general_operations"]
    assert len(done.document["claims"]) == 2


def test_the_first_call_is_timed_in_a_fresh_process(monkeypatch):
    monkeypatch.setattr(measuring, "FRESH_PROCESSES", 1)
    assert len(run.first_call("four-bar")) == 1  # it raises where the process fails


def test_workloads_follow_the_spec():
    assert len(run.workloads(LinkagePrecisionSpec())) == 3 * (3 + 4)
    short = LinkagePrecisionSpec(poses=360, gradients=False, float32=False)
    panels = [work.panel for work in run.workloads(short)]
    assert panels[:2] == ["four-bar, 1 pose", "four-bar, 360 poses"]
