"""A linkage's bench: what it shows is what the library computes, and what it saves is that."""

import functools
import math
import tomllib
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from matplotlib.figure import Figure

from designopt import UserError
from designopt.plot.figures import style
from designopt.plot.lettering import Lettering
from kinematics import (
    compute_spring_energy,
    find_limits,
    parse_linkage,
    solve_poses,
)
from kinematics.explore.bench import LinkageBench
from kinematics.io.designed import DesignedLinkage
from kinematics.io.sketch import parse_sketch
from tests.kinematics.gallery import FOLDER, NAMES, ends, gallery, poses_of, transmission_of

QUICK = ["finger", "quick-return"]
SLIDE = """
[linkage]
name = "pushed crank"
[joints]
O = [0, 0]
A = [20, 35]
C = [127, -20]
[bodies.ground]
joints = ["O"]
fixed = true
[bodies.crank]
joints = ["O", "A"]
[bodies.rod]
joints = ["A", "C"]
[[sliders]]
joint = "C"
on = "ground"
line = [[0, -20], [1, -20]]
[[inputs]]
name = "push"
slider = "C"
"""


@functools.cache
def bench_of(name):
    """A bench drawn into a figure."""
    return drawn(DesignedLinkage.read(FOLDER / f"{name}.toml"))


def drawn(design):
    bench = LinkageBench(design)
    assert isinstance(bench, LinkageBench)
    area: Any = Figure(figsize=(12, 6)).subfigures(1, 1)
    with style():
        bench.draw(area)
    return bench


def start(bench, **changed):
    values = {knob.name: knob.value for knob in bench.knobs}
    assert changed.keys() <= values.keys()
    return values | changed


def readings(shown):
    found: dict[str, Any] = {one.name: one.value for one in shown.readings}
    return found


def inputs_of(linkage, values):
    return jnp.asarray(
        [
            math.radians(values[part.name]) if part.slider is None else values[part.name]
            for part in linkage.structure.inputs
        ]
    )


def check(bench, values):
    """Show values; every number is what the public functions say of a linkage built anew."""
    shown = bench.show(values)
    found = readings(shown)
    assert all(value is None or math.isfinite(value) for value in found.values())
    levels = [artist.get_zorder() for artist in shown.artists]
    assert levels == sorted(levels)
    assert all(artist.get_animated() for artist in shown.artists)
    linkage = bench.linkage(values)
    inputs = inputs_of(linkage, values)
    broken = found["margin"] is None
    if broken:
        assert "no triangle" in shown.message
        return shown
    pose = poses_of(linkage, inputs)
    assert bool(pose.ok) == (shown.message == "")
    np.testing.assert_allclose(found["margin"], pose.margin, rtol=0, atol=1e-9)
    if not bool(pose.ok):
        assert shown.message.startswith(pose.messages()[0])
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
        inputs = gallery_home(bench)
    again = saved(bench, values)
    for one, other in zip(
        (linkage.anchors, linkage.links), (again.anchors, again.links), strict=True
    ):
        for a, b in zip(jax.tree.leaves(one), jax.tree.leaves(other), strict=True):
            np.testing.assert_allclose(a, b, rtol=0, atol=1e-9)
    np.testing.assert_allclose(np.cos(again.reference.inputs - inputs), 1.0, atol=1e-12)
    assert again.assembly == linkage.assembly
    here, there = poses_of(linkage, inputs), poses_of(again, inputs)
    assert bool(there.ok)
    for joint in linkage.structure.joints:
        np.testing.assert_allclose(
            here.value.position(joint), there.value.position(joint), rtol=0, atol=1e-8
        )


def gallery_home(bench):
    return bench._design.linkage.reference.inputs


def sides(bench):
    """The start, and both ends of every knob."""
    yield start(bench)
    for knob in bench.knobs:
        assert knob.low < knob.value < knob.high
        for value in (knob.low, knob.high):
            yield start(bench, **{knob.name: value})


@pytest.mark.parametrize("name", QUICK)
def test_every_knob_shows_what_the_library_computes(name):
    bench = bench_of(name)
    for values in sides(bench):
        check(bench, values)
    check(bench, start(bench))


@pytest.mark.nightly
@pytest.mark.parametrize("name", NAMES)
def test_the_whole_gallery(name):
    bench = bench_of(name)
    for values in sides(bench):
        shown = check(bench, values)
        if readings(shown)["margin"] is None:
            with pytest.raises(UserError, match="no triangle"):
                bench.specs(values)
            continue
        try:
            check_saved(bench, values)
        except UserError:
            assert shown.message


@pytest.mark.parametrize("name", ["finger", "scotch-yoke"])
def test_what_is_saved_is_the_linkage_as_it_stands(name):
    bench = bench_of(name)
    turned = {
        knob.name: knob.value + (7.0 if knob.kind == "joint" else 0.02 * knob.value)
        for knob in bench.knobs
    }
    check_saved(bench, turned)
    again = LinkageBench(reread(bench, turned))
    knobs = {knob.name: knob.value for knob in again.knobs}
    assert knobs.keys() == turned.keys()
    for knob in bench.knobs:
        if knob.kind == "dimension":
            np.testing.assert_allclose(knobs[knob.name], turned[knob.name], rtol=0, atol=1e-9)


def reread(bench, values):
    (file,) = bench.specs(values)
    return DesignedLinkage.of(parse_sketch(tomllib.loads(file.content), "saved"), "saved")


def test_what_is_saved_where_it_locks_is_in_the_first_pose():
    bench = bench_of("watt")
    values = start(bench, crank=189.0)
    assert bench.show(values).message
    check_saved(bench, values)
    assert "in its first pose" in bench.specs(values)[0].title
    assert "as it stands" in bench.specs(start(bench))[0].title


def test_springs_are_as_taut_as_they_were():
    bench = bench_of("finger")
    linkage, again = gallery("finger"), saved(bench, start(bench, pip=-40.0, dip=-25.0))
    inputs = jnp.radians(jnp.asarray([-60.0, -10.0]))
    energies = [compute_spring_energy(one, poses_of(one, inputs).value) for one in (linkage, again)]
    np.testing.assert_allclose(*energies, rtol=1e-9)


def test_what_cannot_be_sketched_is_said():
    bench = bench_of("four-bar")
    with pytest.raises(UserError, match="cannot be sketched"):
        bench.specs(start(bench, **{"rocker O4-B": 40.0, "coupler A-B": 204.0}))


def test_the_transmission_angle_of_a_four_bar():
    """By the law of cosines; least where the crank lies along the ground."""
    bench = bench_of("four-bar")
    a, b, c, d = 40.0, 120.0, 80.0, 100.0

    def angle(crank):
        diagonal = a * a + d * d - 2 * a * d * math.cos(crank)
        cosine = (b * b + c * c - diagonal) / (2 * b * c)
        return math.degrees(math.acos(abs(cosine)))

    for crank in (10.0, 75.0, 200.0):
        found = readings(bench.show(start(bench, crank=crank)))
        np.testing.assert_allclose(found["μ at B"], angle(math.radians(crank)), atol=1e-9)
    found = readings(bench.show(start(bench)))
    least = min(angle(0.0), angle(math.pi))
    np.testing.assert_allclose(found["least μ"], least, atol=1e-9)


def test_the_least_transmission_angle_of_a_watt():
    """By a dense sweep from limit to limit, which are found apart, 2 % short of them."""
    bench = bench_of("watt")
    low, high = (limit.value for limit in ends(find_limits(gallery("watt"), "crank")))
    inset = 0.02 * (high - low)
    cranks = jnp.linspace(low + inset, high - inset, 1201)[:, None]
    angles = transmission_of(gallery("watt"), cranks).angles
    dense = math.degrees(min(float(jnp.min(angle)) for angle in angles.values()))
    for crank in (-80.0, 0.0, 100.0):
        least = readings(bench.show(start(bench, crank=crank)))["least μ"]
        np.testing.assert_allclose(least, dense, rtol=0, atol=0.02)


@pytest.mark.parametrize(
    "name",
    ["four-bar", *(pytest.param(name, marks=pytest.mark.nightly) for name in ("watt", "five-bar"))],
)
def test_the_least_transmission_angle_reads_back(name):
    bench = bench_of(name)
    for share in (0.0, 0.02, -0.03):
        changed = {
            knob.name: knob.value * (1 + share * (-1) ** number)
            for number, knob in enumerate(bench.knobs)
        }
        least = readings(bench.show(changed))["least μ"]
        again = drawn(reread(bench, changed))
        np.testing.assert_allclose(
            readings(again.show(start(again)))["least μ"], least, rtol=0, atol=1e-4
        )


def test_a_range_goes_on_where_a_whole_turn_ends():
    """As a crank that locks around 180° has one range, wherever its turn is cut."""
    bench = bench_of("four-bar")
    locks = start(bench, **{"ground O2-O4": 170.0, "coupler A-B": 100.0, "rocker O4-B": 90.0})
    found = [readings(bench.show({**locks, "crank": crank}))["least μ"] for crank in (5, 355)]
    np.testing.assert_allclose(*found, rtol=0, atol=1e-9)
    limit = math.acos((40**2 + 170**2 - 190**2) / (2 * 40 * 170))
    crank = 0.96 * limit  # 2 % of twice the limit
    diagonal = 40**2 + 170**2 - 2 * 40 * 170 * math.cos(crank)
    cosine = (100**2 + 90**2 - diagonal) / (2 * 100 * 90)
    np.testing.assert_allclose(found[0], math.degrees(math.acos(abs(cosine))), atol=1e-4)


@pytest.mark.parametrize(
    "name",
    ["four-bar", *(pytest.param(name, marks=pytest.mark.nightly) for name in ("watt", "five-bar"))],
)
def test_no_move_compiles_anything(name):
    """The first one that locks, or that no triangle allows, is no exception."""
    jax.clear_caches()
    bench = drawn(DesignedLinkage.read(FOLDER / f"{name}.toml"))
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
        assert any("locks at" in said or "gives a pose" in said for said in messages)
        assert not compiled
        jax.jit(lambda number: number + len(moves))(1.0)
        assert compiled
    finally:
        jax.monitoring.unregister_event_duration_listener(heard)


def test_names_of_pivots_stand_off_their_links():
    bench = bench_of("four-bar")
    for crank in range(0, 360, 15):
        shown = bench.show(start(bench, crank=float(crank)))
        gids: dict[str, Any] = {str(one.get_gid()): one for one in shown.artists}
        names = {one.words: one for one in shown.artists if isinstance(one, Lettering)}
        axes = gids["path:A"].axes
        poses = poses_of(gallery("four-bar"), jnp.radians(jnp.asarray([float(crank)])))
        for pivot, other in (("O2", "A"), ("O4", "B")):
            here, there = (
                axes.transData.transform(np.asarray(poses.value.position(joint)))
                for joint in (pivot, other)
            )
            # An outline is laid out around its place.
            x, y = names[pivot].get_transform().transform((0.0, 0.0)) - here
            link = there - here
            between = math.atan2(y, x) - math.atan2(link[1], link[0])
            assert abs(math.remainder(between, 2 * math.pi)) > math.radians(30)


def test_a_crank_that_turns_has_a_full_turn():
    crank = bench_of("four-bar").knobs[0]
    assert (crank.low, crank.high, crank.unit, crank.kind) == (0.0, 360.0, "°", "joint")


@pytest.mark.parametrize("name", ["watt", pytest.param("peaucellier", marks=pytest.mark.nightly)])
def test_beyond_a_limit_it_says_where_that_is(name):
    bench = bench_of(name)
    limits = ends(find_limits(gallery(name), "crank"))
    knob = bench.knobs[0]
    for limit, value in zip(limits, (knob.low, knob.high), strict=True):
        edge = math.degrees(limit.value)
        # The knob goes beyond it, and what is shown there is the edge to the last digit.
        assert value < edge if limit is limits[0] else value > edge
        shown = bench.show(start(bench, crank=value))
        assert shown.message.endswith(f"crank locks at {edge:.2f}°.")
        survey = bench._surveyor.survey(
            bench.distances(start(bench)), np.radians([value]), 0, bench._spans[0]
        )
        nearest = min(survey.edges, key=lambda one: abs(one.value - limit.value))
        np.testing.assert_allclose(np.degrees(nearest.value), edge, rtol=0, atol=1e-5)


def test_a_slide_in_millimetres():
    """C reaches as far as crank and rod together, from the foot of the line."""
    design = DesignedLinkage.of(parse_sketch(tomllib.loads(SLIDE), "push.toml"), "push.toml")
    bench = drawn(design)
    knob = bench.knobs[0]
    assert (knob.name, knob.unit) == ("push", "mm")
    reach = math.hypot(20, 35) + math.hypot(107, 55)
    farthest = math.sqrt(reach**2 - 20**2)
    assert knob.high > farthest
    assert readings(bench.show(start(bench)))["push"] == 127.0
    message = bench.show(start(bench, push=knob.high)).message
    assert message.endswith(f"push locks at {farthest:.3f} mm.")


def test_a_pose_that_is_none_leaves_the_last_one_faint():
    bench = bench_of("watt")
    good = bench.show(start(bench))
    bad = bench.show(start(bench, crank=189.0))
    gids = [{str(one.get_gid()) for one in shown.artists} for shown in (good, bad)]
    assert "body:crank" in gids[0]
    assert "ghost:crank" not in gids[0]
    assert "body:crank" not in gids[1]
    assert "ghost:crank" in gids[1]


def test_the_traced_curve_is_the_joints_path():
    bench = bench_of("four-bar")
    values = start(bench, **{"coupler A-B": 110.0})
    shown = bench.show(values)
    linkage = bench.linkage(values)
    path: Any
    (path,) = [one for one in shown.artists if one.get_gid() == "path:B"]
    places = np.asarray(path.get_xydata())
    inputs = jnp.linspace(0, 2 * jnp.pi, len(places))[:, None]
    poses = solve_poses(linkage, inputs)
    good = np.asarray(poses.ok)
    np.testing.assert_allclose(places[good], poses.value.position("B")[good], atol=1e-9)
    assert np.all(np.isnan(places[~good]))
