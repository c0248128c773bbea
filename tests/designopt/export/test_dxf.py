"""A drawing as DXF, read back by another reader of the format than the one who wrote it here."""

import math

import numpy as np
import pytest
from ezdxf._options import options
from ezdxf.tools.text import plain_text

from designopt.export.drawing import Circle, Drawing, Label, Layer, LinearDimension, Polyline
from designopt.export.dxf import dxf_text
from designopt.export.layout import SIZES, Paper
from tests.designopt.export.reading import dimensions, opened, polylines, words_of
from tests.designopt.tables import cases

PLATE = Drawing(
    title="plate",
    layers=[
        Layer("plate", "body"),
        Layer("mirrors", "mirror"),
        Layer("axes", "construction"),
        Layer("far", "camera", framed=False),
    ],
    polylines=[
        Polyline("plate", [(0.0, 0.0), (40.0, 0.0), (40.0, 30.0)], closed=True),
        Polyline("mirrors", [(-5.0, 1 / 3), (12.0, 7.0)]),
        Polyline("axes", [(0.0, -5.0), (0.0, 5.0), (2.0, 8.0)]),
        Polyline("far", [(900.0, 0.0), (901.0, 0.0)]),
    ],
    circles=[Circle("plate", "A", (0.0, 0.0), 1.5), Circle("plate", "η", (40.0, 30.0), 1.5)],
    labels=[Label("plate", (40.0, 30.0), "η"), Label("mirrors", (3.0, 3.0), "glass")],
    dimensions=[
        LinearDimension((0.0, 0.0), (40.0, 0.0)),
        LinearDimension((40.0, 30.0), (40.0, 0.0)),
        LinearDimension((40.0, 30.0), (0.0, 0.0)),
    ],
    notes=["of brass", "2 mm thick"],
)


def bar(start, end):
    """A line and its dimension."""
    line, measure = Polyline("bar", [start, end]), LinearDimension(start, end)
    return Drawing("bar", [Layer("bar", "body")], polylines=[line], dimensions=[measure])


@pytest.fixture(scope="module")
def document():
    return opened(PLATE)


def test_nothing_is_amiss_and_units_are_mm(document):
    assert not document.audit().has_issues
    assert (document.header["$INSUNITS"], document.header["$MEASUREMENT"]) == (4, 1)
    assert document.dxfversion >= "AC1024"  # R2010


def test_geometry_is_where_the_sheet_has_it(document):
    space = document.modelspace()
    (line,) = polylines(document, "plate")
    assert [tuple(point) for point in line.get_points("xy")] == list(PLATE.polylines[0].places)
    assert line.closed
    (mirror,) = space.query("LINE[layer=='mirrors']")
    ends = [tuple(mirror.dxf.start)[:2], tuple(mirror.dxf.end)[:2]]
    assert ends == list(PLATE.polylines[1].places)
    (open_line,) = polylines(document, "axes")
    assert not open_line.closed
    circles = {
        circle.get_xdata("DESIGNOPT")[0].value: (tuple(circle.dxf.center)[:2], circle.dxf.radius)
        for circle in space.query("CIRCLE[layer=='plate']")
    }
    assert circles == {"A": ((0.0, 0.0), 1.5), "η": ((40.0, 30.0), 1.5)}
    assert {text.dxf.text for text in space.query("TEXT")} == {"η", "glass"}


def test_texts_hold_nothing_that_is_read_as_a_code():
    """%%d would be shown as a degree sign, %%%%% as signs of percent, ^J as a new line."""
    names = ["90%%d", "a%%%%%b", "x^J", "50%"]
    sheet = PLATE._replace(labels=[Label("plate", (40.0, 30.0), name) for name in names])
    texts = [text.dxf.text for text in opened(sheet).modelspace().query("TEXT")]
    assert not any("%%" in text for text in texts)
    assert [plain_text(text).replace(" ", "") for text in texts] == names


def test_layers_differ_by_kind_and_what_is_not_the_design_lies_on_others(document):
    layers = document.layers
    assert layers.get("mirrors").dxf.lineweight > layers.get("plate").dxf.lineweight
    assert layers.get("axes").dxf.linetype != layers.get("plate").dxf.linetype
    assert layers.get("mirrors").dxf.true_color != layers.get("plate").dxf.true_color
    on_plate = document.modelspace().query("*[layer=='plate']")
    assert sorted(entity.dxftype() for entity in on_plate) == ["CIRCLE", "CIRCLE", "LWPOLYLINE"]


@pytest.mark.parametrize(("names", "wanted"), cases("dxf_layers"))
def test_layers_keep_their_names_as_far_as_the_format_has_them(names, wanted):
    sheet = Drawing(
        "names",
        [Layer(name, "body") for name in names],
        polylines=[Polyline(name, [(0.0, 0.0), (1.0, 2.0)]) for name in names],
    )
    document = opened(sheet)
    assert not document.audit().has_issues
    assert [line.dxf.layer for line in document.modelspace().query("LINE")] == wanted
    assert all(name in document.layers for name in wanted)


def test_dimensions_measure_what_they_stand_at(document):
    found = dimensions(document)
    assert sorted(part.get_measurement() for part in found) == pytest.approx([30, 40, 50], abs=1e-9)
    for part in found:
        assert {part.dxf.layer, part.dxf.dimstyle} == {"dimensions", "SHEET"}
        words = words_of(part)
        # Read from below or from the right: no text stands on its head.
        angle = math.remainder(words.get_rotation(), 360)
        assert -90 < angle <= 90 + 1e-9
        assert words.text.endswith(f"{part.get_measurement():.0f}")


def test_dimensions_are_as_large_on_paper_as_the_standard_has_them():
    for factor in (1.0, 0.01, 1000.0):
        sheet = bar((0.0, 0.0), (150.0 * factor, 0.0))
        scale = Paper.of(sheet).scale
        (dimension,) = dimensions(opened(sheet))
        assert words_of(dimension).dxf.char_height * scale == pytest.approx(2.5)
        assert abs(dimension.dxf.defpoint.y) * scale == pytest.approx(7.0)


@pytest.mark.parametrize(("width", "scale", "words"), cases("sheet_scales"))
def test_the_view_shows_the_design_at_a_standard_scale(width, scale, words):
    document = opened(bar((7.0, 3.0), (7.0 + width, 3.0))._replace(dimensions=[]))
    space = document.paperspace("Sheet")
    _, view = space.viewports()  # the first stands for the paper itself
    assert view.dxf.height / view.dxf.view_height == pytest.approx(scale, rel=1e-12)
    assert view.get_scale() == pytest.approx(scale, rel=1e-12)
    middle = np.array(view.dxf.view_center_point)[:2]
    np.testing.assert_allclose(middle, [7.0 + width / 2, 3.0], rtol=1e-12)
    assert width * scale < view.dxf.width
    texts = [text.dxf.text for text in space.query("TEXT")]
    assert texts[0] == "bar"
    assert texts[1].startswith(words + " ")
    low, high = space.get_paper_limits()
    assert tuple(high - low) == pytest.approx(SIZES["A4"])


def test_the_frame_is_made_for_what_belongs_into_it(document):
    space = document.paperspace("Sheet")
    _, view = space.viewports()
    left = view.dxf.view_center_point.x - view.dxf.width / view.get_scale() / 2
    right = view.dxf.view_center_point.x + view.dxf.width / view.get_scale() / 2
    assert left < -5
    assert 41.5 < right < 900
    assert {"of brass", "2 mm thick"} <= {text.dxf.text for text in space.query("TEXT")}
    assert document.layers.get(view.dxf.layer).dxf.plot == 0


def test_many_dimensions_have_a_larger_sheet():
    fan = [LinearDimension((0.0, 0.0), (50.0, float(height))) for height in range(12)]
    polylines = [Polyline("fan", [part.start, part.end]) for part in fan]
    sheet = Drawing("fan", [Layer("fan", "body")], polylines=polylines, dimensions=fan)
    assert Paper.of(sheet).size == "A3"
    assert len(dimensions(opened(sheet))) == 12


def test_the_same_design_gives_the_same_file_and_settings_stay_as_they_were():
    before = options.write_fixed_meta_data_for_testing
    assert dxf_text(PLATE) == dxf_text(PLATE)
    assert options.write_fixed_meta_data_for_testing == before
