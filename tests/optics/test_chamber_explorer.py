"""What a chamber's explorer shows against Eqs. 1-3 written out: numbers, shapes, and failures."""

import math
from itertools import pairwise

import numpy as np
import pytest

from designopt.errors import UserError
from designopt.explore.explorer import View
from optics import ChamberResult
from optics.chamber.designed import DesignedChamber
from optics.explore.chamber import ChamberExplorer
from tests.designopt.explore.whole import show
from tests.optics.chambers import MOVES, PAPER, eq_1


@pytest.fixture(scope="module")
def paper():
    return ChamberExplorer(DesignedChamber("soft", PAPER))


def readouts(state):
    return {one.name: one.value for one in state.readouts}


@pytest.mark.parametrize("moves", MOVES)
def test_numbers_and_shapes_are_those_of_eq_1(paper, moves):
    values = paper.values() | moves
    state = show(paper, values)
    offset_c, offset_d, angle, images = eq_1(values)
    found = readouts(state)
    expected = {
        "η, imaging ratio": values["imaging_ratio"],
        "Δl_D, offset of D": offset_d,
        "θ_CD, yellow wall": angle,
        "Δl_C, offset of C": offset_c,
        "Δd_b, blue ring": images[0] - images[1],
        "Δd_c, yellow ring": images[1] - images[2],
        "Δd_d, top": images[2],
        "T_B, image height": images[0],
        "T_C, image height": images[1],
        "T_D, image height": images[2],
        "room of D inside Δl_A": values["offset_a"] - abs(offset_d),
    }
    assert list(found) == [*expected, "margin"]
    for name, value in expected.items():
        assert found[name] == pytest.approx(value, rel=1e-9, abs=1e-12), name
    section, image, line = state.panels
    s_b, s_c = values["length_ab"], values["length_ab"] + values["length_bc"]
    s_d = s_c + values["length_cd"]
    corners = [
        (0.0, values["offset_a"]),
        (s_b, values["offset_b"]),
        (s_c, offset_c),
        (s_d, -offset_d),
        (s_d, -values["reference_height"]),
    ]
    shapes = {one.layer: one.places for one in section.drawing.polylines}
    walls = [shapes[name] for name in ("red", "blue", "yellow", "top")]
    np.testing.assert_allclose(walls, [*pairwise(corners)], atol=1e-9)
    pinhole = (-values["pinhole_offset"], -values["reference_height"])
    np.testing.assert_allclose(shapes["light of yellow"], [pinhole, *corners[2:4]], atol=1e-9)
    handles = [one.place for one in section.handles]
    np.testing.assert_allclose(handles, [*corners[:4], pinhole], atol=1e-9)
    rings = {one.layer: np.hypot(*np.array(one.places).T) for one in image.drawing.polylines}
    radii = [*images, 0.0]
    for name, outer, inner in zip(("blue", "yellow", "top"), radii, radii[1:], strict=False):
        assert np.max(rings[name]) == pytest.approx(outer, rel=1e-9)
        assert np.min(rings[name]) == pytest.approx(inner or outer, rel=1e-9)
    assert line.at == values["imaging_ratio"]
    rising, inside, _ = line.series
    assert np.interp(line.at, rising.x, rising.y) == pytest.approx(offset_d, rel=1e-9)
    assert set(inside.y) == {values["offset_a"]}
    assert "θ_CD" in section.notes["yellow wall"]


def test_the_sketch_is_the_file():
    explorer = ChamberExplorer(DesignedChamber("soft", PAPER))
    shown = show(explorer, explorer.values()).panels
    for early, late in zip(explorer.sketch(), shown, strict=False):
        assert isinstance(late, View)
        assert early.name == late.name
        for one, other in zip(early.drawing.polylines, late.drawing.polylines, strict=True):
            np.testing.assert_allclose(one.places, other.places, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize(
    ("moves", "result", "margin"),
    [
        ({"wall_angle_bc": -15.0}, ChamberResult.blue_edge_on, None),
        ({"pinhole_offset": -41.0}, ChamberResult.behind_pinhole, -1.0),
        ({"length_bc": -1.0}, ChamberResult.no_length, -1.0),
    ],
)
def test_a_failure_is_named_and_leaves_the_picture(paper, moves, result, margin):
    values = paper.values()
    before = show(paper, values)
    state = show(paper, values | moves)
    assert state.message == ChamberResult[result]
    assert state.panels == before.panels
    found = readouts(state)
    assert list(found) == list(readouts(before))
    assert {name for name, value in found.items() if value is not None} == {"margin"}
    if margin is None:
        # The pinhole's distance from the line of the blue wall.
        angle = math.radians(moves["wall_angle_bc"])
        above = (values["reference_height"] + values["offset_b"]) * math.cos(angle)
        margin = above + (values["length_ab"] + values["pinhole_offset"]) * math.sin(angle)
    assert found["margin"] == pytest.approx(margin, rel=1e-9)
    with pytest.raises(UserError):
        paper.design.files(values | moves)


def test_a_poor_chamber_is_remarked_on(paper):
    values = paper.values()
    assert show(paper, values).message == ""
    outside = show(paper, values | {"imaging_ratio": 0.9})
    room = readouts(outside)["room of D inside Δl_A"]
    assert room < 0
    assert f"D lies outside the wall at the lens, by {-room:.3g} mm" in outside.message
    assert "the top has no ring" in show(paper, values | {"imaging_ratio": 1.15}).message
    same = show(paper, values | {"image_distance": values["focal_length"]})
    assert "change f or v" in same.message
    assert [panel.name for panel in same.panels] == [panel.name for panel in outside.panels]


@pytest.mark.parametrize(
    ("handle", "by"),
    [
        ("A", (0, 0.5)),
        ("B", (2, 0.3)),
        ("C", (-1, 0.4)),
        ("D", (1.5, -0.2)),
        ("pinhole", (-0.2, 0.3)),
    ],
)
def test_a_dragged_point_goes_where_it_is_dragged(paper, handle, by):
    values = paper.values()
    view = show(paper, values).panels[0]
    start = {one.name: one for one in view.handles}[handle]
    wanted = (start.place[0] + by[0], start.place[1] + by[1])
    found = paper.drag(values, handle, wanted)
    moved = {one.name: one.place for one in show(paper, found).panels[0].handles}
    assert moved[handle] == pytest.approx(wanted, abs=1e-9)
    assert {name for name in values if found[name] != values[name]} == set(start.parameters)
    # Far away it stops at the ends of the ranges.
    far = paper.drag(values, handle, (900.0, -900.0))
    for one in paper.design.parameters:
        assert one.low <= far[one.name] <= one.high


def test_showing_compiles_once(paper, monkeypatch):
    show(paper, paper.values())

    def traced_again(*arguments):
        raise AssertionError("it was traced again")

    monkeypatch.setattr("optics.parametric.chamber.solve_dimension_for_ratio", traced_again)
    for moves in MOVES:
        show(paper, paper.values() | moves)
