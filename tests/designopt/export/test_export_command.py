"""``designopt export`` as a person meets it: files, faults in one line, nothing half-written."""

import json
import shutil
import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import jax
import pytest
from ezdxf.filemanagement import readfile

from designopt.cli import export_files as writing
from designopt.cli import run
from designopt.errors import UserError
from designopt.io.files import replaced_when_complete
from tests.commands import check_command_refused, refused_cases

STUDIES = Path(__file__).parents[3] / "studies"
OLD = Path(__file__).parents[2] / "data" / "old_specs"


@pytest.fixture(autouse=True)
def _in_a_folder_of_files(tmp_path, monkeypatch):
    shutil.copy(STUDIES / "gallery/linkages/four-bar.toml", tmp_path)
    shutil.copy(STUDIES / "gallery/scenes/periscope.toml", tmp_path)
    monkeypatch.chdir(tmp_path)


def files_in(folder: str) -> list[str]:
    return sorted(str(path.relative_to(folder)) for path in Path(folder).rglob("*"))


def test_several_formats_are_written_and_named(capsys):
    formats = ["--to", "dxf", "--to", "svg", "--to", "json", "--to", "svg"]
    assert run(["export", "four-bar.toml", *formats, "--out", "a/b"]) == 0
    assert capsys.readouterr().out.split() == [
        f"a/b/four-bar.{ending}" for ending in ("dxf", "svg", "json")
    ]
    assert files_in("a") == ["b", "b/four-bar.dxf", "b/four-bar.json", "b/four-bar.svg"]
    assert not readfile("a/b/four-bar.dxf").audit().has_issues
    assert ElementTree.parse("a/b/four-bar.svg").getroot().tag.endswith("svg")
    document = json.loads(Path("a/b/four-bar.json").read_text(encoding="utf-8"))
    crank = document["quantities"]["bodies.crank.O2-A"]
    assert crank == {"value": 40.0, "unit": "mm"}


def test_without_out_files_go_to_a_folder_of_their_own():
    assert run(["export", "periscope.toml", "--to", "json"]) == 0
    assert files_in("out") == ["export", "export/periscope.json"]


def test_a_result_is_exported_from_its_own_files():
    specs = Path("mine/specs")
    specs.mkdir(parents=True)
    Path("mine/results.json").write_text('{"study": "finger", "spec": {}}', encoding="utf-8")
    for name in ("linkage.toml", "scene.toml"):
        text = (OLD / name).read_text(encoding="utf-8")
        (specs / name).write_text(text.replace("F = [-7.77, -1.98]", "F = [-7.5, -2.25]"))
    assert run(["export", "mine", "--to", "json", "--out", "."]) == 0
    found = json.loads(Path("mine.json").read_text(encoding="utf-8"))["quantities"]
    assert found["linkage.joints.F.y"] == {"value": -2.25, "unit": "mm"}


def test_numbers_are_as_exact_where_jax_is_in_float32():
    with jax.enable_x64(False):
        assert run(["export", "four-bar.toml", "--to", "json", "--out", "single"]) == 0
        assert not jax.config.read("jax_enable_x64")
    assert run(["export", "four-bar.toml", "--to", "json", "--out", "double"]) == 0
    texts = [Path(f"{name}/four-bar.json").read_bytes() for name in ("single", "double")]
    assert texts[0] == texts[1]


@pytest.mark.parametrize("out", [".", "missing/.."])
def test_existing_files_are_kept_unless_forced(capsys, out):
    Path("four-bar.svg").write_text("mine", encoding="utf-8")
    asked = ["export", "four-bar.toml", "--to", "json", "--to", "svg", "--out", out]
    assert run(asked) == 2
    assert "four-bar.svg: exists already; choose another file" in capsys.readouterr().err
    assert Path("four-bar.svg").read_text(encoding="utf-8") == "mine"
    assert not Path("four-bar.json").exists()
    assert run([*asked, "--force"]) == 0
    assert Path("four-bar.svg").read_text(encoding="utf-8").startswith("<?xml")


def test_files_are_called_as_what_was_named():
    Path("mine.toml").symlink_to("four-bar.toml")
    assert run(["export", "mine.toml", "--to", "svg", "--out", "new"]) == 0
    Path("finger-grasp").mkdir()  # the study's name means the study
    assert run(["export", "finger-grasp", "--to", "json", "--out", "new"]) == 0
    assert files_in("new") == ["finger-grasp.json", "mine.svg"]


def test_a_name_that_cannot_be_printed_spoils_no_file(capsys):
    odd = "peri\ascope %%d\n\udcff.toml"
    Path("periscope.toml").rename(odd)
    formats = ["--to", "svg", "--to", "dxf", "--to", "json"]
    assert run(["export", odd, *formats, "--out", "new"]) == 0
    assert capsys.readouterr().out.count("\n") == 3
    stem = Path("new") / Path(odd).stem
    assert ElementTree.parse(f"{stem}.svg").getroot()[0].text == "peri scope %%d  "
    texts = readfile(f"{stem}.dxf").paperspace("Sheet").query("TEXT")
    assert next(text.dxf.text for text in texts) == "peri scope % %d  "
    document = json.loads(Path(f"{stem}.json").read_text(encoding="utf-8"))
    assert document["name"] == "peri scope %%d  "


def test_settings_beside_the_design_begin_no_search(monkeypatch):
    for place in ("design_linkage", "design_mirrors"):
        monkeypatch.setattr(f"studies.finger.designing.{place}", lambda *_: pytest.fail("a search"))
    asked = ["export", "finger", "--set", "spring.stiffness=12", "--to", "json", "--out", "new"]
    assert run(asked) == 0
    found = json.loads(Path("new/finger.json").read_text(encoding="utf-8"))["quantities"]
    assert found["spring.stiffness"] == {"value": 12.0, "unit": "N mm/rad"}


def test_checks_come_before_any_computing(monkeypatch):
    monkeypatch.setattr(writing, "load_design", lambda *_: pytest.fail("it was loaded"))
    Path("four-bar.json").write_text("mine", encoding="utf-8")
    assert run(["export", "four-bar.toml", "--to", "json", "--out", "."]) == 2
    assert run(["export", "four-bar.toml", "--to", "json", "--out", "four-bar.toml/x"]) == 2


def test_what_cannot_be_said_in_one_format_leaves_none_behind(capsys):
    asked = ["export", "periscope.toml", "--to", "svg", "--to", "mjcf", "--out", "new"]
    assert run(asked) == 2
    assert "--to mjcf: periscope has no linkage that moves it" in capsys.readouterr().err
    assert not Path("new").exists()


def test_a_full_disk_leaves_no_file_behind(monkeypatch, capsys):
    written = []

    def failing(path: Path):
        written.append(path)
        if len(written) == 2:
            raise UserError(f"{path}: cannot be written: disk full; choose another")
        return replaced_when_complete(path)

    monkeypatch.setattr(writing, "replaced_when_complete", failing)
    assert run(["export", "four-bar.toml", "--to", "svg", "--to", "json", "--out", "new"]) == 2
    assert "disk full" in capsys.readouterr().err
    assert files_in("new") == []


@pytest.mark.parametrize(("line", "words"), refused_cases("export"))
def test_faults_are_one_line_and_nothing_is_written(line, words, capsys):
    before = files_in(".")
    check_command_refused(capsys, f"export {line.format(long='x' * 300)}", words)
    assert files_in(".") == before


def test_a_missing_package_is_named_with_its_cure(monkeypatch, capsys):
    monkeypatch.delitem(sys.modules, "designopt.export.dxf", raising=False)
    monkeypatch.setitem(sys.modules, "ezdxf", None)
    assert run(["export", "four-bar.toml", "--to", "dxf"]) == 2
    assert "ezdxf is missing; install designopt[export]" in capsys.readouterr().err
    assert not Path("out").exists()
    assert run(["export", "four-bar.toml", "--to", "svg"]) == 0
