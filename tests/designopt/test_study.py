"""Finding studies among the installed packages."""

import pytest

from designopt import UserError
from designopt.study import study as study_module
from tests.designopt.plugin import SQUARE, points


@pytest.fixture
def installed(monkeypatch):
    monkeypatch.setattr(
        study_module, "entry_points", lambda group: points("square", "string", "absent")
    )


def test_a_plug_in_is_found_by_its_name(installed):
    assert study_module.load_study("square") is SQUARE


def test_an_unknown_name_gets_a_suggestion(installed):
    with pytest.raises(UserError, match="no study is named 'sqare'; did you mean 'square'"):
        study_module.load_study("sqare")
    with pytest.raises(UserError, match="there are: absent, square, string"):
        study_module.load_study("zzz")


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("absent", r"'absent' \(no_such_package:STUDY\) cannot be loaded: No module named"),
        ("string", r"'string' \(.*NOT_A_STUDY\) is a str, not a designopt.Study"),
    ],
)
def test_a_broken_plug_in_is_named(installed, name, message):
    with pytest.raises(UserError, match=message):
        study_module.load_study(name)


def test_listing_survives_broken_plug_ins(installed):
    found = dict(study_module.installed_studies())
    assert list(found) == ["absent", "square", "string"]
    assert found["square"] is SQUARE
    assert isinstance(found["absent"], UserError)
