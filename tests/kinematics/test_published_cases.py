"""Other people's numbers: a failure here means that the library disagrees with the literature.

The cases, with their sources and tolerances, stand in ``tests/data/linkage_cases.json``. Every one
runs through the public functions; those that are positions, velocities or accelerations also run
through ``designopt solve`` on a file.
"""

from __future__ import annotations

import csv
import io
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from designopt.cli import run
from designopt.io.toml_writing import format_toml
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


@pytest.fixture
def solve(tmp_path, capsys):
    """``designopt solve`` on tables: rows of numbers by column, None for an empty cell."""

    def rows(tables, *arguments):
        path = tmp_path / "linkage.toml"
        path.write_text(format_toml(tables), encoding="utf-8")
        assert run(["solve", str(path), *arguments]) == 0
        return [
            {key: float(value) if value else None for key, value in row.items()}
            for row in csv.DictReader(io.StringIO(capsys.readouterr().out))
        ]

    return rows


NORTON = (40.0, 120.0, 80.0, 100.0)


@pytest.mark.parametrize(("mode", "side"), [("open", 1), ("crossed", -1)])
def test_norton_four_bar_positions(mode, side, solve):
    inputs, expected, tolerance = CASES["norton-ex4-1-position"]
    tables = four_bar(*NORTON, side=side)
    poses = poses_of(parse_linkage(tables), jnp.deg2rad(jnp.array([inputs["theta2_deg"]])))
    (row,) = solve(tables, "--sweep", f"crank={inputs['theta2_deg']}")
    for body, angle in (("coupler", "theta3"), ("rocker", "theta4")):
        wanted = expected[f"{angle}_{mode}_deg"]
        close(
            [np.rad2deg(poses.value.angle(body)), row[f"{body}.angle_deg"]], [wanted] * 2, tolerance
        )


def test_norton_four_bar_velocities_and_accelerations(solve):
    inputs, velocity, near = CASES["norton-ex6-7-velocity"]
    given, acceleration, near_2 = CASES["norton-ex7-2-acceleration"]
    tables = four_bar(*NORTON)
    motion = rates_of(
        parse_linkage(tables),
        jnp.deg2rad(jnp.array([inputs["theta2_deg"]])),
        jnp.array([inputs["omega2"]], float),
        jnp.array([given["alpha2"]], float),
    )
    (row,) = solve(tables, "--sweep", "crank=40", "--rate", "crank=25", "--accel", "crank=15")
    first, second = motion.velocity, motion.acceleration
    b_to_a = first.joints["B"] - first.joints["A"]
    for body, number in (("coupler", 3), ("rocker", 4)):
        for found, column, wanted, within in (
            (first, "omega", velocity, near),
            (second, "alpha", acceleration, near_2),
        ):
            name = f"{column}{number}"
            close(found.bodies[body], wanted[name], within[name])
            close(row[f"{body}.{column}"], wanted[name], within[name])
    for found, wanted, tolerance in (
        (first.joints["A"].stacked(), velocity["VA_xy"], near["VA_xy"]),
        (b_to_a.stacked(), velocity["VBA_xy"], near["VBA_xy"]),
        (first.joints["B"].stacked(), velocity["VB_xy"], near["VB_xy"]),
        (second.joints["A"].stacked(), acceleration["AA_xy"], near_2["AA_xy"]),
        ([row["A.vx"], row["A.vy"]], velocity["VA_xy"], near["VA_xy"]),
        ([row[f"B.v{u}"] - row[f"A.v{u}"] for u in "xy"], velocity["VBA_xy"], near["VBA_xy"]),
        ([row["B.vx"], row["B.vy"]], velocity["VB_xy"], near["VB_xy"]),
        ([row["A.ax"], row["A.ay"]], acceleration["AA_xy"], near_2["AA_xy"]),
    ):
        close(found, wanted, tolerance)


@pytest.mark.parametrize(("mode", "sign"), [("open", 1), ("crossed", -1)])
def test_norton_offset_slider_crank(mode, sign, solve):
    inputs, expected, tolerance = CASES["norton-ex4-2-offset-slider-crank"]
    tables = slider_crank(inputs["a_crank"], inputs["b_conrod"], inputs["c_offset"], sign=sign)
    angle = inputs["theta2_deg"]
    pose = poses_of(parse_linkage(tables), jnp.deg2rad(jnp.array([angle]))).value
    (row,) = solve(tables, "--sweep", f"crank={angle}")
    # Norton measures theta3 at the slider's pin, towards the crank's.
    for found in (np.rad2deg(pose.angle("rod")), row["rod.angle_deg"]):
        wanted = expected[f"theta3_{mode}_deg"]
        assert float(np.mod(found + 180, 360)) == pytest.approx(wanted % 360, abs=tolerance)
    for found in (pose.joints["C"].x, row["C.x"], pose.slides[0]):
        assert float(found) == pytest.approx(expected[f"d_{mode}"], abs=tolerance)


@pytest.mark.parametrize(("number", "side"), [(1, 1), (2, -1)])
def test_ch_toolkit_four_bar_on_inclined_ground(number, side, solve):
    inputs, expected, tolerance = CASES["ch-toolkit-fourbar"]
    lengths = [inputs[name] for name in ("r2_crank", "r3_coupler", "r4_rocker", "r1_ground")]
    tables = four_bar(*lengths, side=side, ground_deg=inputs["theta1_deg"])
    pose = poses_of(parse_linkage(tables), jnp.deg2rad(jnp.array([inputs["theta2_deg"]]))).value
    (row,) = solve(tables, "--sweep", f"crank={inputs['theta2_deg']}")
    for body, name in (("coupler", "theta3"), ("rocker", "theta4")):
        wanted = expected[f"{name}_{number}_rad"]
        close([pose.angle(body), np.deg2rad(row[f"{body}.angle_deg"])], [wanted] * 2, tolerance)


def test_inclined_ground_counts_when_the_input_is_relative_to_it():
    tables = four_bar(4, 12, 7, 12, ground_deg=10)
    absolute = parse_linkage(tables)
    tables["inputs"][0]["relative_to"] = "ground"
    relative = parse_linkage(tables)
    one = poses_of(absolute, jnp.deg2rad(jnp.array([70.0]))).value
    other = poses_of(relative, jnp.deg2rad(jnp.array([60.0]))).value
    assert float(one.angle("rocker") - other.angle("rocker")) == pytest.approx(0, abs=1e-14)


def test_course_sheet_slider_crank(solve):
    inputs, expected, near = CASES["coursehero-mathcad-slider-crank"]
    tables = slider_crank(inputs["a_crank"], inputs["b_conrod"], inputs["c_offset"])
    linkage = parse_linkage(tables)
    at = jnp.deg2rad(jnp.array([inputs["theta2_deg"]], float))
    pose = poses_of(linkage, at).value
    rates = rates_of(linkage, at, jnp.array([inputs["omega2"]], float)).velocity
    (row,) = solve(tables, "--sweep", "crank=45", "--rate", "crank=1")
    for angle, omega, speed in (
        (np.rad2deg(pose.angle("rod")), rates.bodies["rod"], rates.joints["C"].x),
        (row["rod.angle_deg"], row["rod.omega"], row["C.vx"]),
    ):
        close(angle + 180, expected["theta3_deg"], near["theta3_deg"])
        close(abs(omega), expected["omega3_abs"], near["omega3_abs"])
        close(abs(speed), expected["v_slider_abs"], near["v_slider_abs"])


def test_golden_slider_crank(solve):
    inputs, expected, near = CASES["linkage-sim-golden-slidercrank"]
    tables = slider_crank(inputs["a_crank"], inputs["b_conrod"], inputs["c_offset"])
    linkage = parse_linkage(tables)
    at = jnp.deg2rad(jnp.array(inputs["theta2_deg"], float))[:, None]
    pose = poses_of(linkage, at).value
    motion = rates_of(linkage, at, jnp.array([inputs["omega2"]], float))
    rows = [
        solve(tables, "--sweep", f"crank={angle}", "--rate", "crank=1", "--accel", "crank=0")[0]
        for angle in inputs["theta2_deg"]
    ]
    for name, found, column in (
        ("x_slider", pose.joints["C"].x, "C.x"),
        ("omega3", motion.velocity.bodies["rod"], "rod.omega"),
        ("v_slider", motion.velocity.joints["C"].x, "C.vx"),
        ("alpha3", motion.acceleration.bodies["rod"], "rod.alpha"),
        ("a_slider", motion.acceleration.joints["C"].x, "C.ax"),
    ):
        close(found, expected[name], near[name])
        close([row[column] for row in rows], expected[name], near[name])
    angles = np.deg2rad([row["rod.angle_deg"] for row in rows])
    for found in (pose.angle("rod"), angles):
        close(found, expected["theta3_rad"], near["theta3_rad"])


def test_exact_transmission_angles(solve):
    inputs, expected, tolerance = CASES["linkage-sim-transmission-angle"]
    lengths = [inputs[k] for k in ("a_crank", "b_coupler", "c_rocker", "d_ground")]
    tables = four_bar(*lengths)
    at = jnp.deg2rad(jnp.array(inputs["theta2_deg"], float))[:, None]
    found = np.rad2deg(transmission_of(parse_linkage(tables), at).angles["B"])
    rows = solve(tables, "--sweep", "crank=0:60:2")
    for angles in (found, [row["B.mu_deg"] for row in rows]):
        close(angles, expected["mu_deg"], tolerance)


def test_jansen_leg(solve):
    inputs, expected, tolerance = CASES["pyslvs-jansen"]
    joints = inputs["joints"]
    crank_lengths = [length or np.hypot(*joints["1"]) for length in inputs["crank_length"]]
    for angle, length, x, y in zip(
        inputs["theta_crank_deg"], crank_lengths, expected["P7_x"], expected["P7_y"], strict=True
    ):
        bars = {f"bar{a}{b}": f"{a} {b}" for a, b in inputs["bars"]}
        drive = [{"name": "crank", "body": "bar01"}]
        fixed = " ".join(map(str, inputs["ground"]))
        tables = tables_of(joints, fixed, bars, {"bar01": length}, inputs=drive)
        poses = poses_of(parse_linkage(tables), jnp.deg2rad(jnp.array([angle], float)))
        (row,) = solve(tables, "--sweep", f"crank={angle}")
        assert bool(poses.ok)
        for found in (poses.value.position("7"), [row["7.x"], row["7.y"]]):
            close(found, [x, y], tolerance)


@pytest.mark.parametrize("mirror", [1, -1])
def test_rhombus_at_its_change_point(mirror, solve):
    """All links in one line and two pins in one place: the pose is what it tends to."""
    inputs, expected, tolerance = CASES["pyslvs-parallelogram-change-point"]
    tables = four_bar(100, 100, 100, inputs["ground"][1][0], sketch_deg=45)
    for joint in ("A", "B"):  # sketched on either side of the change point
        tables["joints"][joint] = [tables["joints"][joint][0], mirror * tables["joints"][joint][1]]
    poses = poses_of(parse_linkage(tables), jnp.zeros(1))
    (row,) = solve(tables, "--sweep", "crank=0")
    assert bool(poses.ok)
    assert abs(poses.margin) <= 1e-12
    for found in (poses.value.position("B"), [row["B.x"], row["B.y"]]):
        close(found, expected["P"], tolerance)


@pytest.mark.parametrize("number", [0, 1, 2])
def test_circles_that_meet_and_touch(number, solve):
    inputs, expected, near = CASES["pyslvs-dyad-rrr"]
    left, right = inputs["radii"][number]
    (near_x, _), (far_x, _) = inputs["c1"], inputs["c2"]
    # A crank puts the left centre in its place; from there, the circles come apart on one side.
    crank, angle = (10, 180) if left + right == far_x - near_x else (10, 0)
    pivot = near_x - crank * np.cos(np.deg2rad(angle))
    tables = four_bar(crank, left, right, far_x - pivot)
    for joint in tables["joints"].values():
        joint[0] += pivot
    poses = poses_of(parse_linkage(tables), jnp.deg2rad(jnp.array([angle], float)))
    (row,) = solve(tables, "--sweep", f"crank={angle}")
    assert bool(poses.ok)
    for x, y in (poses.value.position("B"), (row["B.x"], row["B.y"])):
        close(x, expected["P_x"][number], near["P_x"])
        close(y, expected["P_y"][number], near["P_y"])


def test_five_bar_with_coordinated_inputs(solve):
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
    angles = jnp.array(inputs["theta_a_rad"])
    poses = poses_of(parse_linkage(tables), jnp.stack([angles, 3 * angles], axis=-1))
    rows = [
        solve(tables, "--sweep", f"t={np.rad2deg(t)}", "--sweep", f"u={np.rad2deg(3 * t)}")[0]
        for t in inputs["theta_a_rad"]
    ]
    assert bool(jnp.all(poses.ok))
    for found, column, name in (
        (poses.value.joints["C"].x, "C.x", "C_x"),
        (poses.value.joints["C"].y, "C.y", "C_y"),
    ):
        close(found, expected[name], tolerance)
        close([row[column] for row in rows], expected[name], tolerance)
    for body, name in (("c", "theta_c_rad"), ("d", "theta_d_rad")):
        close(poses.value.angle(body), expected[name], tolerance)


def test_watts_curve(solve):
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
    side_of = jax.jit(lambda design, inputs, signs: solve_poses(design, inputs, signs=signs))
    angles = np.linspace(low, high, 2001)

    def midpoints(cranks, side):
        poses = side_of(linkage, jnp.asarray(cranks)[:, None], jnp.asarray([side], float))
        return np.asarray(poses.value.position("M")), np.asarray(poses.ok)

    swept = {side: midpoints(angles, side) for side in (1.0, -1.0)}
    for theta, wanted in zip(inputs["polar_theta_rad"], expected["r"], strict=True):
        normal = np.array([-np.sin(theta), np.cos(theta)])
        candidates = []
        for side, (places, ok) in swept.items():
            across = places @ normal
            at = np.flatnonzero((across[:-1] * across[1:] < 0) & ok[:-1] & ok[1:])
            least, most = angles[at], angles[at + 1]
            for _ in range(45 if len(at) else 0):  # bisection
                middle = (least + most) / 2
                values = midpoints(middle, side)[0] @ normal
                before = values * across[at] > 0
                least, most = np.where(before, middle, least), np.where(before, most, middle)
            for crank in least:
                radius = np.hypot(*midpoints(np.array([crank]), side)[0][0])
                candidates.append((abs(radius - wanted), side, crank, radius))
        nearest, side, crank, radius = min(candidates)
        assert nearest <= tolerance
        if side == linkage.assembly[0]:
            (row,) = solve(tables, "--sweep", f"crank={np.rad2deg(crank)}")
            assert np.hypot(row["M.x"], row["M.y"]) == pytest.approx(radius, abs=1e-9)


def test_quick_return_time_ratio(solve):
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
        at = jnp.array([angle])
        return float(rates_of(linkage, at, jnp.ones(1)).velocity.bodies["lever"])

    dead = []
    for low, high in ((np.pi, 1.5 * np.pi), (1.5 * np.pi, 2 * np.pi)):
        start = np.sign(omega(low))
        for _ in range(50):
            middle = (low + high) / 2
            low, high = (middle, high) if np.sign(omega(middle)) == start else (low, middle)
        dead.append((low + high) / 2)
    short = dead[1] - dead[0]
    assert (2 * np.pi - short) / short == pytest.approx(expected["time_ratio"], abs=tolerance)
    rows = solve(tables, "--sweep", f"crank={np.rad2deg(dead[0])}", "--rate", "crank=1")
    assert rows[0]["lever.omega"] == pytest.approx(0, abs=1e-9)


def test_crank_rocker_with_unit_time_ratio():
    inputs, expected, near = CASES["brodell-soni-unit-time-ratio"]
    lengths = [inputs[k] for k in ("crank", "coupler", "rocker", "ground")]
    linkage = parse_linkage(four_bar(*lengths))
    angles = np.linspace(0, 2 * np.pi, 36001)[:, None]
    rocker = np.unwrap(poses_of(linkage, jnp.asarray(angles)).value.angle("rocker"))
    least, most = int(np.argmin(rocker)), int(np.argmax(rocker))
    for name, found in (
        ("rocker_swing_deg", rocker[most] - rocker[least]),
        ("crank_angle_between_limits_deg", abs(angles[most, 0] - angles[least, 0])),
        ("mu_min_result_deg", np.min(transmission_of(linkage, jnp.asarray(angles)).angles["B"])),
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
