"""The form of a linkage file: whatever is wrong with it is said at once, in words of the file."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import pytest

from designopt.errors import UserError
from kinematics.io.sketch import load_sketch, parse_sketch

FOUR_BAR = Path(__file__).parents[2] / "studies/gallery/linkages/four-bar.toml"


def tables() -> dict[str, Any]:
    return {
        "joints": {"O": [0, 0], "A": [3.5, 4]},
        "bodies": {
            "ground": {"joints": ["O"], "fixed": True},
            "crank": {"joints": ["O", "A"], "lengths": {"O-A": 5}},
        },
        "inputs": [{"name": "crank", "body": "crank"}],
    }


def test_whole_numbers_are_numbers():
    sketch = parse_sketch(tables(), "f.toml")
    assert sketch.joints["O"] == (0.0, 0.0)
    assert sketch.bodies["crank"].lengths == {"O-A": 5.0}


@pytest.mark.parametrize(
    ("place", "value", "words"),
    [
        (("joints",), 5, ["joints: write it as a table, [joints]"]),
        (("joints", "A"), 5, ["joints.A", "[x, y]", "it is 5"]),
        (("joints", "A"), [1], ["joints.A.1: missing", "[x, y]"]),
        (("joints", "A"), [1, 2, 3], ["joints.A", "[x, y]"]),
        (("joints", "A"), ["1", True], ["joints.A.0", "joints.A.1", "without quotes"]),
        (("joints", "A"), [float("nan"), float("inf")], ["joints.A.0", "nan", "joints.A.1", "inf"]),
        (("joints", "A"), [10**400, 0], ["joints.A.0", "finite number", "..."]),
        (("joints", "A"), [1e31, 0], ["joints.A.0", "1e+31", "slip of the pen"]),
        (("joints", "A B"), [0, 0], ["joints.A B", "blanks"]),
        (("joints", "A\x00"), [0, 0], ["joints.A\\x00", "printed"]),
        (("joints", ""), [0, 0], ["joints.: a name must not be empty"]),
        (("bodies",), None, ["bodies: missing; add it"]),
        (("bodies", "x"), 3, ["bodies.x", "table", "it is 3"]),
        (("bodies", "crank", "joints"), [], ["bodies.crank.joints", "needs a joint; add one"]),
        (("bodies", "crank", "joints"), "OA", ["bodies.crank.joints", "list of names", "'OA'"]),
        (("bodies", "crank", "joint"), ["O"], ["bodies.crank.joint", "did you mean 'joints'?"]),
        (("bodies", "crank", "fixed"), "no", ["bodies.crank.fixed", "true or false", "'no'"]),
        (("bodies", "crank", "fixed"), 1, ["bodies.crank.fixed", "true or false"]),
        (("bodies", "crank", "lengths", "O-A"), 0, ["lengths.O-A", "must be positive"]),
        (("bodies", "crank", "lengths", "O-A"), -1, ["lengths.O-A", "must be positive", "-1"]),
        (("bodies", "crank", "lengths", "O-A"), "5", ["lengths.O-A", "without quotes"]),
        (("sliders",), {"joint": "A"}, ["sliders", "[[sliders]]", "double brackets"]),
        (("sliders",), [{"joint": "A", "on": "g", "line": [0, 1]}], ["sliders.0.line.0", "[x, y]"]),
        (
            ("sliders",),
            [{"joint": "A", "on": "g", "line": [[0, 0]] * 3}],
            ["sliders.0.line: write it as two points"],
        ),
        (("inputs",), {}, ["[[inputs]]"]),
        (("inputs", 0, "body"), 3, ["inputs.0.body", 'text in quotes, "…"']),
        (("inputs", 0, "nmae"), "x", ["inputs.0.nmae", "did you mean 'name'?"]),
        (("springs",), [{"between": ["a", "b"], "stiffness": -1}], ["springs.0.stiffness", "-1"]),
        (("linkage",), "x", ["linkage: write it as a table, [linkage]"]),
        (("linkage",), {"name": "a\u202eb"}, ["linkage.name: a name must not be blank, longer"]),
        (("inputs", 0, "name"), "a\x1b[2J", ["inputs.0.name", "brackets"]),
        (("bodies", "crank", "joints"), ["O", "A\x9b"], ["bodies.crank.joints.1", "printed"]),
        (("input",), 3, ["input: no such key; did you mean 'inputs'?"]),
        (("qqq",), 3, ["qqq: no such key; remove it", "joints, bodies"]),
    ],
)
def test_wrong_forms_are_told_with_their_key_and_cure(place, value, words):
    data = copy.deepcopy(tables())
    table: Any = data
    for part in place[:-1]:
        table = table[part]
    if value is None:
        del table[place[-1]]
    else:
        table[place[-1]] = value
    with pytest.raises(UserError) as raised:
        parse_sketch(data, "f.toml")
    said = str(raised.value)
    assert said.startswith("f.toml: ")
    assert said.isprintable()
    assert "pydantic" not in said
    assert "BodyTable" not in said
    for word in words:
        assert word in said


def test_all_faults_are_told_at_once():
    data = tables()
    data["joints"]["A"] = "here"
    data["bodies"]["crank"]["fixed"] = "no"
    data["input"] = data.pop("inputs")
    with pytest.raises(UserError) as raised:
        parse_sketch(data, "f.toml")
    for word in ("joints.A", "bodies.crank.fixed", "did you mean 'inputs'?"):
        assert word in str(raised.value)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"a = 1\na = 2", ["not TOML", "correct it"]),
        (b"name = '\xe9'", ["not UTF-8"]),
        (b"a = " + b"[" * 5000 + b"]" * 5000, ["nested too deeply"]),
        (b"a = " + b"1" * 5000, ["too many digits"]),
        (b"", ["joints: missing", "bodies: missing"]),
        (None, ["cannot be read", "No such file"]),
    ],
)
def test_what_is_no_linkage_file_is_told(tmp_path, content, words):
    path = tmp_path / "f.toml"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(UserError) as raised:
        load_sketch(path)
    for word in (str(path), *words):
        assert word in str(raised.value)


def test_folders_and_impossible_paths_are_told(tmp_path):
    for path in (tmp_path, "nul\x00l"):
        with pytest.raises(UserError, match="cannot be read"):
            load_sketch(path)


@pytest.mark.parametrize("change", [lambda text: b"\xef\xbb\xbf" + text, lambda text: text])
def test_files_from_any_editor_are_read(tmp_path, change):
    content = FOUR_BAR.read_bytes()
    path = tmp_path / "f.toml"
    path.write_bytes(change(content.replace(b"\n", b"\r\n")))
    assert load_sketch(path) == load_sketch(FOUR_BAR)
