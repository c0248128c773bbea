"""Settings of every installed study, and the words of its report, read from their schemas."""

import ast
import functools
import json
import math
import re
from collections.abc import Iterator
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

import pytest

from designopt import UserError
from designopt.study.settings import fields, spec_with, targets_waived
from designopt.study.study import load_study
from tests.commands import refused_cases
from tests.golden import schemas

ROOT = Path(__file__).parents[2]
STUDIES = sorted(entry_points(group="designopt.studies").names)
WORDS = sorted((ROOT / "studies").rglob("report.md"))


def values_out_of_bounds(schema: dict[str, Any]) -> Iterator[Any]:
    """Values that a key's schema rules out: of another type, not finite, beyond its bounds."""
    kind = schema.get("type")
    yield {"a": {"b": 1}}
    if kind in ("number", "integer"):
        yield from ("wide", math.nan, math.inf)
        yield from (schema[key] - 1 for key in ("minimum", "exclusiveMinimum") if key in schema)
        yield from (schema[key] + 1 for key in ("maximum", "exclusiveMaximum") if key in schema)
        yield from (schema[key] for key in schema if key.startswith("exclusive"))
    if kind == "integer":
        yield 1.5
    if kind == "boolean":
        yield "perhaps"
    if "enum" in schema:
        yield "none of these"
    if kind == "array":
        yield 1
        if isinstance(items := schema.get("items"), dict):
            yield from ([value] for value in values_out_of_bounds(items))
        if schema.get("minItems"):
            yield []


def written(value: Any) -> str:
    """A value as ``--set`` takes it."""
    if isinstance(value, dict):
        return "{a = {b = 1}}"
    if isinstance(value, list):
        return f"[{', '.join(map(written, value))}]"
    return json.dumps(value) if isinstance(value, str) else repr(value)


@pytest.mark.parametrize("name", STUDIES)
def test_what_a_setting_rules_out_is_one_line_that_names_it(name):
    model = load_study(name).spec
    for key, schema in schemas(model).items():
        for value in values_out_of_bounds(schema):
            setting = f"{key}={written(value)}"
            try:
                spec_with(model, [setting], study=name)
            except UserError as error:
                message = str(error)
            else:
                pytest.fail(f"{setting} is accepted")
            assert f"--set {key}" in message, message
            assert "\n" not in message
            assert len(message) < 1500


@pytest.mark.parametrize(("given", "words"), refused_cases("settings_of_studies"))
def test_settings_that_contradict_each_other_are_one_line(given, words):
    name, setting = given.split()
    with pytest.raises(UserError) as caught:
        spec_with(load_study(name).spec, [setting], study=name)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", STUDIES)
def test_defaults_are_valid_have_a_meaning_and_targets(name):
    model = load_study(name).spec
    assert targets_waived(model()) == ""
    for key, default, meaning in fields(model):
        assert len(meaning) > 4, key
        if isinstance(default, (bool, int, float)):
            assert spec_with(model, [f"{key}={json.dumps(default)}"], study=name) == model()


STATED = {
    "bending-posture": (
        "unseen=800 seeds=4 etas=[] sweep=false",
        "samples=1000 unseen=100 seeds=1 eta=0.7",
    ),
    "object-size": (
        "other_lamp_grasps=3 stability_images=6 random_grasps=201",
        "stability_images=4 random_grasps=199 place=0.9 samples=1600",
    ),
    "surface-profile": (
        "trials=51 fingers=6 severities=[] sagittas=[] roughnesses=[] size_slides=1",
        "trials=49 fingers=4 severity=0.5 calibration=33",
    ),
}
"""Settings to which targets apply as to the defaults, and settings to which they do not."""


@pytest.mark.parametrize("name", STATED)
def test_targets_apply_to_the_stated_study_and_to_more_of_it(name):
    for settings, apply in zip(STATED[name], (True, False), strict=True):
        for setting in settings.split():
            spec = spec_with(load_study(name).spec, [setting], study=name)
            assert (targets_waived(spec) == "") == apply, setting


@functools.cache
def written_names() -> re.Pattern[str]:
    """A pattern of all names and texts in the studies' code; what braces hold may be anything."""
    patterns = set()
    for path in (ROOT / "studies").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            match node:
                case ast.Constant(value=str(text)) if re.fullmatch(r"[\w-]+", text):
                    patterns.add(text)
                case ast.keyword(arg=str(name)):
                    patterns.add(name)
                case ast.JoinedStr(values=parts):
                    fixed = [part.value if isinstance(part, ast.Constant) else "" for part in parts]
                    if len("".join(map(str, fixed))) > 3:
                        patterns.add(".+".join(re.escape(str(part)) for part in fixed))
    return re.compile("|".join(f"(?:{pattern})" for pattern in sorted(patterns)))


@pytest.mark.parametrize("words", WORDS, ids=lambda path: "/".join(path.parts[-3:-1]))
def test_every_entry_of_a_report_is_used(words):
    used = written_names()
    for section in re.split(r"^# ", words.read_text(encoding="utf-8"), flags=re.MULTILINE)[1:]:
        names = re.findall(r"^([\w-]+)(?: \[.*\])?: ", section, flags=re.MULTILINE)
        assert names, section
        assert [name for name in names if not used.fullmatch(name)] == []
