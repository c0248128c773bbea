"""Naming a design: by a study, by a file, by the folder of a result."""

import re
from dataclasses import dataclass
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest
from pydantic import Field

from designopt import Spec, Study, UserError, design_kind, designs
from designopt.design_kind import Design, DesignKind, read_tables
from designopt.designs import load_design
from designopt.io.files import read_toml
from designopt.io.spec import SpecFile
from designopt.study import study as study_module
from designopt.study.results import Results
from designopt.study.runner import run


class BoxSpec(Spec):
    side: float = Field(default=2.0, description="a length (mm)")


@dataclass(frozen=True)
class Box:
    """A model that remembers where it comes from."""

    name: str
    spec: BoxSpec | None = None
    folder: Path | None = None


def unasked(model):
    raise NotImplementedError


def kind(name: str, read) -> DesignKind:
    return DesignKind(name, name, read, unasked, unasked, lambda model: [])


def results(spec, context):
    return Results(["A box."], [], specs=[SpecFile("box.toml", "the box", "[box]\n")])


FILE = kind("box", lambda path: Box(read_toml(path, "box")["box"]["name"]))
OTHER = kind("ball", lambda path: Box("ball"))


def designed(spec, folder) -> Design:
    return Design(FILE, Box("box", spec, folder))


BOX = Study("box", "A box", BoxSpec, results, design=designed)
RULER = Study("ruler", "Measures", BoxSpec, results)

POINTS = {
    study_module.STUDY_GROUP: {"box": "BOX", "ruler": "RULER"},
    design_kind.DESIGN_GROUP: {"box": "FILE", "ball": "OTHER"},
}


@pytest.fixture(autouse=True)
def installed(monkeypatch, tmp_path):
    """Only the studies and kinds of files of this module, in an empty folder."""

    def points(group: str) -> list[EntryPoint]:
        return [EntryPoint(name, f"{__name__}:{at}", group) for name, at in POINTS[group].items()]

    for module in (study_module, design_kind, designs):
        monkeypatch.setattr(module, "entry_points", points)
    monkeypatch.chdir(tmp_path)


def result_of(study: Study, spec: BoxSpec, folder: Path) -> Path:
    run(study, spec, seed=0, dtype="float64", out=folder, force=False)
    return folder


def refused(named: str, settings=()) -> str:
    with pytest.raises(UserError) as caught:
        load_design(named, settings)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_a_study_with_its_settings():
    assert load_design("box") == designed(BoxSpec(), None)
    assert load_design("box", ["side=3"]) == designed(BoxSpec(side=3.0), None)
    assert "--set sise: unknown key; did you mean 'side'?" in refused("box", ["sise=3"])


def test_a_result_has_the_spec_that_it_was_made_with(tmp_path):
    folder = result_of(BOX, BoxSpec(side=5.0), tmp_path / "earlier")
    assert load_design(str(folder)) == designed(BoxSpec(side=5.0), folder / "specs")
    assert (folder / "specs" / "box.toml").is_file()
    message = refused(str(folder), ["side=3"])
    assert message.startswith("--set side=3: only a study has settings; change ")


def test_a_study_is_meant_where_a_folder_has_its_name():
    Path("box").mkdir()
    assert load_design("box", ["side=3"]) == designed(BoxSpec(side=3.0), None)
    assert refused("./box") == (
        "box: a folder without a result of designopt run; name a file or a study"
    )


NO_RESULT = (
    *("{", "[1, 2]", '{"study": "box"}', '{"spec": {}}', "\xff", "[" * 100_000, "null"),
    *('{"study": "box", "spec": []}', '{"study": "box", "spec": null}'),
)
OTHER_SPECS = ('{"length": 1.0}', '{"side": "wide"}')


@pytest.mark.parametrize(
    ("text", "words"),
    [
        *((text, r"a folder without a result of designopt run; ") for text in (None, *NO_RESULT)),
        ('{"study": "boxx", "spec": {}}', ".*no study is named 'boxx'; did you mean 'box'"),
        *(
            (f'{{"study": "box", "spec": {spec}}}', "made by another version .*; run it again$")
            for spec in OTHER_SPECS
        ),
    ],
)
def test_a_folder_without_a_result_of_an_installed_study_is_refused(tmp_path, text, words):
    if text is not None:
        (tmp_path / "results.json").write_bytes(text.encode("latin-1"))
    assert re.match(f"{tmp_path}: {words}", refused(str(tmp_path)))


def test_a_study_that_designs_nothing_is_refused(tmp_path):
    message = "study 'ruler' measures and designs nothing that could be shown; these design: box"
    assert refused("ruler") == message
    assert refused(str(result_of(RULER, BoxSpec(), tmp_path / "measured"))) == message


def test_a_file_is_read_by_its_kind(tmp_path):
    Path("crate.toml").write_text('[box]\nname = "crate"\n')
    assert load_design("crate.toml") == Design(FILE, Box("crate"))
    Path("plain").write_text("[ball]\n")
    assert load_design("plain") == Design(OTHER, Box("ball"))
    assert refused("crate.toml", ["side=3"]).startswith("--set side=3: only a study has settings")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[bax]\n", "no design that is known here: a ball has [ball], a box has [box]"),
        ("", "no design that is known here"),
        ("[box\n", "thing.toml: not TOML: "),
        ("\xff", "thing.toml: cannot be read: it is not UTF-8 text"),
        (None, "thing.toml: cannot be read: No such file"),
    ],
)
def test_a_file_that_is_none_is_refused(text, message):
    if text is not None:
        Path("thing.toml").write_bytes(text.encode("latin-1"))
    assert message in refused("thing.toml")


def test_names_of_nothing_are_refused_however_long():
    assert refused("bix") == "STUDY: no study is named 'bix'; did you mean 'box'?"
    assert "File name too long" in refused(f"{'x' * 5000}.toml")
    assert "no study is named" in refused("x" * 5000)


def test_what_does_not_move_has_no_simulation():
    with pytest.raises(UserError, match="--to mjcf: crate has no linkage that moves it; export a"):
        Design(FILE, Box("crate")).mjcf()


def test_a_file_of_another_kind_is_named_with_what_takes_it(tmp_path):
    path = tmp_path / "box.toml"
    path.write_text("[box]\n")
    assert read_tables(path, "box", "box") == {"box": {}}
    with pytest.raises(UserError) as caught:
        read_tables(path, "ball", "ball")
    assert (
        str(caught.value) == f"{path}: it describes a box and no ball; designopt explore takes it"
    )
    path.write_text("[bag]\n")
    assert read_tables(path, "ball", "ball") == {"bag": {}}  # whoever asked names what is missing


def test_a_kind_of_file_that_cannot_be_loaded_is_named(tmp_path, monkeypatch):
    point = EntryPoint("bag", "no_such_package:FILE", design_kind.DESIGN_GROUP)
    monkeypatch.setattr(design_kind, "entry_points", lambda group: [point])
    path = tmp_path / "bag.toml"
    path.write_text("[bag]\n")
    assert "'bag' (no_such_package:FILE) cannot be loaded: No module named" in refused(str(path))
