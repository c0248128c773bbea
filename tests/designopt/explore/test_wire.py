"""What the page draws, against what the SVG and DXF exporters write of the same drawing."""

import copy
import io
import itertools
import json
import xml.etree.ElementTree as ElementTree

import ezdxf
import numpy as np

from designopt.explore.explorer import Chart, Series, View
from designopt.explore.wire import changed_fields, encode_panels
from designopt.export.dxf import dxf_text
from designopt.export.line_styles import line_styles_of
from designopt.export.svg import svg_text
from tests.designopt.explore.slider_crank import SliderCrank, draw
from tests.designopt.explore.whole import show

SVG = "{http://www.w3.org/2000/svg}"
VALUES = SliderCrank().values()
DRAWING = draw(VALUES, "slider")


def numbers(text):
    """Those of a path's data, or of a polygon's points."""
    return [float(one) for one in text.translate(str.maketrans(",MLAZ", "     ")).split()]


def apply(fields, change):
    """Put what was sent where it belongs, as the page's script does."""
    panels = {panel["name"]: panel for panel in fields["panels"]}
    for one in change.get("panels", ()):
        panel = panels.setdefault(one["name"], {})
        changed = one.get("changed", ())
        panel |= {key: value for key, value in one.items() if key != "changed"}
        for index, shape in changed:
            panel["shapes"][index] = shape
    names = [one["name"] for one in change["panels"]]
    return {**fields, **change, "panels": [panels[name] for name in names]}


def test_coordinates_of_page_svg_and_dxf_are_the_same():
    [view] = encode_panels([View("slider", DRAWING)])
    lines = [shape for shape in view["shapes"] if len(shape) == 3]
    circles = [shape for shape in view["shapes"] if len(shape) == 5]
    root = ElementTree.fromstring(svg_text(DRAWING))
    written = {}  # by layer, in the order of the file
    for group, layer in zip(root.findall(f"{SVG}g"), DRAWING.layers, strict=False):
        shapes = [numbers(one.get("d") or one.get("points", "")) for one in group]
        written[layer.name] = [one for one in shapes if one]
        centers = [
            [float(one.get(key, "")) for key in ("cx", "cy", "r")]
            for one in group.iter(f"{SVG}circle")
        ]
        of_layer = [rest for number, _, *rest in circles if DRAWING.layers[number] == layer]
        assert of_layer == centers
    for number, layer in enumerate(DRAWING.layers):
        assert [numbers(d) for one, _, d in lines if one == number] == written[layer.name]

    model = ezdxf.read(io.StringIO(dxf_text(DRAWING))).modelspace()  # pyright: ignore[reportPrivateImportUsage]
    drawn = [
        (one.dxf.layer, [(x, -y) for x, y in one.get_points("xy")])  # pyright: ignore[reportAttributeAccessIssue]
        for one in model.query("LWPOLYLINE")
    ]
    straight = [
        (one.dxf.layer, [(place.x, -place.y) for place in (one.dxf.start, one.dxf.end)])
        for one in model.query("LINE")
    ]
    ours = [
        (DRAWING.layers[layer].name, np.reshape(numbers(d), (-1, 2)).tolist())
        for layer, _, d in lines
        if "A" not in d
    ]
    theirs = [*straight, *(one for one in drawn if one[0] != "rim")]
    assert len(ours) == len(theirs) == 3
    for (layer, places), (dxf_layer, dxf_places) in zip(ours, theirs, strict=True):
        assert layer.lower() == dxf_layer.lower()
        np.testing.assert_allclose(places, dxf_places, rtol=0, atol=1e-12)
    round_ones = [
        [*np.multiply(one.dxf.center.vec2, (1, -1)), one.dxf.radius]
        for one in model.query("CIRCLE")
    ]
    np.testing.assert_allclose([one[2:] for one in circles], round_ones, rtol=0, atol=1e-12)
    [[middle, *_]] = [points for layer, points in drawn if layer == "rim"]
    arc = numbers(next(d for _, _, d in lines if "A" in d))
    np.testing.assert_allclose(arc[:2], middle, atol=1e-12)


def test_styles_and_the_frame_are_those_of_the_exporters():
    [view] = encode_panels([View("slider", DRAWING)])
    styles = line_styles_of(DRAWING.layers)
    for name, _, color, width, dashed, fill in view["layers"]:
        assert (color, width, dashed, fill) == styles[name]
    (left, low), (right, high) = DRAWING.box()
    assert view["box"] == [left, -high, right, -low]
    [empty] = encode_panels([View("none", DRAWING._replace(polylines=(), circles=()))])
    assert empty["box"] is None


def test_what_is_sent_of_a_change_makes_the_whole():
    shown = []
    for values in (VALUES, {**VALUES, "crank": 70.0}, {**VALUES, "radius": 20.0}):
        fields = {"panels": encode_panels(show(SliderCrank(), values).panels), "note": "same"}
        shown.append(json.loads(json.dumps(fields, allow_nan=False)))
    fields = copy.deepcopy(changed_fields(shown[0], {"panels": [], "note": ""}))
    assert fields == shown[0]
    for before, after in itertools.pairwise(shown):
        change = changed_fields(after, before)
        assert "note" not in change
        assert len(json.dumps(change)) < len(json.dumps(after))
        fields = apply(fields, copy.deepcopy(change))
        assert fields == after
    [view, chart] = changed_fields(shown[1], shown[0])["panels"]
    assert [index for index, _ in view["changed"]] == [1, 2, 3, 4, 5]  # not the rim
    assert chart == {"name": "motion", "at": 70.0}


def test_a_gap_in_a_curve_is_null():
    [chart] = encode_panels(
        [Chart("c", "x (mm)", "y (mm)", [Series("s", [0.0, 1.0, 2.0], [1.0, float("nan"), 3.0])])]
    )
    assert chart["series"] == [["s", [0.0, 1.0, 2.0], [1.0, None, 3.0]]]
