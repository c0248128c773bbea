"""A linkage's bench: what it shows, saves and improves is what the library computes."""

import functools
import math
import tomllib
from typing import Any

import jax
import numpy as np
import pytest

from designopt import UserError
from kinematics import compute_spring_energy, find_limits, parse_linkage
from kinematics.explore.bench import LinkageBench
from kinematics.explore.optimising import PATIENCE, UPDATES
from kinematics.io.designed import DesignedLinkage
from kinematics.io.sketch import parse_sketch
from tests.helpers import assert_same, figure_of, nightly, readings
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

NO_POSE = {"rocker O4-B": 40.0, "coupler A-B": 204.0}
LOCKS = {"ground O2-O4": 170.0, "coupler A-B": 100.0, "rocker O4-B": 90.0}


@functools.cache
def bench_of(name):
    """A bench drawn into a figure."""
    return drawn(DesignedLinkage.read(FOLDER / f"{name}.toml"))


def drawn(design):
    bench = LinkageBench(design)
    figure_of(bench)
    return bench


def start(bench, **changed):
    values = {knob.name: knob.value for knob in bench.knobs}
    assert changed.keys() <= values.keys()
    return values | changed


def inputs_of(linkage, values):
    parts = linkage.structure.inputs
    shown = [(values[part.name], part.slider is None) for part in parts]
    return np.array([math.radians(value) if turns else value for value, turns in shown])


def check(bench, values):
    """Show values; every number is what the public functions compute of a linkage built anew."""
    shown = bench.show(values)
    found = readings(shown)
    assert all(value is None or math.isfinite(value) for value in found.values())
    linkage = bench.linkage(values)
    inputs = inputs_of(linkage, values)
    if found["margin"] is None:
        assert "no triangle" in shown.message
        return shown
    pose = poses_of(linkage, inputs)
    assert bool(pose.ok) == (shown.message == "")
    np.testing.assert_allclose(found["margin"], pose.margin, rtol=0, atol=1e-9)
    for pin, angle in transmission_of(linkage, inputs).angles.items():
        if bool(pose.ok):
            np.testing.assert_allclose(found[f"μ at {pin}"], np.degrees(angle), rtol=0, atol=1e-6)
        else:
            assert found[f"μ at {pin}"] is None
    return shown


def saved(bench, values):
    (file,) = bench.specs(values)
    assert file.name == "linkage.toml"
    return parse_linkage(tomllib.loads(file.content), file.name)


def check_saved(bench, values):
    """The file is the same linkage, in the same pose at the same inputs."""
    linkage, inputs = bench.linkage(values), inputs_of(bench.linkage(values), values)
    if not bool(poses_of(linkage, inputs).ok):
        inputs = bench._design.linkage.reference.inputs
    again = saved(bench, values)
    assert_same((again.anchors, again.links), (linkage.anchors, linkage.links), rtol=0, atol=1e-9)
    np.testing.assert_allclose(np.cos(again.reference.inputs - inputs), 1.0, atol=1e-12)
    assert again.assembly == linkage.assembly
    here, there = poses_of(linkage, inputs), poses_of(again, inputs)
    assert bool(there.ok)
    for joint in linkage.structure.joints:
        np.testing.assert_allclose(
            here.value.position(joint), there.value.position(joint), rtol=0, atol=1e-8
        )


def test_no_move_compiles_anything():
    """The first one that locks, or that no triangle allows, is no exception.

    It stands first, before other tests have compiled what runs outside of the jitted functions.
    """
    tables = gallery_tables("four-bar", {"linkage/name": "compiled by no other test"})
    bench = drawn(DesignedLinkage.of(parse_sketch(tables, "x"), "x"))
    bench.show(start(bench))
    moves = [{knob.name: end} for knob in bench.knobs for end in (knob.high, knob.low)]
    moves.append({knob.name: knob.low for knob in bench.knobs if knob.kind == "dimension"})
    moves.append(
        moves[-1] | {knob.name: knob.high for knob in bench.knobs if "ground" in knob.name}
    )
    compiled = []

    def heard(event: str, *_: Any, **__: Any) -> None:
        if event == "/jax/core/compile/backend_compile_duration":
            compiled.append(event)

    jax.monitoring.register_event_duration_secs_listener(heard)
    try:
        messages = [bench.show(start(bench, **move)).message for move in moves]
        assert any("locks at" in message or "gives a pose" in message for message in messages)
        assert not compiled
        jax.jit(lambda number: number + len(moves))(1.0)
        assert compiled
    finally:
        jax.monitoring.unregister_event_duration_listener(heard)


@each_linkage(quick=("quick-return",))
def test_every_knob_shows_what_the_library_computes(name):
    """At the start and at both ends of every knob."""
    bench = bench_of(name)
    check_saved(bench, start(bench))
    for knob in bench.knobs:
        assert knob.low < knob.value < knob.high
        for value in (knob.low, knob.high):
            check(bench, start(bench, **{knob.name: value}))
    assert check(bench, start(bench)).message == ""


def test_what_is_saved_is_the_linkage_as_it_stands():
    bench = bench_of("finger")
    turned = {
        knob.name: knob.value + (7.0 if knob.kind == "joint" else 0.02 * knob.value)
        for knob in bench.knobs
    }
    check_saved(bench, turned)
    (file,) = bench.specs(turned)
    sketch = parse_sketch(tomllib.loads(str(file.content)), "saved")
    knobs = {knob.name: knob.value for knob in LinkageBench(DesignedLinkage.of(sketch, "x")).knobs}
    for knob in bench.knobs:
        if knob.kind == "dimension":
            np.testing.assert_allclose(knobs[knob.name], turned[knob.name], rtol=0, atol=1e-9)
    # Springs are as taut as they were.
    linkages = gallery("finger"), saved(bench, start(bench, pip=-40.0, dip=-25.0))
    inputs = np.radians([-60.0, -10.0])
    energies = [compute_spring_energy(one, poses_of(one, inputs).value) for one in linkages]
    np.testing.assert_allclose(*energies, rtol=1e-9)


def test_what_is_saved_where_it_locks_is_in_the_first_pose():
    bench = bench_of("four-bar")
    values = start(bench, crank=180.0, **LOCKS)
    assert bench.show(values).message
    check_saved(bench, values)
    assert "in its first pose" in bench.specs(values)[0].title
    with pytest.raises(UserError, match="cannot be sketched"):
        bench.specs(start(bench, **NO_POSE))


def least_of_four_bar(lengths, crank):
    """Its transmission angle by the law of cosines, degrees."""
    a, b, c, d = lengths
    diagonal = a * a + d * d - 2 * a * d * np.cos(crank)
    return math.degrees(np.arccos(np.max(np.abs(b * b + c * c - diagonal) / (2 * b * c))))


def test_the_transmission_angle_of_a_four_bar():
    """By the law of cosines; least where the crank lies along the ground."""
    bench = bench_of("four-bar")
    lengths = 40.0, 120.0, 80.0, 100.0
    for crank in (10.0, 75.0, 200.0):
        found = readings(bench.show(start(bench, crank=crank)))["μ at B"]
        np.testing.assert_allclose(found, least_of_four_bar(lengths, math.radians(crank)))
    found = readings(bench.show(start(bench)))["least μ"]
    np.testing.assert_allclose(found, least_of_four_bar(lengths, np.array([0.0, math.pi])))
    crank = bench.knobs[0]
    assert (crank.low, crank.high, crank.unit, crank.kind) == (0.0, 360.0, "°", "joint")
    # A crank that locks around 180° has one range, wherever its turn is cut.
    found = [readings(bench.show(start(bench, crank=at, **LOCKS)))["least μ"] for at in (5, 355)]
    limit = math.acos((40**2 + 170**2 - 190**2) / (2 * 40 * 170))
    least = least_of_four_bar((40, 100, 90, 170), 0.96 * limit)  # 2 % of twice the limit
    np.testing.assert_allclose(found, [least, least], atol=1e-4)


def test_limits_of_a_watt():
    """Least transmission angle by a sweep from limit to limit, which are found apart."""
    bench = bench_of("watt")
    limits = [limit.value for limit in ends(find_limits(gallery("watt"), "crank"))]
    knob = bench.knobs[0]
    for limit, value in zip(np.degrees(limits), (knob.low, knob.high), strict=True):
        message = bench.show(start(bench, crank=value)).message
        assert message.endswith(f"crank locks at {limit:.2f}°.")
        survey = bench._surveyor.survey(
            bench.distances(start(bench)), np.radians([value]), 0, bench._spans[0]
        )
        nearest = min(np.abs(np.degrees([edge.value for edge in survey.edges]) - limit))
        assert nearest < 1e-5
    inset = 0.02 * (limits[1] - limits[0])
    cranks = np.linspace(limits[0] + inset, limits[1] - inset, 1201)[:, None]
    angles = transmission_of(gallery("watt"), cranks).angles
    wanted = math.degrees(min(float(np.min(angle)) for angle in angles.values()))
    for crank in (-80.0, 100.0):
        least = readings(bench.show(start(bench, crank=crank)))["least μ"]
        np.testing.assert_allclose(least, wanted, rtol=0, atol=0.02)


def test_the_traced_curve_is_the_joints_path():
    bench = bench_of("four-bar")
    values = start(bench, **{"coupler A-B": 110.0})
    path: Any
    (path,) = [one for one in bench.show(values).artists if one.get_gid() == "path:B"]
    places = np.asarray(path.get_xydata())
    poses = poses_of(bench.linkage(values), np.linspace(0, 2 * np.pi, len(places))[:, None])
    wanted = np.where(poses.ok[:, None], poses.value.position("B"), np.nan)
    np.testing.assert_allclose(places, wanted, rtol=0, atol=1e-9)


def test_a_slide_in_millimetres():
    """C reaches as far as crank and rod together, from the foot of the line."""
    bench = drawn(DesignedLinkage.of(parse_sketch(PUSHED, "push.toml"), "push.toml"))
    knob = bench.knobs[0]
    assert (knob.name, knob.unit) == ("push", "mm")
    reach = math.hypot(20, 35) + math.hypot(107, 55)
    farthest = math.sqrt(reach**2 - 20**2)
    assert knob.high > farthest
    assert readings(bench.show(start(bench)))["push"] == 127.0
    message = bench.show(start(bench, push=knob.high)).message
    assert message.endswith(f"push locks at {farthest:.3f} mm.")


@pytest.mark.parametrize(
    "name", ["four-bar", *nightly("watt", "five-bar", "slider-crank", "finger")]
)
def test_lengths_found_transmit_better(name):
    """What is told is what is read; joints stay, and dimensions stay within their knobs."""
    bench = bench_of(name)
    values = start(bench)
    steps = list(bench.optimise(values))
    assert len(steps) <= UPDATES + 1
    for step in steps:
        assert step.values.keys() == values.keys()
        for knob in bench.knobs:
            if knob.kind == "joint":
                assert step.values[knob.name] == values[knob.name]
            else:
                assert knob.low - 1e-9 <= step.values[knob.name] <= knob.high + 1e-9
    last = steps[-1]
    least = [readings(bench.show(values))["least μ"] for values in (values, last.values)]
    assert least[1] > least[0] + 5
    told = f"least transmission angle {least[1]:.1f}° instead of {least[0]:.1f}°; "
    assert last.message.startswith(told)
    # Where nothing is better, it stays.
    *further, end = bench.optimise(last.values)
    if len(steps) <= UPDATES:
        assert len(further) <= PATIENCE
        assert end.values == last.values
    if name == "four-bar":
        names = ("crank O2-A", "coupler A-B", "rocker O4-B", "ground O2-O4")
        check_best_four_bar(*(last.values[name] for name in names))


def check_best_four_bar(a, b, c, d):
    """By the law of cosines, with every crank angle; the crank still turns all the way."""
    lengths = sorted((a, b, c, d))
    assert lengths[0] == a
    assert lengths[0] + lengths[3] < lengths[1] + lengths[2]  # Grashof's condition
    least = least_of_four_bar((a, b, c, d), np.linspace(0, 2 * np.pi, 3601))
    # With equal deviations from 90° at both ends of the ground, sin of it is a d / (b c): least
    # at the shortest crank and the longest coupler and rocker that balance b² + c² = a² + d².
    np.testing.assert_allclose(b * b + c * c, a * a + d * d, rtol=1e-3)
    assert a == pytest.approx(20.0, rel=1e-3)
    np.testing.assert_allclose(least, 90 - math.degrees(math.asin(a * d / (b * c))), atol=0.1)
    assert least > 76.0


def test_what_cannot_be_optimised_is_refused():
    bench = bench_of("four-bar")
    with pytest.raises(UserError, match="gives a pose"):
        next(bench.optimise(start(bench, **NO_POSE, **{"crank O2-A": 20.0})))


def test_without_transmission_angles_there_is_no_aim():
    lone = tables_of({"O": [0, 0], "A": [30, 0]}, "O", {"crank": "O A"})
    bench = LinkageBench(DesignedLinkage.of(parse_sketch(lone, "lone"), "lone"))
    assert bench.aim == ""
    with pytest.raises(UserError, match="no pin with a transmission angle"):
        bench.optimise(start(bench))
