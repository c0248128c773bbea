"""A linkage's explorer: what it shows, and what dragging gives, is what the library computes."""

import functools
import math
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from designopt.explore.explorer import Chart, View
from kinematics import find_limits
from kinematics.explore.explorer import LinkageExplorer
from kinematics.export.drawing import make_linkage_drawing
from kinematics.io.designed import DesignedLinkage
from kinematics.io.sketch import parse_sketch
from tests.designopt.explore.whole import show
from tests.helpers import nightly
from tests.kinematics.gallery import (
    FOLDER,
    PUSHED,
    each_linkage,
    ends,
    gallery,
    gallery_tables,
    poses_of,
    tables_of,
    transmission_of,
)

LOCKS = {"bodies.ground.O2-O4": 170.0, "bodies.coupler.A-B": 100.0, "bodies.rocker.O4-B": 90.0}
NO_POSE = {"bodies.rocker.O4-B": 40.0, "bodies.coupler.A-B": 204.0, "bodies.crank.O2-A": 20.0}


@functools.cache
def explorer_of(name):
    return LinkageExplorer(DesignedLinkage.read(FOLDER / f"{name}.toml"))


def explorer(tables):
    return LinkageExplorer(DesignedLinkage.of(parse_sketch(tables, "x"), "x"))


def start(one, **changed):
    values = one.values()
    assert changed.keys() <= values.keys()
    return values | changed


def readouts(state):
    return {readout.name: readout.value for readout in state.readouts}


def panels(state) -> tuple[Any, ...]:
    view, *charts = state.panels
    assert isinstance(view, View)
    assert all(isinstance(chart, Chart) for chart in charts)
    return view, *charts


def linkage_of(one, values):
    """The linkage of these values, and its inputs, rad or mm."""
    design = one.design
    linkage = design.dimensions.linkage(design.poses.linkage, jnp.asarray(design.distances(values)))
    named = enumerate(linkage.input_names)
    return linkage, np.array([design.inside(column, values[name]) for column, name in named])


def pins(view, name):
    """Where the circles of a pin are."""
    return [circle.center for circle in view.drawing.circles if circle.name == name]


def check(one, values):
    """Every number, pin and note is what the public functions compute of a linkage built anew."""
    state = show(one, values)
    view, *charts = panels(state)
    found = readouts(state)
    assert all(value is None or math.isfinite(value) for value in found.values())
    if found["margin"] is None:
        assert "no triangle" in state.message
        return state
    linkage, inputs = linkage_of(one, values)
    pose = poses_of(linkage, inputs)
    assert bool(pose.ok) == (state.message == "")
    np.testing.assert_allclose(found["margin"], pose.margin, rtol=0, atol=1e-9)
    for pin, angle in transmission_of(linkage, inputs).angles.items():
        if bool(pose.ok):
            np.testing.assert_allclose(found[f"μ at {pin}"], np.degrees(angle), rtol=0, atol=1e-6)
        else:
            assert found[f"μ at {pin}"] is None
    kinds = {layer.kind for layer in view.drawing.layers} - {"path"}
    assert kinds == ({"body"} if bool(pose.ok) else {"construction"})
    assert bool(view.handles) == bool(pose.ok)
    for handle in view.handles:
        place = pose.value.position(handle.name.removeprefix("pin "))
        np.testing.assert_allclose(handle.place, place, rtol=0, atol=1e-8)
        for center in pins(view, handle.name.removeprefix("pin ")):
            np.testing.assert_allclose(center, place, rtol=0, atol=1e-8)
    first = panels(show(one, one.values()))[1:]
    assert [chart.name for chart in charts] == [chart.name for chart in first]
    return state


def test_no_move_compiles_anything():
    """The first one that locks, or that no triangle allows, is no exception.

    It stands first, before other tests have compiled what runs outside of the jitted functions.
    """
    one = explorer(gallery_tables("watt", {"linkage/name": "compiled by no other test"}))
    show(one, start(one))
    ends = [*one.joints, *one.design.parameters]
    moves = [{each.name: end} for each in ends for end in (each.high, each.low)]
    moves.append({each.name: each.low for each in one.design.parameters})
    compiled = []

    def heard(event: str, *_: Any, **__: Any) -> None:
        if event == "/jax/core/compile/backend_compile_duration":
            compiled.append(event)

    jax.monitoring.register_event_duration_secs_listener(heard)
    try:
        messages = [show(one, start(one, **move)).message for move in moves]
        assert any("locks at" in message for message in messages)
        for handle in panels(show(one, start(one)))[0].handles:
            one.drag(start(one), handle.name, (handle.place[0] + 1, handle.place[1]))
        assert not compiled
        jax.jit(lambda number: number + len(moves))(1.0)
        assert compiled
    finally:
        jax.monitoring.unregister_event_duration_listener(heard)


@each_linkage(quick=("quick-return",))
def test_every_value_shows_what_the_library_computes(name):
    """At the start and at both ends of every range."""
    one = explorer_of(name)
    for each in (*one.joints, *one.design.parameters):
        assert each.low <= each.value <= each.high
        for value in (each.low, each.high):
            check(one, start(one, **{each.name: value}))
    assert check(one, start(one)).message == ""


@each_linkage(quick=("four-bar",))
def test_the_first_pose_is_drawn_as_the_exporters_draw_it(name):
    """And before anything is computed the same, without curves."""
    one = explorer_of(name)
    wanted = make_linkage_drawing(DesignedLinkage.read(FOLDER / f"{name}.toml"))
    (sketch,) = one.sketch()
    shown, *_ = panels(show(one, start(one)))
    for view in (sketch, shown):
        circles, lines = view.drawing.circles, view.drawing.polylines
        lines = [line for line in lines if not line.name.startswith("path")]
        assert [part.name for part in circles] == [part.name for part in wanted.circles]
        np.testing.assert_allclose(
            [(*part.center, part.radius) for part in circles],
            [(*part.center, part.radius) for part in wanted.circles],
            atol=1e-8,
        )
        places = [place for line in wanted.polylines for place in line.places]
        if name not in ("quick-return", "scotch-yoke", "slider-crank") or view is sketch:
            # Lines that joints slide along are drawn over what they travel.
            found = [place for line in lines for place in line.places]
            np.testing.assert_allclose(found, places, atol=1e-8)
    assert [handle.name for handle in sketch.handles] == [handle.name for handle in shown.handles]


def test_the_four_bar_in_words_and_numbers():
    one = explorer_of("four-bar")
    (crank,) = one.joints
    assert (crank.low, crank.high, crank.unit) == (0.0, 360.0, "°")
    state = show(one, start(one, crank=90.0))
    # By the law of cosines: B is at the ends of 120 and 80.
    diagonal = math.hypot(40, 100)
    angle = math.degrees(math.acos((120**2 + 80**2 - diagonal**2) / (2 * 120 * 80)))
    assert readouts(state) == {
        "crank": 90.0,
        "margin": pytest.approx(diagonal - 40),
        "μ at B": pytest.approx(angle),
        "least μ in the working range": pytest.approx(26.384329749),
    }
    view, *_ = panels(state)
    assert view.notes["crank"] == "O2–A 40 mm, at 90.00°"
    assert view.notes["ground"] == "O2–O4 100 mm"
    assert view.notes["B"].endswith(f" mm, μ {angle:.2f}°")
    assert readouts(show(one, start(one, **LOCKS)))["least μ in the working range"] is None


def test_limits_of_a_watt():
    """Its curves end where `find_limits` finds that it locks, and there it is drawn faintly."""
    one = explorer_of("watt")
    limits = [limit.value for limit in ends(find_limits(gallery("watt"), "crank"))]
    (crank,) = one.joints
    for limit, value in zip(limits, (crank.low, crank.high), strict=True):
        state = show(one, start(one, crank=value))
        assert state.message.endswith(f"crank locks at {math.degrees(limit):.2f}°.")
        view, margin, angle = panels(state)
        for chart, top in ((margin, margin.y_range[1] / 1.05), (angle, 90.0)):
            (locks,) = [series for series in chart.series if series.name == "locks"]
            x = np.reshape(locks.x, (2, 3))
            np.testing.assert_allclose(x[:, :2], np.degrees([[end] * 2 for end in limits]))
            np.testing.assert_allclose(np.reshape(locks.y, (2, 3))[:, :2], [[0, top]] * 2)
            assert np.isnan(x[:, 2]).all()
        pose = poses_of(gallery("watt"), np.array([limit + 1e-7 * (1 if value < 0 else -1)]))
        np.testing.assert_allclose(pins(view, "D")[0], pose.value.position("D"), atol=0.05)


def test_charts_are_the_margin_and_the_angles_of_the_linkage():
    one = explorer_of("watt")
    _, margin, angle = panels(show(one, start(one)))
    (crank,) = one.joints
    assert (margin.x_label, margin.y_label, angle.y_label) == ("crank (°)", "margin (mm)", "μ (°)")
    assert margin.at == angle.at == crank.value
    assert angle.y_range == (0.0, 90.0)
    cranks = np.radians(margin.series[0].x)[:, None]
    poses = poses_of(gallery("watt"), cranks)
    good = np.asarray(poses.ok)
    assert not good.all()
    # A limit itself is one by rounding only.
    inside = np.abs(np.where(good, poses.margin, 1.0)) > 1e-3
    wanted = np.where(good, poses.margin, np.nan)
    np.testing.assert_allclose(np.array(margin.series[0].y)[inside], wanted[inside], atol=1e-9)
    angles = transmission_of(gallery("watt"), cranks).angles
    for series in angle.series[:2]:
        wanted = np.where(good, np.degrees(angles[series.name.removeprefix("μ at ")]), np.nan)
        np.testing.assert_allclose(np.array(series.y)[inside], wanted[inside], atol=1e-6)
    assert [series.name for series in angle.series] == ["μ at B", "μ at D", "locks", "usual least"]


def test_the_input_that_moved_last_is_the_abscissa():
    one = explorer_of("five-bar")
    show(one, start(one, left=one.values()["left"] + 1.0))
    labels = []
    for changed in ({}, {"right": 60.0}, {"right": 60.0, "bodies.ground.O2-O5": 13.0}, {}):
        labels.append(panels(show(one, start(one, **changed)))[1].x_label)
    assert labels == ["left (°)", "right (°)", "right (°)", "right (°)"]
    assert panels(show(one, start(one, left=20.0)))[2].at == 20.0


def test_the_traced_curve_is_the_joints_path():
    """In pieces, where the linkage locks between."""
    one = explorer_of("four-bar")
    for changed, pieces in (({"bodies.coupler.A-B": 110.0}, 1), (LOCKS, 2)):
        values = start(one, **changed)
        view, *_ = panels(show(one, values))
        (layer,) = [layer.name for layer in view.drawing.layers if layer.kind == "path"]
        lines = [line for line in view.drawing.polylines if line.layer == layer]
        paths = [np.array(line.places) for line in lines if line.name == "path of B"]
        assert len(paths) == pieces
        linkage, _ = linkage_of(one, values)
        cranks = np.linspace(0, 2 * np.pi, 121)[:, None]
        poses = poses_of(linkage, cranks)
        wanted = np.asarray(poses.value.position("B"))[np.asarray(poses.ok)]
        found = np.vstack(paths)
        assert len(found) - len(wanted) == (0 if pieces == 1 else 2)  # where it locks
        for place in wanted:
            assert np.min(np.hypot(*(found - place).T)) < 1e-9


def test_a_slide_in_millimetres():
    """C reaches as far as crank and rod together, from the foot of the line."""
    one = explorer(PUSHED)
    (push,) = one.joints
    assert (push.name, push.unit) == ("push", "mm")
    reach = math.hypot(20, 35) + math.hypot(107, 55)
    farthest = math.sqrt(reach**2 - 20**2)
    assert push.high > farthest
    assert readouts(show(one, start(one)))["push"] == 127.0
    message = show(one, start(one, push=push.high)).message
    assert message.endswith(f"push locks at {farthest:.3f} mm.")
    # Its joint is dragged along its line, and takes the rod with it.
    found = one.drag(start(one), "pin C", (120.0, 3.0))
    assert found["push"] == pytest.approx(120.0)
    assert found["bodies.rod.A-C"] == pytest.approx(math.hypot(100, 55))


def test_where_nothing_assembles_it_is_said():
    one = explorer_of("four-bar")
    state = check(one, start(one, **NO_POSE))
    assert state.message.endswith("No crank in its range gives a pose.")
    open_one = explorer_of("watt")
    short = {name: 0.5 * open_one.values()[name] for name in ("bodies.rocker.O4-B",)}
    short["bodies.rocker.B-C"] = 1.7 * open_one.values()["bodies.rocker.B-C"]
    short["bodies.rocker.O4-C"] = 0.5 * open_one.values()["bodies.rocker.O4-C"]
    state = check(open_one, start(open_one, **short))
    assert state.message.startswith("rocker: ")
    values = start(open_one, **short)
    assert open_one.drag(values, "pin A", (0.0, 0.0)) == values


@pytest.mark.parametrize("name", ["watt", *nightly("quick-return", "five-bar", "jansen", "finger")])
def test_a_dragged_joint_is_where_it_was_dragged_and_the_others_stay(name):
    one = explorer_of(name)
    values = start(one)
    before, *_ = panels(show(one, values))
    places = {handle.name: np.array(handle.place) for handle in before.handles}
    ground = gallery(name).structure.fixed_joints
    assert f"pin {ground[0]}" not in places
    origin, second = np.asarray(gallery(name).anchors)[:2]
    level = (second - origin) / np.hypot(*(second - origin))
    for handle in before.handles:
        joint = handle.name.removeprefix("pin ")
        target = places[handle.name] + (0.4, 0.3)
        found = one.drag(values, handle.name, tuple(target.tolist()))
        assert {key for key in found if found[key] != values[key]} <= {*handle.parameters}
        after = {h.name: np.array(h.place) for h in panels(show(one, found))[0].handles}
        step = places[handle.name] - origin
        if joint in ground and abs(level[0] * step[1] - level[1] * step[0]) < 1e-6:
            target = origin + level * ((target - origin) @ level)  # along the ground
        if (name, joint) in {("quick-return", "T"), ("quick-return", "R")}:
            continue  # on lines: test_a_joint_on_a_line_is_dragged_along_it
        np.testing.assert_allclose(after.pop(handle.name), target, atol=1e-6)
        # What hangs on a lever that the joint has turned goes with it.
        still = {} if (name, joint) in {("quick-return", "A"), ("quick-return", "O2")} else after
        for other, place in still.items():
            np.testing.assert_allclose(place, places[other], atol=1e-6, err_msg=handle.name)


def test_a_joint_on_a_line_is_dragged_along_it():
    """The lever's end along the lever, whose angle is the crank's; the ram along its line."""
    one = explorer_of("quick-return")
    values = start(one, crank=40.0)
    view, *_ = panels(show(one, values))
    places = {handle.name: np.array(handle.place) for handle in view.handles}
    for pin, along in (("pin T", places["pin T"] - (0, -25)), ("pin R", np.array([1.0, 0.0]))):
        along = along / np.hypot(*along)
        aside = np.array([-along[1], along[0]])
        target = places[pin] + 0.5 * along + 0.3 * aside
        view, *_ = panels(show(one, one.drag(values, pin, tuple(target.tolist()))))
        found = {handle.name: handle.place for handle in view.handles}[pin]
        np.testing.assert_allclose(found, places[pin] + 0.5 * along, atol=1e-6)


def test_dragging_ends_at_the_ends_of_ranges():
    """A, dragged far away, is where crank and coupler are as long as they can be."""
    one = explorer_of("four-bar")
    values = start(one)
    before, *_ = panels(show(one, values))
    places = {handle.name: handle.place for handle in before.handles}
    found = one.drag(values, "pin A", (300.0, -400.0))
    for parameter in one.design.parameters:
        assert parameter.low <= found[parameter.name] <= parameter.high
    assert found["bodies.crank.O2-A"] == pytest.approx(1.7 * 40, rel=1e-6)
    after, *_ = panels(show(one, found))
    moved = {handle.name: handle.place for handle in after.handles}
    np.testing.assert_allclose(moved["pin B"], places["pin B"], atol=1e-3)
    # Of a full turn the angle goes on at the other end; beyond a lock nothing can be dragged.
    turned = one.drag(values, "pin A", (39.0, -5.0))
    assert turned["crank"] == pytest.approx(360 - math.degrees(math.atan2(5, 39)))
    locked = start(one, crank=180.0, **LOCKS)
    assert one.drag(locked, "pin A", (39.0, -5.0)) == locked
    assert one.drag(values, "pin O2", (1.0, 1.0)) == one.drag(values, "lens", (1.0, 1.0)) == values


def test_a_corner_stays_on_its_side_of_its_body():
    one = explorer_of("watt")
    values = start(one)
    joints = {h.name.removeprefix("pin "): h.place for h in panels(show(one, values))[0].handles}
    first, second, corner = (complex(*joints[joint]) for joint in ("O4", "B", "C"))
    along = second - first
    height = ((corner - first) / along).imag
    mirrored = first + along * complex(0.55, -height)
    found = one.drag(values, "pin C", (mirrored.real, mirrored.imag))
    lengths = [found[f"bodies.rocker.{pair}"] for pair in ("O4-B", "O4-C", "B-C")]
    assert lengths[1] + lengths[2] == pytest.approx(lengths[0], rel=1e-3)  # as D lets it


def test_what_can_be_dragged_of_a_scotch_yoke():
    one = explorer_of("scotch-yoke")
    view, *_ = panels(show(one, start(one)))
    places = {handle.name: handle.place for handle in view.handles}
    assert [*places] == ["pin A", "pin Z"]
    # The yoke does not turn: its end moves along it.
    found = one.drag(start(one), "pin Z", (places["pin Z"][0] - 3, places["pin Z"][1] + 2))
    assert found == start(one) | {"bodies.yoke.Y-Z": pytest.approx(47.0)}


def test_without_transmission_angles_there_is_one_chart():
    one = explorer(tables_of({"O": [0, 0], "A": [30, 0]}, "O", {"crank": "O A"}))
    state = check(one, start(one))
    assert [panel.name for panel in state.panels] == ["Linkage", "Margin"]
    found = one.drag(start(one), "pin A", (0.0, 40.0))
    assert (found["crank"], found["bodies.crank.O-A"]) == (pytest.approx(90), pytest.approx(40))
