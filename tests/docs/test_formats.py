"""The reference of files has every key, and what it states is what the reader accepts."""

import tomllib
from importlib.resources import files

import pydantic
import pytest

from designopt.io.spec import Spec
from designopt.study.study import installed_studies
from docs.generator.formats import FORMATS, format_page, key_rows, meanings, tables_of, unit_of
from docs.generator.settings import settings_page
from optics.scene.file import CameraTable

UNITLESS = {
    "format", "bounces", "pixels", "f_number", "min_transmission", "index", "red", "green", "blue",
    "reach", "outer_reach", "conic", "projection", "gamma", "scatter", "pictures", "covariance",
    "columns", "rows", "first_marker", "layer_index", "lateral_color", "lens_k1",
}  # fmt: skip
"""Numbers that are counts, ratios, or of several units."""


def all_tables(model):
    """A model and the tables in it."""
    found = [model]
    for field in model.model_fields.values():
        for part in tables_of(field.annotation):
            found += all_tables(part)
    return found


@pytest.mark.parametrize("file", FORMATS, ids=lambda file: file.page)
def test_every_key_has_a_meaning_and_every_number_a_unit(file):
    page = format_page(file)
    for model in all_tables(file.load()):
        known = meanings(model)
        for name, field in model.model_fields.items():
            key = field.alias or name
            assert known.get(name), (model.__name__, name)
            assert f"`{key}`" in page
            if "float" in str(field.annotation) and key not in UNITLESS:
                assert unit_of(known[name])[1] or key == "lengths", (model.__name__, known[name])


def test_bounds_are_those_that_the_reader_keeps():
    rows = {row[0]: row for row in key_rows(CameraTable, "camera")}
    assert rows["`fov_deg`"][2:5] == ["degrees", "–", "> 0, ≤ 360"]
    assert rows["`position`"][1:4] == ["[number, number]", "mm", "**required**"]
    scene = tomllib.loads((files("studies") / "gallery/scenes/finger.toml").read_text())
    model = next(file for file in FORMATS if file.page == "scene").load()
    for fov, fits in ((360, True), (360.001, False), (0, False)):
        given = scene | {"camera": scene["camera"] | {"fov_deg": fov}}
        try:
            model.model_validate(given)
        except pydantic.ValidationError:
            assert not fits
        else:
            assert fits


def test_a_meaning_is_taken_from_below_its_field():
    class Table(Spec):
        length: float
        """Of the bar, mm."""
        wide: float = pydantic.Field(2.0, description="across (N mm/rad)")

    assert meanings(Table) == {"length": "Of the bar, mm.", "wide": "across (N mm/rad)"}
    assert unit_of("Of the bar, mm.") == ("Of the bar", "mm")
    assert unit_of("across (N mm/rad)") == ("Across", "N mm/rad")
    assert unit_of("number of teeth") == ("Number of teeth", "")


def test_settings_of_all_studies_are_listed():
    page = settings_page()
    for name, _ in installed_studies():
        assert f"{{#{name}}}" in page
    assert "| `body.thickness` | number | mm | `25.0` |" in page
