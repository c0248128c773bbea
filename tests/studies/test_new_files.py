"""Files to begin with, as installed: settings of every study, and the galleries."""

import itertools
import json
import re
import shutil
import tomllib
from pathlib import Path

import pytest

from designopt import cli
from designopt.design_kind import kind_of_tables
from designopt.designs import load_design
from designopt.file_template import FileTemplate, installed_templates
from designopt.study.settings import Config, fields, spec_with
from designopt.study.settings_file import format_settings, read_config
from designopt.study.study import installed_studies, load_study
from studies.finger.spec import FingerSpec
from studies.models.body import BodySpec
from tests.helpers import GALLERY

ROOT = GALLERY.parents[1]
STUDIES = [name for name, _ in installed_studies()]
FOUND = list(installed_templates())
FILES = {path: path.read_text(encoding="utf-8") for path in GALLERY.glob("*/*.toml")}


def as_files(folder: Path, name: str) -> list[Path]:
    """The settings of a study in a file as it is written, and in the result of a default run."""
    study = load_study(name)
    paths = [folder / "my.toml", folder / "results.json"]
    paths[0].write_text(format_settings(study), encoding="utf-8")
    document = {"study": name, "spec": study.spec().model_dump(mode="json")}
    paths[1].write_text(json.dumps(document), encoding="utf-8")
    return paths


@pytest.mark.parametrize("name", STUDIES)
def test_a_file_of_settings_has_all_of_them_and_is_the_defaults(tmp_path, name):
    study = load_study(name)
    for path in as_files(tmp_path, name):
        config = read_config([path], study)
        assert spec_with(study.spec, [], study=name, config=config) == study.spec()
    text = (tmp_path / "my.toml").read_text(encoding="utf-8")
    lines, words = text.splitlines(), " ".join(text.replace("\n# ", "\n").split())
    for key, default, meaning in fields(study.spec):
        line = f"{key.rpartition('.')[2]} ="
        assert any(one.startswith(f"# {line}" if default is None else line) for one in lines), key
        assert meaning in words, key


def test_the_requirements_in_the_readme_are_settings():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    [block] = re.findall(r"^```toml\n(\[body\].*?)^```", text, re.DOTALL | re.MULTILINE)
    config = Config(tomllib.loads(block), "README.md")
    spec = spec_with(FingerSpec, [], study="finger", config=config)
    assert isinstance(spec, FingerSpec)
    assert spec.body == BodySpec(distal=28.0)
    assert spec.mirrors.pads.thickness == [1.5, 1.0]


FINGERS = [path for path in FILES if path.parent.name == "fingers"]


@pytest.mark.parametrize("path", FINGERS, ids=[path.stem for path in FINGERS])
def test_the_requirements_of_the_gallery_are_settings_other_than_the_defaults(path):
    study = load_study("finger")
    spec = spec_with(study.spec, [], study="finger", config=read_config([path], study))
    assert isinstance(spec, FingerSpec)
    given = tomllib.loads(FILES[path])
    assert given["body"] == {key: getattr(spec.body, key) for key in given["body"]}
    assert all(getattr(BodySpec(), key) != value for key, value in given["body"].items())


def test_every_file_of_the_galleries_is_offered_by_a_name_of_its_own():
    names = [name for name, _ in FOUND]
    assert len(set(names)) == len(names)
    templates = [one for _, one in FOUND if isinstance(one, FileTemplate)]
    assert len(templates) == len(names)
    further = {one.name: one for one in templates[len(STUDIES) :] if one.spec is None}
    assert sorted(one.content() for one in further.values()) == sorted(FILES.values())
    assert {"four-bar", "scene", "chamber", "finger-joints"} <= set(further)
    assert {path.stem for path in FILES} - set(further) == {"finger"}  # a study's name
    for one in further.values():
        assert len(one.name) + 5 < len(f"{one.name}{one.purpose}") < 140
        kind = kind_of_tables(tomllib.loads(one.content()))
        if one.command == "designopt run finger --config":
            assert kind is None
            assert one.purpose.startswith("settings: Requirements of a")
            continue
        assert kind is not None
        assert one.purpose.startswith(f"{kind.name}: ")
        assert one.command in ("designopt explore", kind.command)


def test_every_file_of_the_galleries_has_a_comment_that_names_it():
    for path, text in FILES.items():
        head = list(itertools.takewhile(lambda line: line.startswith("#"), text.splitlines()))
        assert head, path


def test_the_chamber_is_explored(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert cli.run(["new", "chamber"]) == 0
    design = load_design("chamber.toml")
    assert design.name == "chamber"
    assert design.explorer().values()["imaging_ratio"] == pytest.approx(0.6, abs=0.005)
    eta = float(design.model.chamber.imaging_ratio().value)
    assert eta == pytest.approx(0.6, abs=0.005)


QUICK = ["precision = true", "stability = true", "clearance = 1.5"]


def test_a_changed_file_runs_and_its_result_runs_to_the_same_result(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert cli.run(["new", "table1", "my.toml"]) == 0
    text = Path("my.toml").read_text(encoding="utf-8")
    for line in QUICK:
        assert text.count(line) == 1
        text = text.replace(line, line.replace("true", "false").replace("1.5", "1.2"))
    Path("my.toml").write_text(text, encoding="utf-8")
    assert cli.run(["run", "table1", "--config", "my.toml", "--out", "first"]) == 0
    shutil.copy("first/results.json", "earlier.json")
    assert cli.run(["run", "table1", "--config", "earlier.json", "--out", "again"]) == 0
    first, again = (
        json.loads(Path(name, "results.json").read_text(encoding="utf-8"))
        for name in ("first", "again")
    )
    assert first["spec"]["clearance"] == 1.2
    found = {name: metric["value"] for name, metric in first["metrics"].items()}
    most = (4.1 - 1.2 - found["line_intercept_mm"]) / found["line_slope_mm"]
    assert found["largest_ratio"] == pytest.approx(most, rel=1e-6)
    for key in ("spec", "metrics", "findings", "tables"):
        assert first[key] == again[key]
    for table in first["tables"]:
        assert Path("first", table).read_bytes() == Path("again", table).read_bytes()
