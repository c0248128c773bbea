"""Drawings and numbers of scenes and chambers, against their files and formulas of their own."""

import math
import tomllib
from collections import Counter
from typing import Any

import numpy as np
import pytest

from designopt.export.drawing import Drawing
from optics.chamber.designed import DesignedChamber
from optics.export.chamber_drawing import chamber_quantities, make_chamber_drawing
from optics.export.scene_drawing import make_scene_drawing, scene_quantities
from optics.scene.designed import DesignedScene
from optics.scene.file import SceneFile
from tests.designopt.export.reading import dimensions, numbers_in, opened
from tests.helpers import SCENES
from tests.optics.chambers import chamber

NAMES = sorted(path.stem for path in SCENES.glob("*.toml"))
DRAWN = 1e-3
"""How far a curved mirror's drawing may be from its curve, mm; and a tenth of this part of its
length."""


def scene(name: str) -> DesignedScene:
    return DesignedScene.read(SCENES / f"{name}.toml")


def tables(name: str) -> dict[str, Any]:
    return tomllib.loads((SCENES / f"{name}.toml").read_text(encoding="utf-8"))


def polylines(sheet: Drawing, layer: str) -> list[list[tuple[float, float]]]:
    return [list(polyline.places) for polyline in sheet.polylines if polyline.layer == layer]


PAD = {"name": "pad", "from": [9, 0], "to": [9, 5]}
CAMERA = {"position": [200, 0], "direction_deg": 180, "fov_deg": 60, "pixels": 100}


def designed(camera: dict[str, Any] | None = None, **tables: Any) -> DesignedScene:
    file = SceneFile.model_validate({"camera": CAMERA | (camera or {}), **tables})
    return DesignedScene.of(file, "scene")


def curved(radius: float, conic: float, half: float = 40.0) -> Drawing:
    mirror = {"name": "m", "from": [0, half], "to": [0, -half], "radius": radius, "conic": conic}
    return make_scene_drawing(designed(mirrors=[mirror]))


@pytest.mark.parametrize("name", NAMES)
def test_every_number_of_a_scene_file_is_among_the_numbers(name):
    quantities = scene_quantities(scene(name))
    assert len({part.name for part in quantities}) == len(quantities)
    missing = Counter(numbers_in(tables(name))) - Counter(float(part.value) for part in quantities)
    assert not missing
    for part in quantities:
        leaf = part.name.rsplit(".", 1)[-1]
        units = {"x": "mm", "y": "mm", "length": "mm", "radius": "mm", "conic": "", "pixels": "px"}
        units |= {"direction": "°", "field_of_view": "°", "min_grazing": "°", "bounces": ""}
        units |= {"width": "mm", "thickness": "mm", "height": "mm", "min_transmission": ""}
        units |= dict.fromkeys(("red", "green", "blue"), "")
        units |= dict.fromkeys(("from", "to"), "°" if ".bevel." in part.name else "mm")
        assert part.unit == units[leaf]


def test_a_lens_and_coefficients_are_among_the_numbers():
    coefficients = [0.01, -0.002, 0.0003, -0.00004]
    lens = {"focal_length": 2.5, "f_number": 2.8, "focus": 30.0}
    design = designed({"projection": coefficients, "lens": lens}, pads=[PAD])
    found = {part.name: part for part in scene_quantities(design)}
    assert [found[f"camera.projection.k{i}"].value for i in range(1, 5)] == coefficients
    assert {key: found[f"camera.lens.{key}"].value for key in lens} == lens
    assert found["camera.lens.focus"].unit == "mm"


@pytest.mark.parametrize("name", NAMES)
def test_a_drawing_has_what_the_file_has_where_it_is(name):
    data, document = tables(name), opened(make_scene_drawing(scene(name)))
    assert not document.audit().has_issues
    space = document.modelspace()
    for layer in ("mirrors", "pads", "blockers"):
        wanted = [
            (*part["from"], *part["to"]) for part in data.get(layer, []) if "radius" not in part
        ]
        found = [
            (line.dxf.start.x, line.dxf.start.y, line.dxf.end.x, line.dxf.end.y)
            for line in space.query(f"LINE[layer=='{layer}']")
        ]
        np.testing.assert_array_equal(found, wanted)
    hinges = [tuple(circle.dxf.center)[:2] for circle in space.query("CIRCLE[layer=='hinges']")]
    assert hinges == [tuple(frame["hinge"]) for frame in data.get("frames", {}).values()]
    (circle,) = space.query("CIRCLE[layer=='camera']")
    assert tuple(circle.dxf.center)[:2] == tuple(data["camera"]["position"])
    # Lines of sight are the axis and the edges of the field.
    camera, sheet = data["camera"], make_scene_drawing(scene(name))
    turns = []
    for start, end in polylines(sheet, "camera") + polylines(sheet, "field of view"):
        assert start == tuple(camera["position"])
        angle = math.degrees(math.atan2(end[1] - start[1], end[0] - start[0]))
        turns.append(math.remainder(angle - camera["direction_deg"], 360))
    half = camera["fov_deg"] / 2
    assert turns == pytest.approx([0, -half, half], abs=1e-9)


LAYERED = {
    "name": "p",
    "from": [10, 3],
    "to": [10, -17],
    "side": "right",
    "layers": [
        {"thickness": 3, "index": 1.5, "overhang": [0, 1], "bevel_deg": [45, 0]},
        {
            "thickness": 2,
            "index": {"red": 1.4, "green": 1.41, "blue": 1.42},
            "sides": {"from": "clear"},
        },
    ],
    "bezel": {"lip": [1, 2], "height": 0.5},
}
"""Under layers that are all to the left of x = 10."""


def test_layers_and_bezel_are_drawn_where_they_are():
    sheet = make_scene_drawing(designed(pads=[PAD | {"name": "bare"}, LAYERED]))
    found = [line for line in sheet.polylines if line.layer == "layers"]
    assert all(line.closed for line in found)
    outermost = [(8, 3), (8, -18), (5, -18), (5, 0)]
    bezels = [[(5, 0), (4.5, 0), (4.5, -1), (5, -1)], [(5, -18), (4.5, -18), (4.5, -16), (5, -16)]]
    wanted = [outermost, [(10, 3), (10, -17), (8, -17), (8, 3)], *bezels]
    np.testing.assert_allclose([line.places for line in found], wanted, atol=1e-12)
    texts = [label.text for label in sheet.labels if label.layer == "layers"]
    assert texts == ["p: 2 layers", "bezel", "bezel"]
    assert sheet.notes[-2:] == [
        "p pad, layer 1 (outside): 3 mm, index 1.5, sides black",
        "p pad, layer 2: 2 mm, index 1.4/1.41/1.42 (red/green/blue), from clear, to black, "
        "beside black",
    ]
    document = opened(sheet)
    assert not document.audit().has_issues
    assert len(document.modelspace().query("LWPOLYLINE[layer=='layers']")) == 4
    assert not polylines(make_scene_drawing(designed(pads=[PAD])), "layers")


def test_the_numbers_of_layers_say_what_is_not_stated():
    design = designed(pads=[PAD | {"name": "bare"}, LAYERED])
    found = {part.name: (part.value, part.unit) for part in scene_quantities(design)}
    assert found["pads.p.min_transmission"] == (0.3, "")
    assert found["pads.p.layers.1.index.blue"] == (1.5, "")
    assert found["pads.p.layers.2.index.blue"] == (1.42, "")
    assert found["pads.p.layers.1.bevel.from"] == (45, "°")
    assert found["pads.p.layers.2.overhang.to"] == (0, "mm")
    assert found["pads.p.bezel.lip.to"] == (2, "mm")
    assert not [name for name in found if name.startswith("pads.bare.") and "transm" in name]


def test_a_camera_that_sees_all_around_has_one_edge():
    around = {"position": [0, 0], "direction_deg": 90, "fov_deg": 360}
    sheet = make_scene_drawing(designed(around, pads=[PAD]))
    ((_, end),) = polylines(sheet, "field of view")
    assert end[1] < 0
    assert abs(end[0]) < 1e-12
    assert not opened(sheet).audit().has_issues


@pytest.mark.parametrize(
    ("radius", "conic", "half"),
    [
        *((radius, 0.0, 40.0) for radius in (100.0, -41.0, 40.000001, 5000.0)),
        *((0.75 * half, -1.0, half) for half in (40.0, 0.04)),
        (64.0, -0.36, 40.0),
    ],
)
def test_a_curved_mirror_is_nowhere_far_from_its_conic(radius, conic, half):
    (line,) = polylines(curved(radius, conic, half), "mirrors")
    assert (line[0], line[-1]) == ((0.0, half), (0.0, -half))
    places = np.array(line)
    fine = places[:-1, None] + np.linspace(0, 1, 33)[:, None] * np.diff(places, axis=0)[:, None]
    # y² + (1 + k) z² = 2 R z; to the left of from → to is +x, and there z grows from the vertex.
    root = math.copysign(math.sqrt(radius**2 - (1 + conic) * half**2), radius)
    depth = half**2 / (radius + root)
    y, z = fine[..., 1], fine[..., 0] + depth
    across = np.hypot(y, (1 + conic) * z - radius)
    off = (y**2 + (1 + conic) * z**2 - 2 * radius * z) / (2 * across)
    assert np.max(np.abs(off)) < DRAWN * min(1.0, 0.1 * 2 * half)
    # The mirror is the minor arc.
    assert np.max(np.abs(z / depth - 0.5)) <= 0.5 + 1e-9


def test_a_far_camera_is_drawn_but_does_not_shrink_the_picture():
    sheet = make_scene_drawing(scene("circle"))
    (left, _), (right, _) = sheet.box()
    assert right - left < 100
    assert any(circle.center == (10000, 0) for circle in sheet.circles)
    assert any("outside the picture" in note for note in sheet.notes)
    assert max(math.dist(part.start, part.end) for part in sheet.dimensions) < 100
    assert not any("outside" in note for note in make_scene_drawing(scene("ellipse")).notes)


def test_dimensions_of_a_scene_say_how_to_build_it():
    data = tables("finger")
    sheet = opened(make_scene_drawing(scene("finger")))
    found = [part.get_measurement() for part in dimensions(sheet)]
    wanted = [math.dist(part["from"], part["to"]) for part in data["mirrors"] + data["pads"]]
    for part in data["mirrors"]:
        hinge = data["frames"][part["body"]]["hinge"]
        wanted += [math.dist(hinge, part[end]) for end in ("from", "to")]
    assert sorted(found) == pytest.approx(sorted(wanted), abs=1e-9)


def test_a_distance_that_two_mirrors_share_is_stated_once():
    measures = make_scene_drawing(scene("kaleidoscope-60")).dimensions
    assert len(set(measures)) == len(measures)
    corner, camera = (0.0, 0.0), tuple(map(float, tables("kaleidoscope-60")["camera"]["position"]))
    assert sum({part.start, part.end} == {corner, camera} for part in measures) == 1


CHAMBER = chamber(length_cd=37.0)


def test_the_chamber_is_drawn_region_by_region():
    sheet = make_chamber_drawing(DesignedChamber("chamber", CHAMBER))
    document = opened(sheet)
    assert not document.audit().has_issues
    offset_c = 2.0 - 30.0 * math.tan(math.radians(2))
    corners = [(0, 4.1), (40, 2.0), (70, offset_c), (107, -2.55), (107, -8.616)]
    for index, region in enumerate(("red", "blue", "yellow", "top")):
        (line,) = document.modelspace().query(f"LINE[layer=='{region}']")
        np.testing.assert_allclose(tuple(line.dxf.start)[:2], corners[index], atol=1e-12)
        np.testing.assert_allclose(tuple(line.dxf.end)[:2], corners[index + 1], atol=1e-12)
    for region, strong in (("red", (0,)), ("blue", (2,)), ("yellow", (0, 1))):
        color = np.array(document.layers.get(region).rgb, int)
        assert np.min(color[list(strong)]) > 1.4 * np.max(np.delete(color, strong))
    (pinhole,) = document.modelspace().query("CIRCLE")
    np.testing.assert_allclose(tuple(pinhole.dxf.center)[:2], (-0.844, -8.616))
    assert [label.text for label in sheet.labels] == ["A", "B", "C", "D", "E", "pinhole"]
    found = [part.get_measurement() for part in dimensions(document)]
    wanted = [40.0, 30.0, 37.0, 4.1, 2.0, offset_c, 2.55, 0.844, 8.616]
    assert sorted(found) == pytest.approx(sorted(wanted), abs=1e-9)


def test_the_numbers_of_a_chamber_follow_eqs_1_to_3():
    quantities = chamber_quantities(DesignedChamber("c", CHAMBER))
    found = {part.name: (part.value, part.unit) for part in quantities}
    assert found["length_cd"] == (37.0, "mm")
    assert found["wall_angle_bc"] == (pytest.approx(2.0), "°")
    offset_c = 2.0 - 30.0 * math.tan(math.radians(2))
    assert found["offset_c"] == (pytest.approx(offset_c), "mm")
    angle = math.degrees(math.atan((offset_c + 2.55) / 37.0))
    assert found["wall_angle_cd"] == (pytest.approx(angle), "°")
    heights = [
        (4.0 - 3.5) * (8.616 + offset) / (s + 0.844)
        for s, offset in ((40.0, 2.0), (70.0, offset_c), (107.0, -2.55))
    ]
    blue, yellow = heights[0] - heights[1], heights[1] - heights[2]
    assert found["ring_blue"] == (pytest.approx(blue), "mm")
    assert found["ring_yellow"] == (pytest.approx(yellow), "mm")
    assert found["ring_top"] == (pytest.approx(heights[2]), "mm")
    assert found["imaging_ratio"] == (pytest.approx(yellow / blue), "")
    assert len(found) == 17
    notes = make_chamber_drawing(DesignedChamber("c", CHAMBER)).notes
    assert notes[-1] == f"imaging ratio {yellow / blue:.6g}"


def test_a_chamber_without_an_image_has_no_numbers_of_it():
    design = DesignedChamber("behind", chamber(pinhole_offset=-50.0))
    names = {part.name for part in chamber_quantities(design)}
    assert {"imaging_ratio", "ring_blue"}.isdisjoint(names)
    assert "length_ab" in names
    assert not any("ratio" in note for note in make_chamber_drawing(design).notes)
    assert not opened(make_chamber_drawing(design)).audit().has_issues
