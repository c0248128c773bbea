"""A linkage's drawing and numbers, against its file and against the solver of poses."""

from __future__ import annotations

import itertools
import math
from collections import Counter
from functools import cache
from typing import Any

import jax
import numpy as np
import pytest
from ezdxf.document import Drawing as DxfDocument

from designopt.export.drawing import Drawing
from designopt.export.dxf import dxf_text
from kinematics import solve_poses
from kinematics.export.drawing import linkage_quantities, make_linkage_drawing
from kinematics.io.designed import DesignedLinkage
from kinematics.io.sketch import parse_sketch
from tests.designopt.export.reading import dimensions, opened
from tests.kinematics.gallery import FOLDER, NAMES, bodies_at, gallery_tables, tables_of

MAKER = 1e-6
"""What the distances between pins have to keep, mm."""


@cache
def design(name: str) -> DesignedLinkage:
    return DesignedLinkage.read(FOLDER / f"{name}.toml")


@cache
def sheet(name: str) -> Drawing:
    return make_linkage_drawing(design(name))


@cache
def drawing(name: str) -> DxfDocument:
    return opened(sheet(name))


def stated(name: str) -> dict[tuple[str, str, str], float]:
    """Distances between joints that the file states: exact ones, otherwise the sketch's."""
    data, found = gallery_tables(name), {}
    for body, part in data["bodies"].items():
        lengths = part.get("lengths", {})
        for pair in itertools.combinations(part["joints"], 2):
            if lengths and "-".join(pair) not in lengths:
                continue  # other lengths may have moved it
            sketched = math.dist(*(data["joints"][joint] for joint in pair))
            found[body, *pair] = lengths.get("-".join(pair), sketched)
    return found


def numbers(name: str) -> dict[str, tuple[float, str]]:
    quantities = linkage_quantities(design(name))
    found = {part.name: (part.value, part.unit) for part in quantities}
    assert len(found) == len(quantities)
    return found


def linkage(**changes: Any) -> DesignedLinkage:
    base = tables_of(
        {"A": [0, 0], "B": [10, 0], "C": [10, 8], "D": [0, 8]},
        "A B",
        {"left": "A D", "right": "B C", "top": "D C"},
        inputs=[{"name": "turn", "body": "left"}],
    )
    return DesignedLinkage.of(parse_sketch(base | changes, "sketch"), "sketch")


@pytest.mark.parametrize("name", NAMES)
def test_pins_in_the_file_are_as_far_apart_as_the_linkage_says(name):
    pins: dict[str, dict[str, np.ndarray]] = {}
    for circle in drawing(name).modelspace().query("CIRCLE"):
        joint = circle.get_xdata("DESIGNOPT")[0].value
        place = np.array(circle.dxf.center)[:2]
        pins.setdefault(circle.dxf.layer, {})[joint] = place
    data, measured = gallery_tables(name), 0
    assert set(pins) <= set(data["bodies"])
    for (body, first, second), wanted in stated(name).items():
        if {first, second} <= pins.get(body, {}).keys():
            found = math.dist(pins[body][first], pins[body][second])
            assert found == pytest.approx(wanted, abs=MAKER), (body, first, second)
            measured += 1
    assert measured >= (1 if name == "scotch-yoke" else 2)
    # A pin is drawn on every body that it joins, in one place.
    for first, second in itertools.combinations(pins.values(), 2):
        for joint in first.keys() & second.keys():
            np.testing.assert_allclose(first[joint], second[joint], atol=MAKER)

    document = drawing(name)
    assert not document.audit().has_issues
    assert all(body in document.layers for body in gallery_tables(name)["bodies"])
    measured = [part.get_measurement() for part in dimensions(document)]
    by_joints = {frozenset(key[1:]): value for key, value in stated(name).items()}
    assert sorted(measured) == pytest.approx(sorted(by_joints.values()), abs=MAKER)

    # Every joint that joins is a circle, and the others are not.
    partners = bodies_at(data) + Counter(slider["joint"] for slider in data.get("sliders", []))
    circles = {circle.name for circle in sheet(name).circles}
    assert circles == {joint for joint, count in partners.items() if count > 1}
    assert {label.text for label in sheet(name).labels} == set(data["joints"])
    for layer in sheet(name).layers:
        own = [circle for circle in sheet(name).circles if circle.layer == layer.name]
        for first, second in itertools.combinations(own, 2):
            assert math.dist(first.center, second.center) > first.radius + second.radius


def test_bodies_are_bars_or_outlines_and_carry_their_slots():
    (rocker,) = (line for line in sheet("watt").polylines if line.layer == "rocker")
    assert rocker.closed
    corners = {circle.name: circle.center for circle in sheet("watt").circles}
    assert set(rocker.places) == {corners[joint] for joint in ("O4", "B", "C")}
    # The lever's slot runs along it, through the crank's pin.
    lines = [line.places for line in sheet("quick-return").polylines if line.layer == "lever"]
    pin = next(part.center for part in sheet("quick-return").circles if part.name == "A")
    slot = next(line for line in lines if math.dist(*line[:2]) < 10)
    assert math.dist(slot[0], pin) + math.dist(pin, slot[1]) == pytest.approx(math.dist(*slot))
    fixed = [s.places for s in sheet("slider-crank").polylines if s.layer == "ground"]
    assert any(all(y == pytest.approx(-20, abs=1e-9) for _, y in line) for line in fixed)


@pytest.mark.parametrize("name", NAMES)
def test_numbers_hold_every_number_of_the_file(name):
    found, data = numbers(name), gallery_tables(name)
    for (body, first, second), wanted in stated(name).items():
        value, unit = found[f"bodies.{body}.{first}-{second}"]
        assert (value, unit) == (pytest.approx(wanted, rel=1e-12), "mm")
    home = design(name).linkage
    if name in ("quick-return", "scotch-yoke", "slider-crank"):
        pose = solve_poses(home, home.reference.inputs).value
        for joint in home.structure.joints:
            place = [found[f"joints.{joint}.{axis}"][0] for axis in "xy"]
            np.testing.assert_allclose(place, pose.position(joint), atol=1e-9)
    for spring in data.get("springs", []):
        name = f"springs.{'-'.join(spring['between'])}"
        assert found[f"{name}.stiffness"] == (spring["stiffness"], "N mm/rad")
        assert found[f"{name}.preload"] == (spring["preload"], "rad")
    if not any("lengths" in part for part in data["bodies"].values()):
        for joint, place in data["joints"].items():
            read_back = [found[f"joints.{joint}.{axis}"] for axis in "xy"]
            assert [value for value, _ in read_back] == pytest.approx(place, abs=1e-9)
            assert {unit for _, unit in read_back} == {"mm"}
    assert {f"inputs.{part['name']}" for part in data["inputs"]} <= found.keys()


def test_angles_are_those_between_joints_in_degrees():
    found = numbers("finger-crank")

    def angle(first: str, second: str) -> float:
        joints = gallery_tables("finger-crank")["joints"]
        x, y = np.subtract(joints[second], joints[first])
        return math.degrees(math.atan2(y, x))

    assert found["inputs.theta"] == (pytest.approx(angle("F", "E")), "°")
    assert found["bodies.rod.angle"] == (pytest.approx(angle("D", "E")), "°")
    relative = angle("C", "D") - angle("B", "T")
    assert found["inputs.gamma"] == (pytest.approx(relative), "°")


def test_places_in_a_body_are_its_own():
    found = numbers("jansen")
    joints = gallery_tables("jansen")["joints"]
    foot = gallery_tables("jansen")["bodies"]["foot"]["joints"]
    places = [[found[f"bodies.foot.{joint}.{axis}"][0] for axis in "xy"] for joint in foot]
    assert places[0] == [0, 0]
    assert places[1][1] == 0
    for (i, first), (j, second) in itertools.combinations(enumerate(foot), 2):
        wanted = math.dist(joints[first], joints[second])
        assert math.dist(places[i], places[j]) == pytest.approx(wanted)


def test_sliders_have_their_lines_and_places():
    found = numbers("slider-crank")
    assert found["sliders.C.point.y"] == (-20, "mm")
    assert found["sliders.C.angle"] == (0, "°")
    # Norton's Example 4-2: the pin C on the line y = −20 at its distance from the line's origin.
    wanted = found["joints.C.x"][0] - found["sliders.C.point.x"][0]
    assert found["sliders.C.slide"] == (pytest.approx(wanted, abs=1e-9), "mm")
    assert "sliders.C.turn" not in found
    yoke = numbers("scotch-yoke")
    assert yoke["sliders.Y.turn"] == (pytest.approx(0, abs=1e-9), "°")


def test_a_body_held_by_its_slots_alone_is_found_from_them():
    # Two pins of the ground in two slots of a plate, which its angle drives.
    tables = tables_of(
        {"O": [0, 0], "M": [20, 0], "P": [5, 12], "Q": [15, 13]},
        "O M",
        {"plate": "P Q"},
        sliders=[
            {"joint": "O", "on": "plate", "line": [[0, 0], [5, 12]]},
            {"joint": "M", "on": "plate", "line": [[20, 0], [15, 13]]},
        ],
        inputs=[{"name": "turn", "body": "plate"}],
    )
    plate = linkage(**tables)
    found = {part.name: part.value for part in linkage_quantities(plate)}
    for joint, place in plate.sketch.joints.items():
        read_back = [found[f"joints.{joint}.{axis}"] for axis in "xy"]
        np.testing.assert_allclose(read_back, place, atol=1e-9)
    assert {circle.name for circle in make_linkage_drawing(plate).circles} == {"O", "M"}


def test_springs_are_noted_but_many_are_only_counted():
    spring = {"between": ["left", "right"], "stiffness": 30, "preload": 0.25}
    notes = make_linkage_drawing(linkage(springs=[spring])).notes
    assert "spring left – right: 30 N mm/rad, preload 0.25 rad" in notes
    many = make_linkage_drawing(linkage(springs=[spring] * 40))
    assert "40 springs" in many.notes
    dxf_text(many)  # and the drawing still has room


def test_coincident_joints_have_no_dimension():
    joints = {"A": [0, 0], "B": [10, 0], "C": [10, 8], "D": [0, 8], "D2": [0, 8]}
    bodies = {"left": "A D D2", "right": "B C", "top": "D C"}
    inputs = [{"name": "turn", "body": "left"}]
    twin = linkage(**tables_of(joints, "A B", bodies, inputs=inputs))
    lengths = [math.dist(part.start, part.end) for part in make_linkage_drawing(twin).dimensions]
    assert sorted(lengths) == pytest.approx([8, 8, 8, 10, 10])
    assert not opened(make_linkage_drawing(twin)).audit().has_issues


def test_a_linkage_read_in_float32_is_drawn_too():
    with jax.enable_x64(False):
        small = make_linkage_drawing(linkage())
    wanted = make_linkage_drawing(linkage())
    np.testing.assert_allclose(
        [part.center for part in small.circles], [part.center for part in wanted.circles], atol=1e-5
    )
