"""Cameras as they are sold: sensors, lenses and modules against formulas of the textbook."""

import copy
import dataclasses
import itertools
import json
import math
import re
import tomllib
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from designopt import UserError
from designopt.cli import run
from designopt.io.toml_writing import format_toml
from optics import find_blur, find_coverage, format_scene, parse_scene
from optics.scene.camera import Camera, Equidistant
from optics.scene.catalogue import camera_catalogue
from optics.scene.designed import DesignedScene
from optics.scene.fabrication import Fabrication, perturb
from optics.scene.imaging import Imaging
from optics.scene.scene import Scene, place
from optics.scene.sold import fields_of_view
from optics.visibility.remarks import remark_on_fields
from tests.helpers import DATA, assert_same, check_gradients
from tests.mutations import mutate
from tests.optics.test_camera import HEIGHTS, PROJECTIONS
from tests.refusals import check_refused

ROUNDING = 1e-12
"""Of a few operations, relative."""

SLOPES = 1e-8
"""What central differences leave, of a function and a design of order one."""

ANGLES = {
    "pinhole": np.arctan,
    "equidistant": lambda height: height,
    "equisolid": lambda height: 2 * np.arcsin(height / 2),
    "stereographic": lambda height: 2 * np.arctan(height / 2),
    "orthographic": np.arcsin,
}
"""Angles of heights in focal lengths."""

FORMAT = {"sensor_mm": [4.0, 3.0], "pixels": [1600, 1200], "section_axis": "long"}
EXTENTS = {"horizontal": 4.0, "vertical": 3.0, "diagonal": 5.0}
PAD = {"name": "pad", "from": [20.0, -2.0], "to": [20.0, 2.0]}
LENS = {"focal_length": 2.0, "f_number": 2.0, "focus": 20.0}
MODULE = {
    "lens_diameter": 6.0,
    "lens_length": 5.0,
    "pupil_depth": 0.5,
    "board": [10.0, 8.0],
    "board_thickness": 1.5,
    "connector_length": 2.0,
}

every_name = pytest.mark.parametrize("name", HEIGHTS)


def tables(**keys: Any) -> dict[str, Any]:
    others = {"scene": {"name": "sold"}, "pads": [PAD]}
    given = {key: keys.pop(key) for key in ("pads", "mirrors", "blockers", "frames") if key in keys}
    return others | given | {"camera": {"position": [0.0, 0.0], "direction_deg": 0.0} | keys}


def sold(**keys: Any) -> dict[str, Any]:
    """A scene with a camera before a sensor of 4 by 3 mm."""
    return tables(**({"format": FORMAT} | keys))


def camera(**keys: Any) -> Camera:
    return parse_scene(sold(**keys)).camera


def test_a_diagonal_of_160_degrees_is_less_along_the_long_side():
    """Numbers of a maker's 4:3 sensor, computed by hand."""
    along = {"equisolid": 124.0, "equidistant": 128.0, "stereographic": 135.5}
    for name, wanted in along.items():
        found = camera(fov_deg=160.0, fov_axis="diagonal", projection=name)
        assert math.degrees(found.field_of_view) == pytest.approx(wanted, abs=0.3)
        exact = 2 * ANGLES[name](0.8 * HEIGHTS[name](math.radians(80)))
        assert float(found.field_of_view) == pytest.approx(exact, rel=ROUNDING)
    short = {"section_axis": "short"}
    keys = {"fov_deg": 160.0, "fov_axis": "diagonal", "projection": "equidistant"}
    found = camera(**keys, format=FORMAT | short)
    assert math.degrees(found.field_of_view) == pytest.approx(96)


def test_160_degrees_along_the_short_side_are_213_and_267():
    eye = Camera(np.zeros(2), 0.0, math.radians(160), 1080, Equidistant())
    found = fields_of_view(eye, 4 / 3)
    assert found == pytest.approx({"horizontal": 640 / 3, "vertical": 160, "diagonal": 800 / 3})
    other = fields_of_view(eye, 3 / 4)
    assert other == pytest.approx({"horizontal": 160, "vertical": 120, "diagonal": 200})
    told = remark_on_fields(eye)
    for word in ("160°", "213.3°", "266.7°", "120°", "200°"):
        assert word in told


def test_what_a_lens_does_not_image_is_said():
    eye = Camera(np.zeros(2), 0.0, math.radians(120), 100, PROJECTIONS["orthographic"])
    assert fields_of_view(eye) == {
        "horizontal": None,
        "vertical": pytest.approx(120),
        "diagonal": None,
    }
    assert "more than it images" in remark_on_fields(eye)


@every_name
@pytest.mark.parametrize("side", ["long", "short"])
def test_the_focal_length_and_not_the_field_of_view_says_where_rays_are_imaged(name, side):
    eye = camera(focal_length=2.5, projection=name, format=FORMAT | {"section_axis": side})
    length, count = (4.0, 1600) if side == "long" else (3.0, 1200)
    assert float(eye.pixels) == count
    angles = np.radians([-30.0, 0.0, 10.0])
    pixels = count / 2 - count / length * 2.5 * HEIGHTS[name](angles)
    np.testing.assert_allclose(eye.pixel(jnp.asarray(angles)), pixels, rtol=ROUNDING)
    limits = jnp.asarray([0.5, -0.5]) * eye.field_of_view
    np.testing.assert_allclose(eye.pixel(limits), [0, count], atol=count * ROUNDING)
    fields = {axis: 2 * ANGLES[name](part / 5.0) for axis, part in EXTENTS.items()}
    if name == "orthographic":  # its image ends in the sensor's corner
        fields["diagonal"] = None
    for axis, found in fields_of_view(eye).items():
        field = fields[axis]
        assert found == (None if field is None else pytest.approx(math.degrees(field)))
    assert Imaging.of(eye).shape == (count, 2800 - count)


@every_name
def test_an_image_circle_cuts_the_field_of_view_and_moves_no_pixel(name):
    whole = camera(focal_length=2.5, projection=name)
    cut = camera(focal_length=2.5, projection=name, image_circle_mm=3.5)
    assert float(cut.field_of_view) == pytest.approx(2 * ANGLES[name](0.7), rel=ROUNDING)
    assert float(cut.pixel(jnp.asarray(0.3))) == float(whole.pixel(jnp.asarray(0.3)))
    beyond = camera(focal_length=2.5, projection=name, image_circle_mm=4.5)
    assert beyond.field_of_view == whole.field_of_view  # the sensor's edge
    assert fields_of_view(beyond)["diagonal"] == pytest.approx(math.degrees(2 * ANGLES[name](0.9)))
    # A field of view is that of the circle where this ends before the sensor.
    told = camera(fov_deg=100.0, fov_axis="diagonal", projection=name, image_circle_mm=3.5)
    assert math.degrees(told.field_of_view) == pytest.approx(100)


def test_pixels_outside_the_image_circle_are_dark():
    eye = camera(focal_length=2.5, projection="equisolid", image_circle_mm=3.5)
    lit = Imaging.of(eye).lit()
    assert lit is not None
    rows, columns = np.indices((1600, 1200))
    radius = np.hypot(rows - 799.5, columns - 599.5) * 4.0 / 1600
    np.testing.assert_array_equal(lit, radius <= 1.75)
    assert Imaging.of(camera(focal_length=2.5, projection="equisolid")).lit() is None


@every_name
@pytest.mark.parametrize("axis", EXTENTS)
def test_two_of_focal_length_field_and_projection_give_the_third(name, axis):
    focal, half = 2.4, math.radians(40)
    focal = EXTENTS[axis] / 2 / HEIGHTS[name](half)
    field = {"fov_deg": 80.0, "fov_axis": axis}
    by_field = camera(**field, projection=name, image_circle_mm=3.0)
    assert by_field.sensor is not None
    # A circle of 3 mm has 80° itself if it ends before the axis does.
    shrunk = min(3.0 / EXTENTS[axis], 1.0)
    assert float(by_field.sensor.focal_length) == pytest.approx(focal * shrunk, rel=ROUNDING)
    for near in (0.995, 1.0, 1.005):
        found = camera(**field, focal_length=focal * near)
        assert type(found.projection) is type(PROJECTIONS[name])
        assert found.sensor is not None
        assert float(found.sensor.focal_length) == pytest.approx(focal * near)
    camera(**field, focal_length=focal * 0.995, projection=name)
    words = [f"contradicts fov_deg = 80 ({axis})", f"{focal:.4g} mm"]
    check_refused(parse_scene, sold(**field, focal_length=focal * 1.02, projection=name), words)


def test_a_focal_length_of_no_classical_projection_names_the_nearest_and_the_cure():
    # 2.5 mm over half the diagonal: 1.718 mm pinhole … 2.16 mm orthographic at 110°.
    wanted = {name: 2.5 / height(math.radians(55)) for name, height in HEIGHTS.items()}
    refused = sold(fov_deg=110.0, fov_axis="diagonal", focal_length=3.3)
    nearest = max(wanted, key=wanted.__getitem__)
    words = [f'nearest is "{nearest}" with {wanted[nearest]:.4g} mm', "Kannala-Brandt"]
    check_refused(parse_scene, refused, words)


def test_kannala_brandt_before_a_sensor():
    coefficients = [0.05, -0.01, 0.0, 0.0]
    eye = camera(fov_deg=100.0, fov_axis="horizontal", projection=coefficients)
    half = math.radians(50)
    height = half + 0.05 * half**3 - 0.01 * half**5
    assert eye.sensor is not None
    assert float(eye.sensor.focal_length) == pytest.approx(2 / height, rel=ROUNDING)
    assert math.degrees(eye.field_of_view) == pytest.approx(100, abs=1e-9)
    # r = θ − θ³/4 stops to grow at √(4/3) = 66.16°, at a height of 0.77: within the sensor.
    stops = sold(focal_length=2.5, projection=[-0.25, 0, 0, 0])
    check_refused(parse_scene, stops, ["the image ends within the sensor", "image_circle_mm"])
    parse_scene(sold(focal_length=2.5, projection=[-0.25, 0, 0, 0], image_circle_mm=3.8))


@pytest.mark.parametrize(
    "keys",
    [
        {"focal_length": 2.5, "projection": "stereographic"},
        {"fov_deg": 130.0, "fov_axis": "diagonal", "focal_length": 2.2},
        {"focal_length": 2.5, "projection": [0.02, 0.0, 0.0, 0.0], "image_circle_mm": 3.3},
        {
            "focal_length": 2.0,
            "projection": "equisolid",
            "format": FORMAT | {"section_axis": "short"},
            "lens": LENS | {"nearest_focus": 20.0},
            "max_blur_px": 2.0,
            "module": MODULE,
            "body": "f",
            "frames": {"f": {"hinge": [1.0, 2.0], "angle": "a"}},
        },
        {"model": "oak-ffc-ov9782-w", "format": {"section_axis": "short"}},
    ],
    ids=str,
)
def test_what_is_written_is_read_back(keys):
    scene = parse_scene(sold(**keys), "sold")
    text = format_scene(scene)
    again = parse_scene(tomllib.loads(text), "sold")
    assert again.layout == scene.layout
    assert_same(again, scene)
    assert_same(again.camera.sensor, scene.camera.sensor, 0, 0)
    assert_same(again.camera.module, scene.camera.module, 0, 0)
    assert "camera module" not in text


def test_derivatives_of_pixels_of_a_camera_with_a_sensor():
    eye = camera(focal_length=2.5, projection="equisolid")
    known = eye.sensor
    assert known is not None

    def seen(design: list[jax.Array]) -> jax.Array:
        focal, length, field, angle = design
        sensor = dataclasses.replace(
            known, focal_length=focal, size=jnp.stack([length, 3 * length])
        )
        own = eqx.tree_at(
            lambda eye: (eye.sensor, eye.field_of_view, eye.pixels),
            eye,
            (sensor, field, jnp.full_like(field, 2.0)),
        )
        return own.pixel(angle) + own.pixels_per_radian(angle) + own.angle(angle + 0.7)

    design = [jnp.array([number]) for number in (2.5, 4.0, 1.7, 0.4)]
    check_gradients(seen, design, atol=10 * SLOPES)
    slopes = jax.grad(lambda parts: seen(parts))([part[0] for part in design])
    assert slopes[2] == 0  # what is seen of the field moves no pixel


@pytest.mark.parametrize("x64", [True, False])
def test_arrays_have_the_default_float_type(x64):
    keys = {"focal_length": 2.0, "projection": [0.01, 0.0, 0.0, 0.0], "image_circle_mm": 3.5}
    with jax.enable_x64(x64):
        found = parse_scene(sold(**keys, lens=LENS, max_blur_px=2.0, module=MODULE))
        kinds = {leaf.dtype for leaf in jax.tree.leaves((found, found.surface_ends))}
        again = parse_scene(tomllib.loads(format_scene(found)), "sold")
        assert_same(again.camera.field_of_view, found.camera.field_of_view, rtol=1e-6)
    assert kinds == {jnp.dtype("float64" if x64 else "float32")}


@pytest.mark.parametrize("name", camera_catalogue())
@pytest.mark.parametrize("side", ["long", "short"])
def test_cameras_of_the_catalogue_are_as_their_makers_state(name, side):
    entry = camera_catalogue()[name]
    assert entry["verified"] is False
    eye = parse_scene(tables(model=name, format={"section_axis": side})).camera
    assert eye.sensor is not None
    stated, focal = dict(entry["stated"]), float(eye.sensor.focal_length)
    within = stated.pop("within")
    long, short = entry["format"]["sensor_mm"]
    extents = {"horizontal": long, "vertical": short, "diagonal": math.hypot(long, short)}
    lens, circle = ANGLES[entry["projection"]], entry.get("image_circle_mm", math.inf)
    for key, value in stated.items():
        extent = extents.get(key)
        found = focal
        if extent is not None:
            found = math.degrees(2 * lens(min(extent, circle) / 2 / focal))
        assert found == pytest.approx(value, rel=within)
    own = min(extents["horizontal" if side == "long" else "vertical"], circle)
    assert float(eye.field_of_view) == pytest.approx(2 * lens(own / 2 / focal))


def test_a_file_says_otherwise_than_its_model():
    given = {"model": "ov5647-160", "format": {"section_axis": "long"}}
    eye = parse_scene(tables(**given, fov_deg=120.0)).camera
    assert math.degrees(eye.field_of_view) == pytest.approx(96)
    other = {"section_axis": "long", "pixels": [1296, 972]}
    assert float(parse_scene(tables(**given | {"format": other})).camera.pixels) == 1296


@pytest.mark.parametrize(
    ("given", "assumed"),
    [
        ({"model": "ov6948"}, ["fov_axis, diagonal is assumed", "projection, equidistant"]),
        ({"model": "ov5647-160"}, ["projection, equidistant is assumed"]),
        ({"model": "ov5647-160", "projection": "equisolid"}, []),
        ({"model": "raspberry-pi-2"}, []),
    ],
)
def test_a_trace_names_what_is_assumed_of_a_model(given, assumed, tmp_path, capsys):
    path = tmp_path / "model.toml"
    keys = tables(**given, format={"section_axis": "short"})
    path.write_text(format_toml(keys, "a camera"))
    _, said = traced(capsys, path)
    found = [line for line in said if "assumed" in line]
    assert len(found) == bool(assumed)
    assert all(words in found[0] for words in assumed)


def ends_of(scene: Scene, **degrees: float) -> np.ndarray:
    """Ends of the module's lines in a pose, mm, as complex numbers."""
    placed = place(scene, scene.pose({name: math.radians(one) for name, one in degrees.items()}))
    ends = np.stack(
        [placed.absolute(placed.starts).stacked(), placed.absolute(placed.ends).stacked()], 1
    )
    return ends[-6:] @ [1, 1j]


CORNERS = {0.5 + 3j, 0.5 - 3j, -4.5 + 3j, -4.5 - 3j, -4.5 + 5j, -4.5 - 5j, -8 + 5j, -8 - 5j}
"""Of the module above, forward and to the left of its entrance pupil, mm."""


def test_the_module_is_a_barrel_on_a_board_and_goes_with_the_camera():
    where = {"position": [3.0, 4.0], "direction_deg": 30.0, "body": "f"}
    keys = {"focal_length": 2.5, "projection": "equidistant", "module": MODULE}
    frames = {"f": {"hinge": [1.0, 0.0], "angle": "a"}}
    scene = parse_scene(sold(**where, **keys, frames=frames))
    assert {part.name for part in scene.layout.module} == {"camera module"}
    assert scene.layout.blockers == ()

    def wanted(turn_deg: float) -> list[complex]:
        turn = np.exp(1j * math.radians(turn_deg))
        at = [3 + 4j + corner * np.exp(1j * math.radians(30)) for corner in CORNERS]
        return sorted((1 + (one - 1) * turn for one in at), key=lambda one: (one.real, one.imag))

    for angle in (0.0, 50.0):
        found = set(np.round(ends_of(scene, a=angle).ravel(), 9))
        found = sorted(found, key=lambda one: (one.real, one.imag))
        np.testing.assert_allclose(found, wanted(angle), atol=1e-8)
    # It is misplaced with the camera.
    none = Fabrication.none(scene.layout)
    made = perturb(scene, dataclasses.replace(none, camera=jnp.array([0.5, -1.0])))
    np.testing.assert_allclose(ends_of(made), ends_of(scene) + 0.5 - 1j, atol=1e-12)


def test_the_module_hides_what_a_mirror_shows_behind_it():
    mirror = {"name": "m", "from": [30.0, 40.0], "to": [30.0, -40.0]}
    pad = {"name": "pad", "from": [-20.0, -4.0], "to": [-20.0, 4.0], "side": "right"}
    keys = {"focal_length": 2.5, "projection": "equidistant", "mirrors": [mirror], "pads": [pad]}
    seen = [
        float(find_coverage(scene, scene.pose()).value[0])
        for scene in (parse_scene(sold(**keys)), parse_scene(sold(**keys, module=MODULE)))
    ]
    assert seen == pytest.approx([1.0, 0.0], abs=1e-12)
    # Of a pad beside it the silhouette is hidden: from (60, 0) over the corner of the board's back.
    wide = pad | {"from": [-20.0, 0.0], "to": [-20.0, 20.0]}
    scene = parse_scene(sold(**keys | {"pads": [wide]}, module=MODULE))
    shadow = 5 * (60 + 20) / max(60 + 4.5, 0)
    hidden = float(find_coverage(scene, scene.pose()).value[0])
    assert hidden == pytest.approx(1 - shadow / 20, rel=1e-9)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"pads": [PAD | {"from": [-6.0, 8.0], "to": [-6.0, 4.0]}]}, ["pad 'pad'"]),
        ({"pads": [PAD | {"from": [-6.0, 1.0], "to": [-6.0, 2.0]}]}, ["pad 'pad'"]),
        (
            {"mirrors": [{"name": "m", "from": [-9.0, -4.0], "to": [-3.0, -4.0]}],
             "blockers": [{"name": "b", "from": [0.0, 4.0], "to": [-1.0, 2.0]}]},
            ["mirror 'm', blocker 'b' would reach into it"],
        ),
        # Its chord passes in front of the lens, the arc bulges into it.
        (
            {"mirrors": [{"name": "m", "from": [2, 5], "to": [2, -5], "radius": 6.0}]},
            ["mirror 'm' would reach into it in the reference pose"],
        ),
        (
            {"module": MODULE | {"pupil_depth": 2.5}},
            # atan(3 / 2.5), and atan(2 / 2.5) of the field of view of 2.5 mm.
            ["begins 50.19° from the optical axis", "ends at 51.57°", "'pupil_depth'"],
        ),
    ],
)  # fmt: skip
def test_a_module_that_is_in_the_way_is_refused(change, words):
    keys = {"focal_length": 2 / 0.9, "projection": "equidistant", "module": MODULE}
    parse_scene(sold(**keys))
    check_refused(parse_scene, sold(**keys | change), ["camera.module: ", *words])


@pytest.mark.parametrize(
    "clear",
    [
        {"pads": [PAD | {"from": [-8.0, -5.0], "to": [-8.0, 5.0]}]},  # flush with its back
        {"mirrors": [{"name": "m", "from": [2, -5], "to": [2, 5], "radius": 6.0}]},
        {"module": MODULE | {"pupil_depth": -0.5}},
    ],
)
def test_a_module_may_touch_what_is_beside_it(clear):
    keys = {"focal_length": 2.5, "projection": "equidistant", "module": MODULE}
    parse_scene(sold(**keys | clear))


def test_the_example_of_the_readme_is_read():
    text = (DATA.parents[1] / "README.md").read_text(encoding="utf-8")
    (block,) = (
        one for one in re.findall(r"```toml\n(.*?)```", text, re.S) if "section_axis" in one
    )
    eye = parse_scene(tomllib.loads(block) | {"pads": [PAD]}).camera
    # 160° are those of the image circle, which nearly holds the sensor.
    assert math.degrees(eye.field_of_view) == pytest.approx(160 * 3.63 / 4.5)
    other = re.sub(r'projection = "equidistant" *# or ([^,]*),.*', r"\1", block)
    assert isinstance(
        parse_scene(tomllib.loads(other) | {"pads": [PAD]}).camera.projection, Equidistant
    )


def spot(distance: float) -> float:
    """Blur in pixels of `LENS` on pixels of 2.5 µm, by similar triangles behind the lens."""
    sensor, image = 1 / (1 / 2 - 1 / 20), 1 / (1 / 2 - 1 / distance)
    return 1.0 * abs(sensor - image) / image / 0.0025


def test_blur_is_that_of_similar_triangles_on_pixels_of_the_sensor():
    eye = camera(focal_length=2.0, projection="equidistant", lens=LENS)
    distances = np.array([[5.0, 20.0], [12.0, 300.0]])
    wanted = np.vectorize(spot)(distances)
    np.testing.assert_allclose(find_blur(eye, jnp.asarray(distances)), wanted, rtol=1e-9, atol=1e-9)


def traced(capsys: pytest.CaptureFixture[str], path: Any, *more: str) -> tuple[Any, list[str]]:
    assert run(["trace", str(path), *more]) == 0
    shown = capsys.readouterr()
    return json.loads(shown.out), shown.err.splitlines()


SOLD = """
pads = [{ name = "floor", from = [-2, -20], to = [6, -20] }, { name = "far", from = [-9, -60], to = [-8, -60] }]
mirrors = [{ name = "side", from = [10, 0], to = [10, -30] }]
[camera]
position = [0, 0]
direction_deg = -90
focal_length = 2
projection = "equidistant"
max_blur_px = 5
format = { sensor_mm = [4, 3], pixels = [1600, 1200], section_axis = "long" }
lens = { focal_length = 2, f_number = 2, focus = 20 }
"""  # noqa: E501


def test_a_trace_tells_fields_of_view_and_blur_at_working_distances(tmp_path, capsys):
    path = tmp_path / "sold.toml"
    path.write_text(SOLD)
    document, said = traced(capsys, path)
    fields = {axis: math.degrees(part / 2) for axis, part in EXTENTS.items()}
    assert document["camera"]["field_of_view_deg"] == pytest.approx(fields)
    assert document["camera"]["focal_length_px"] == pytest.approx(800)
    assert document["lens"]["pixel_mm"] == pytest.approx(0.0025)
    views = document["poses"][0]["pads"]["floor"]["views"]
    direct = [20.0, math.hypot(6, 20)]
    mirrored = [math.hypot(20 - 6, 20), math.hypot(22, 20)]
    for name, distances in (("direct", direct), ("mirror:side", mirrored)):
        assert views[name]["distance_mm"] == pytest.approx(distances, rel=1e-4)
        wanted = [spot(distance) for distance in views[name]["distance_mm"]]
        assert views[name]["blur_px_at_distance"] == pytest.approx(wanted, abs=1e-6)
    limited, fields_said = said[:-1], said[-1]
    assert max(spot(one) for one in direct) < 5 < spot(mirrored[0]) < spot(mirrored[1])
    blurred = [line for line in limited if "max_blur_px" in line]
    assert [line.split(":")[0] for line in blurred[:1]] == ["pad 'floor' by mirror"]
    assert f"a blur of {spot(mirrored[1]):.3g} px at {mirrored[1]:.4g} mm" in blurred[0]
    assert "pad 'far' by direct: a blur of" in blurred[1]
    assert "114.6° (horizontal), 85.94° (vertical), 143.2° (diagonal)" in fields_said
    # Without a format: as for a sensor that lies one way or the other.
    text = SOLD.replace(next(line for line in SOLD.splitlines() if "format" in line), "pixels = 99")
    path.write_text(text.replace("focal_length = 2\nproj", "fov_deg = 160\nproj"))
    document, said = traced(capsys, path)
    sides = document["camera"]["field_of_view_deg_if_section_has_side"]
    assert sides["short"] == pytest.approx(
        {"horizontal": 640 / 3, "vertical": 160, "diagonal": 800 / 3}
    )
    assert "213.3° and the diagonal 266.7°" in said[-1]


def test_a_lens_focused_at_infinity_is_traced(tmp_path, capsys):
    path = tmp_path / "far.toml"
    path.write_text(SOLD.replace("focus = 20", "focus = 1e30"))
    document, _ = traced(capsys, path, "--bounces=0")
    assert document["lens"]["focus_mm"] is None
    assert document["lens"]["sensor_distance_mm"] == 2


@pytest.mark.parametrize("number", range(0, 60, 10))
def test_changed_files_are_read_or_refused_in_one_line(number):
    keys = {"fov_deg": 110.0, "fov_axis": "diagonal", "image_circle_mm": 4.6, "max_blur_px": 3.0}
    others = {"lens": LENS | {"focal_length": 2.4, "nearest_focus": 9.0}, "module": MODULE}
    whole = sold(**keys, **others, projection="equidistant")
    parse_scene(whole)
    refused = []
    for part in range(number, number + 10):
        data, generator = copy.deepcopy(whole), np.random.default_rng([78, part])
        mutate(data, generator, only_numbers=bool(part % 2))
        try:
            scene = parse_scene(data, "f.toml")
        except UserError as error:
            refused.append(str(error))
        else:
            parse_scene(tomllib.loads(format_scene(scene)), "again")
            assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(scene))
            assert remark_on_fields(scene.camera).isprintable()
    assert all(line.isprintable() for line in refused)


def test_blur_in_poses_is_told_of_the_worst(tmp_path, capsys):
    path = tmp_path / "sold.toml"
    text = SOLD.replace("to = [-8, -60] }", 'to = [-8, -60], body = "f" }')
    path.write_text(text + '[frames.f]\nhinge = [-8, -60]\nangle = "a"\n')
    _, said = traced(capsys, path, "--sweep", "a=0:80:3", "--bounces=0")
    (line,) = [one for one in said if "max_blur_px" in one]
    assert line.startswith("pad 'far' by direct: ")
    assert "at 3 of 3 poses; worst at a = " in line


def test_the_field_of_view_of_a_sold_lens_is_no_parameter():
    from optics.parametric.scene import SceneParameters
    from optics.scene.file import SceneFile

    keys = {"focal_length": 2.0, "projection": "equisolid", "lens": LENS, "module": MODULE}
    data = sold(**keys)
    design = DesignedScene.of(SceneFile.model_validate(data), "sold")
    parameters = SceneParameters(design)
    values = parameters.values()
    assert "camera.field_of_view" not in values
    (file,) = parameters.files(values | {"camera.position.x": -1.0})
    scene = parse_scene(tomllib.loads(str(file.content)), "sold")
    # With the camera goes its module.
    np.testing.assert_allclose(ends_of(scene), ends_of(design.scene) - 1, atol=1e-12)
    assert_same(scene.camera.sensor, design.scene.camera.sensor, 0, 0)


def test_numbers_and_drawing_of_a_sold_camera():
    from optics.export.scene_drawing import make_scene_drawing, scene_quantities
    from optics.scene.file import SceneFile

    keys = {"focal_length": 2.0, "projection": "equisolid", "image_circle_mm": 3.8}
    data = sold(**keys, lens=LENS | {"nearest_focus": 9.0}, max_blur_px=3.0, module=MODULE)
    design = DesignedScene.of(SceneFile.model_validate(data), "sold")
    found = {part.name: part.value for part in scene_quantities(design)}
    wanted = {
        "field_of_view": math.degrees(4 * math.asin(1.9 / 4)),
        "pixels": 1600,
        "focal_length": 2.0,
        "sensor.long": 4.0,
        "sensor.short": 3.0,
        "image_circle": 3.8,
        "max_blur": 3.0,
        "lens.nearest_focus": 9.0,
        "module.pupil_depth": 0.5,
        "module.board.along": 10.0,
        "module.board.across": 8.0,
    }
    assert {name: found[f"camera.{name}"] for name in wanted} == pytest.approx(wanted)
    lines = [part for part in make_scene_drawing(design).polylines if part.layer == "camera module"]
    ends = itertools.chain.from_iterable(line.places for line in lines)
    assert {complex(round(x, 9), round(y, 9)) for x, y in ends} == CORNERS


@pytest.mark.parametrize("before", [Equidistant(), PROJECTIONS["kannala-brandt"]], ids=["0", "k"])
def test_a_distortion_keeps_where_the_field_ends_on_the_sensor(before):
    eye = camera(focal_length=2.5, projection="equidistant")
    scene = eqx.tree_at(lambda scene: scene.camera.projection, parse_scene(sold(
        focal_length=2.5, projection="equidistant")), before)  # fmt: skip
    none = Fabrication.none(scene.layout)
    made = perturb(scene, dataclasses.replace(none, distortion=jnp.asarray(0.03))).camera
    half = eye.field_of_view / 2
    np.testing.assert_allclose(made.pixel(half), scene.camera.pixel(half), rtol=ROUNDING)
    inner, plain = (one.pixel(half / 2) - 800 for one in (made, scene.camera))
    assert abs(inner) < abs(plain)
