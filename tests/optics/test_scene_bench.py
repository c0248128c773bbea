"""A scene's bench shows what the public functions say of the scene that it saves."""

import functools
import tomllib
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from optics.explore.scene_bench import SceneBench
from optics.explore.scene_knobs import ParameterMap
from optics.explore.scene_seeing import _coverage, _quickly, _views

from designopt.errors import UserError
from optics.plot.label_layout import Label, PlacedLabel, moved
from optics.scene.designed import DesignedScene
from optics.scene.file import SceneFile
from optics.scene.reading import parse_scene
from optics.visibility.coverage import find_coverage, find_views
from optics.visibility.sharpness import find_sharpness
from studies.oracles.rays import bounds
from tests.helpers import SCENES, assert_same, figure_of, load_toml, nightly, readings
from tests.optics.scenes import fans_of, posed, structure_of


@functools.cache
def design(name):
    return DesignedScene.read(SCENES / f"{name}.toml")


def opened(name):
    """A bench drawn into a figure, and the values it begins with."""
    bench = SceneBench(design(name))
    figure_of(bench)
    return bench, {knob.name: knob.value for knob in bench.knobs}


def saved(bench, values):
    """The scene that the saved file describes."""
    (file,) = bench.specs(values)
    assert file.name == "scene.toml"
    return parse_scene(tomllib.loads(file.content))


MOVED = {
    "pip": 35.0,
    "dip": 70.0,
    "camera tilt": -7.7,
    "camera x": 14.5,
    "camera y": 15.25,
    "field of view": 130.0,
    "distal mirror: to x": 50.0,
    "proximal mirror: from y": 16.0,
}


def test_the_saved_file_has_the_knobs_numbers_and_the_camera_takes_its_body_along():
    bench, values = opened("finger")
    before, after = design("finger").scene, saved(bench, {**values, **MOVED})
    assert after.layout == before.layout
    np.testing.assert_allclose(after.camera.position, [14.5, 15.25], atol=1e-12)
    np.testing.assert_allclose(np.degrees(after.camera.direction), -104.0, atol=1e-12)
    np.testing.assert_allclose(np.degrees(after.camera.field_of_view), 130.0, atol=1e-12)
    mirrors = np.array(before.mirrors)
    mirrors[0, 1, 0], mirrors[1, 0, 1] = 50.0, 16.0
    np.testing.assert_allclose(after.mirrors, mirrors, atol=1e-12)

    def seen_from_the_camera(scene):
        arrows = (np.asarray(scene.blockers[0]) - np.asarray(scene.camera.position)) @ [1, 1j]
        return arrows * np.exp(-1j * float(scene.camera.direction))

    np.testing.assert_allclose(
        seen_from_the_camera(after), seen_from_the_camera(before), atol=1e-12
    )
    np.testing.assert_array_equal(after.blockers[1:], before.blockers[1:])
    np.testing.assert_array_equal(after.pads, before.pads)
    # What nobody turned comes back as it was.
    same = saved(bench, values)
    assert_same(same, before, atol=1e-9)


@pytest.mark.parametrize("turned", [MOVED, *nightly({}, {"pip": 60.0, "camera tilt": 26.3})])
def test_readings_are_those_of_the_saved_scene(turned):
    bench, values = opened("finger")
    assert turned.keys() <= values.keys()
    values |= turned
    shown = bench.show(values)
    # Of what is not all seen, the message names every pad.
    short = {k.partition(":")[0] for k, v in readings(shown).items() if "coverage" in k and v < 100}
    assert all(f"pad '{name}': " in shown.message for name in short)
    scene, pose = saved(bench, values), {name: values[name] for name in ("pip", "dip")}
    angles = np.radians([pose["pip"], pose["dip"]])
    views = find_views(scene, jnp.asarray(angles))
    several = jax.tree.map(lambda leaf: leaf[None], views.value)
    sharp = find_sharpness(scene, angles[None], several, bounces=1).px_per_mm[0]
    seen = np.asarray(views.value.coverage())
    found = readings(shown)
    assert found["camera tilt"] == values["camera tilt"]
    assert found["camera direction"] == pytest.approx(values["camera tilt"] - 96.3)
    direction = np.degrees(float(scene.camera.direction))
    assert found["camera direction"] == pytest.approx(direction)
    # Many rays, traced by a program of its own, enclose what is seen.
    shot = bounds(structure_of(scene.layout), fans_of([posed(scene, angles)]), 4001, 1)
    inner, outer = shot.coverage[:, 0, 0]
    for index, part in enumerate(scene.layout.pads):
        covered = found[f"{part.name}: coverage"]
        assert covered == pytest.approx(100 * seen[index], abs=1e-9)
        assert 100 * inner[index] - 1e-9 <= covered <= 100 * outer[index] + 1e-9
        if seen[index] == 0:
            assert found[f"{part.name}: least resolution"] is None
            missed = -np.degrees(np.max(views.margin[:, index]))
            assert found[f"{part.name}: missed by"] == pytest.approx(missed, abs=1e-9)
            continue
        assert found[f"{part.name}: least resolution"] == pytest.approx(sharp[index, 0])
        assert found[f"{part.name}: median resolution"] == pytest.approx(sharp[index, 1])
        assert found[f"{part.name}: missed by"] is None


def test_curves_are_coverage_over_the_knob_moved_last():
    bench, values = opened("finger")
    bench.show(values)
    for name, low, high in (("dip", 0.0, 90.0), ("camera tilt", -30.0, 30.0)):
        values[name] = low + 0.4 * (high - low)
        drawn: dict[Any, Any] = {one.get_gid(): one for one in bench.show(values).artists}
        assert drawn["now"].get_xdata() == pytest.approx([0.4, 0.4])
        for index, part in enumerate(design("finger").scene.layout.pads):
            share, covered = (column[17] for column in drawn[f"curve:{part.name}"].get_data())
            there = values | {name: low + share * (high - low)}
            angles = jnp.radians(jnp.array([there["pip"], there["dip"]]))
            wanted = find_coverage(saved(bench, there), angles).value[index]
            assert covered == pytest.approx(100 * float(wanted), abs=1e-9)


def test_a_slider_compiles_nothing_anew():
    bench, values = opened("finger")
    bench.show(values)
    programs: list[Any] = [_quickly(function) for function in (_views, _coverage)]
    before = [program._cache_size() for program in programs]
    for knob in bench.knobs:
        bench.show({**values, knob.name: 0.3 * knob.low + 0.7 * knob.high})
    assert [program._cache_size() for program in programs] == before


def test_a_scene_that_cannot_be_is_told_and_leaves_the_picture():
    bench, values = opened("finger")
    shown = bench.show(values)
    ends = {f"distal mirror: {end} {axis}": 20.0 for end in ("from", "to") for axis in "xy"}
    told = bench.show(values | ends)
    assert told.message == "finger: mirrors.0: it has no length; move 'from' or 'to'"
    assert readings(told).keys() == readings(shown).keys()
    assert list(told.artists) == list(shown.artists)
    with pytest.raises(UserError, match="it has no length"):
        bench.specs(values | ends)
    with pytest.raises(UserError, match="it has no length"):
        bench.optimise(values | ends)


def test_tilt_is_counted_from_straight():
    bench = SceneBench(design("finger"), straight_deg=-90.0)
    values = {knob.name: knob.value for knob in bench.knobs}
    assert values["camera tilt"] == pytest.approx(-6.3)
    for tilt in (values["camera tilt"], 5.0):
        direction = saved(bench, values | {"camera tilt": tilt}).camera.direction
        assert np.degrees(float(direction)) == pytest.approx(tilt - 90.0, abs=1e-12)


@pytest.mark.slow
def test_a_point_that_all_rays_meet_has_no_resolution():
    bench, values = opened("ellipse")
    found = readings(shown := bench.show(values))
    assert found["target: coverage"] == 0
    assert found["target: least resolution"] is None
    assert found["target: median resolution"] is None
    assert shown.message == (
        "pad 'target': none of it is seen; all rays to it meet it in single points"
    )


def test_the_saved_lens_is_that_of_the_file():
    tables = load_toml("scenes/lens.toml")
    turned = ParameterMap.of(DesignedScene.of(SceneFile.model_validate(tables), "lens"))
    same = turned.tables({knob.name: knob.value for knob in turned.knobs})
    assert same["camera"]["lens"] == tables["camera"]["lens"]


def test_the_saved_layers_are_those_of_the_file():
    turned = ParameterMap.of(design("layered-pad"))
    values = {knob.name: knob.value for knob in turned.knobs}
    assert_same(parse_scene(turned.tables(values)), design("layered-pad").scene, rtol=1e-12)
    moved = parse_scene(turned.tables(values | {"lid mirror: to y": 12.0, "camera x": 1.0}))
    assert float(moved.mirrors[0, 1, 1]) == pytest.approx(12.0)
    assert_same(moved.layers, design("layered-pad").scene.layers, rtol=1e-12)


def test_a_curved_mirror_has_a_radius_that_its_ends_allow():
    bench = SceneBench(design("circle"))
    values = {knob.name: knob.value for knob in bench.knobs}
    assert float(saved(bench, values | {"bowl mirror: radius": 80.0}).radii[0]) == 80
    with pytest.raises(UserError, match="make 'radius' longer than 40"):
        bench.specs(values | {"bowl mirror: radius": 40.0})


@pytest.mark.nightly
@pytest.mark.parametrize("name", sorted(path.stem for path in SCENES.glob("*.toml")))
def test_every_scene_of_the_gallery_bears_its_knobs(name):
    bench, values = opened(name)
    names = readings(bench.show(values)).keys()
    for knob in bench.knobs:
        assert knob.low <= knob.value <= knob.high
        for end in (knob.low, knob.high):
            assert readings(bench.show({**values, knob.name: end})).keys() == names
    assert_same(saved(bench, values), design(name).scene, rtol=1e-9)


def covered_over_range(bench, values):
    """Least coverage of any pad over the joints' ranges, denser than the search looks."""
    joints = [knob for knob in bench.knobs if knob.kind == "joint"]
    grid = np.meshgrid(*(np.radians(np.linspace(k.low, k.high, 7)) for k in joints))
    poses = np.stack([part.ravel() for part in grid], axis=-1) if grid else np.zeros((1, 0))
    return float(np.min(find_coverage(saved(bench, values), jnp.asarray(poses)).value))


@pytest.mark.parametrize(
    ("name", "turned"),
    [
        pytest.param("folded-pad", {"field of view": 50.0}, marks=pytest.mark.slow),
        pytest.param("finger", {"camera tilt": 15.0}, marks=pytest.mark.nightly),
    ],
)
def test_optimising_sees_more(name, turned):
    bench, values = opened(name)
    values |= turned
    steps = list(bench.optimise(values))
    assert steps[-1].values.keys() == values.keys()
    for knob in bench.knobs:
        assert all(knob.low <= step.values[knob.name] <= knob.high for step in steps)
        if knob.kind == "joint" or knob.name == "field of view":
            assert all(step.values[knob.name] == values[knob.name] for step in steps)
    before, after = (covered_over_range(bench, at) for at in (values, steps[-1].values))
    assert before < 0.95
    assert after > before + 0.05
    assert "it was" in steps[-1].message


def test_what_cannot_be_improved_or_shown_says_so():
    bench = SceneBench(design("circle"))
    assert bench.aim == ""
    values = {knob.name: knob.value for knob in bench.knobs}
    with pytest.raises(UserError, match="straight mirrors only"):
        bench.optimise(values)
    tables = design("folded-pad").file.model_dump(by_alias=True, exclude_unset=True)
    bare = DesignedScene.of(SceneFile.model_validate({**tables, "pads": []}), "bare")
    with pytest.raises(UserError, match=r"add one under \[\[pads\]\]"):
        SceneBench(bare)


def test_a_name_moves_with_what_it_names():
    before = Label("lid", np.array([[0.0, 0.0], [10.0, 0.0]]), 1, 2.0)
    name = PlacedLabel("lid", np.array([5.0, 3.0]), 0.0, np.array([[5.0, 2.0], [5.0, 0.0]]))
    up = moved(name, before, Label("lid", np.array([[2.0, 1.0], [2.0, 21.0]]), 1, 2.0))
    np.testing.assert_allclose(up.middle, [-1.0, 11.0], atol=1e-12)
    np.testing.assert_allclose(up.leader, [[0.0, 11.0], [2.0, 11.0]], atol=1e-12)
    assert np.degrees(up.angle) == pytest.approx(90)
    # Upside down, it is turned to be read.
    back = moved(name, before, Label("lid", np.array([[0.0, 0.0], [-10.0, 0.0]]), 1, 2.0))
    np.testing.assert_allclose(back.middle, [-5.0, -3.0], atol=1e-12)
    assert np.degrees(back.angle) == pytest.approx(0)
