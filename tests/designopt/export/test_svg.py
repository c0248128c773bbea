"""A drawing as SVG, measured as a browser would."""

import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest

from designopt.export.drawing import Circle, Drawing, Label, Layer, Polyline
from designopt.export.svg import svg_text

SVG = "{http://www.w3.org/2000/svg}"
INKSCAPE = "{http://www.inkscape.org/namespaces/inkscape}"

SHEET = Drawing(
    title="finger & <thumb>",
    layers=[
        Layer("crank 1", "body"),
        Layer("crank_1", "body"),
        Layer("7", "construction"),
        Layer("away", "camera", framed=False),
    ],
    polylines=[
        Polyline("crank 1", [(0.0, 0.0), (40.0, 10.0), (1 / 3, 30.0)], closed=True),
        Polyline("7", [(-10.0, -20.0), (0.0, 5.0)]),
        Polyline("away", [(-900.0, 0.0), (0.0, 0.0)]),
    ],
    circles=[Circle("crank_1", "A", (40.0, 10.0), 2.5)],
    labels=[Label("crank 1", (40.0, 10.0), "A < B")],
    notes=["straight"],
)


@pytest.fixture
def root() -> ElementTree.Element:
    return ElementTree.fromstring(svg_text(SHEET))


def test_one_unit_is_one_millimetre_and_all_that_is_framed_is_inside(root):
    left, top, width, height = map(float, root.attrib["viewBox"].split())
    assert (root.get("width"), root.get("height")) == (f"{width!r}mm", f"{height!r}mm")
    assert left < -10
    assert left + width > 42.5
    assert left + width - 42.5 == pytest.approx(-10 - left)
    assert top < -30
    assert top + height > 20


def test_lines_and_circles_are_where_the_sheet_has_them_y_upwards(root):
    (polygon,) = root.iter(f"{SVG}polygon")
    places = np.array([pair.split(",") for pair in polygon.attrib["points"].split()], float)
    np.testing.assert_array_equal(places * [1, -1], SHEET.polylines[0].places)
    line, _ = root.iter(f"{SVG}polyline")
    assert line.get("points") == "-10.0,20.0 0.0,-5.0"
    (circle,) = root.iter(f"{SVG}circle")
    assert [float(circle.attrib[key]) for key in ("cx", "cy", "r")] == [40.0, -10.0, 2.5]
    assert circle.findtext(f"{SVG}title") == "A"
    assert "-0.0" not in svg_text(SHEET)


def test_layers_are_groups_that_inkscape_knows(root):
    groups = {group.get(f"{INKSCAPE}label"): group for group in root.findall(f"{SVG}g")}
    assert list(groups) == ["crank 1", "crank_1", "7", "away", "names"]
    identifiers = [group.get("id") for group in groups.values()]
    assert identifiers == ["crank_1", "crank_1_2", "_7", "away", "names"]
    assert all(group.get(f"{INKSCAPE}groupmode") == "layer" for group in groups.values())
    assert [child.tag for child in groups["crank_1"]] == [f"{SVG}circle"]
    assert groups["7"].get("stroke-dasharray")
    assert not groups["crank 1"].get("stroke-dasharray")
    assert groups["crank 1"].get("stroke") != groups["crank_1"].get("stroke")


def test_texts_stand_beside_their_places_in_the_picture(root):
    (text,) = root.iter(f"{SVG}text")
    assert text.text == "A < B"
    beside = np.array([float(text.attrib["x"]), -float(text.attrib["y"])])
    assert 0 < np.hypot(*(beside - [40, 10])) < 10
    left, top, width, height = map(float, root.attrib["viewBox"].split())
    assert left < beside[0] < left + width
    assert top < -beside[1] < top + height
    assert root.findtext(f"{SVG}title") == "finger & <thumb>"
    assert "straight" in (root.findtext(f"{SVG}desc") or "")


def test_the_same_design_gives_the_same_file():
    assert svg_text(SHEET) == svg_text(SHEET)
