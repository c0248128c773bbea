"""A scene's explorer shows what the public functions and an oracle have of the scene it saves."""

import functools
import tomllib
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from designopt.explore.explorer import Chart, View
from designopt.programs import Prompt
from optics.explore.scene import (
    COVERAGE,
    HIDDEN,
    SEEN,
    Picture,
    SceneExplorer,
    _part_parameters,
    scene_view,
)
from optics.plot.section import place_parts
from optics.scene.designed import DesignedScene
from optics.scene.reading import parse_scene
from optics.visibility.coverage import find_coverage, find_views
from optics.visibility.sharpness import find_sharpness
from studies.oracles.rays import bounds
from tests.designopt.explore.whole import show
from tests.helpers import SCENES, nightly
from tests.optics.scenes import fans_of, mirrored, posed, structure_of


@functools.cache
def opened(name):
    return SceneExplorer(DesignedScene.read(SCENES / f"{name}.toml"))


def readouts(state) -> dict[str, Any]:
    return {one.name: one.value for one in state.readouts}


def saved(explorer, values):
    (file,) = explorer.design.files(values)
    return parse_scene(tomllib.loads(file.content))


def view_of(state):
    panel = state.panels[0]
    assert isinstance(panel, View)
    return panel


MOVED = {
    "pip": 35.0,
    "dip": 70.0,
    "camera.direction": -104.0,
    "camera.position.x": 14.5,
    "camera.position.y": 15.25,
    "camera.field_of_view": 130.0,
    "mirrors.distal.to.x": 50.0,
    "mirrors.proximal.from.y": 16.0,
}


def shown(explorer, turned):
    values = explorer.values()
    assert turned.keys() <= values.keys()
    values |= turned
    return values, show(explorer, values)


@pytest.mark.parametrize("turned", [MOVED, *nightly({}, {"pip": 60.0, "camera.direction": -70.0})])
def test_numbers_and_shapes_are_those_of_the_saved_scene(turned):
    explorer = opened("finger")
    values, state = shown(explorer, turned)
    scene, angles = saved(explorer, values), np.radians([values["pip"], values["dip"]])
    views = find_views(scene, jnp.asarray(angles))
    several = jax.tree.map(lambda leaf: leaf[None], views.value)
    sharp = find_sharpness(scene, angles[None], several, bounces=1).px_per_mm[0]
    seen = np.asarray(views.value.coverage())
    found = readouts(state)
    # Of what is not all seen, the message names every pad.
    short = {k.partition(":")[0] for k, v in found.items() if "coverage" in k and v < 100}
    assert all(f"pad '{name}': " in state.message for name in short)
    # Many rays, traced by a program of its own, enclose what is seen.
    pose = posed(scene, angles)
    shot = bounds(structure_of(scene.layout), fans_of([pose]), 4001, 1)
    inner, outer = shot.coverage[:, 0, 0]
    view = view_of(state)
    mirrors = len(scene.layout.mirrors)
    for index, part in enumerate(scene.layout.pads):
        covered = found[f"{part.name}: coverage"]
        assert covered == pytest.approx(100 * seen[index], abs=1e-9)
        assert 100 * inner[index] - 1e-9 <= covered <= 100 * outer[index] + 1e-9
        # Seen and hidden pieces lie on the pad, and are as long as the numbers have it.
        start, end = pose.ends[mirrors + index]
        lengths = {SEEN: 0.0, HIDDEN: 0.0}
        for line in view.drawing.polylines:
            if line.layer in lengths and line.name == f"{part.name} pad":
                at = ((np.array(line.places) @ [1, 1j]) - start) / (end - start)
                np.testing.assert_allclose(at.imag, 0, atol=1e-8)
                lengths[line.layer] += at.real[1] - at.real[0]
        assert lengths[SEEN] == pytest.approx(covered / 100, abs=1e-7)
        assert sum(lengths.values()) == pytest.approx(1, abs=1e-7)
        numbers = [found[f"{part.name}: {word} resolution"] for word in ("least", "median")]
        if seen[index] == 0:
            assert numbers == [None, None]
            missed = -np.degrees(np.max(views.margin[:, index]))
            assert found[f"{part.name}: missed by"] == pytest.approx(missed, abs=1e-9)
            continue
        assert numbers == pytest.approx(sharp[index, :2].tolist())
        assert found[f"{part.name}: missed by"] is None
        assert "px/mm" in view.notes[f"{part.name} pad"]


def test_light_is_reflected_as_it_must_be():
    """From a point of the pad, light runs to the camera's image in the mirror."""
    explorer = opened("finger")
    values, state = shown(explorer, {"pip": 20.0, "dip": 30.0})
    pose = posed(saved(explorer, values), np.radians([values["pip"], values["dip"]]))
    drawing = view_of(state).drawing
    layers = [layer for layer in drawing.layers if layer.kind == "view"]
    assert len({layer.color for layer in layers}) == len(layers) > 1
    assert {layer.name for layer in layers} <= {label.text for label in drawing.labels}
    count = 0
    for layer in layers:
        outlines = [
            np.array(line.places) @ [1, 1j]
            for line in drawing.polylines
            if line.layer == layer.name
        ]
        if layer.name == "direct":
            for outline in outlines:
                assert outline[0] == pytest.approx(pose.position, abs=1e-8)
            continue
        mirror = pose.ends[["distal", "proximal"].index(layer.name.removeprefix("mirror:"))]
        image = mirrored(pose.position, mirror)
        for first, last in zip(outlines[::2], outlines[1::2], strict=True):
            assert first[0] == pytest.approx(pose.position, abs=1e-8)
            for on_mirror, on_pad in ((last[0], last[3]), (last[1], last[2])):
                assert on_mirror in first
                ray = (on_pad - image) / (on_mirror - image)
                assert ray.imag == pytest.approx(0, abs=1e-7)
                assert ray.real > 1
                count += 1
    assert count


def test_the_chart_is_coverage_over_what_was_moved_last():
    explorer = opened("finger")
    values = explorer.values()
    show(explorer, values)
    for name, low, high in (("dip", 0.0, 90.0), ("camera.direction", -126.3, -66.3)):
        values[name] = low + 0.4 * (high - low)
        chart = show(explorer, values).panels[1]
        assert isinstance(chart, Chart)
        assert chart.name == COVERAGE
        assert chart.at == pytest.approx(values[name])
        for index, series in enumerate(chart.series):
            there = values | {name: series.x[17]}
            assert there[name] == pytest.approx(low + 17 / 60 * (high - low))
            angles = jnp.radians(jnp.array([there["pip"], there["dip"]]))
            wanted = find_coverage(saved(explorer, there), angles).value[index]
            assert series.y[17] == pytest.approx(100 * float(wanted), abs=1e-9)


def test_turning_asks_for_nothing_that_is_not_compiled():
    explorer, prompt = opened("finger"), Prompt()
    values = explorer.values()
    with prompt.answering():
        first = show(explorer, values)
    prompt.compile()
    with prompt.answering():
        for one in (*explorer.joints, *explorer.design.parameters):
            state = show(explorer, {**values, one.name: 0.3 * one.low + 0.7 * one.high})
            assert [panel.name for panel in state.panels] == [one.name for one in first.panels]
    assert not prompt.is_behind


def test_a_scene_that_cannot_be_leaves_the_picture():
    explorer = opened("finger")
    values, state = shown(explorer, {})
    ends = {f"mirrors.distal.{end}.{axis}": 20.0 for end in ("from", "to") for axis in "xy"}
    failed = show(explorer, values | ends)
    assert failed.message == "finger: mirrors.0: it has no length; move 'from' or 'to'"
    assert readouts(failed).keys() == readouts(state).keys()
    assert failed.panels == state.panels
    # Also where the numbers of the last that can be are not computed yet.
    bent = explorer.show(values | {"pip": 60.0})
    left = explorer.show(values | ends | {"pip": 60.0}).numbers()
    assert (left.notes, left.charts) == (bent.numbers().notes, bent.numbers().charts)
    assert left.charts[0].at == 60.0


def test_the_sketch_is_the_file_in_its_first_pose():
    explorer = opened("finger")
    (view,) = explorer.sketch()
    lines = {line.name: line.places for line in view.drawing.polylines}
    assert lines["distal mirror"] == [(23.24, 19.04), (53.81, 0.34)]
    assert lines["tip"] == [(55.0, -4.0), (55.0, 21.0)]
    assert not [layer for layer in view.drawing.layers if layer.kind == "view"]
    assert view.notes["distal mirror"] == "35.84 mm"
    assert view.notes["camera"] == "at (15.75, 16.99) mm, direction -96.3°, field of view 160°"
    assert {"straight", "bent"} == set(explorer.presets)


POSE = {"pip": 35.0, "dip": 70.0}


@pytest.mark.parametrize("handle", ["camera", "distal mirror, from", "proximal mirror, to"])
def test_a_dragged_end_goes_where_it_is_dragged_in_any_pose(handle):
    explorer = opened("finger")
    values = explorer.values() | POSE
    handles = _handles(explorer, values)
    start = handles[handle]
    wanted = (start.place[0] + 1.5, start.place[1] - 0.75)
    found = explorer.drag(values, handle, wanted)
    assert {name for name in values if found[name] != values[name]} == set(start.parameters)
    moved = _handles(explorer, found)
    assert moved[handle].place == pytest.approx(wanted, abs=1e-8)
    far = explorer.drag(values, handle, (1e6, -1e6))
    for one in explorer.design.parameters:
        assert one.low <= far[one.name] <= one.high


def test_a_mirror_is_dragged_whatever_its_name_is(tmp_path):
    path, name = tmp_path / "named.toml", "a mirror, b"
    path.write_text((SCENES / "periscope.toml").read_text().replace('"lower"', f'"{name}"'))
    explorer = SceneExplorer(DesignedScene.read(path))
    values = explorer.values()
    found = explorer.drag(values, f"{name} mirror, to", (120.0, 20.0))
    ends = {f"mirrors.{name}.to.x": 120.0, f"mirrors.{name}.to.y": 20.0}
    assert found == pytest.approx({**values, **ends})
    assert explorer.drag(values, "another mirror, to", (120.0, 20.0)) == values
    assert explorer.drag(values, "lens", (120.0, 20.0)) == values


def test_the_dragged_axis_turns_the_camera():
    explorer = opened("finger")
    values = explorer.values()
    found = explorer.drag(values, "camera axis", (15.75 + 3.0, 16.99 - 30.0))
    assert found["camera.direction"] == pytest.approx(np.degrees(np.arctan2(-30, 3)))
    assert explorer.drag(values, "camera axis", (15.75, 16.99)) == values


def _handles(explorer, values):
    """Of the scene as it is saved."""
    scene = saved(explorer, values)
    angles = np.radians([values[joint.name] for joint in explorer.joints])
    picture = Picture(place_parts(scene, angles))
    view = scene_view("section", "", scene, picture, _part_parameters)
    return {one.name: one for one in view.handles}


@pytest.mark.slow
def test_a_point_that_all_rays_meet_has_no_resolution():
    explorer = opened("ellipse")
    state = show(explorer, explorer.values())
    found = readouts(state)
    assert found["target: coverage"] == 0
    assert found["target: least resolution"] is None
    assert found["target: median resolution"] is None
    assert state.message == (
        "pad 'target': none of it is seen; all rays to it meet it in single points"
    )
    assert [panel.name for panel in state.panels] == ["section"]


@pytest.mark.nightly
@pytest.mark.parametrize("name", sorted(path.stem for path in SCENES.glob("*.toml")))
def test_every_scene_of_the_gallery_bears_its_ranges(name):
    explorer = SceneExplorer(DesignedScene.read(SCENES / f"{name}.toml"))
    values = explorer.values()
    names = readouts(show(explorer, values)).keys()
    for one in (*explorer.joints, *explorer.design.parameters):
        assert one.low <= one.value <= one.high
        for end in (one.low, one.high):
            assert readouts(show(explorer, {**values, one.name: end})).keys() == names
