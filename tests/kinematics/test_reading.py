"""What cannot be a mechanism is told in one line: where, what is wrong, and what to change."""

from __future__ import annotations

import copy
import functools
import tomllib
from pathlib import Path
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

GALLERY = Path(__file__).parents[2] / "studies/gallery/linkages"


@functools.cache
def _read(name: str) -> dict[str, Any]:
    return tomllib.loads((GALLERY / f"{name}.toml").read_text(encoding="utf-8"))


def gallery(name: str, *changes: tuple[str, Any]) -> dict[str, Any]:
    """A gallery file with entries replaced, or removed where the value is ``...``."""
    data = copy.deepcopy(_read(name))
    for path, value in changes:
        places: list[Any] = [int(part) if part.isdigit() else part for part in path.split("/")]
        table: Any = data
        last = places.pop()
        for place in places:
            table = table[place]
        if value is ...:
            del table[last]
        elif isinstance(table, list) and last == len(table):
            table.append(value)
        else:
            table[last] = value
    return data


def bar(*joints: str, **more: Any) -> dict[str, Any]:
    return {"joints": list(joints), **more}


def parallelogram(**joints: list[float]) -> dict[str, Any]:
    """Three parallel cranks on one coupler: one crank too many."""
    return {
        "joints": {
            "O": [0, 0],
            "P": [50, 0],
            "Q": [100, 0],
            "A": [10, 30],
            "B": [60, 30],
            "C": [110, 30],
        }
        | joints,
        "bodies": {
            "ground": bar("O", "P", "Q", fixed=True),
            "crank": bar("O", "A"),
            "middle": bar("P", "B"),
            "rocker": bar("Q", "C"),
            "coupler": bar("A", "B", "C"),
        },
        "inputs": [{"name": "turn", "body": "crank"}],
    }


def braced() -> dict[str, Any]:
    """A four-bar held by a brace, which also carries a chain of two bars that nothing drives."""
    return gallery(
        "four-bar",
        ("bodies/brace", bar("O2", "B")),
        ("joints/D", [150, 40]),
        ("bodies/tail", bar("B", "D")),
    )


def point_on_lines(first: list[Any], second: list[Any]) -> dict[str, Any]:
    """A joint that is on no body: it slides on a turning arm and on the ground (PRP)."""
    return {
        "joints": {"O": [0, 0], "A": [30, 0], "P": [30, 30]},
        "bodies": {"ground": bar("O", fixed=True), "arm": bar("O", "A")},
        "sliders": [
            {"joint": "P", "on": "arm", "line": first},
            {"joint": "P", "on": "ground", "line": second},
        ],
        "inputs": [{"name": "arm", "body": "arm"}],
    }


def yoke(*changes: tuple[str, Any]) -> dict[str, Any]:
    """The Scotch yoke with two sliders instead of one that keeps it."""
    second = {"joint": "Z", "on": "ground", "line": [[0, 0], [1, 0]]}
    return gallery("scotch-yoke", ("sliders/0/keeps", ...), ("sliders/2", second), *changes)


def said_of(data: dict[str, Any]) -> str:
    with pytest.raises(UserError) as raised:
        parse_linkage(data, "f.toml")
    said = str(raised.value)
    assert said.startswith("f.toml: ")
    assert "\n" not in said
    return said


LINE = [[0, 0], [1, 0]]
FB, SC = "four-bar", "slider-crank"
NAMES = [
    (gallery(FB, ("bodies/crank/joints/1", "a")), ["bodies.crank.joints", "'a'", "are: O2, A"]),
    (gallery(FB, ("bodies/crank/joints/1", "O-4")), ["'O-4'", "did you mean 'O4'?"]),
    (gallery(FB, ("bodies/crank/joints/2", "A")), ["bodies.crank.joints", "2 times", "once"]),
    (gallery(FB, ("bodies/crank/joints", ["A"])), ["bodies.crank.joints", "needs two joints"]),
    (gallery(FB, ("bodies/world", bar("A", "B"))), ["bodies.world", "choose another name"]),
    (gallery(FB, ("bodies/ground/fixed", False)), ["none is fixed", "fixed = true"]),
    (gallery(FB, ("bodies", {"g": bar("A", fixed=True)})), ["none can move", "add a body"]),
    ({"joints": {}, "bodies": {}}, ["bodies: there is none", "fixed = true"]),
    (gallery(FB, ("bodies/crank/lengths", {"O2A": 4})), ["lengths: 'O2A'", "as in O2-A"]),
    (gallery(FB, ("bodies/crank/lengths/A-O2", 4)), ["O2-A and A-O2 contradict", "keep one"]),
    (
        {
            "joints": {"a-b": [0, 0], "c": [1, 0], "a": [0, 1], "b-c": [1, 1]},
            "bodies": {
                "g": bar("a", fixed=True),
                "k": bar("a", "b-c", "a-b", "c", lengths={"a-b-c": 1}),
            },
        },
        ["bodies.k.lengths: 'a-b-c'", "several pairs", "rename"],
    ),
    (gallery(FB, ("joints/X", [1, 1])), ["joints.X", "on no body", "remove it"]),
    (
        gallery(FB, ("joints/X", [1, 1]), ("joints/Y", [2, 1]), ("bodies/w", bar("X", "Y"))),
        ["bodies.w: it hangs loose", "tied to a fixed one"],
    ),
    (gallery(SC, ("sliders/0/joint", "c")), ["sliders.0.joint", "'c'"]),
    (gallery(SC, ("sliders/0/on", "grund")), ["sliders.0.on", "did you mean 'ground'?"]),
    (gallery(SC, ("sliders/0/on", "rod")), ["sliders.0", "pinned to 'rod'", "on another"]),
    (gallery(SC, ("sliders/0/line", [[1, 2], [1, 2]])), ["sliders.0.line", "coincide", "move"]),
    (gallery(SC, ("sliders/0/keeps", "rood")), ["sliders.0.keeps", "did you mean 'rod'?"]),
    (gallery(SC, ("sliders/0/keeps", "crank")), ["sliders.0.keeps", "does not hold 'C'"]),
    (
        gallery(SC, ("sliders/1", _read(SC)["sliders"][0])),
        ["sliders.1: it repeats sliders.0", "remove one"],
    ),
    (
        gallery(
            SC,
            ("bodies/wall", bar("W", fixed=True)),
            ("joints/W", [9, 9]),
            ("sliders/1", {"joint": "W", "on": "ground", "line": LINE}),
        ),
        ["sliders.1", "'W' and 'ground' are both fixed", "remove it"],
    ),
    (gallery(FB, ("inputs/1", {"name": "crank", "body": "rocker"})), ["2 are named 'crank'"]),
    (gallery(FB, ("inputs/0/name", "ok")), ["'ok' is the name of another column", "choose"]),
    (gallery(FB, ("inputs/0/name", "A.x")), ["'A.x' is the name of another column", "choose"]),
    (gallery(FB, ("inputs/0/body", ...)), ["inputs.0", "either a body or a slider"]),
    (gallery(FB, ("inputs/0/slider", "A")), ["inputs.0", "either a body or a slider"]),
    (gallery(FB, ("inputs/0/body", "crnk")), ["inputs.0.body", "did you mean 'crank'?"]),
    (gallery(FB, ("inputs/0/body", "ground")), ["inputs.0.body", "fixed", "name a moving"]),
    (gallery(FB, ("inputs/0/relative_to", "crank")), ["inputs.0.relative_to", "itself"]),
    (gallery(FB, ("inputs/0/relative_to", "wrld")), ["relative_to", "did you mean 'world'?"]),
    (gallery(SC, ("inputs/0", {"name": "s", "slider": "A"})), ["inputs.0.slider", "'A'", "C"]),
    (gallery(FB, ("inputs/0", {"name": "s", "slider": "A"})), ["inputs.0.slider", "add it"]),
    (
        gallery(SC, ("inputs/0", {"name": "s", "slider": "C", "relative_to": "rod"})),
        ["inputs.0.relative_to", "'C' slides on ground"],
    ),
    (
        point_on_lines([[0, 0], [1, 1]], LINE) | {"inputs": [{"name": "s", "slider": "P"}]},
        ["inputs.0.slider", "slides on arm and ground", "relative_to"],
    ),
    (
        gallery("finger", ("springs/0/between", ["distal", "plat"])),
        ["springs.0.between", "did you mean 'plate'?"],
    ),
    (
        gallery("finger", ("springs/0/between", ["plate", "plate"])),
        ["springs.0.between", "two different bodies"],
    ),
]


@pytest.mark.parametrize(("data", "words"), NAMES)
def test_wrong_names_are_told(data, words):
    said = said_of(data)
    for word in words:
        assert word in said


def test_all_wrong_names_are_told_at_once():
    said = said_of(
        gallery(FB, ("bodies/crank/joints/1", "Q"), ("inputs/0/body", "q"), ("bodies/rocker", {}))
        | {"bodies": gallery(FB, ("bodies/crank/joints/1", "Q"))["bodies"]}
    )
    assert "bodies.crank.joints" in said
    assert "inputs.0.body" in said


def figures(kutzbach: int, rank: int, inputs: int) -> str:
    return (
        f"mobility {kutzbach} by Kutzbach's count, {rank} by the Jacobian's rank at the sketch, "
        f"{inputs} input{'' if inputs == 1 else 's'}"
    )


def exact(data: dict[str, Any], **lengths: float) -> dict[str, Any]:
    for key, length in lengths.items():
        body, a, b = key.split("_")
        data["bodies"][body].setdefault("lengths", {})[f"{a}-{b}"] = length
    return data


MOBILITY = [
    # under-driven
    (gallery(FB, ("inputs/0", ...)), figures(1, 1, 0), ["inputs:", "crank", "rocker", "add 1"]),
    (
        gallery("five-bar", ("inputs/1", ...)),
        figures(2, 2, 1),
        ["inputs:", "left-arm, right, right-arm can still move", "add 1 input"],
    ),
    (
        gallery("five-bar", ("inputs", [])),
        figures(2, 2, 0),
        ["left, left-arm, right, right-arm can still move", "add 2 inputs"],
    ),
    (
        gallery(FB, ("joints/D", [150, 40]), ("bodies/tail", bar("B", "D"))),
        figures(2, 2, 1),
        ["inputs:", "tail can still move", "add 1 input"],
    ),
    (
        point_on_lines(LINE, LINE) | {"sliders": [{"joint": "P", "on": "ground", "line": LINE}]},
        figures(2, 2, 1),
        ["P can still move", "add 1 input"],
    ),
    # over-driven by inputs
    (
        gallery(FB, ("inputs/1", {"name": "other", "body": "rocker"})),
        figures(1, 1, 2),
        ["inputs:", "redundant: input 'crank' or input 'other'; remove 1 of them"],
    ),
    (
        gallery("five-bar", ("inputs/2", {"name": "arm", "body": "left-arm"})),
        figures(2, 2, 3),
        ["redundant: input 'left' or input 'right' or input 'arm'; remove 1 of them"],
    ),
    (
        gallery("watt", ("inputs/1", {"name": "far", "body": "output"})),
        figures(1, 1, 2),
        ["redundant: input 'crank' or input 'far'"],
    ),
    (
        gallery("scotch-yoke", ("inputs/0/body", "yoke")),
        figures(1, 1, 1),
        ["inputs:", "crank, yoke can still move", "redundant: input 'crank'; remove it, and drive"],
    ),
    # over-driven by bodies and sliders
    (
        parallelogram(),
        figures(0, 1, 1),
        ["bodies:", "redundant: body 'middle' or body 'rocker'; remove 1 of them"],
    ),
    (
        exact(
            parallelogram(A=[12, 29], B=[63, 33]),
            crank_O_A=31,
            middle_P_B=31,
            rocker_Q_C=31,
            coupler_A_B=50,
            coupler_B_C=50,
            coupler_A_C=100,
        ),
        figures(0, 1, 1),
        ["redundant: body 'middle' or body 'rocker'"],
    ),
    (
        parallelogram(B=[60, 40]),
        figures(0, 0, 1),
        ["bodies:", "more is prescribed", "body 'middle' or body 'rocker'"],
    ),
    (
        parallelogram(B=[60, 40]) | {"inputs": []},
        figures(0, 0, 0),
        ["bodies:", "nothing can move"],
    ),
    (
        gallery(FB, ("bodies/twin", bar("A", "B", lengths={"A-B": 120}))),
        figures(0, 1, 1),
        ["redundant: body 'coupler' or body 'twin'"],
    ),
    (
        gallery("scotch-yoke", ("sliders/2", {"joint": "Z", "on": "ground", "line": LINE})),
        figures(0, 1, 1),
        ["sliders:", "redundant: slider of 'Z' on 'ground'; remove it"],
    ),
    # one part too many, another free
    (
        gallery("five-bar", ("inputs/1", {"name": "again", "body": "left"})),
        figures(2, 2, 2),
        ["left-arm, right, right-arm can still move", "input 'left' or input 'again'; remove 1"],
    ),
    (
        braced(),
        figures(1, 1, 1),
        [
            "tail can still move",
            "another part is prescribed more than once",
            "redundant: ",
            "drive",
        ],
    ),
    (  # plate and distal share two pins, which weld them together
        gallery("finger", ("bodies/plate/joints/2", "B")),
        figures(2, 3, 2),
        ["bar can still move", "more than once: distal and plate; remove a joint there"],
    ),
    # inputs that cannot drive
    (
        {
            "joints": {"O": [0, 0], "A": [0, 30], "B": [40, 30], "C": [100, 30]},
            "bodies": {
                "ground": bar("O", "C", fixed=True),
                "crank": bar("O", "A"),
                "coupler": bar("A", "B"),
                "rocker": bar("B", "C"),
            },
            "inputs": [{"name": "crank", "body": "crank"}],
        },
        figures(1, 1, 1),
        ["inputs:", "coupler, rocker can move", "turning or change point", "sketch it elsewhere"],
    ),
    (
        point_on_lines([[0, 30], [1, 30]], [[0, 30], [1, 30]]),
        figures(1, 1, 1),
        ["P can move", "turning or change point", "drive another body"],
    ),
]


@pytest.mark.parametrize(("data", "counts", "words"), MOBILITY)
def test_wrong_mobility_is_told_with_both_counts_and_a_cure(data, counts, words):
    said = said_of(data)
    for word in (counts, *words):
        assert word in said


IMPOSSIBLE = [
    (
        exact(gallery(FB), crank_O2_A=10, coupler_A_B=10, rocker_O4_B=10),
        ["bodies: the loop", "–[coupler]–", "reach 30 mm", "100 mm apart", "margin -70 mm"],
    ),
    (
        exact(gallery(FB), coupler_A_B=500),
        ["bodies: the loop", "reach 220 mm", "A and B are 500 mm apart on 'coupler'", "change"],
    ),
    (
        gallery(SC, ("bodies/rod/lengths/A-C", 20), ("sliders/0/line", [[0, -100], [1, -100]])),
        ["bodies: the loop", "reach 60 mm", "the line of C and O2 are 100 mm apart", "change"],
    ),
    (
        gallery(FB, ("bodies/twin", bar("A", "B", lengths={"A-B": 110}))),
        ["Kutzbach's count", "body 'coupler' or body 'twin'"],
    ),
    (
        gallery(FB, ("bodies/crank/lengths/O2-A", 40), ("joints/A", [0, 0])),
        ["bodies.crank: O2-A = 40", "coincide in the sketch", "move one"],
    ),
    (
        gallery(
            FB,
            ("bodies/ground/lengths", {"O2-O4": 100}),
            ("bodies/wall", bar("O4", "O2", fixed=True, lengths={"O4-O2": 90})),
        ),
        ["bodies.ground and bodies.wall", "both 100 and 90", "keep one"],
    ),
    (
        gallery(
            FB,
            ("joints/W", [50, 10]),
            ("bodies/ground/lengths", {"O2-O4": 100}),
            ("bodies/wall", bar("O2", "W", fixed=True, lengths={"O2-W": 20})),
            ("bodies/floor", bar("O4", "W", fixed=True, lengths={"O4-W": 20})),
        ),
        ["bodies.ground and bodies.wall and bodies.floor", "make no triangle", "change one"],
    ),
    (
        gallery("stephenson", ("bodies/rod/lengths/P-D", 70)),
        ["bodies: the linkage cannot be assembled", "apart", "change its lengths"],
    ),
    (
        gallery(FB, ("joints/B", [65, 13])),
        ["joints: the sketch does not say on which side", "at B", "move the joint"],
    ),
    (
        yoke(("joints/Z", [20, 50])),
        ["sliders.2", "does not say in which order 'Y' and 'Z'", "move one"],
    ),
]


@pytest.mark.parametrize(("data", "words"), IMPOSSIBLE)
def test_impossible_dimensions_are_told(data, words):
    said = said_of(data)
    for word in words:
        assert word in said


TEXTBOOK = {
    "double-butterfly": 1,
    "finger": 2,
    "finger-crank": 2,
    "five-bar": 2,
    "four-bar": 1,
    "jansen": 1,
    "peaucellier": 1,
    "quick-return": 1,
    "scotch-yoke": 1,
    "slider-crank": 1,
    "stephenson": 1,
    "watt": 1,
}


def test_the_textbook_knows_the_whole_gallery():
    assert set(TEXTBOOK) == {path.stem for path in GALLERY.glob("*.toml")}


@pytest.mark.parametrize(("name", "mobility"), TEXTBOOK.items())
def test_mobility_of_the_gallery(name, mobility):
    drawn = measure_sketch(load_sketch(GALLERY / f"{name}.toml"), name)
    equations = Equations(drawn.dimensions)
    assembled = equations.assemble(drawn.configuration)
    found = Mobility(equations, assembled.configuration)
    assert assembled.gap < 1e-12 * equations.size
    assert found.kutzbach == found.mobility == found.inputs == mobility
    assert (found.free, found.redundant) == (0, 0)
    # Independently, 3 (L − 1) − 2 J, a pin in a slot being two freedoms, one joint and a half.
    data = _read(name)
    moving = [body for body in data["bodies"].values() if not body.get("fixed")]
    sliders = data.get("sliders", [])
    fixed = {j for body in data["bodies"].values() if body.get("fixed") for j in body["joints"]}
    pins = sum(
        max(0, sum(joint in body["joints"] for body in moving) + (joint in fixed) - 1)
        for joint in data["joints"]
    )
    slots = sum(2 if "keeps" in slider else 1 for slider in sliders)
    assert 3 * len(moving) - 2 * pins - slots == mobility


def distance(pose: Any, a: str, b: str) -> float:
    return float(np.hypot(*(np.asarray(pose.position(a)) - np.asarray(pose.position(b)))))


def home_pose(data: dict[str, Any]) -> Any:
    linkage = parse_linkage(data, "f.toml")
    solved = solve_poses(linkage, linkage.reference.inputs)
    assert bool(solved.ok)
    return solved.value


def test_exact_lengths_hold_in_the_pose_and_the_rest_is_the_sketchs():
    data = gallery(
        FB,
        ("joints/P", [80, 80]),
        ("joints/O4", [110, 5]),
        ("bodies/coupler/joints/2", "P"),
        ("bodies/coupler/lengths/P-A", 70.5),
        ("bodies/ground/lengths", {"O2-O4": 100}),
    )
    pose = home_pose(data)
    for body in data["bodies"].values():
        for pair, length in body.get("lengths", {}).items():
            assert distance(pose, *pair.split("-")) == pytest.approx(length, rel=1e-13)
    assert distance(pose, "B", "P") == pytest.approx(np.hypot(143 - 80, 67 - 80))
    assert np.arctan2(*np.asarray(pose.position("O4"))[::-1]) == pytest.approx(np.arctan2(5, 110))


def test_fixed_joints_without_lengths_are_exactly_where_they_are_sketched():
    data = gallery(FB, ("joints/O2", [0.1, 0.3]), ("joints/O4", [100.7, -0.9]))
    np.testing.assert_array_equal(parse_linkage(data).anchors, [[0.1, 0.3], [100.7, -0.9]])


def test_several_fixed_bodies_are_one():
    data = gallery(
        FB,
        ("bodies/ground", bar("O2", fixed=True)),
        ("bodies/wall", bar("O4", fixed=True)),
        ("inputs/0/relative_to", "wall"),
    )
    assert parse_linkage(data).reference.inputs == pytest.approx(np.arctan2(26, 30))
    moved = gallery(
        FB,
        ("joints/W", [150, 0]),
        ("bodies/ground/lengths", {"O2-O4": 110}),
        ("bodies/wall", bar("O4", "W", fixed=True, lengths={"O4-W": 40})),
    )
    np.testing.assert_allclose(parse_linkage(moved).anchors, [[0, 0], [110, 0], [150, 0]])


def test_three_bodies_may_share_a_pin():
    data = gallery(
        FB,
        ("joints/O6", [200, 0]),
        ("joints/D", [190, 60]),
        ("bodies/ground/joints/2", "O6"),
        ("bodies/link", bar("B", "D", lengths={"B-D": 50})),
        ("bodies/output", bar("O6", "D")),
    )
    pose = home_pose(data)
    assert distance(pose, "B", "D") == pytest.approx(50)


def test_names_need_not_be_plain():
    data = gallery(
        FB,
        ("joints/G'", [50, 80]),
        ("bodies/coupler/joints/2", "G'"),
        ("bodies/coupler/lengths/A-G'", 60),
    )
    assert distance(home_pose(data), "A", "G'") == pytest.approx(60)
    greek = gallery(FB, ("inputs/0/name", "θ₂"))
    assert parse_linkage(greek).input_names == ("θ₂",)


@pytest.mark.parametrize(("scale", "offset"), [(1e12, 0), (1e-9, 0), (1e-20, 0), (1, 1e8)])
def test_any_size_and_any_origin_will_do(scale, offset):
    data = gallery(FB)
    data["joints"] = {
        name: [scale * x + offset, scale * y - offset] for name, (x, y) in data["joints"].items()
    }
    for body in data["bodies"].values():
        body["lengths"] = {k: scale * v for k, v in body.get("lengths", {}).items()}
    linkage, plain = parse_linkage(data), parse_linkage(gallery(FB))
    np.testing.assert_allclose(linkage.reference.angles, plain.reference.angles, rtol=1e-6)
    assert linkage.assembly == plain.assembly


def test_a_very_short_crank_is_no_fault():
    data = exact(gallery(FB, ("joints/A", [3e-6, 2.6e-6])), crank_O2_A=4e-6)
    assert parse_linkage(data).assembly == (1,)


def test_a_slot_drawn_through_a_joint_stays_there():
    """The slot runs from O4 through S; exact lengths move S in its body, and the slot with it."""
    data = gallery(
        "quick-return",
        ("joints/S", [8, 1]),
        ("bodies/lever/joints", ["O4", "T", "S"]),
        ("bodies/lever/lengths", {"O4-T": 60, "T-S": 36}),
        ("sliders/0/line", [[0, -25], [8, 1]]),
    )
    pose = home_pose(data)
    o4, s, a = (np.asarray(pose.position(name)) for name in ("O4", "S", "A"))
    assert distance(pose, "T", "S") == pytest.approx(36)
    assert np.cross([*(s - o4), 0], [*(a - o4), 0])[2] == pytest.approx(0, abs=1e-10)


@pytest.mark.parametrize(
    "changes",
    [
        [],
        [("sliders/2/line", [[5, 0], [-3, 0]])],
        [("joints/Z", [-30, 0])],
        [("joints/W", [45, 0]), ("bodies/yoke/joints/2", "W"), ("joints/W", [45, 0])],
        [
            ("joints/W", [45, 0]),
            ("bodies/yoke/joints/2", "W"),
            ("sliders/3", {"joint": "W", "on": "ground", "line": [[0, 0], [1, 0]]}),
        ],
    ],
)
def test_two_sliders_on_one_line_keep_a_body_from_turning(changes):
    data = yoke(*changes)
    linkage = parse_linkage(data)
    assert [part.keeps for part in linkage.structure.sliders] == ["yoke", None]
    pose = solve_poses(linkage, jnp.radians(jnp.array([75.0])))
    assert bool(pose.ok)
    for joint in ("Y", "Z"):
        assert float(pose.value.position(joint)[1]) == pytest.approx(0, abs=1e-13)
    assert distance(pose.value, "Y", "Z") == pytest.approx(50)
    ahead = np.sign(data["joints"]["Z"][0] - data["joints"]["Y"][0])
    assert float(pose.value.angle("yoke")) == pytest.approx(0 if ahead > 0 else np.pi)
    assert float(pose.value.position("Y")[0]) == pytest.approx(30 * np.cos(np.radians(75)))


def test_the_driven_one_of_two_sliders_is_kept():
    data = yoke(
        ("sliders/2/line", [[5, 0], [-3, 0]]), ("inputs/0", {"name": "stroke", "slider": "Z"})
    )
    linkage = parse_linkage(data)
    assert [part.joint for part in linkage.structure.sliders] == ["A", "Z"]
    pose = solve_poses(linkage, jnp.array([-55.0])).value  # from x = 5 towards −x
    assert np.asarray(pose.position("Z")) == pytest.approx([60, 0], abs=1e-12)
    assert np.asarray(pose.position("Y")) == pytest.approx([10, 0], abs=1e-12)


def test_inputs_are_read_from_the_sketch():
    data = gallery(SC, ("inputs/0", {"name": "s", "slider": "C", "relative_to": "world"}))
    assert parse_linkage(data).reference.inputs == pytest.approx([127])
    assert parse_linkage(gallery("five-bar")).reference.inputs == pytest.approx(
        [np.arctan2(1.2, 3.8), np.arctan2(3.1, 2.5)]
    )


def test_a_joint_on_two_lines_and_on_no_body():
    linkage = parse_linkage(point_on_lines([[0, 0], [30, 30]], [[0, 30], [1, 30]]))
    pose = solve_poses(linkage, jnp.radians(jnp.array([-15.0]))).value
    assert np.asarray(pose.position("P")) == pytest.approx([30 / np.tan(np.radians(30)), 30])


def test_files_and_tables_give_the_same_linkage():
    linkage = read_linkage(GALLERY / "finger.toml")
    tables = parse_linkage(gallery("finger"))
    assert linkage.structure == tables.structure
    assert linkage.structure.springs == (("distal", "plate"),)
    assert parse_sketch(gallery("finger"), "x") == load_sketch(GALLERY / "finger.toml")
