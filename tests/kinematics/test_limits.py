"""Limits against closed forms, brute force, and their own derivatives."""

from functools import cache

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from kinematics import classify_grashof, find_limits, parse_linkage, solve_turning_point
from tests.helpers import central_differences, nightly
from tests.kinematics.gallery import (
    ends,
    four_bar,
    gallery,
    gallery_tables,
    pin_in_two_slots,
    poses_of,
    slider_crank,
)

EXACT = 1e-10  # what the project promises for a turning point


@cache
def limits_of(name):
    """Of the crank of a linkage of the gallery."""
    return find_limits(gallery(name), "crank")


def crank_angle(crank, ground, diagonal):
    """Crank angle at which the pins of the dyad are a given distance apart (law of cosines)."""
    return np.arccos((crank**2 + ground**2 - diagonal**2) / (2 * crank * ground))


@pytest.mark.parametrize("count", [2, *nightly(12)])
def test_a_four_bar_locks_where_its_dyad_is_straight(count):
    random = np.random.default_rng(2)
    checked = 0
    while checked < count:
        crank, coupler, rocker, ground = random.uniform(1, 5, 4).round(2).tolist()
        lengths = (crank, coupler, rocker, ground)
        if max(lengths) * 2 > sum(lengths) * 0.95 or classify_grashof(*lengths).margin > -0.2:
            continue
        far = (coupler + rocker, crank + ground), (abs(coupler - rocker), abs(ground - crank))
        straight = set()
        if far[0][0] < far[0][1]:
            straight.add(crank_angle(crank, ground, far[0][0]))
        if far[1][0] > far[1][1]:
            straight.add(crank_angle(crank, ground, far[1][0]))
        if not straight:
            continue
        checked += 1
        limits = find_limits(parse_linkage(four_bar(*lengths)), "crank")
        for limit in ends(limits):
            folded = abs(np.arctan2(np.sin(limit.value), np.cos(limit.value)))
            assert min(abs(folded - end) for end in straight) < EXACT
            assert set(limit.bodies) == {"coupler", "rocker"}


def test_a_slider_crank_locks_where_its_rod_is_square_to_the_line():
    limits = find_limits(parse_linkage(slider_crank(50, 40, -5, at=0.2)), "crank")
    found = [limit.value for limit in ends(limits)]
    np.testing.assert_allclose(found, np.arcsin([-45 / 50, 35 / 50]), rtol=0, atol=EXACT)


def test_a_slide_has_a_stroke():
    """Driven at the slider, an in-line slider-crank goes from rod − crank to rod + crank."""
    tables = slider_crank(40, 120, 0)
    tables["inputs"] = [{"name": "ram", "slider": "C"}]
    limits = find_limits(parse_linkage(tables), "ram")
    np.testing.assert_allclose([limit.value for limit in ends(limits)], [80, 160], atol=1e-8)


def test_a_narrow_gap_between_samples_is_found():
    """The crank can almost turn: it is locked for a hundredth of a degree, far from any sample."""
    half = np.deg2rad(0.005)
    reach = np.sqrt(2**2 + 5**2 + 2 * 2 * 5 * np.cos(half))
    limits = find_limits(parse_linkage(four_bar(2, reach - 4, 4, 5, sketch_deg=20.2)), "crank")
    assert ends(limits)[1].value == pytest.approx(np.pi - half, abs=1e-9)
    assert ends(limits)[0].value == pytest.approx(-np.pi + half, abs=1e-9)


def test_a_start_at_the_limit_is_the_limit():
    """An in-line slider-crank whose crank is twice its rod goes to ±30°."""
    linkage = parse_linkage(slider_crank(2, 1, 0, at=0.2))
    for end in (1, -1):
        limits = find_limits(linkage, "crank", jnp.array([end * (np.pi / 6 + 1e-12)]))
        assert ends(limits)[0].value == pytest.approx(-np.pi / 6, abs=1e-9)
        assert ends(limits)[1].value == pytest.approx(np.pi / 6, abs=1e-9)


def test_a_pin_in_two_slots_ends_where_they_are_parallel():
    linkage = parse_linkage(pin_in_two_slots(5))
    limits = find_limits(linkage, "arm")
    assert ends(limits)[0].value == pytest.approx(0, abs=EXACT)
    assert ends(limits)[1].value == pytest.approx(np.pi, abs=EXACT)
    poses = poses_of(linkage, jnp.array([[0.5], [1.0], [2.0], [-0.1], [0.0]]))
    # Beyond its end it would come back from the other side.
    assert poses.ok[:4].tolist() == [True, True, True, False]
    # A pin in two slots is where they cross; parallel ones have no place, and no margin.
    wanted = 5 / np.tan([0.5, 1.0, 2.0])
    np.testing.assert_allclose(poses.value.joints["P"].x[:3], wanted, rtol=1e-12)
    assert float(poses.margin[4]) == 0.0


@cache
def locking_triad():
    """Stephenson's linkage with a crank too long to turn fully, and its limits."""
    linkage = parse_linkage(gallery_tables("stephenson", {"bodies/crank/lengths": {"O6-D": 25.0}}))
    return linkage, find_limits(linkage, "crank")


@pytest.mark.slow
def test_beyond_the_lock_nothing_is_found_and_the_reason_is_told():
    linkage, limits = locking_triad()
    values = ends(limits)[1].value + np.array([-1e-6, 1e-6, 1e-2, 0.5])
    poses = poses_of(linkage, values[:, None])
    assert poses.ok.tolist() == [True, False, False, False]
    assert poses.margin[0] > 0 > poses.margin[1]
    assert np.all(np.diff(poses.margin) < 0)
    assert "locks before it comes here" in poses.messages()[1]


@pytest.mark.slow
def test_limits_of_a_triad_do_not_depend_on_where_the_search_starts():
    linkage, here = locking_triad()
    there = find_limits(linkage, "crank", linkage.reference.inputs + 0.3)
    for one, other in zip(ends(here), ends(there), strict=True):
        assert one.locks
        assert one.value == pytest.approx(other.value, abs=EXACT)


def test_only_what_is_asked_for_has_to_follow():
    """Watt's first four-bar turns fully; its second does not."""
    linkage = gallery("watt")
    assert not limits_of("watt").full_turn
    assert find_limits(linkage, "crank", of=("B",)).full_turn


def test_change_points():
    limits = find_limits(parse_linkage(four_bar(1, 3, 2, 4)), "crank")  # 1 + 4 = 3 + 2
    assert limits.full_turn
    assert [np.cos(point) for point in limits.change_points] == pytest.approx([-1], abs=1e-9)
    parallelogram = find_limits(parse_linkage(four_bar(2, 5, 2, 5)), "crank")
    assert parallelogram.full_turn
    cosines = sorted({round(float(np.cos(p)), 6) for p in parallelogram.change_points})
    assert cosines == [-1.0, 1.0]


@pytest.mark.parametrize("name", ["quick-return", "jansen"])
def test_cranks_that_turn_fully(name):
    assert limits_of(name).full_turn


def test_the_first_of_several_groups_to_lock_counts():
    limits = limits_of("watt")
    for limit, outward in zip(ends(limits), (-1, 1), strict=True):
        beside = limit.value + outward * np.array([[-1e-7], [1e-7]])
        assert poses_of(gallery("watt"), jnp.asarray(beside)).ok.tolist() == [True, False]
        assert limit.bodies == ("link", "output")


def test_other_inputs_are_held_where_they_are_asked():
    linkage = gallery("five-bar")
    limits = find_limits(linkage, "left", jnp.deg2rad(jnp.array([20.0, 170.0])))
    # The right end is then at 12 − 4 = 8 less a little, so that the left one goes all the way.
    assert limits.full_turn
    with pytest.raises(ValueError, match="no input is named 'crank'"):
        find_limits(linkage, "crank")


def test_a_start_that_is_no_pose_is_refused():
    with pytest.raises(ValueError, match="no pose"):
        find_limits(gallery("watt"), "crank", jnp.array([np.pi]))


@pytest.mark.slow
def test_turning_points_of_a_triad():
    """Where it locks, the Jacobian is singular: two assemblies meet as a square root."""
    linkage, limits = locking_triad()
    assert not limits.full_turn
    for limit, outward in zip(ends(limits), (-1, 1), strict=True):
        steps = np.array([1e-4, 1e-6, 1e-8, -1e-9])
        poses = poses_of(linkage, limit.value - outward * steps[:, None])
        assert poses.ok.tolist() == [True, True, True, False]
        # The margin, a singular value, vanishes as the root of what is left.
        ratios = np.asarray(poses.margin)[:3] / np.sqrt(steps[:3])
        np.testing.assert_allclose(ratios, ratios[-1], rtol=0.05)


@pytest.mark.parametrize("name", ["watt", *nightly("double-butterfly")])
def test_turning_points_are_differentiable(name):
    linkage = gallery(name)
    _, limit = ends(limits_of(name))
    body = linkage.structure.moving[-1].name

    @jax.jit
    def value(length):
        longer = eqx.tree_at(lambda design: design.links[body].length, linkage, length)
        return solve_turning_point(longer, "crank", limit).value

    length = linkage.links[body].length
    assert float(value(length)) == pytest.approx(limit.value, abs=1e-12)
    (wanted,) = central_differences(value, length)
    assert float(jax.jit(jax.grad(value))(length)) == pytest.approx(wanted, rel=1e-5)


def test_impossible_four_bars_have_no_class():
    with pytest.raises(ValueError, match="cannot close"):
        classify_grashof(1, 1, 1, 4)
    with pytest.raises(ValueError, match="positive"):
        classify_grashof(0, 1, 1, 1)
