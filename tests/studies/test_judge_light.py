"""The judge's fabricated fingers and light against formulas, roots and quadrature."""

from __future__ import annotations

import importlib.util
import math
from functools import partial
from typing import Any

import numpy as np
import pytest
import scipy.integrate
import scipy.optimize

from studies.oracles.judge.capture import Capture, expose
from studies.oracles.judge.contacts import RIM, Contact, Contacts, bulge, pin_bulge, pin_edge
from studies.oracles.judge.fabrication import CHANNELS, fabricated, of_channel, sample_errors
from studies.oracles.judge.frames import judge
from studies.oracles.judge.light import air_irradiance, gather_light, light_membranes
from studies.oracles.judge.photograph import lens_of, photograph, trace_light
from studies.oracles.judge.solids import FOOT, GAP, TOP, frame_of
from studies.oracles.judge.tracing import Tracer

needs_mitsuba = pytest.mark.skipif(
    importlib.util.find_spec("mitsuba") is None,
    reason="Mitsuba is not installed; the extra 'judge' brings it",
)

FINE_PX = 2e-3
"""Of corners that rays in float32 find."""

PAD: dict[str, Any] = {"name": "pad", "from": [-20, 0], "to": [25, 0], "side": "left"}
PAD["width"] = 20.0
SCENE: dict[str, Any] = {
    "camera": {"position": [0, 30], "direction_deg": -85, "fov_deg": 140, "pixels": 700},
    "mirrors": [{"name": "wall", "from": [30, 4], "to": [34, 40], "side": "left"}],
    "pads": [PAD],
    "blockers": [{"name": "camera body", "from": [-2, 31], "to": [2, 31], "side": "both"}],
}
CLEAR = {"thickness": 3, "index": 1.49, "sides": "clear"}


def root(function, low, high) -> float:
    """Between two places where a function has different signs."""
    found: Any = scipy.optimize.brentq(function, low, high, xtol=1e-14)
    return found


def section(degrees):
    """Unit vector in the section."""
    return np.array([math.cos(math.radians(degrees)), math.sin(math.radians(degrees)), 0.0])


def imaged(camera, point, *, k1=0.0, scale=1.0):
    """Where a lens r = θ + k₁ θ³ images a point: axes and pinhole written out."""
    position, axis, up, right = camera
    way = point - position
    way = way / np.linalg.norm(way)
    angle = math.atan2(math.hypot(way @ up, way @ right), way @ axis)
    half = math.radians(70)
    focal = 350 / (half + k1 * half**3) * scale
    radius = focal * (angle + k1 * angle**3)
    across, above = np.array([way @ right, way @ up]) / math.hypot(way @ up, way @ right)
    return [(933 - 1) / 2 + radius * across, (700 - 1) / 2 - radius * above]


def camera_axes(degrees=-85.0, yaw=0.0, roll=0.0):
    """Axis, up and right by the two rotations, as matrices about the camera's own vectors."""
    axis, up, right = section(degrees), section(degrees + 90), np.array([0.0, 0, 1])

    def turned(vector, about, angle):  # Rodrigues
        return (
            vector * math.cos(angle)
            + np.cross(about, vector) * math.sin(angle)
            + about * (about @ vector) * (1 - math.cos(angle))
        )

    # From the axis towards +z about the up vector, then from that one towards it about the axis.
    axis, right = (turned(one, np.cross(axis, right), yaw) for one in (axis, right))
    return axis, *(turned(one, np.cross(up, right), roll) for one in (up, right))


def corner_points(z=10.0):
    return {(end, side): np.array([x, 0.0, side * z]) for end, x in ((0, -20.0), (1, 25.0))
            for side in (-1, 1)}  # fmt: skip


def corners_of(found, path=""):
    return {(one.end, one.side): one.place for one in found.corners if one.path == path}


def test_errors_have_their_shapes_and_deviations():
    tables = SCENE | {"pads": [PAD | {"layers": [CLEAR, CLEAR]}, PAD]}
    deviations = {"camera": [0.3, 0.0], "mirror_bow": 0.05, "thickness": 0.1, "lateral_color": 1e-3}
    generator = np.random.default_rng(0)
    drawn = [sample_errors(tables, deviations, generator) for _ in range(2000)]
    assert np.shape(drawn[0]["mirror_bow"]) == (1,)
    assert [len(one) for one in drawn[0]["thickness"]] == [2, 0]
    assert np.std([one["camera"] for one in drawn], axis=0) == pytest.approx([0.3, 0], rel=0.05)
    assert np.std([one["thickness"][0] for one in drawn]) == pytest.approx(0.1, rel=0.05)
    with pytest.raises(ValueError, match="mirror_sag"):
        sample_errors(tables, {"mirror_sag": 1.0}, generator)


def test_parts_are_displaced_in_the_section():
    errors = {"pad_tilt": [0.1], "pad_offset": [0.5], "pad_shift": [-2.0], "tilt": math.pi / 2}
    layered = SCENE | {"pads": [PAD | {"layers": [CLEAR | {"index": {"red": 1.4, "green": 1.5}}]}]}
    made = fabricated(layered, errors | {"camera": [1, 2], "thickness": 0.25, "index": [[0.01]]})
    middle = np.add(made["pads"][0]["from"], made["pads"][0]["to"]) / 2
    along, normal = np.array([[math.cos(0.1), math.sin(0.1)], [-math.sin(0.1), math.cos(0.1)]])
    np.testing.assert_allclose(middle, [2.5, 0] - 2 * along + 0.5 * normal, atol=1e-12)
    np.testing.assert_allclose(made["pads"][0]["to"], middle + 22.5 * along, atol=1e-12)
    [layer] = made["pads"][0]["layers"]
    assert layer["thickness"] == 3.25
    assert layer["index"] == pytest.approx({"red": 1.41, "green": 1.51})
    assert of_channel(made, "red")["pads"][0]["layers"][0]["index"] == pytest.approx(1.41)
    # The camera carries its body: (−2, 31) is (−2, 1) from the pinhole, and that turns to (−1, −2).
    np.testing.assert_allclose(made["blockers"][0]["from"], [1 - 1, 32 - 2], atol=1e-12)


@needs_mitsuba
def test_a_camera_out_of_the_section_sees_corners_where_a_pinhole_has_them():
    errors = {"camera": [0.2, -0.4], "lateral": 0.5, "tilt": 0.03, "yaw": 0.02, "roll": -0.05}
    errors |= {"distortion": 0.004, "lateral_color": [0.001, -0.002]}
    place = np.array([0.2, 29.6, 0.5])
    camera = (place, *camera_axes(-85 + math.degrees(0.03), 0.02, -0.05))
    for channel, scale in zip(CHANNELS, (1.001, 1.0, 0.998), strict=True):
        found = corners_of(judge(SCENE, {}, errors, channel))
        assert len(found) == 4
        for corner, point in corner_points().items():
            wanted = imaged(camera, point, k1=0.004, scale=scale)
            assert found[corner] == pytest.approx(wanted, abs=FINE_PX)
    # Signs: the axis towards +z, so that all moves to lesser columns; the up vector too, so that
    # what is above moves to lesser columns against what is below.
    plain, yawed, rolled = (
        corners_of(judge(SCENE, {}, one)) for one in ({}, {"yaw": 0.02}, {"roll": 0.02})
    )
    assert all(yawed[one][0] < plain[one][0] - 3 for one in plain)
    ends = {one: rolled[one][0] - plain[one][0] for one in plain}
    top, bottom = (1, 1), (0, 1)
    assert plain[top][1] < plain[bottom][1]
    assert ends[top] < -1
    assert ends[bottom] > 1


@needs_mitsuba
def test_every_color_has_its_own_index():
    indices = {"red": 1.485, "green": 1.49, "blue": 1.50}
    layered = [SCENE | {"pads": [PAD | {"layers": [CLEAR | {"index": index}]}]}
               for index in (indices, indices["blue"])]  # fmt: skip
    found = corners_of(judge(layered[0], {}, None, "blue"))
    assert found == corners_of(judge(layered[1], {}))
    green = corners_of(judge(layered[0], {}))
    assert max(math.dist(found[one], green[one]) for one in found) > 0.05
    [shown] = photograph(layered[0] | {"mirrors": []}, None, {}, Capture(), 0).shown
    for corner, place in zip(((0, -1), (0, 1), (1, -1), (1, 1)), shown.channels[2], strict=True):
        assert place == pytest.approx(found[corner], abs=FINE_PX)


@needs_mitsuba
def test_lamps_beside_black_layers_are_refused():
    tables = {"pads": [PAD | {"layers": [CLEAR | {"sides": "black"}]}]}
    with pytest.raises(ValueError, match="no clear sides"):
        light_membranes(tables, Capture(light="lamps"))


@needs_mitsuba
def test_every_ray_begins_at_the_pupil_of_its_angle():
    camera = SCENE["camera"] | {"pupil_shift": [0.5, 0.1]}
    found = corners_of(judge(SCENE | {"camera": camera}, {}, {"pupil": 0.2}))
    axes = camera_axes()
    for corner, point in corner_points().items():

        def missed(angle, point=point):
            pupil = np.array([0, 30, 0]) + (0.7 * angle**2 + 0.1 * angle**4) * axes[0]
            way = point - pupil
            return math.acos(way @ axes[0] / np.linalg.norm(way)) - angle

        angle = root(missed, 0.01, 1.5)
        pupil = np.array([0, 30, 0]) + (0.7 * angle**2 + 0.1 * angle**4) * axes[0]
        assert found[corner] == pytest.approx(imaged((pupil, *axes), point), abs=FINE_PX)


def shortest(mirror, lean, bow, start, end):
    """Where light from one point to another meets a bowed, leaning mirror: the stationary way."""
    one, other = (np.array([*mirror[key], 0.0]) for key in ("from", "to"))
    length = np.linalg.norm(other - one)
    along = (other - one) / length
    normal = np.array([-along[1], along[0], 0])
    z = np.array([0.0, 0, 1])
    # Rodrigues about the line from "from" to "to"; the normal turns towards +z.
    across = z * math.cos(lean) + np.cross(along, z) * math.sin(lean)
    normal = normal * math.cos(lean) + np.cross(along, normal) * math.sin(lean)
    assert normal[2] * lean >= 0

    def point(x):
        height = bow * (1 - (2 * x[0] / length) ** 2)
        return (one + other) / 2 + x[0] * along + height * normal + x[1] * across

    def slopes(x):  # of the way's length
        tangents = along - 8 * bow * x[0] / length**2 * normal, across
        ways = [(point(x) - p) / np.linalg.norm(point(x) - p) for p in (start, end)]
        return [sum(way @ tangent for way in ways) for tangent in tangents]

    solved = scipy.optimize.root(slopes, [0.0, 0.0], tol=1e-14)
    assert np.abs(slopes(solved.x)).max() < 1e-11
    return point(solved.x)


@needs_mitsuba
@pytest.mark.parametrize("side", ["left", "both"])
def test_leaning_and_bowed_mirrors_show_corners_by_the_stationary_way(side):
    lean, bow = 0.02, 0.15
    tables = SCENE | {"mirrors": [SCENE["mirrors"][0] | {"side": side}]}
    errors = {"mirror_lean": [lean], "mirror_bow": [bow]}
    found = corners_of(judge(tables, {}, errors), "wall")
    plain = corners_of(judge(tables, {}), "wall")
    assert len(found) >= 2
    camera = np.array([0.0, 30, 0])
    for corner, place in found.items():
        met = shortest(SCENE["mirrors"][0], lean, bow, camera, corner_points()[corner])
        assert place == pytest.approx(imaged((camera, *camera_axes()), met), abs=FINE_PX)
        assert math.dist(place, plain[corner]) > 1


@needs_mitsuba
@pytest.mark.parametrize("gap", [-0.05, 0.1, 0.1375, 0.15])
def test_a_corner_beyond_the_end_of_a_mirror_is_not_found_elsewhere(gap):
    mirror, camera = SCENE["mirrors"][0], np.array([0.0, 30, 0])
    met = shortest(mirror, 0.0, 0.0, camera, corner_points()[1, -1])
    along = np.subtract(mirror["to"], mirror["from"])
    cut = mirror | {"from": (met[:2] + gap * along / np.linalg.norm(along)).tolist()}
    found = corners_of(judge(SCENE | {"mirrors": [cut]}, {}), "wall")
    assert ((1, -1) in found) == (gap < 0)
    if gap < 0:
        assert found[1, -1] == pytest.approx(imaged((camera, *camera_axes()), met), abs=FINE_PX)


@needs_mitsuba
def test_a_mirror_written_from_its_other_end_leans_and_bows_the_other_way():
    mirror = SCENE["mirrors"][0]
    back = mirror | {"from": mirror["to"], "to": mirror["from"], "side": "right"}
    one = judge(SCENE, {}, {"mirror_lean": [0.02], "mirror_bow": [0.1]})
    other = judge(SCENE | {"mirrors": [back]}, {}, {"mirror_lean": [-0.02], "mirror_bow": [-0.1]})
    first, second = (corners_of(found, "wall") for found in (one, other))
    assert first.keys() == second.keys()
    for corner in first:
        assert first[corner] == pytest.approx(second[corner], abs=FINE_PX)


@needs_mitsuba
def test_a_pad_leans_with_its_layers():
    """The same picture as of a camera turned about the membrane's line the other way."""
    tables = SCENE | {"pads": [PAD | {"layers": [CLEAR | {"sides": "black"}]}], "mirrors": []}
    lean = 0.03
    found = corners_of(judge(tables, {}, {"pad_lean": [lean]}))

    def turned(vector):  # about x by minus the lean
        x, y, z = vector
        c, s = math.cos(lean), math.sin(lean)
        return np.array([x, y * c + z * s, z * c - y * s])

    camera = tuple(turned(one) for one in (np.array([0.0, 30, 0]), *camera_axes()))
    assert len(found) == 4
    for corner, point in corner_points().items():
        source, height = camera[0], camera[0][1]
        reach = math.hypot(point[0] - source[0], point[2] - source[2])

        def missed(sine, height=height, reach=reach):
            inner = sine / math.sqrt(1.49**2 - sine**2)
            return (height - 3) * sine / math.sqrt(1 - sine**2) + 3 * inner - reach

        sine = root(missed, 0, 0.99999)
        way = np.array([point[0] - source[0], 0, point[2] - source[2]]) * sine / reach
        way[1] = -math.sqrt(1 - sine**2)
        assert found[corner] == pytest.approx(imaged(camera, source + way), abs=FINE_PX)


@pytest.mark.parametrize("lamp", [0, 1, 2])
def test_a_line_lamp_in_air_lights_a_membrane_by_the_integral(lamp):
    length, half = 30.0, 12.0
    along, across = np.array([0.0, 3.0, 15.0]), np.array([-12.0, 2.0, 11.0])
    found = air_irradiance(length, half, lamp, along, across)
    for x, z, value in zip(along, across, found, strict=True):

        def sent(height, t, x=x, z=z):
            point = [(t, half + GAP), (-GAP, t - half), (t, -half - GAP)][lamp]
            square = (point[0] - x) ** 2 + (point[1] - z) ** 2 + height**2
            normal = abs(point[0] - x) if lamp == 1 else abs(point[1] - z)
            return normal * height / square**2 / math.pi

        extent = 2 * half if lamp == 1 else length
        wanted = scipy.integrate.dblquad(sent, 0, extent, FOOT, TOP, epsabs=1e-9)[0]
        assert value == pytest.approx(wanted, rel=5e-3)


def test_lamps_in_air_light_edges_4_to_10_times_as_much_as_the_middle():
    pads = [{"name": "pad", "from": [0, 0], "to": [30, 0], "width": 24.0}]
    [light], _ = light_membranes({"pads": pads}, Capture(light="lamps"))
    values = light.at(np.array([15.0, 15.0, 15.0]), np.array([-12.0, 0.0, 12.0]))
    total = values.sum(axis=-1)
    assert 4 < total[0] / total[1] < 10
    assert values[2, 0] > 5 * values[0, 0]
    assert values[0, 2] > 5 * values[2, 2]


def diffuse_escape(index):
    """Part of matt light that leaves a plane surface of glass (Fresnel, by quadrature)."""

    def leaves(cosine):
        sine = index * math.sqrt(1 - cosine**2)
        if sine >= 1:
            return 0.0
        other = math.sqrt(1 - sine**2)
        across = (index * cosine - other) / (index * cosine + other)
        within = (cosine - index * other) / (cosine + index * other)
        return 2 * cosine * (1 - (across**2 + within**2) / 2)

    critical = math.sqrt(1 - 1 / index**2)
    return scipy.integrate.quad(leaves, critical, 1)[0]


@needs_mitsuba
def test_a_layer_keeps_matt_light_as_fresnel_has_it_and_lamps_by_air_give_none_of_theirs():
    pad = {"name": "pad", "from": [-40, 0], "to": [40, 0], "side": "left", "width": 80.0}
    tables = {"pads": [pad | {"layers": [CLEAR | {"thickness": 1.0}]}]}
    tracer = Tracer(tables, {}, 0j, lamps=True)
    generator = np.random.default_rng(0)
    square, turn = generator.random(40_000), 2 * np.pi * generator.random(40_000)
    flat = np.sqrt(square)
    ways = np.stack([flat * np.cos(turn), np.sqrt(1 - square), flat * np.sin(turn)], axis=-1)
    begin = np.tile([0.0, 0.02, 0.0], (len(ways), 1))
    back = tracer.trace(ways, begin, np.zeros(len(ways), int), "air")
    kept = np.where(back.reached, back.transmission, 0).sum() / len(ways)
    # Far from the edges what does not leave comes back.
    assert kept == pytest.approx(1 - diffuse_escape(1.49), abs=0.01)
    # From above, through the top: no way into the air beside a layer of n > √2, but into what
    # touches it.
    down = ways * [1, -1, 1]
    eye = np.tile([39.0, 30.0, 39.0], (len(down), 1))
    assert tracer.trace(down, eye, walls="air").glow.sum() == 0
    assert tracer.trace(down, eye, walls="coupled").glow.sum() > 10


@needs_mitsuba
@pytest.mark.parametrize("lamp", [0, 2])
def test_a_lamp_that_touches_a_layer_lights_the_membrane_directly_and_by_its_image_in_the_top(lamp):
    length, half, height, index = 30.0, 10.0, 3.0, 1.49
    layer = {"thickness": height, "index": index, "sides": {"beside": "clear"}}
    pad = {"from": [0, 0], "to": [length, 0], "side": "left", "width": 2 * half, "layers": [layer]}
    for x, z in ((15.0, 0.0), (4.0, -5.0)):
        count = 60
        places = np.full(count, x), np.full(count, z)
        found, _ = gather_light(pad, length, half, places, "coupled", (3, 3))

        def sent(y, t, x=x, z=z):
            across = (half if lamp == 0 else -half) - z
            square = (t - x) ** 2 + y**2 + across**2
            reflected = 1.0
            if y > height:
                cosine = y / math.sqrt(square)
                sine = index * math.sqrt(1 - cosine**2)
                if sine < 1:
                    other = math.sqrt(1 - sine**2)
                    first = (index * cosine - other) / (index * cosine + other)
                    second = (cosine - index * other) / (cosine + index * other)
                    reflected = (first**2 + second**2) / 2
            return reflected * abs(across) * y / square**2 / math.pi

        parts = [
            scipy.integrate.dblquad(sent, 0, length, *levels, epsabs=1e-5)[0]
            for levels in ((0, height), (height, 2 * height))
        ]
        assert parts[1] > parts[0] / 10
        # Rays: 60 times 987, of which a tenth meet the lamp.
        assert found[:, lamp].mean() == pytest.approx(sum(parts), rel=0.02)
        assert found[:, 1].max() == 0  # the end "from" is black


@needs_mitsuba
def test_second_images_join_the_membrane_and_black_sides_show_none():
    def width(sides):
        pads = [PAD | {"layers": [CLEAR | {"sides": sides}]}]
        light, _ = trace_light(SCENE | {"pads": pads, "mirrors": []}, {}, Capture(exposure=1.0))
        row = light[350, :, 1]
        return np.flatnonzero(row > 0.5)[[0, -1]], row

    pads = [PAD | {"layers": [CLEAR]}]
    lens, tracer = lens_of(SCENE, {}), Tracer(SCENE | {"pads": pads}, {}, 30j)
    (low, high), row = width("clear")
    assert row[low + 2 : high - 2].min() > 0.9
    (inner, outer), _ = width("black")
    assert low < inner - 5
    assert high > outer + 5
    # The outline of clear sides is that of the layer's top, straight lines in air.
    places = np.array([[low, 350.0], [high, 350.0]])
    rays = lens.rays(places)
    top = rays * (27 / -rays[:, 1:2])
    assert np.abs(top[:, 2]) == pytest.approx([10, 10], abs=0.1)
    assert tracer.trace(rays).reached.tolist() == [False, False]


@needs_mitsuba
def test_half_height_edges_of_an_even_square_are_where_its_corners_are():
    errors = {"roll": 0.01, "yaw": 0.004}
    capture = Capture(exposure=1.0, noise=0.0, blur=0.7)
    photo = photograph(SCENE | {"mirrors": []}, errors, {}, capture, 0)
    [shown] = photo.shown
    assert shown.whole
    assert shown.lifted == [0] * 4
    light = photo.pixels[..., 1] / 255
    # Along rows: the columns at which the light is a half, against the line of sight to the edge.
    made = fabricated(SCENE | {"mirrors": []}, errors)
    lens = lens_of(made, {})
    off = []
    for row in range(230, 480, 10):
        for side, order in ((-1, 1), (1, -1)):
            line = light[row, ::order]
            first = int(np.argmax(line > 0.5))
            share = (0.5 - line[first - 1]) / (line[first] - line[first - 1])
            column = first - 1 + share
            column = column if order == 1 else light.shape[1] - 1 - column

            def across(column, row=row):
                [ray] = lens.rays(np.array([[column, row]]))
                return ray[2] * 30 / -ray[1]

            beside = partial(lambda c, side, at: at(c) - side * 10, side=side, at=across)
            wanted = root(beside, column - 3, column + 3)
            off.append(column - wanted)
    # Rays of a pixel are some, and those of a side many.
    assert np.sqrt(np.mean(np.square(off))) < 0.04
    assert abs(np.mean(off[::2])) < 0.01
    assert abs(np.mean(off[1::2])) < 0.01
    assert np.hypot(*np.subtract(shown.corners, shown.channels[1]).T).max() < 1e-9


def test_noise_and_response_have_their_statistics():
    light = np.full((200, 300, 3), 0.25)
    far = np.full((200, 300), 20.0)
    generator = np.random.default_rng(0)
    linear = expose(light, far, Capture(noise=0.04, blur=0), generator) / 255
    assert linear.mean() == pytest.approx(0.25, abs=1e-3)
    # Half of the deviation at full scale, and a fifth of it besides.
    assert linear.std() == pytest.approx(0.04 * math.hypot(0.5, 0.2), rel=0.02)
    coded = expose(light, far, Capture(noise=0, blur=0, gamma=2.2), generator) / 255
    assert coded == pytest.approx(np.full_like(light, 0.25 ** (1 / 2.2)), abs=0.002)
    again = expose(light, far, Capture(), np.random.default_rng(5))
    assert np.array_equal(again, expose(light, far, Capture(), np.random.default_rng(5)))


def test_defocus_spreads_light_over_discs_by_distance():
    light = np.zeros((101, 101, 3))
    light[50, 50] = 1.0
    capture = Capture(noise=0, blur=0, defocus=200.0, focus=40.0)
    near = expose(40 * light, np.full((101, 101), 20.0), capture, np.random.default_rng(0))
    # 200 |1/20 − 1/40| = 5 px.
    assert np.count_nonzero(near[..., 1] > 64) == pytest.approx(math.pi * 25, rel=0.2)
    sharp = expose(light, np.full((101, 101), 40.0), capture, np.random.default_rng(0))
    assert np.count_nonzero(sharp[..., 1]) == 1


def test_membranes_lie_on_what_is_pressed_into_them():
    away = np.linspace(0, 6, 601)
    height = bulge(away, 8.0, 0.5)
    assert height[0] == 0.5
    # Hertz: half of the depth at the contact's edge, a² = R d, with the sphere's own slope.
    assert bulge(np.array([2.0]), 8.0, 0.5)[0] == pytest.approx(0.25)
    assert np.all(np.diff(height) < 0)
    assert np.abs(np.diff(height, 2)).max() < 1e-3
    pads = {"pads": [PAD]}
    contacts = Contacts(pads, [Contact("pad", "sphere", 10.0, 2.0, 0.5)])
    normal = contacts.normals(0, np.array([11.0]), np.array([2.0]))[0]
    assert normal == pytest.approx(np.array([1 / 8, 0, 1]) / math.hypot(1, 1 / 8), abs=1e-6)
    # A ray straight down meets the top, and one that passes above it nothing.
    origins, ways = np.array([[10.0, 2, 5], [0, 2, 0.6]]), np.array([[0, 0, -1.0], [1, 0, 0]])
    far = contacts.meet(0, origins, ways)
    assert far[0] == pytest.approx(4.5, abs=1e-3)
    assert far[1] == np.inf


@needs_mitsuba
def test_the_top_of_a_contact_appears_where_it_is_and_corners_say_how_far_they_are_lifted():
    contact = Contact("pad", "sphere", 40.0, 5.0, 0.8)
    tables = SCENE | {"mirrors": []}
    contacts = Contacts(tables, [contact])
    tracer, lens = Tracer(tables, {}, 30j, contacts=contacts), lens_of(tables, {})
    [place] = np.array([imaged((np.array([0, 30.0, 0]), *camera_axes()), np.array([20, 0.8, 5]))])
    traced = tracer.trace(lens.rays(place[None]))
    assert traced.along[0] == pytest.approx(40, abs=0.01)
    assert traced.across[0] == pytest.approx(5, abs=0.01)
    pressed = Capture(contacts=(Contact("pad", "ball", 44.0, 9.0, 0.5),))
    [shown] = photograph(tables, None, {}, pressed, 0).shown
    assert shown.lifted[3] > 0.1
    assert max(shown.lifted[:3]) < 0.01


@needs_mitsuba
def test_pictures_are_kept_and_the_same_for_a_seed(tmp_path):
    tables = SCENE | {"pads": [PAD | {"layers": [CLEAR]}]}
    capture = Capture(light="lamps", coupling="coupled", walls=0.05, flare=0.02, jpeg=90, gamma=2.2)
    first = photograph(tables, {"pupil": 0.1}, {}, capture, 3, tmp_path)
    [kept] = tmp_path.iterdir()
    again = photograph(tables, {"pupil": 0.1}, {}, capture, 3, tmp_path)
    assert np.array_equal(first.pixels, again.pixels)
    assert [one.path for one in first.shown] == [one.path for one in again.shown] == ["", "wall"]
    kept.unlink()
    other = photograph(tables, {"pupil": 0.1}, {}, capture, 3, tmp_path)
    assert np.array_equal(first.pixels, other.pixels)
    assert first.pixels.shape == (700, 933, 3)
    # Lamps that touch the layer are saturated strips; walls are nearly black, but not quite.
    assert np.count_nonzero(first.pixels.max(axis=-1) == 255) > 500
    assert 0 < np.median(first.pixels) < 60


def test_frames_of_leaning_parts_turn_the_normal_towards_greater_columns():
    frame = frame_of({}, {}, PAD | {"lean": 0.1})
    assert frame.normal == pytest.approx([0, math.cos(0.1), math.sin(0.1)])
    assert frame.across == pytest.approx([0, -math.sin(0.1), math.cos(0.1)])


def test_a_pins_bulge_is_flat_round_and_steepest_at_its_edge():
    flat, depth = 1.5, 0.8
    edge, away = pin_edge(flat, depth), np.linspace(0, 6, 3001)
    height = pin_bulge(away, flat, depth)
    assert height[away <= flat] == pytest.approx(np.full((away <= flat).sum(), depth))
    # On the rim it follows the rim's own circle.
    assert pin_bulge(np.array([1.7]), flat, depth)[0] == pytest.approx(depth - 0.2**2 / (2 * RIM))
    assert flat < edge < flat + RIM + depth
    assert np.all(np.diff(height) < 1e-12)
    assert np.abs(np.diff(height)).max() < 0.02
    assert away[np.argmin(np.gradient(height))] == pytest.approx(edge, abs=0.01)
    # By Sneddon's integral the load's own condition: what is not sunk at the edge is nothing.
    sunk = edge * math.sqrt(edge**2 - flat**2) - edge * flat * math.acos(flat / edge)
    assert sunk / RIM == pytest.approx(depth)


def test_a_pin_without_a_flat_end_is_a_sphere():
    away = np.linspace(0, 4, 50)
    assert pin_edge(1e-6, 0.4) == pytest.approx(math.sqrt(RIM * 0.4), rel=1e-3)
    assert pin_bulge(away, 1e-6, 0.4) == pytest.approx(bulge(away, RIM, 0.4), abs=2e-3)


def test_lamps_of_more_heights_hide_in_finer_steps():
    pads = {"pads": [PAD]}
    contacts = (Contact("pad", "sphere", 20.0, 0.0, 1.4, size=5.0),)
    few, many, most = (
        light_membranes(pads, Capture(light="lamps", contacts=contacts, heights=count))[0][0].values
        for count in (3, 12, 24)
    )
    assert np.abs(many - most).max() < 0.5 * np.abs(few - most).max()
