"""``--set`` texts: what they become, and what is said of a faulty one."""

import pydantic_core
import pytest

from designopt import Spec, UserError, setting
from designopt.study.settings import fields, spec_with, targets_waived
from tests.commands import refused_cases
from tests.designopt.plugin import SquareSpec


def make(*assignments: str) -> SquareSpec:
    spec = spec_with(SquareSpec, assignments, study="square")
    assert isinstance(spec, SquareSpec)
    return spec


def test_values_are_toml_and_plain_text():
    spec = make("side=3", "inner.length=0.5", "label=wide angle")
    assert (spec.side, spec.inner.length, spec.label) == (3.0, 0.5, "wide angle")
    assert make("side=1e-3", 'label="a=b"').label == "a=b"
    assert make("side=1", "side=2").side == 2  # the last one counts
    assert make("side=1", "label=1\nside=2").label == "1\nside=2"
    assert make("side=1", f"label={'[' * 5000}").label == "[" * 5000


@pytest.mark.parametrize(
    ("assignments", "message"),
    [
        *refused_cases("settings"),
        (["side=1", "inner" + 3000 * ".a" + "=1"], ".a=1: nested too deeply for a setting"),
        (["side=1", "inner=" + 40 * "[" + 40 * "]"], "]: nested too deeply for a setting"),
    ],
)
def test_faults_name_the_key_and_the_cure(assignments, message):
    with pytest.raises(UserError) as caught:
        make(*assignments)
    assert message in str(caught.value)
    assert "designopt list square" in str(caught.value) or "was already given" in message
    assert "\n" not in str(caught.value)


def test_what_no_file_can_hold_is_refused():
    with pytest.raises(UserError) as caught:
        make("side=1", "label=caf\udce9")  # what the shell makes of a Latin é
    assert str(caught.value) == "--set 'label=caf\\udce9': not UTF-8; write it in UTF-8"


def test_all_faults_come_at_once():
    with pytest.raises(UserError) as caught:
        make("side=x", "inner.length=-1", "lable=y")
    for key in ("side", "inner.length", "lable"):
        assert f"--set {key}" in str(caught.value)


def test_fields_are_listed_with_defaults_and_meanings():
    assert list(fields(SquareSpec)) == [
        ("side", pydantic_core.PydanticUndefined, "side of the square (mm)"),
        ("inner.length", 2.0, "a length (mm)"),
        ("label", "", "free text"),
        ("asked", 9.0, "area asked for (mm²)"),
    ]


class Lens(Spec):
    focal_length: float = setting(2.0, "focal length (mm)", free=True)
    rows: int = setting(100, "rows of pixels", scales=True)


class Eye(Spec):
    lens: Lens = Lens(rows=200)
    side: str = "left"


class Face(Spec):
    eye: Eye = Eye(side="right")


def face(*assignments: str) -> Face:
    spec = spec_with(Face, assignments, study="face")
    assert isinstance(spec, Face)
    return spec


def test_a_nested_key_leaves_the_others_at_the_studys_defaults():
    lens = Lens(focal_length=3.0, rows=200)
    assert face("eye.lens.focal_length=3") == Face(eye=Eye(lens=lens, side="right"))
    assert [default for _, default, _ in fields(Face)] == [2.0, 200, "right"]


def test_nested_settings_decide_whether_targets_apply():
    assert targets_waived(face("eye.lens.focal_length=3", "eye.lens.rows=300")) == ""
    assert targets_waived(face("eye.lens.rows=150")) == "eye.lens.rows = 150 is less than 200"
    assert targets_waived(face("eye.side=left")) == "eye.side is not the default"
