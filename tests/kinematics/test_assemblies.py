"""All assemblies, none missed: against brute force, and up to six of a triad."""

import jax.numpy as jnp
import numpy as np
import pytest
import scipy.optimize

from kinematics import find_assemblies, parse_linkage
from kinematics.solve.triads import solve_two_loops
from tests.kinematics.gallery import four_bar, gallery


def positions(found, joint):
    return sorted(tuple(np.round(np.asarray(pose.position(joint)), 6)) for pose in found.poses)


def test_both_sides_of_a_four_bar():
    found = find_assemblies(gallery("four-bar"), jnp.deg2rad(jnp.array([40.0])))
    assert found.complete
    angles = sorted(float(np.rad2deg(pose.angle("rocker"))) for pose in found.poses)
    assert angles == pytest.approx([-98.01, 57.33], abs=0.011)  # Norton, Example 4-1


def test_a_pose_that_does_not_exist_has_no_assembly():
    found = find_assemblies(gallery("watt"), jnp.deg2rad(jnp.array([180.0])))
    assert (len(found.poses), found.complete) == (0, True)


def test_where_two_assemblies_meet_there_is_one():
    stretched = parse_linkage(four_bar(10, 30, 30, 50))  # 10 + 50 = 30 + 30
    found = find_assemblies(stretched, jnp.array([np.pi]))
    assert len(found.poses) == 1


def test_all_sides_of_a_dyadic_linkage():
    found = find_assemblies(gallery("jansen"), gallery("jansen").reference.inputs)
    assert (len(found.poses), found.complete) == (8, True)
    assert len({positions(found, "J7")[i] for i in range(8)}) == 8


def brute_force(residual, is_angle, reach, starts=3000, seed=0):
    random = np.random.default_rng(seed)
    scale = np.where(is_angle, np.pi, reach)
    found = []
    for start in random.uniform(-1, 1, (starts, 4)) * scale:

        def real(unknowns):
            gaps = residual(unknowns)
            return np.concatenate([gaps.real, gaps.imag])

        at, _, status, _ = map(
            np.asarray, scipy.optimize.fsolve(real, start, xtol=1e-13, full_output=True)
        )
        if status != 1 or np.max(np.abs(real(at))) > 1e-9:
            continue
        x = np.where(is_angle, np.angle(np.exp(1j * at)), at)
        step = [
            np.max(np.where(is_angle, np.abs(np.exp(1j * x) - np.exp(1j * y)), np.abs(x - y)))
            for y in found
        ]
        if all(s > 1e-5 for s in step):
            found.append(x)
    return np.array(sorted(map(tuple, found))).reshape(-1, 4)


def triad(links, platform, pivots):
    """Three links from fixed pivots to the corners of a platform: unknowns links 1-3, platform."""

    def residual(unknowns):
        first, second, third = pivots + links * np.exp(1j * unknowns[:3])
        corners = first + platform * np.exp(1j * unknowns[3])
        return corners - [second, third]

    return residual


# The bound of the sextic is attained.
SIX = (
    np.array([1.09, 0.86, 1.37]),
    np.array([0.54 + 0.61j, -0.88 + 0.61j]),
    np.array([0, -0.71 + 0.6j, -0.57 - 0.53j]),
)


def test_random_triads_have_the_solutions_that_brute_force_finds():
    random = np.random.default_rng(5)
    counts = []
    for number in range(5):
        links = random.uniform(0.4, 1.6, 3)
        platform = random.uniform(0.3, 1.2, 2) * np.exp(1j * random.uniform(0, 6, 2))
        pivots = random.uniform(-1, 1, 3) + 1j * random.uniform(-1, 1, 3)
        residual = triad(*((links, platform, pivots) if number else SIX))
        found = solve_two_loops(residual, (True,) * 4, 10.0)
        expected = brute_force(residual, (True,) * 4, 1.0, starts=500 if number else 1000)
        assert found.complete
        counts.append(len(found.unknowns))
        assert len(found.unknowns) == len(expected)
        if len(expected):
            np.testing.assert_allclose(found.unknowns, expected, atol=1e-6)
    assert counts[0] == 6
    assert 4 in counts


def test_a_triad_with_a_slide():
    """One link replaced by a slide along a fixed line."""
    pivots, links, platform = np.array([0, 1 + 0.2j]), [0.8, 0.9], np.array([0.7, 0.4 + 0.5j])

    def residual(unknowns):
        first, second = pivots + links * np.exp(1j * unknowns[:2])
        corners = first + platform * np.exp(1j * unknowns[2])
        return corners - [second, 0.3 + 0.9j + unknowns[3] * np.exp(0.4j)]

    kinds = (True, True, True, False)
    found = solve_two_loops(residual, kinds, 5.0)
    expected = brute_force(residual, kinds, 2.0, starts=600)
    assert found.complete
    assert len(expected) > 0
    np.testing.assert_allclose(found.unknowns, expected, atol=1e-6)


@pytest.mark.slow
def test_three_loops_are_not_called_complete():
    found = find_assemblies(
        gallery("double-butterfly"), gallery("double-butterfly").reference.inputs
    )
    assert not found.complete
    assert len(found.poses) >= 2
