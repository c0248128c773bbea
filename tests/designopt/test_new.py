"""``designopt new``: what it writes and lists, what it refuses, and the way from there to a run."""

import json
import shlex
import tomllib
from importlib.metadata import EntryPoint
from pathlib import Path

import pydantic
import pytest

from designopt import cli, file_template
from designopt.errors import UserError
from designopt.file_template import TEMPLATE_GROUP, FileTemplate
from designopt.io.spec import Spec
from designopt.study import study as study_module
from designopt.study.settings_file import format_settings, format_spec
from tests.commands import check_command_refused, refused_cases
from tests.designopt.plugin import SQUARE, points

BOARD = "# A board.\nrows = 3\n"


class TileSpec(Spec):
    side: float = pydantic.Field(default=2.0, description="a side (mm)", gt=0)
    color: str = pydantic.Field(default="red", description="a color")


def tile(given: TileSpec | None = None) -> str:
    return format_spec("A tile.", TileSpec, given)


def proof(given: TileSpec) -> bytes:
    if given.color == "none":
        raise UserError("color none: there is no such ink; choose another")
    return f"{given.side} {given.color}".encode()


TEMPLATES = (
    FileTemplate("board", "board: of squares", "board-maker", lambda: BOARD),
    FileTemplate("tile", "tile: one", "tiler", tile, TileSpec, {".txt": proof, ".log": proof}),
)


@pytest.fixture(autouse=True)
def folder(monkeypatch, tmp_path):
    """A folder to work in; a study, templates, and some that are broken."""
    names = {"boards": f"{__name__}:TEMPLATES", "gone": "no_such_package:TEMPLATES"}
    templates = [EntryPoint(name, value, TEMPLATE_GROUP) for name, value in names.items()]
    monkeypatch.setattr(study_module, "entry_points", lambda group: points("square", "absent"))
    monkeypatch.setattr(file_template, "entry_points", lambda group: templates)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def new(capsys, *words: str) -> list[str]:
    assert cli.run(["new", *words]) == 0
    shown = capsys.readouterr()
    assert shown.err == ""
    return shown.out.splitlines()


def test_names_are_listed_a_line_each_whatever_is_broken(capsys):
    lines = new(capsys, "--list")
    assert [line.split()[0] for line in lines] == ["absent", "square", "board", "tile", "gone"]
    assert lines[1:3] == [
        "square  settings: The area of a square (designopt run square --config FILE)",
        "board   board: of squares (board-maker FILE)",
    ]
    assert "(study 'absent' (no_such_package:STUDY) cannot be loaded" in lines[0]
    assert "(the templates 'gone' (no_such_package:TEMPLATES) cannot be loaded" in lines[4]


def test_a_file_is_written_and_the_next_command_is_named(folder, capsys):
    assert new(capsys, "board") == ["board.toml", "next: board-maker board.toml"]
    assert Path("board.toml").read_text(encoding="utf-8") == BOARD
    lines = new(capsys, "square", "of mine.toml")
    assert lines == ["of mine.toml", "next: designopt run square --config 'of mine.toml'"]
    assert Path("of mine.toml").read_text(encoding="utf-8") == format_settings(SQUARE)
    assert new(capsys, "square", "board.toml", "--force")[0] == "board.toml"
    assert Path("board.toml").read_bytes() == Path("of mine.toml").read_bytes()
    assert sorted(path.name for path in folder.iterdir()) == ["board.toml", "of mine.toml"]


def test_prints_are_written_beside_the_file(folder, capsys):
    (folder / "a.b").mkdir()
    assert new(capsys, "tile", "a.b/my.tile", "--set", "side=3", "--set=color=blue") == [
        "a.b/my.tile", "a.b/my.txt", "a.b/my.log", "next: tiler a.b/my.tile",
    ]  # fmt: skip
    tables = tomllib.loads((folder / "a.b/my.tile").read_text(encoding="utf-8"))
    assert tables == {"side": 3.0, "color": "blue"}
    for ending in ("txt", "log"):
        assert (folder / f"a.b/my.{ending}").read_bytes() == b"3.0 blue"
    assert new(capsys, "tile", "a.b/my.tile", "--force")[0] == "a.b/my.tile"
    assert (folder / "a.b/my.txt").read_bytes() == b"2.0 red"
    assert len(list((folder / "a.b").iterdir())) == 3
    lines = new(capsys, "tile", "-", "--set", "side=4")
    assert lines[lines.index("side = 4.0") - 1] == "# a side (mm); > 0"


def test_settings_of_a_study_are_set(capsys):
    lines = new(capsys, "square", "-", "--set", "side=2", "--set", "inner.length=7")
    assert tomllib.loads("\n".join(lines)) == {
        "side": 2.0, "label": "", "asked": 9.0, "inner": {"length": 7.0},
    }  # fmt: skip
    assert "# side =" in new(capsys, "square", "-")


def test_on_standard_output_is_the_file_alone(folder, capsys):
    assert new(capsys, "board", "-") == BOARD.splitlines()
    assert list(folder.iterdir()) == []


@pytest.mark.parametrize(("line", "words"), refused_cases("new"))
def test_faults_are_one_line_and_leave_everything_as_it_was(folder, capsys, line, words):
    (folder / "there").mkdir()
    for name in ("old.toml", "print.log"):
        (folder / name).write_text("mine")
    check_command_refused(capsys, f"new {line}", words)
    assert sorted(path.name for path in folder.iterdir()) == ["old.toml", "print.log", "there"]
    assert Path("old.toml").read_text() == Path("print.log").read_text() == "mine"


def result(folder: str) -> dict:
    document = json.loads(Path(folder, "results.json").read_text(encoding="utf-8"))
    return {name: document[name] for name in ("study", "spec", "seed", "metrics")}


def test_from_new_to_a_run_and_from_its_result_to_the_same_run(capsys):
    _, following = new(capsys, "square")
    path = Path("square.toml")
    path.write_text(path.read_text().replace("# side =", "side = 2.5").replace("9.0", "6.25"))
    command = shlex.split(following.removeprefix("next: designopt "))
    assert cli.run([*command, "--out", "first"]) == 0
    assert result("first")["spec"]["side"] == 2.5
    assert result("first")["metrics"]["area_mm2"]["value"] == 6.25
    assert cli.run(["run", "square", "--config", "first/results.json", "--out", "second"]) == 0
    assert result("second") == result("first")
    again = ["run", "square", "--config", "first", "--set", "inner.length=1", "--out", "third"]
    assert cli.run(again) == 0
    assert result("third")["spec"] == result("first")["spec"] | {"inner": {"length": 1.0}}


@pytest.mark.parametrize(("line", "words"), refused_cases("run_config"))
def test_a_faulty_file_of_settings_is_one_line(folder, capsys, line, words):
    (folder / "square.toml").write_text("side = 1\nlable = 'x'\n[inner]\nlength = -1\n")
    (folder / "torn.toml").write_text("side = 1\n[inner\n")
    check_command_refused(capsys, f"run square {line}", words)
    assert sorted(path.name for path in folder.iterdir()) == ["square.toml", "torn.toml"]
