"""The finger's drawing and numbers, against the two files that the study writes."""

from __future__ import annotations

import itertools
import math
import tomllib
from collections import Counter

import numpy as np
import pytest

from designopt.designs import load_design
from studies.models import packaged_finger
from studies.models.spec_files import finger_files
from tests.designopt.export.reading import numbers_in, opened

FILES = {file.name: tomllib.loads(str(file.content)) for file in finger_files(packaged_finger())}
LINKAGE, SCENE = FILES["linkage.toml"], FILES["scene.toml"]


@pytest.fixture(scope="module")
def finger():
    return load_design("finger")


@pytest.fixture(scope="module")
def space(finger):
    document = opened(finger.drawing())
    assert not document.audit().has_issues
    return document.modelspace()


def test_pins_are_as_far_apart_as_the_linkage_says(space):
    pins = {
        circle.get_xdata("DESIGNOPT")[0].value: np.array(circle.dxf.center)[:2]
        for circle in space.query("CIRCLE[layer!='camera']")
    }
    assert set(pins) == set(LINKAGE["joints"]) - {"O", "T"}
    for first, second in itertools.combinations(pins, 2):
        wanted = math.dist(LINKAGE["joints"][first], LINKAGE["joints"][second])
        assert math.dist(pins[first], pins[second]) == pytest.approx(wanted, abs=1e-6)
    # Linkage and optics share their coordinates: hinges are pins.
    assert tuple(pins["A"]) == pytest.approx(SCENE["frames"]["proximal"]["hinge"], abs=1e-9)
    assert tuple(pins["B"]) == pytest.approx(SCENE["frames"]["distal"]["hinge"], abs=1e-9)


def test_optics_are_where_the_scene_has_them(space):
    for layer in ("mirrors", "pads", "blockers"):
        found = [
            (line.dxf.start.x, line.dxf.start.y, line.dxf.end.x, line.dxf.end.y)
            for line in space.query(f"LINE[layer=='{layer}']")
        ]
        np.testing.assert_array_equal(found, [(*p["from"], *p["to"]) for p in SCENE[layer]])


def test_the_outline_is_the_body_and_holds_the_pads(finger, space):
    (outline,) = space.query("LWPOLYLINE[layer=='outline']")
    places = np.array(outline.get_points("xy"))
    np.testing.assert_array_equal(places.min(axis=0), [-35, -4])
    np.testing.assert_array_equal(places.max(axis=0), [55, 21])
    assert outline.closed


def test_layers_are_those_of_both_parts_once(finger):
    names = [layer.name for layer in finger.drawing().layers]
    assert len(set(names)) == len(names)
    phalanges = "proximal", "intermediate", "distal"
    walls = [f"{name} wall" for name in phalanges]
    bars = [name for name in LINKAGE["bodies"] if name not in phalanges]
    mirrors = [f"{mirror['name']} mirror" for mirror in SCENE["mirrors"]]
    optics = ["mirrors", "pads", "blockers", "layers", "camera", "field of view"]
    assert sorted(names) == sorted([*walls, *bars, *mirrors, *optics, "outline"])


def test_every_number_of_both_files_is_among_the_numbers(finger):
    quantities = finger.quantities()
    found = {part.name: (part.value, part.unit) for part in quantities}
    assert len(found) == len(quantities)
    scene = Counter(value for name, (value, _) in found.items() if name.startswith("scene."))
    dimensions = {name: table for name, table in SCENE.items() if name != "scene"}  # its format
    assert not Counter(numbers_in(dimensions)) - scene
    for joint, place in LINKAGE["joints"].items():
        values = [found[f"linkage.joints.{joint}.{axis}"][0] for axis in "xy"]
        assert values == pytest.approx(place, abs=1e-9)
    assert found["spring.stiffness"] == (30.0, "N mm/rad")
    assert found["spring.preload"] == (0.3, "rad")
    assert found["spring.servo"] == (300.0, "N mm/rad")
    assert found["body.thickness"] == (25.0, "mm")
    assert found["body.range"] == (90.0, "°")
