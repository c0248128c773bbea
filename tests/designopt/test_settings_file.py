"""Settings in a file: how they are written, how they are laid over defaults, faults of the file."""

import json
import tomllib
from pathlib import Path
from typing import Annotated, Literal

import pytest
from pydantic import Field

from designopt import Spec, Study, UserError, setting
from designopt.study.settings import Config, spec_with
from designopt.study.settings_file import format_settings, read_config
from designopt.study.study import load_study
from studies.models import format_finger, packaged_finger
from tests.commands import refused_cases
from tests.designopt.plugin import SQUARE
from tests.helpers import GALLERY


class Lens(Spec):
    model: Literal["wide", "long"] = setting("wide", "which lens")
    focal_length: float | None = setting(None, "in place of the model's (mm)", gt=0, lt=50)
    stops: list[Annotated[float, Field(ge=1)]] = setting([2.0, 4.0], "f-numbers", max_length=3)


class Eye(Spec):
    lens: Lens = setting(Lens(stops=[2.8]), "what it looks through")
    rows: int = setting(100, "rows of pixels", ge=1, le=2**20, multiple_of=2)


class Face(Spec):
    name: str = setting('a "b"', "any text, such as that of a passport: the name at birth, " * 2)
    width: float = Field(description="from ear to ear (mm)", ge=0)
    eye: Eye = setting(Eye(rows=200), "the left one")


FACE = Study("face", "A face", Face, lambda spec, context: pytest.fail("it was run"))

WRITTEN = """\
# A face
#
# The settings of the study with their defaults. Change what is to differ; what is left out, or is
# behind a #, has its default. Then
#
#     designopt run face --config FILE
#
# with --set KEY=VALUE for single settings, which lie over the file.

# any text, such as that of a passport: the name at birth, any text, such as that of a passport:
# the name at birth,
name = "a \\"b\\""
# from ear to ear (mm); >= 0; must be given
# width =

# the left one
[eye]
# rows of pixels; >= 1, <= 1048576, a multiple of 2
rows = 200

# what it looks through
[eye.lens]
# which lens; "wide" or "long"
model = "wide"
# in place of the model's (mm); > 0, < 50
# focal_length =
# f-numbers; at most 3 of them, each >= 1
stops = [2.8]
"""


def config(text: str) -> Config:
    return Config(tomllib.loads(text), "my.toml")


def face(text: str, *assignments: str) -> Spec:
    return spec_with(Face, assignments, study="face", config=config(text))


def refused(text: str, *assignments: str) -> str:
    with pytest.raises(UserError) as caught:
        face(text, *assignments)
    assert "\n" not in str(caught.value)
    hint = " ('designopt list face' shows every key with its default)"
    assert str(caught.value).endswith(hint)
    return str(caught.value).removesuffix(hint)


def test_every_setting_is_written_with_its_meaning_and_bounds():
    assert format_settings(FACE) == WRITTEN


def test_what_is_written_is_the_defaults_and_can_be_changed():
    assert face(WRITTEN, "width=3") == Face(width=3.0)
    given = WRITTEN.replace("# width =", "width = 4").replace(
        "# focal_length =", "focal_length = 8"
    )
    lens = Lens(focal_length=8.0, stops=[2.8])
    assert face(given) == Face(width=4.0, eye=Eye(rows=200, lens=lens))


def test_tables_lie_over_the_defaults_of_the_study_and_set_lies_over_them():
    text = 'width = 3\n[eye.lens]\nmodel = "long"\nfocal_length = 9\n'
    lens = Lens(model="long", focal_length=9.0, stops=[2.8])
    assert face(text) == Face(width=3.0, eye=Eye(rows=200, lens=lens))
    wide = lens.model_copy(update={"model": "wide"})
    assert face(text, "eye.lens.model=wide", "eye.rows=8") == Face(
        width=3.0, eye=Eye(rows=8, lens=wide)
    )


@pytest.mark.parametrize(
    ("text", "assignments", "message"),
    [
        ("", [], "my.toml: width=…: this key is missing and has no default; give it a value"),
        (
            'widht = 3\nwidth = -1\neye.rows = "many"',
            [],
            "my.toml: width=-1: input should be greater than or equal to 0; eye.rows=many: input "
            "should be a valid integer, unable to parse string as an integer; widht: unknown key; "
            "did you mean 'width'?",
        ),
        ("width = 1\nrows = 3", [], "my.toml: rows: unknown key; did you mean 'eye.rows'?"),
        ("width = 1\neye = 3", [], "my.toml: eye=…: it has keys of its own; the keys of eye are"),
        ("width = {a = 1}", [], "my.toml: width: input should be a valid number"),
        ("width = 2020-01-01", [], "my.toml: width=2020-01-01: input should be a valid number"),
        (
            "width = -1",
            ["eye.rows=3"],
            "my.toml: width=-1: input should be greater than or equal to 0; --set eye.rows=3: "
            "input should be a multiple of 2",
        ),
        ("width = -1", ["width=-2"], "--set width=-2: input should be greater than or equal to 0"),
        ("width = 1", ["eye.lens=3"], "--set eye.lens=…: it has keys of its own"),
    ],
)
def test_faults_are_named_where_they_are(text, assignments, message):
    assert refused(text, *assignments).startswith(message)


def test_what_contradicts_itself_is_a_fault_of_whoever_contradicts():
    finger = load_study("finger").spec
    for assignments, prefix in (([], "my.toml: "), (["advice=false"], "my.toml: ")):
        with pytest.raises(UserError) as caught:
            spec_with(finger, assignments, study="finger", config=config("body.thickness = 9"))
        assert str(caught.value).startswith(f"{prefix}a finger 9 mm thick has no room")
    with pytest.raises(UserError) as caught:
        spec_with(finger, ["body.thickness=9"], study="finger", config=config("advice = false"))
    assert str(caught.value).startswith("a finger 9 mm thick has no room")
    two = config('[mirrors.camera]\nmodel = "imx219-200"\nfov_deg = 120\n')
    with pytest.raises(UserError) as caught:
        spec_with(finger, [], study="finger", config=two)
    assert str(caught.value).startswith("my.toml: mirrors.camera: fov_deg and model 'imx219-200'")
    assert "leave one of both out" in str(caught.value)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder with files of many kinds."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.toml").write_text("side = 3\n")
    (tmp_path / "finger.toml").write_text(format_finger(packaged_finger()))
    results = {
        "square": {"study": "square", "spec": {"side": 3.0}},
        "other": {"study": "table1", "spec": {}},
        "sweep": {"study": "square", "spec": [1]},
        "none": {"spec": {}},
    }
    for name, document in results.items():
        (tmp_path / name).mkdir()
        (tmp_path / name / "results.json").write_text(json.dumps(document))
    (tmp_path / "broken.json").write_text('{"study": "square", ')
    (tmp_path / "empty").mkdir()
    return tmp_path


def test_settings_come_from_a_file_a_result_or_its_folder(folder):
    assert read_config([], SQUARE).tables == {}
    assert read_config([Path("a.toml")], SQUARE) == Config({"side": 3}, "a.toml")
    for path in (Path("square"), Path("square/results.json")):
        assert read_config([path], SQUARE) == Config({"side": 3.0}, "square/results.json")


@pytest.mark.parametrize(("paths", "message"), refused_cases("config"))
def test_files_of_another_kind_are_refused_in_one_line(folder, paths, message):
    places = [Path(path.format(gallery=GALLERY)) for path in paths]
    with pytest.raises(UserError) as caught:
        read_config(places, SQUARE)
    assert str(caught.value).startswith(message.format(gallery=GALLERY))
    assert "\n" not in str(caught.value)


def test_a_table_of_the_study_makes_no_design_of_its_settings(tmp_path):
    """A scene's file has [camera], too, and a chamber's [chamber]."""
    path = tmp_path / "my.toml"
    for name in ("finger-mirrors", "table1"):
        study = load_study(name)
        path.write_text(format_settings(study))
        assert spec_with(study.spec, [], study=name, config=read_config([path], study)) == (
            study.spec()
        )
