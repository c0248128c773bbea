"""MuJoCo models of linkages, loaded by MuJoCo and driven, beside this package's own answers."""

from __future__ import annotations

import math
from typing import Any
from xml.etree import ElementTree

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from designopt.errors import UserError
from kinematics import Linkage, parse_linkage, solve_input_efforts
from kinematics.export.mjcf import Stop, linkage_mjcf
from kinematics.export.mjcf_bodies import Disc, Pad
from tests.helpers import nightly
from tests.kinematics.gallery import (
    NAMES,
    PUSHED,
    SKETCHED_FOUR_BAR,
    each_linkage,
    gallery,
    gallery_tables,
    poses_of,
    tables_of,
)
from tests.kinematics.simulated import Simulated

NEAR = 0.02
"""Difference of a place that motors and springs may leave, mm: a motor yields to a spring of
30 N mm/rad by 2e-4 rad at most, over 55 mm."""

CLOSED = 1e-3
"""Gap of a loop that motors and springs may leave, mm."""

YIELDS = 1e-3
"""How far a stop yields to the 2 N m with which a motor pushes on it, rad."""

REST = 1e-4
"""How far from where it should a linkage with strong springs may rest, as a part of its size."""

LONG_TO_COMPILE = {"stephenson", "double-butterfly"}
"""Iterated poses compile for half a minute."""

LOCKS = "double-butterfly"
"""Goes only one way from its sketch as far as it is driven here."""

efforts_of = jax.jit(solve_input_efforts)

# The lever hangs on nothing but its slot, through which the fixed pin P goes, and the crank.
BLOCK_FIRST = tables_of(
    {"P": [60, 0], "O": [0, 0], "A": [10, 20], "T": [80, -8]},
    "P O",
    {"lever": "A T", "crank": "O A"},
    sliders=[{"joint": "P", "on": "lever", "line": [[10, 20], [80, -8]]}],
)

FURTHER = {
    "a block that holds its lever": BLOCK_FIRST,
    "a slider pushed": PUSHED,
    "driven between bodies without a common pin": SKETCHED_FOUR_BAR
    | {"inputs": [{"name": "opening", "body": "rocker", "relative_to": "crank"}]},
    "driven against the tree": SKETCHED_FOUR_BAR
    | {"inputs": [{"name": "knee", "body": "crank", "relative_to": "coupler"}]},
}


def driven(linkage: Linkage, *, back: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """Inputs from the sketch on, one way or both ways, and what a model is told to go there."""
    slides = np.array([part.body is None for part in linkage.structure.inputs])
    travel = np.where(slides, 0.1 * float(linkage.size()), 0.4)
    parts = np.linspace(0, 1, 9)
    if back:
        parts = np.concatenate([np.linspace(0, 1, 5), np.linspace(0.75, -1, 8)])
    inputs = np.asarray(linkage.reference.inputs) + parts[:, None] * travel
    return inputs, inputs * np.where(slides, 1e-3, 1.0)


def enlarged(scale: float, table: dict[str, Any] = SKETCHED_FOUR_BAR) -> Linkage:
    """A linkage enlarged, its lines too."""
    joints = {name: (scale * np.array(at)).tolist() for name, at in table["joints"].items()}
    sliders = [
        part | {"line": (scale * np.array(part["line"])).tolist()}
        for part in table.get("sliders", [])
    ]
    return parse_linkage(table | {"joints": joints, "sliders": sliders})


def follows(linkage: Linkage, *, near: float, closed: float, back: bool = True) -> None:
    """MuJoCo moves a linkage where it is solved, and no loop opens; both in mm."""
    model = Simulated(linkage_mjcf(linkage))
    inputs, controls = driven(linkage, back=back)
    poses = poses_of(linkage, jnp.asarray(inputs))
    assert bool(poses.ok.all())
    for i, control in enumerate(controls):
        model.settle(control)
        assert model.gap() < closed
        for joint in linkage.structure.joints:
            wanted = np.asarray(poses.value.position(joint))[i]
            places = model.places(joint)
            assert np.abs(places[:, :2] - wanted).max() < near
            assert np.abs(places[:, 2]).max() == 0


@each_linkage(quick=sorted({*NAMES} - LONG_TO_COMPILE))
def test_the_gallery_moves_as_it_is_solved(name):
    follows(gallery(name), near=NEAR, closed=CLOSED, back=name != LOCKS)


@pytest.mark.parametrize("name", FURTHER)
def test_other_ways_to_drive_and_to_cut_move_as_they_are_solved(name):
    follows(parse_linkage(FURTHER[name], name), near=NEAR, closed=CLOSED)


@pytest.mark.parametrize("name", NAMES)
def test_a_model_has_its_lengths_and_freedoms_and_rests_at_first(name):
    linkage = gallery(name)
    text = linkage_mjcf(linkage)
    assert text == linkage_mjcf(linkage)
    model = Simulated(text)
    assert model.freedoms() == len(linkage.structure.inputs)
    assert model.gap() < 1e-8
    assert {model.model.actuator(i).name for i in range(model.model.nu)} == {*linkage.input_names}
    np.testing.assert_allclose(
        model.data.actuator_length, linkage.reference.inputs, rtol=1e-9, atol=1e-12
    )
    home = model.data.qpos.copy()
    model.start("sketch")
    for _ in range(10):
        model.run(0.1)
        np.testing.assert_allclose(model.data.qpos, home, atol=1e-5)
    checked = 0
    for element in ElementTree.fromstring(text).iter("body"):
        body = element.attrib["name"]
        sites = {site.attrib["name"]: site.attrib["pos"] for site in element.findall("site")}
        if body not in linkage.links:
            continue
        first, second = (
            np.array(sites[f"{joint} on {body}"].split(), float)
            for joint in linkage.structure.body(body).joints[:2]
        )
        length = 1e3 * math.dist(first, second)
        assert abs(length - float(linkage.links[body].length)) < 1e-9 * length
        checked += 1
    assert checked == len(linkage.structure.moving)


@pytest.mark.parametrize(
    "springs",
    [
        [{"between": ["crank", "coupler"], "stiffness": 40, "preload": 0.3}],
        [{"between": ["coupler", "crank"], "stiffness": 40, "preload": 0.3}],
        [{"between": ["rocker", "crank"], "stiffness": 40, "preload": 0.7}],
        [{"between": ["crank", "rocker"], "stiffness": 40, "preload": 0.7}],
        [
            {"between": ["ground", "rocker"], "stiffness": 25, "preload": -0.2},
            {"between": ["rocker", "ground"], "stiffness": 10, "preload": 0.4},
        ],
    ],
)
def test_motors_hold_springs_as_by_virtual_work(springs):
    """At a hinge, at none, either way round, and two of them."""
    linkage = parse_linkage(SKETCHED_FOUR_BAR | {"springs": springs})
    model = Simulated(linkage_mjcf(linkage))
    inputs, controls = driven(linkage)
    efforts = np.asarray(efforts_of(linkage, jnp.asarray(inputs)))
    assert np.abs(efforts).max() > 2
    for control, effort in zip(controls, efforts, strict=True):
        model.settle(control)
        # The motor yields a little, and so do the pins.
        np.testing.assert_allclose(1e3 * model.data.actuator_force, effort, rtol=1e-3, atol=0.01)


def test_a_soft_motor_yields_as_by_virtual_work():
    """Two inputs, one of them free: the spring finds its rest, and the motor its moment."""
    linkage = gallery("finger-crank")
    model = Simulated(linkage_mjcf(linkage, motors={"theta": 300.0}))
    assert model.model.nu == 1
    home = float(linkage.reference.inputs[0])
    model.settle([home - 0.5])
    theta = model.coordinate("crank on world")
    gamma = model.coordinate("plate on distal")
    efforts = np.asarray(efforts_of(linkage, jnp.asarray([theta, gamma])))
    # No stop and no contact: the spring rests, so the crank goes where it is told to.
    np.testing.assert_allclose(efforts, 0.0, atol=0.01)
    np.testing.assert_allclose(theta, home - 0.5, atol=1e-5)
    np.testing.assert_allclose(gamma, float(linkage.reference.inputs[1]) - 0.3, atol=1e-3)


@pytest.mark.parametrize(
    "between", [("ground", "rocker"), ("rocker", "world"), ("crank", "rocker")]
)
def test_stops_hold_at_their_angles(between):
    """At a hinge, either way round, and where there is none."""
    linkage = parse_linkage(SKETCHED_FOUR_BAR)
    inputs, controls = driven(linkage)
    pose = poses_of(linkage, jnp.asarray(inputs))

    def angle(body, index):
        return 0.0 if body in ("ground", "world") else float(pose.value.angle(body)[4 * index])

    turns = [angle(between[1], i) - angle(between[0], i) for i in range(3)]
    ends = sorted([turns[1] - turns[0], 0.0])
    stop = Stop(between, ends[0], ends[1])
    model = Simulated(linkage_mjcf(linkage, motors={"crank": 1e4}, stops=[stop]))
    model.settle(controls[-1])
    # Half-way the stop holds it, however far the motor is told to go.
    np.testing.assert_allclose(model.coordinate("crank on world"), inputs[4, 0], atol=YIELDS)
    model.settle(controls[2])
    np.testing.assert_allclose(model.coordinate("crank on world"), inputs[2, 0], atol=1e-5)


def test_pads_touch_discs_at_their_faces():
    """A crank of 40 mm with a pad along it, 3 mm beside its axis, on a disc of 5 mm."""
    table = tables_of({"O": [10, -5], "A": [50, -5]}, "O", {"crank": "O A"})
    pad = Pad("pad", "crank", (15.0, -8.0), (45.0, -8.0))
    disc = Disc("disc", (28.0, -25.0), 5.0)
    text = linkage_mjcf(parse_linkage(table), motors={"crank": 80.0}, pads=[pad], discs=[disc])
    model = Simulated(text)
    for command in np.linspace(0.0, -1.5, 16):
        model.settle([command])
    # The disc's centre is 3 + 5 mm beside the line O-A.
    away, low = 18.0, -20.0
    wanted = math.atan2(low, away) + math.asin(8 / math.hypot(away, low))
    np.testing.assert_allclose(model.coordinate("crank on world"), wanted, atol=1e-4)
    assert model.data.ncon > 0
    assert set(model.data.contact.dim.tolist()) == {1}


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"motors": {"cranck": 1.0}}, "motors.cranck: no input has this name; there are: crank"),
        ({"stops": [Stop(("crank", "rod"), -1.0, 1.0)]}, "stops.0: no body is named 'rod'"),
        ({"stops": [Stop(("crank", "rocker"), 0.1, 1.0)]}, "does not hold the assembled sketch"),
        ({"pads": [Pad("pad", "rod", (0.0, 0.0), (1.0, 0.0))]}, "pads.0: no body is named 'rod'"),
        ({"pads": [Pad("pad", "crank", (1.0, 0.0), (1.0, 0.0))]}, "its two ends coincide"),
    ],
)
def test_what_cannot_be_is_refused(given, words):
    with pytest.raises(UserError, match="linkage: ") as raised:
        linkage_mjcf(parse_linkage(SKETCHED_FOUR_BAR), **given)
    assert words in str(raised.value)
    assert "\n" not in str(raised.value)


STRONG = {
    # Where a stiff spring pulls at a loop: past the pins of a tree, at a block, at a slider pushed.
    "four-bar": (SKETCHED_FOUR_BAR, ["ground", "rocker"]),
    "four-bar, no common pin": (SKETCHED_FOUR_BAR, ["crank", "rocker"]),
    "a block that holds its lever": (BLOCK_FIRST, ["ground", "lever"]),
    "a slider driven": (PUSHED | {"inputs": SKETCHED_FOUR_BAR["inputs"]}, ["crank", "rod"]),
    "a slider pushed": (PUSHED, ["crank", "rod"]),
}


@pytest.mark.parametrize("size", [3.0, *nightly(10.0, 100.0)])
@pytest.mark.parametrize("stiffness", [300.0, *nightly(0.3, 30.0)])
@pytest.mark.parametrize("name", STRONG)
def test_strong_springs_do_not_pull_small_linkages_apart(name, size, stiffness):
    table, between = STRONG[name]
    scale = size / float(parse_linkage(table).size())
    spring = {"between": between, "stiffness": stiffness, "preload": 1.0}
    linkage = enlarged(scale, table | {"springs": [spring]})
    assert float(linkage.size()) == pytest.approx(size)
    follows(linkage, near=REST * size, closed=REST * size, back=False)


def test_without_motors_there_is_no_keyframe_for_their_controls():
    assert "<keyframe>" not in linkage_mjcf(parse_linkage(SKETCHED_FOUR_BAR), motors={})


def test_what_never_turns_has_neither_spring_nor_stop():
    """The yoke slides without turning: no joint changes the angle between it and the ground."""
    table = gallery_tables("scotch-yoke")
    spring = {"between": ["ground", "yoke"], "stiffness": 3.0, "preload": 1.0}
    linkage = parse_linkage(table | {"springs": [spring]})
    text = linkage_mjcf(linkage, stops=[Stop(("yoke", "ground"), -1.0, 1.0)])
    assert text == linkage_mjcf(parse_linkage(table))
    assert Simulated(text).model.ntendon == 0


@pytest.mark.parametrize("scale", [1e-3, 100.0])
def test_small_and_large_linkages_move_alike(scale):
    follows(enlarged(scale), near=1e-9 * scale, closed=CLOSED * scale, back=False)


def test_what_is_too_small_for_mujoco_is_refused():
    with pytest.raises(UserError, match=r"dimension is 0\.0012 mm; make it 0\.01 mm or more"):
        linkage_mjcf(enlarged(1e-5))
