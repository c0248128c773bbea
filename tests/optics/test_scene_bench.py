"""A scene's bench shows what the public functions say of the scene that it saves."""

import functools
import tomllib
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from designopt.errors import UserError
from designopt.plot.drawn_once import DrawnOnce
from designopt.plot.figures import style
from designopt.plot.lettering import Lettering
from optics.explore import scene_picture as scene_bench_picture
from optics.explore.scene_bench import SceneBench
from optics.explore.scene_seeing import _coverage, _quickly, _views
from optics.plot.label_layout import Label, PlacedLabel, moved
from optics.scene.designed import DesignedScene
from optics.scene.file import SceneFile
from optics.scene.reading import parse_scene
from optics.visibility.coverage import find_coverage, find_views
from optics.visibility.sharpness import find_sharpness
from optics.visibility.views import describe_end
from tests.optics.brute_force import coverage, shoot
from tests.optics.scenes import posed

GALLERY = Path(__file__).parents[2] / "studies/gallery/scenes"
NAMES = sorted(path.stem for path in GALLERY.glob("*.toml"))
QUICK = {"finger"}


@functools.cache
def design(name):
    return DesignedScene.read(GALLERY / f"{name}.toml")


def opened(name, **options):
    """A bench drawn into the right half of a figure, the values it begins with, and its canvas."""
    bench = SceneBench(design(name), **options)
    with style():
        figure = Figure(figsize=(12, 6))
        canvas = FigureCanvasAgg(figure)
        halves: Any = figure.subfigures(1, 2)
        bench.draw(halves[1])
    return bench, {knob.name: knob.value for knob in bench.knobs}, canvas


def saved(bench, values):
    """The scene that the saved file describes."""
    (file,) = bench.specs(values)
    assert file.name == "scene.toml"
    return parse_scene(tomllib.loads(file.content))


def readings(shown) -> dict[str, Any]:
    return {reading.name: reading.value for reading in shown.readings}


def by_gid(shown, gid) -> Any:
    return next(artist for artist in shown.artists if artist.get_gid() == gid)


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


def test_joints_come_first_and_dimensions_say_what_they_are():
    knobs = SceneBench(design("finger")).knobs
    assert [knob.kind for knob in knobs] == ["joint"] * 2 + ["dimension"] * 12
    by_name = {knob.name: knob for knob in knobs}
    assert len(by_name) == len(knobs)
    assert [knob.name for knob in knobs[:6]] == [
        "pip",
        "dip",
        "camera tilt",
        "camera x",
        "camera y",
        "field of view",
    ]
    tilt, end = by_name["camera tilt"], by_name["distal mirror: from x"]
    assert (tilt.low, tilt.value, tilt.high) == (-30.0, 0.0, 30.0)
    assert (end.low, end.value, end.high) == pytest.approx((15.24, 23.24, 31.24))
    assert (tilt.unit, end.unit) == ("°", "mm")
    assert set(MOVED) <= set(by_name)
    assert all(knob.low <= knob.value <= knob.high for knob in knobs)
    # A mirror keeps all of its knobs or has none.
    assert len(SceneBench(design("finger"), most=11).knobs) == 2 + 8


def test_the_saved_file_has_the_knobs_numbers_and_the_camera_takes_its_body_along():
    bench, values, _ = opened("finger")
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
    for one, other in zip(jax.tree.leaves(same), jax.tree.leaves(before), strict=True):
        np.testing.assert_allclose(one, other, atol=1e-9)


@pytest.mark.parametrize(
    "turned",
    [
        pytest.param({}, marks=pytest.mark.nightly),
        MOVED,
        pytest.param({"pip": 60.0, "camera tilt": 26.3}, marks=pytest.mark.nightly),
    ],
)
def test_readings_are_those_of_the_saved_scene(turned):
    bench, values, _ = opened("finger")
    values |= turned
    shown = bench.show(values)
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
    ray = posed(scene, angles)
    runs = shoot(ray.surfaces, ray.position, ray.direction, ray.field_of_view, 4001, 1)
    inner, outer = coverage(runs, 3)
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


def test_pictures_show_what_the_readings_say():
    bench, values, _ = opened("finger", floor=2.5)
    bench.show(values)
    values |= {"dip": 60.0, "camera tilt": 26.3}
    shown = bench.show(values)
    found = readings(shown)
    names = [part.name for part in design("finger").scene.layout.pads]
    bars = by_gid(shown, "coverage").get_segments()
    assert [bar[1, 0] for bar in bars] == [found[f"{name}: coverage"] for name in names]
    sharp = [found[f"{name}: least resolution"] for name in names]
    least = by_gid(shown, "least").get_xdata()
    assert list(least) == [number for number in sharp if number is not None]
    covered = np.array([found[f"{name}: coverage"] for name in names])
    assert (covered < 99).any()
    for name, whole in zip(names, covered == 100, strict=True):
        kinds = {artist.get_gid() for artist in shown.artists}
        assert (f"hidden:{name}" in kinds) != whole
    seen = [name for name, part in zip(names, covered, strict=True) if part > 0]
    colors = {by_gid(shown, f"seen:{name}").get_color() for name in seen}
    assert len(colors) == len({*covered[covered > 0]}) > 1
    assert all(artist.get_animated() for artist in shown.artists)


def test_curves_are_coverage_over_the_knob_moved_last():
    bench, values, _ = opened("finger")
    bench.show(values)
    scene = design("finger").scene
    for name, low, high in (("dip", 0.0, 90.0), ("camera tilt", -30.0, 30.0)):
        values[name] = low + 0.4 * (high - low)
        shown = bench.show(values)
        assert by_gid(shown, "now").get_xdata() == pytest.approx([0.4, 0.4])
        for index in (0, 2):
            curve = by_gid(shown, f"curve:{scene.layout.pads[index].name}")
            part, covered = curve.get_data()
            at = 17
            there = saved(bench, {**values, name: low + part[at] * (high - low)})
            dip = low + part[at] * (high - low) if name == "dip" else values["dip"]
            angles = jnp.radians(jnp.array([values["pip"], dip]))
            wanted = find_coverage(there, angles).value[index]
            assert covered[at] == pytest.approx(100 * float(wanted), abs=1e-9)
    texts = {artist.words for artist in shown.artists if isinstance(artist, Lettering)}
    assert {"camera tilt (°)", "-30", "30"} <= texts


def test_a_slider_compiles_nothing_anew():
    bench, values, _ = opened("finger")
    bench.show(values)
    programs: list[Any] = [_quickly(function) for function in (_views, _coverage)]
    before = [program._cache_size() for program in programs]
    for knob in bench.knobs:
        bench.show({**values, knob.name: 0.3 * knob.low + 0.7 * knob.high})
    assert [program._cache_size() for program in programs] == before


def test_axes_stay_until_the_picture_no_longer_fits():
    bench, values, canvas = opened("finger")
    bench.show(values)
    (axes,) = (axes for axes in canvas.figure.subfigs[1].axes if axes.get_title() == "finger")
    limits = axes.get_xlim(), axes.get_ylim()
    for pip in (0.0, 45.0, 90.0):
        bench.show({**values, "pip": pip})
        assert (axes.get_xlim(), axes.get_ylim()) == limits
    far = {**values, "camera y": 60.0}
    bench.show(far)
    assert axes.get_ylim()[1] > 60 > limits[1][1]
    limits = axes.get_xlim(), axes.get_ylim()
    bench.show({**far, "camera y": 59.0})
    assert (axes.get_xlim(), axes.get_ylim()) == limits


def legend_of(shown):
    (legend,) = (artist for artist in shown.artists if isinstance(artist, DrawnOnce))
    return legend


def told(legend):
    return [text.get_text() for text in legend.artist.get_texts()]


def test_the_legend_tells_of_all_few_paths_and_is_drawn_once():
    bench, values, _ = opened("finger")
    legend = legend_of(bench.show(values))
    pads = ["pad, seen", "pad, seen in part", "pad, hidden", "sensing side of a pad"]
    assert told(legend)[:4] == pads
    assert told(legend)[-3:] == ["direct", "mirror:distal", "mirror:proximal"]
    for angle in (45.0, 90.0):
        assert legend_of(bench.show({**values, "pip": angle})) is legend


def test_of_many_paths_it_tells_of_those_that_have_seen_anything(monkeypatch):
    monkeypatch.setattr(scene_bench_picture, "FEW", 2)
    bench, values, _ = opened("finger")
    before = legend_of(bench.show(values))
    assert told(before)[-2:] == ["direct", "mirror:distal"]
    bent = {**values, "pip": 90.0, "dip": 90.0}
    after = legend_of(bench.show(bent))
    assert after is not before
    assert told(after)[-3:] == ["direct", "mirror:distal", "mirror:proximal"]
    assert legend_of(bench.show(values)) is after
    section: Any = after.axes
    kept = [child for child in section.get_children() if isinstance(child, DrawnOnce)]
    assert kept == [after]


def test_a_section_is_true_to_scale_even_where_there_is_nothing_to_see():
    bench, values, canvas = opened("finger")
    bench.show(values)
    (axes,) = (axes for axes in canvas.figure.subfigs[1].axes if axes.get_title() == "finger")
    for size in ((12, 6), (6, 9)):
        canvas.figure.set_size_inches(*size)
        ends = {"from x": "to x", "from y": "to y"}
        flat = {f"distal mirror: {a}": values[f"distal mirror: {b}"] for a, b in ends.items()}
        assert bench.show({**values, **flat}).message
        across, up = np.diff(axes.transData.transform([(0, 0), (1, 1)]), axis=0)[0]
        assert across == pytest.approx(up, rel=1e-9)


def test_a_message_says_which_pad_is_hidden_and_what_ends_the_view():
    bench, values, _ = opened("finger")
    assert bench.show(values).message == ""
    values["camera tilt"] = 26.3
    message = bench.show(values).message
    found = readings(bench.show(values))
    names = [part.name for part in design("finger").scene.layout.pads]
    worst = min(names, key=lambda name: found[f"{name}: coverage"])
    assert message.startswith(f"pad '{worst}': ")
    views = find_views(saved(bench, values), jnp.zeros(2)).value
    pad = names.index(worst)
    there = np.flatnonzero(views.present[pad])
    assert there.size
    ends = [
        describe_end(design("finger").scene.layout, int(label[pad, piece]))
        for piece in there
        for label in (views.start_label, views.end_label)
    ]
    told = message.partition("what is seen ends at: ")[2].split("; pad ")[0].split("; ")
    assert set(told) <= set(ends)
    narrow = {**values, "field of view": 80.0, "camera tilt": -30.0}
    hidden = bench.show(narrow)
    assert "none of it is seen; nearest to showing any of it is" in hidden.message
    assert "widen one of them" in hidden.message
    short = [name for name in names if readings(hidden)[f"{name}: coverage"] < 100]
    assert len(short) > 1
    assert all(f"pad '{name}': " in hidden.message for name in short)


def test_a_scene_that_cannot_be_is_told_and_leaves_the_picture():
    bench, values, _ = opened("finger")
    shown = bench.show(values)
    ends = {f"distal mirror: {end} {axis}": 20.0 for end in ("from", "to") for axis in "xy"}
    told = bench.show(values | ends)
    assert told.message == "finger: mirrors.0: it has no length; move 'from' or 'to'"
    assert [reading.name for reading in told.readings] == [
        reading.name for reading in shown.readings
    ]
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


def test_the_header_tells_the_pose():
    bench, values, _ = opened("finger")
    (file,) = bench.specs(values | {"pip": 35.0})
    first = file.content.splitlines()[0]
    assert first == "# finger as explored; in the picture it had --pose pip=35,dip=0"


@pytest.mark.slow
def test_a_point_that_all_rays_meet_has_no_resolution():
    bench, values, _ = opened("ellipse")
    found = readings(shown := bench.show(values))
    assert found["target: coverage"] == 0
    assert found["target: least resolution"] is None
    assert found["target: median resolution"] is None
    assert shown.message == (
        "pad 'target': none of it is seen; all rays to it meet it in single points"
    )
    # Its rays are drawn all the same.
    assert by_gid(shown, "ray:mirror:bowl:target") is not None


@pytest.mark.slow
def test_the_camera_is_drawn_whole():
    for name in ("finger", "periscope"):
        bench, values, canvas = opened(name)
        for x in ("low", "value", "high"):
            moves = {k.name: getattr(k, x) for k in bench.knobs if k.name.startswith("camera ")}
            sign = by_gid(bench.show({**values, **moves}), "camera")
            canvas.draw()
            ends = sign.get_window_extent(canvas.get_renderer())
            frame = sign.axes.bbox
            assert frame.x0 < ends.x0 < ends.x1 < frame.x1
            assert frame.y0 < ends.y0 < ends.y1 < frame.y1


def test_a_curved_mirror_has_a_radius_that_its_ends_allow():
    bench = SceneBench(design("circle"))
    values = {knob.name: knob.value for knob in bench.knobs}
    assert float(saved(bench, values | {"bowl mirror: radius": 80.0}).radii[0]) == 80
    with pytest.raises(UserError, match="make 'radius' longer than 40"):
        bench.specs(values | {"bowl mirror: radius": 40.0})


@pytest.mark.parametrize(
    "name",
    [name if name in QUICK else pytest.param(name, marks=pytest.mark.nightly) for name in NAMES],
)
def test_every_scene_of_the_gallery_bears_its_knobs(name):
    bench, values, canvas = opened(name)
    shown = bench.show(values)
    names = [reading.name for reading in shown.readings]
    canvas.draw()
    # Curved mirrors are looked into by rays, which takes longer.
    knobs = bench.knobs[::3] if bench.aim == "" else bench.knobs
    for knob in knobs:
        for end in (knob.low, knob.high):
            shown = bench.show({**values, knob.name: end})
            assert [reading.name for reading in shown.readings] == names
    for artist in shown.artists:
        (artist.axes or canvas.figure).draw_artist(artist)
    before, after = design(name).scene, saved(bench, values)
    assert before.layout == after.layout
    for one, other in zip(jax.tree.leaves(before), jax.tree.leaves(after), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-9)


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
    bench, values, _ = opened(name)
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
