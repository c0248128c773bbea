"""Other people's numbers: a failure here means that the library disagrees with the literature.

The cases, with their sources and tolerances, stand in ``tests/data/linkage_cases.json``. Every one
runs through the public functions, with which `test_solve_command` compares ``designopt solve``.
"""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.optimize

from kinematics import classify_grashof, find_limits, parse_linkage, solve_poses
from tests.helpers import close, published_cases
from tests.kinematics.gallery import (
    ends,
    four_bar,
    poses_of,
    rates_of,
    slider_crank,
    tables_of,
    transmission_of,
)

CASES = published_cases("linkage_cases.json")


NORTON = (40.0, 120.0, 80.0, 100.0)


def pose_at(tables, *degrees):
    """The pose at angles of the inputs; it exists."""
    poses = poses_of(parse_linkage(tables), jnp.asarray(np.radians(degrees)))
    assert bool(poses.ok)
    return poses.value


@pytest.mark.parametrize(("mode", "side"), [("open", 1), ("crossed", -1)])
def test_norton_four_bar_positions(mode, side):
    inputs, expected, tolerance = CASES["norton-ex4-1-position"]
    pose = pose_at(four_bar(*NORTON, side=side), inputs["theta2_deg"])
    for body, angle in (("coupler", "theta3"), ("rocker", "theta4")):
        close(np.rad2deg(pose.angle(body)), expected[f"{angle}_{mode}_deg"], tolerance)


def test_norton_four_bar_velocities_and_accelerations():
    inputs, velocity, near = CASES["norton-ex6-7-velocity"]
    given, acceleration, near_2 = CASES["norton-ex7-2-acceleration"]
    at = np.radians([inputs["theta2_deg"]])
    rates = np.array([inputs["omega2"]], float), np.array([given["alpha2"]], float)
    motion = rates_of(parse_linkage(four_bar(*NORTON)), at, *rates)
    for found, turn, letter, wanted, within in (
        (motion.velocity, "omega", "V", velocity, near),
        (motion.acceleration, "alpha", "A", acceleration, near_2),
    ):
        for body, number in (("coupler", 3), ("rocker", 4)):
            close(found.bodies[body], wanted[f"{turn}{number}"], within[f"{turn}{number}"])
        joints = {"A": found.joints["A"], "B": found.joints["B"]}
        joints["BA"] = joints["B"] - joints["A"]
        for joint, vector in joints.items():
            name = f"{letter}{joint}_xy"
            if name in wanted:
                close(vector.stacked(), wanted[name], within[name])


@pytest.mark.parametrize(("mode", "sign"), [("open", 1), ("crossed", -1)])
def test_norton_offset_slider_crank(mode, sign):
    inputs, expected, tolerance = CASES["norton-ex4-2-offset-slider-crank"]
    tables = slider_crank(inputs["a_crank"], inputs["b_conrod"], inputs["c_offset"], sign=sign)
    pose = pose_at(tables, inputs["theta2_deg"])
    # Norton measures theta3 at the slider's pin, towards the crank's.
    wanted = expected[f"theta3_{mode}_deg"] % 360
    close(np.mod(np.rad2deg(pose.angle("rod")) + 180, 360), wanted, tolerance)
    close([pose.joints["C"].x, pose.slides[0]], [expected[f"d_{mode}"]] * 2, tolerance)


@pytest.mark.parametrize(("number", "side"), [(1, 1), (2, -1)])
def test_ch_toolkit_four_bar_on_inclined_ground(number, side):
    inputs, expected, tolerance = CASES["ch-toolkit-fourbar"]
    lengths = [inputs[name] for name in ("r2_crank", "r3_coupler", "r4_rocker", "r1_ground")]
    tables = four_bar(*lengths, side=side, ground_deg=inputs["theta1_deg"])
    pose = pose_at(tables, inputs["theta2_deg"])
    for body, name in (("coupler", "theta3"), ("rocker", "theta4")):
        close(pose.angle(body), expected[f"{name}_{number}_rad"], tolerance)


def test_inclined_ground_counts_when_the_input_is_relative_to_it():
    tables = four_bar(4, 12, 7, 12, ground_deg=10)
    absolute = pose_at(tables, 70.0).angle("rocker")
    tables["inputs"][0]["relative_to"] = "ground"
    assert float(pose_at(tables, 60.0).angle("rocker")) == pytest.approx(float(absolute), abs=1e-14)


def test_course_sheet_slider_crank():
    inputs, expected, near = CASES["coursehero-mathcad-slider-crank"]
    tables = slider_crank(inputs["a_crank"], inputs["b_conrod"], inputs["c_offset"])
    at = jnp.asarray(np.radians([inputs["theta2_deg"]]))
    rates = rates_of(parse_linkage(tables), at, jnp.array([inputs["omega2"]], float)).velocity
    angle = np.rad2deg(pose_at(tables, inputs["theta2_deg"]).angle("rod"))
    close(angle + 180, expected["theta3_deg"], near["theta3_deg"])
    close(abs(rates.bodies["rod"]), expected["omega3_abs"], near["omega3_abs"])
    close(abs(rates.joints["C"].x), expected["v_slider_abs"], near["v_slider_abs"])


def test_golden_slider_crank():
    inputs, expected, near = CASES["linkage-sim-golden-slidercrank"]
    tables = slider_crank(inputs["a_crank"], inputs["b_conrod"], inputs["c_offset"])
    linkage = parse_linkage(tables)
    at = np.radians(inputs["theta2_deg"])[:, None]
    pose = poses_of(linkage, at).value
    motion = rates_of(linkage, at, np.array([inputs["omega2"]], float))
    for name, found in (
        ("x_slider", pose.joints["C"].x),
        ("theta3_rad", pose.angle("rod")),
        ("omega3", motion.velocity.bodies["rod"]),
        ("v_slider", motion.velocity.joints["C"].x),
        ("alpha3", motion.acceleration.bodies["rod"]),
        ("a_slider", motion.acceleration.joints["C"].x),
    ):
        close(found, expected[name], near[name])


def test_exact_transmission_angles():
    inputs, expected, tolerance = CASES["linkage-sim-transmission-angle"]
    lengths = [inputs[k] for k in ("a_crank", "b_coupler", "c_rocker", "d_ground")]
    at = jnp.asarray(np.radians(inputs["theta2_deg"]))[:, None]
    found = transmission_of(parse_linkage(four_bar(*lengths)), at).angles["B"]
    close(np.rad2deg(found), expected["mu_deg"], tolerance)


def test_jansen_leg():
    inputs, expected, tolerance = CASES["pyslvs-jansen"]
    joints = inputs["joints"]
    crank_lengths = [length or np.hypot(*joints["1"]) for length in inputs["crank_length"]]
    bars = {f"bar{a}{b}": f"{a} {b}" for a, b in inputs["bars"]}
    drive = [{"name": "crank", "body": "bar01"}]
    fixed = " ".join(map(str, inputs["ground"]))
    for angle, length, x, y in zip(
        inputs["theta_crank_deg"], crank_lengths, expected["P7_x"], expected["P7_y"], strict=True
    ):
        tables = tables_of(joints, fixed, bars, {"bar01": length}, inputs=drive)
        close(pose_at(tables, angle).position("7"), [x, y], tolerance)


@pytest.mark.parametrize("mirror", [1, -1])
def test_rhombus_at_its_change_point(mirror):
    """All links in one line and two pins in one place: the pose is what it tends to."""
    inputs, expected, tolerance = CASES["pyslvs-parallelogram-change-point"]
    tables = four_bar(100, 100, 100, inputs["ground"][1][0], sketch_deg=45)
    for joint in ("A", "B"):  # sketched on either side of the change point
        tables["joints"][joint] = [tables["joints"][joint][0], mirror * tables["joints"][joint][1]]
    poses = poses_of(parse_linkage(tables), jnp.zeros(1))
    assert bool(poses.ok)
    assert abs(poses.margin) <= 1e-12
    close(poses.value.position("B"), expected["P"], tolerance)


@pytest.mark.parametrize("number", [0, 1, 2])
def test_circles_that_meet_and_touch(number):
    inputs, expected, near = CASES["pyslvs-dyad-rrr"]
    left, right = inputs["radii"][number]
    (near_x, _), (far_x, _) = inputs["c1"], inputs["c2"]
    # A crank puts the left centre in its place; from there, the circles come apart on one side.
    crank, angle = (10, 180) if left + right == far_x - near_x else (10, 0)
    pivot = near_x - crank * np.cos(np.deg2rad(angle))
    tables = four_bar(crank, left, right, far_x - pivot)
    for joint in tables["joints"].values():
        joint[0] += pivot
    x, y = pose_at(tables, angle).position("B")
    close(x, expected["P_x"][number], near["P_x"])
    close(y, expected["P_y"][number], near["P_y"])


def test_five_bar_with_coordinated_inputs():
    inputs, expected, tolerance = CASES["mechanism-fivebar"]
    a, b, c, d, ground = (inputs[k] for k in ("a", "b", "c", "d", "e_ground"))
    # Both inputs are angles of the first two links, against the ground.
    first = inputs["theta_a_rad"][0]
    end = [a * np.cos(first), a * np.sin(first)]
    elbow = [end[0] + b * np.cos(3 * first), end[1] + b * np.sin(3 * first)]
    joints = {"O2": [0, 0], "A": end, "B": elbow, "O5": [ground, 0]}
    joints["C"] = [expected["C_x"][0], expected["C_y"][0]]
    tables = tables_of(
        joints,
        "O2 O5",
        {"a": "O2 A", "b": "A B", "c": "B C", "d": "O5 C"},
        {"a": a, "b": b, "c": c, "d": d},
        inputs=[{"name": "t", "body": "a"}, {"name": "u", "body": "b"}],
    )
    angles = np.array(inputs["theta_a_rad"])
    poses = poses_of(parse_linkage(tables), jnp.asarray(np.stack([angles, 3 * angles], axis=-1)))
    assert bool(jnp.all(poses.ok))
    place = poses.value.joints["C"]
    for found, name in (
        (place.x, "C_x"),
        (place.y, "C_y"),
        (poses.value.angle("c"), "theta_c_rad"),
        (poses.value.angle("d"), "theta_d_rad"),
    ):
        close(found, expected[name], tolerance)


def test_watts_curve():
    """The rod's midpoint lies on the closed-form curve, at the polar angles of the case."""
    inputs, expected, tolerance = CASES["watts-curve-polar"]
    b, a, c = inputs["crank_b"], inputs["half_distance_a"], inputs["half_rod_c"]
    tables = four_bar(b, 2 * c, b, 2 * a)
    for joint in tables["joints"].values():
        joint[0] -= a
    tables["joints"]["M"] = np.mean([tables["joints"]["A"], tables["joints"]["B"]], axis=0).tolist()
    tables["bodies"]["coupler"]["joints"] = ["A", "B", "M"]
    tables["bodies"]["coupler"]["lengths"] = {"A-B": 2 * c, "A-M": c}
    linkage = parse_linkage(tables)
    low, high = (limit.value for limit in ends(find_limits(linkage, "crank")))
    angles = np.linspace(low, high, 2001)
    side_of = jax.jit(lambda inputs, signs: solve_poses(linkage, inputs, signs=signs))

    def midpoints(cranks, side):
        """As many cranks as in the sweep, so that one program serves them all."""
        filled = np.resize(cranks, len(angles))[:, None]
        poses = side_of(jnp.asarray(filled), jnp.asarray([side], float))
        count = len(cranks)
        return np.asarray(poses.value.position("M"))[:count], np.asarray(poses.ok)[:count]

    swept = {side: midpoints(angles, side) for side in (1.0, -1.0)}
    for theta, wanted in zip(inputs["polar_theta_rad"], expected["r"], strict=True):
        normal = np.array([-np.sin(theta), np.cos(theta)])
        radii = []
        for side, (places, ok) in swept.items():
            across = places @ normal
            at = np.flatnonzero((across[:-1] * across[1:] < 0) & ok[:-1] & ok[1:])
            least, most = angles[at], angles[at + 1]
            for _ in range(45 if len(at) else 0):  # bisection
                middle = (least + most) / 2
                before = midpoints(middle, side)[0] @ normal * across[at] > 0
                least, most = np.where(before, middle, least), np.where(before, most, middle)
            radii += [np.hypot(*place) for place in midpoints(least, side)[0]] if len(at) else []
        assert min(abs(radius - wanted) for radius in radii) <= tolerance


def test_quick_return_time_ratio():
    """The crank's turn between the lever's dead points, found as roots of its angular velocity."""
    inputs, expected, tolerance = CASES["quick-return-time-ratio"]
    r, d = inputs["r"], inputs["d"]
    tables = tables_of(
        {"O4": [0, 0], "O2": [0, d], "A": [r, d], "T": [2 * r, 2 * d]},
        "O4 O2",
        {"crank": "O2 A", "lever": "O4 T"},
        sliders=[{"joint": "A", "on": "lever", "line": [[0, 0], [r, d]]}],
        inputs=[{"name": "crank", "body": "crank", "relative_to": "world"}],
    )
    linkage = parse_linkage(tables)

    def omega(angle):
        return float(rates_of(linkage, np.array([angle]), np.ones(1)).velocity.bodies["lever"])

    quarters = (np.pi, 1.5 * np.pi, 2 * np.pi)
    dead: list[Any] = [scipy.optimize.brentq(omega, *span) for span in itertools.pairwise(quarters)]
    short = dead[1] - dead[0]
    assert (2 * np.pi - short) / short == pytest.approx(expected["time_ratio"], abs=tolerance)


def test_crank_rocker_with_unit_time_ratio():
    inputs, expected, near = CASES["brodell-soni-unit-time-ratio"]
    lengths = [inputs[k] for k in ("crank", "coupler", "rocker", "ground")]
    linkage = parse_linkage(four_bar(*lengths))
    angles = np.linspace(0, 2 * np.pi, 36001)
    rocker = np.unwrap(poses_of(linkage, angles[:, None]).value.angle("rocker"))
    least, most = int(np.argmin(rocker)), int(np.argmax(rocker))
    for name, found in (
        ("rocker_swing_deg", rocker[most] - rocker[least]),
        ("crank_angle_between_limits_deg", abs(angles[most] - angles[least])),
        ("mu_min_result_deg", np.min(transmission_of(linkage, angles[:, None]).angles["B"])),
    ):
        close(np.rad2deg(found), expected[name], near[name])


def test_grashof_classes():
    inputs, expected, _ = CASES["grashof-classes"]
    turns = zip(expected["crank_full_turn"], expected["rocker_full_turn"], strict=True)
    for lengths, name, (crank, rocker) in zip(
        inputs["lengths"], inputs["classes"], turns, strict=True
    ):
        found = classify_grashof(*lengths)
        assert found.name == name
        assert found.crank_turns == bool(crank)
        assert found.rocker_turns == bool(rocker)
        # The same from the poses: does the crank's range have an end?
        assert find_limits(parse_linkage(four_bar(*lengths)), "crank").full_turn == bool(crank)


def test_no_case_is_left_out():
    text = Path(__file__).read_text(encoding="utf-8")
    assert [name for name in CASES if f'"{name}"' not in text] == []
