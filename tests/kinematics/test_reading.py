"""Linkage files: what is read from them, and the one line in which the others are refused."""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest

from designopt.errors import UserError
from kinematics import parse_linkage, read_linkage, solve_poses
from kinematics.io.assembling import Equations
from kinematics.io.mobility import Mobility
from kinematics.io.sketch import load_sketch, parse_sketch
from kinematics.io.sketch_geometry import measure_sketch
from tests.kinematics.gallery import FOLDER, NAMES, bodies_at, gallery_tables
from tests.refusals import check_refused, refusals


@pytest.mark.parametrize(("data", "words"), refusals("refused_linkages.toml", gallery_tables))
def test_what_cannot_be_a_mechanism_is_refused(data, words):
    check_refused(parse_linkage, data, words)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"a = 1\na = 2", ["not TOML", "correct it"]),
        (b"joints = { A = [1" + b"0" * 400 + b", 0] }", ["joints.A.0", "finite number", "..."]),
        (b"", ["joints: missing", "bodies: missing"]),
        (None, ["cannot be read", "No such file"]),
    ],
)
def test_what_is_no_linkage_file_is_refused(tmp_path, content, words):
    path = tmp_path / "f.toml"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(UserError) as raised:
        load_sketch(path)
    for word in (str(path), *words):
        assert word in str(raised.value)
    for place in (tmp_path, "nul\x00l"):
        with pytest.raises(UserError, match="cannot be read"):
            load_sketch(place)


def test_files_from_any_editor_are_read(tmp_path):
    content = (FOLDER / "four-bar.toml").read_bytes()
    path = tmp_path / "f.toml"
    path.write_bytes(b"\xef\xbb\xbf" + content.replace(b"\n", b"\r\n"))
    assert load_sketch(path) == load_sketch(FOLDER / "four-bar.toml")
    assert parse_sketch(gallery_tables("finger"), "x") == load_sketch(FOLDER / "finger.toml")
    linkage = read_linkage(FOLDER / "finger.toml")
    assert linkage.structure == parse_linkage(gallery_tables("finger")).structure
    assert linkage.structure.springs == (("distal", "plate"),)


# Degrees of freedom as textbooks count them; of all other linkages of the gallery, one.
TWO = {"finger", "finger-crank", "five-bar"}


@pytest.mark.parametrize("name", NAMES)
def test_mobility_of_the_gallery(name):
    drawn = measure_sketch(load_sketch(FOLDER / f"{name}.toml"), name)
    equations = Equations(drawn.dimensions)
    assembled = equations.assemble(drawn.configuration)
    found = Mobility(equations, assembled.configuration)
    assert assembled.gap < 1e-12 * equations.size
    mobility = 2 if name in TWO else 1
    assert found.kutzbach == found.mobility == found.inputs == mobility
    assert (found.free, found.redundant) == (0, 0)
    # Independently, 3 (L − 1) − 2 J, a pin in a slot being two freedoms, one joint and a half.
    data = gallery_tables(name)
    moving = sum(not body.get("fixed") for body in data["bodies"].values())
    pins = sum(count - 1 for count in bodies_at(data).values())
    slots = sum(2 if "keeps" in slider else 1 for slider in data.get("sliders", []))
    assert 3 * moving - 2 * pins - slots == mobility


def distance(pose: Any, a: str, b: str) -> float:
    return float(np.hypot(*(np.asarray(pose.position(a)) - np.asarray(pose.position(b)))))


def home_pose(data: dict[str, Any]) -> Any:
    linkage = parse_linkage(data, "f.toml")
    solved = solve_poses(linkage, linkage.reference.inputs)
    assert bool(solved.ok)
    return solved.value


def test_exact_lengths_hold_in_the_pose_and_the_rest_is_the_sketchs():
    data = gallery_tables(
        "four-bar",
        {
            "joints/P": [80, 80],
            "joints/O4": [110, 5],
            "bodies/coupler/joints/2": "P",
            "bodies/coupler/lengths/P-A": 70.5,
            "bodies/ground/lengths": {"O2-O4": 100},
        },
    )
    pose = home_pose(data)
    for body in data["bodies"].values():
        for pair, length in body.get("lengths", {}).items():
            assert distance(pose, *pair.split("-")) == pytest.approx(length, rel=1e-13)
    assert distance(pose, "B", "P") == pytest.approx(np.hypot(143 - 80, 67 - 80))
    assert np.arctan2(*np.asarray(pose.position("O4"))[::-1]) == pytest.approx(np.arctan2(5, 110))


def test_fixed_joints_without_lengths_are_exactly_where_they_are_sketched():
    data = gallery_tables("four-bar", {"joints/O2": [0.1, 0.3], "joints/O4": [100.7, -0.9]})
    np.testing.assert_array_equal(parse_linkage(data).anchors, [[0.1, 0.3], [100.7, -0.9]])


def test_several_fixed_bodies_are_one():
    walls = {"joints/W": [150, 0], "bodies/ground/lengths": {"O2-O4": 110}}
    walls["bodies/wall"] = {"joints": ["O4", "W"], "fixed": True, "lengths": {"O4-W": 40}}
    moved = parse_linkage(gallery_tables("four-bar", walls | {"inputs/0/relative_to": "wall"}))
    np.testing.assert_allclose(moved.anchors, [[0, 0], [110, 0], [150, 0]])
    assert moved.reference.inputs == pytest.approx(np.arctan2(26, 30))


def test_three_bodies_may_share_a_pin_and_names_need_not_be_plain():
    changes = {
        "joints/O6'": [200, 0],
        "joints/D": [190, 60],
        "bodies/ground/joints/2": "O6'",
        "bodies/link": {"joints": ["B", "D"], "lengths": {"B-D": 50}},
        "bodies/output": {"joints": ["O6'", "D"], "lengths": {"O6'-D": 60}},
        "inputs/0/name": "θ₂",
    }
    pose = home_pose(gallery_tables("four-bar", changes))
    assert distance(pose, "B", "D") == pytest.approx(50)
    assert distance(pose, "O6'", "D") == pytest.approx(60)


@pytest.mark.parametrize(("scale", "offset"), [(1e12, 0), (1e-20, 0), (1, 1e8)])
def test_any_size_and_any_origin_will_do(scale, offset):
    data = gallery_tables("four-bar")
    data["joints"] = {
        name: [scale * x + offset, scale * y - offset] for name, (x, y) in data["joints"].items()
    }
    for body in data["bodies"].values():
        body["lengths"] = {k: scale * v for k, v in body.get("lengths", {}).items()}
    linkage, plain = parse_linkage(data), parse_linkage(gallery_tables("four-bar"))
    np.testing.assert_allclose(linkage.reference.angles, plain.reference.angles, rtol=1e-6)
    assert linkage.assembly == plain.assembly


def test_a_very_short_crank_is_no_fault():
    changes = {"joints/A": [3e-6, 2.6e-6], "bodies/crank/lengths/O2-A": 4e-6}
    assert parse_linkage(gallery_tables("four-bar", changes)).assembly == (1,)


def test_a_slot_drawn_through_a_joint_stays_there():
    """The slot runs from O4 through S; exact lengths move S in its body, and the slot with it."""
    data = gallery_tables(
        "quick-return",
        {
            "joints/S": [8, 1],
            "bodies/lever/joints": ["O4", "T", "S"],
            "bodies/lever/lengths": {"O4-T": 60, "T-S": 36},
            "sliders/0/line": [[0, -25], [8, 1]],
        },
    )
    pose = home_pose(data)
    o4, s, a = (np.asarray(pose.position(name)) for name in ("O4", "S", "A"))
    assert distance(pose, "T", "S") == pytest.approx(36)
    assert np.cross([*(s - o4), 0], [*(a - o4), 0])[2] == pytest.approx(0, abs=1e-10)


def yoke(changes: dict[str, Any]) -> dict[str, Any]:
    """The Scotch yoke with two sliders instead of one that keeps it."""
    second = {"joint": "Z", "on": "ground", "line": [[0, 0], [1, 0]]}
    return gallery_tables(
        "scotch-yoke", {"sliders/0/keeps": "(removed)", "sliders/2": second} | changes
    )


THIRD = {"joints/W": [45, 0], "bodies/yoke/joints/2": "W"}
ON_GROUND = {"joint": "W", "on": "ground", "line": [[0, 0], [1, 0]]}


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"sliders/2/line": [[5, 0], [-3, 0]]},
        {"joints/Z": [-30, 0]},
        THIRD,
        THIRD | {"sliders/3": ON_GROUND},
    ],
)
def test_two_sliders_on_one_line_keep_a_body_from_turning(changes):
    data = yoke(changes)
    linkage = parse_linkage(data)
    assert [part.keeps for part in linkage.structure.sliders] == ["yoke", None]
    pose = solve_poses(linkage, jnp.asarray(np.radians([75.0])))
    assert bool(pose.ok)
    for joint in ("Y", "Z"):
        assert float(pose.value.position(joint)[1]) == pytest.approx(0, abs=1e-13)
    assert distance(pose.value, "Y", "Z") == pytest.approx(50)
    ahead = np.sign(data["joints"]["Z"][0] - data["joints"]["Y"][0])
    assert float(pose.value.angle("yoke")) == pytest.approx(0 if ahead > 0 else np.pi)
    assert float(pose.value.position("Y")[0]) == pytest.approx(30 * np.cos(np.radians(75)))


def test_the_driven_one_of_two_sliders_is_kept():
    driven = {"sliders/2/line": [[5, 0], [-3, 0]], "inputs/0": {"name": "stroke", "slider": "Z"}}
    linkage = parse_linkage(yoke(driven))
    assert [part.joint for part in linkage.structure.sliders] == ["A", "Z"]
    pose = solve_poses(linkage, jnp.array([-55.0])).value  # from x = 5 towards −x
    assert np.asarray(pose.position("Z")) == pytest.approx([60, 0], abs=1e-12)
    assert np.asarray(pose.position("Y")) == pytest.approx([10, 0], abs=1e-12)


def test_inputs_are_read_from_the_sketch():
    slide = {"name": "s", "slider": "C", "relative_to": "world"}
    data = gallery_tables("slider-crank", {"inputs/0": slide})
    assert parse_linkage(data).reference.inputs == pytest.approx([127])
    assert parse_linkage(gallery_tables("five-bar")).reference.inputs == pytest.approx(
        [np.arctan2(1.2, 3.8), np.arctan2(3.1, 2.5)]
    )
    wanted = [np.arctan2(26, 30)]
    assert parse_linkage(gallery_tables("four-bar")).reference.inputs == pytest.approx(wanted)
