"""Whatever is wrong in a spec file is said at once, by the kind of its field, in its own words."""

from functools import partial
from typing import Annotated, Any, Literal

import pydantic
import pytest

from designopt import Spec
from designopt.io.spec_files import Length, Line, Name, Number, Point, Title, validated
from tests.commands import refused_cases
from tests.refusals import check_refused


class Square(Spec):
    kind: Literal["square"]
    side: Length


class Disc(Spec):
    kind: Literal["disc"]
    radius: Length


class Part(Spec):
    name: Name
    title: Title = "part"
    outline: list[Point] = pydantic.Field(default_factory=list)
    axis: Line | None = None
    tags: list[Name] = pydantic.Field(default_factory=list)
    weights: list[Number] = pydantic.Field(default_factory=list)
    on: pydantic.StrictBool = True

    @pydantic.model_validator(mode="after")
    def _is_named_well(self) -> "Part":
        if self.name == "thing":
            raise ValueError("'thing' says little; choose another name")
        return self


class Drawing(Spec):
    origin: Point = (0.0, 0.0)
    scale: Length = 1.0
    gain: Annotated[Number, pydantic.Field(ge=0)] = 1.0
    sizes: dict[Name, Length] = pydantic.Field(default_factory=dict)
    parts: list[Part] = pydantic.Field(default_factory=list)
    shape: Square | Disc = pydantic.Field(default=Disc(kind="disc", radius=1), discriminator="kind")


def said_of(tables: dict[str, Any]) -> str:
    return check_refused(partial(validated, Drawing), tables, [])


def test_a_faultless_file_becomes_its_spec():
    tables = {"origin": [1, 2], "parts": [{"name": "a", "axis": [[0, 0], [1, 0.5]]}]}
    drawing = validated(Drawing, tables, "f.toml")
    assert drawing == Drawing(
        origin=(1.0, 2.0), parts=[Part(name="a", axis=((0.0, 0.0), (1.0, 0.5)))]
    )


@pytest.mark.parametrize(("tables", "said"), refused_cases("spec_files"))
def test_faults_are_told_by_the_kind_of_the_field(tables, said):
    assert said in said_of(tables)


def test_all_faults_are_told_at_once_and_long_values_are_cut():
    said = said_of({"origin": "x" * 99, "scale": 0, "qq\n": 1})
    long = "x" * 17
    assert f"origin: write it as two numbers, [x, y] (it is '{long}...{long}'); scale: " in said
    assert "must be positive (it is 0); correct it; 'qq\\n': no such key" in said


UNPRINTABLE = ("\0", "\t", "\x1b", "\x7f", "\x85", "\u2028", "\u2029", "\u202e", "\u2066", "\ufeff")


@pytest.mark.parametrize("key", ["name", "title"])
def test_what_cannot_be_printed_is_in_no_name(key):
    for char in UNPRINTABLE:
        said = said_of({"parts": [{"name": "a", key: f"a{char}b"}]})
        assert said.startswith(f"f.toml: parts.0.{key}: a name must not "), ascii(char)


def test_a_name_is_no_longer_than_a_drawing_has_room_for():
    part = {"name": 100 * "é", "title": 50 * "$ "}
    assert validated(Drawing, {"parts": [part]}, "f.toml").parts[0].title == part["title"]
    for key in part:
        said = said_of({"parts": [part | {key: part[key] + "x"}]})
        assert f"parts.0.{key}: a name must not be blank, longer than 100 characters" in said
