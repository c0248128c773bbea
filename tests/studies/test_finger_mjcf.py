"""The finger's MuJoCo model, driven quasi-statically, beside the equilibria of ``finger-grasp``.

Its loops are closed with ``solref`` −1e8, −2e4 (a spring of 10⁸/s², critically damped), stops and
contacts have ``solref`` 0.001, 2, all of them the highest impedance, 0.9999. Over the 24 default
closings of design B (free, on circles, loaded, and 12 pinches, eight of which give way)
PIP then differs by 0.007° and DIP by 0.015° at most, and loops gape by 0.0009 mm. The largest
difference is at a pinch that is about to give way, where a joint moves far for little force: with
a hundredth of that stiffness it is 0.045° there, with a hundredfold one 0.013°.

No state is left out: on these ways ``finger-grasp`` finds an equilibrium at every motor angle.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cache
from xml.etree import ElementTree

import jax.numpy as jnp
import numpy as np
import pytest

from designopt import cli
from designopt.errors import UserError
from studies.finger.run import finger_design, spring_from
from studies.finger.spec import FingerSpec
from studies.models import Finger
from studies.models.finger import links_of, pins_of
from studies.models.finger_file import bare_finger
from studies.models.finger_parts import PHALANGES
from studies.models.grasp import cases
from studies.models.grasp.analysis import analyze
from studies.models.grasp.closing import Path, close_all, there_and_back
from studies.models.grasp.mjcf import MOTOR, grasp_mjcf
from studies.models.grasp.objects import Circle
from studies.models.grasp.pinch import loading, predict
from studies.models.grasp.spec import GraspSpec
from studies.models.grasp.transfer import pads
from studies.models.linkage_design.coupling.postures import find_coupled_postures
from studies.models.linkage_kinds import KINDS
from tests.kinematics.simulated import Simulated, mujoco
from tests.studies.fingers import finger_of_kind

ANGLE, GAP = math.radians(0.5), 0.05
"""Differences (rad) and gaps (mm) that were asked for."""

HELD = 0.001
"""Part of the largest force, or of the largest moment, by which both may differ."""

FOUND, PINS = np.radians([0.01, 0.02]), 0.001
"""Differences of PIP and DIP and gaps that `studies.models.grasp.mjcf` states."""

JOINTS = ("intermediate on world", "distal on intermediate")
"""PIP and DIP; flexion is negative."""

SPEC = GraspSpec()
DESIGN_B = cases.finger_of(SPEC)
BODY = DESIGN_B.body
END = math.radians(SPEC.motor_end_deg)


def object_of(path: Path) -> Circle | None:
    thing = path.problem.thing
    assert thing is None or isinstance(thing, Circle)
    return thing


@dataclass(frozen=True)
class Closing:
    """What MuJoCo finds along a path: joints (rad), moment of the motor (N mm), largest gap (mm),
    and forces on the intermediate and the distal pad (N), one row for every motor angle."""

    joints: np.ndarray
    motor: np.ndarray
    gap: float
    forces: np.ndarray


def simulate(path: Path, text: str) -> Closing:
    model = Simulated(text)
    straight = model.coordinate("crank on world")
    for name, load in zip(JOINTS, path.problem.load, strict=True):
        model.data.joint(name).qfrc_applied[0] = -1e-3 * float(load)
    joints, motor, forces, gap = [], [], [], 0.0
    for command in path.commands.tolist():
        model.settle([straight - command])
        gap = max(gap, model.gap())
        joints.append([-model.coordinate(name) for name in JOINTS])
        motor.append(-1e3 * float(model.data.actuator(MOTOR).force[0]))
        forces.append([model.push(f"{name} pad") for name in ("intermediate", "distal")])
    return Closing(np.array(joints), np.array(motor), gap, np.array(forces))


def agree(path: Path, found: Closing) -> None:
    assert path.ok.all(), set(path.messages)
    assert np.abs(found.joints - path.joints).max() < ANGLE
    assert found.gap < GAP
    np.testing.assert_allclose(found.motor, path.motor, atol=HELD * np.abs(path.motor).max())
    if path.per_pad:
        forces = np.stack([path.push(0), path.push(1)], axis=1)
        np.testing.assert_allclose(found.forces, forces, atol=HELD * np.abs(forces).max())


@cache
def designed() -> Finger:
    return finger_design(FingerSpec(), None)


def bare() -> Finger:
    """The designed finger without what its closing does not need, for one program's sake.

    The motor's parallelogram turns its crank as the motor itself would.
    """
    finger = designed()
    pins = replace(pins_of(finger), K=None)
    return Finger.of(finger.body, pins, finger.spring, name=finger.name)


FINGERS = {"design B": lambda: DESIGN_B, "the designed finger": bare}
CLOSINGS = ("adaptive", "adaptive, loaded", "pinch that holds", "pinch that gives way", "free")


@cache
def closings() -> dict[tuple[str, str], Path]:
    """Every way of closing of both fingers, by two compiled programs."""
    problems, motions, free = [], [], []
    for make in FINGERS.values():
        finger = make()
        check = cases.touching(BODY, *cases.check_touch(BODY))
        pip = math.radians(30.0)
        pinches = predict(finger, [(pip, 25.0), (pip, 12.0)])
        assert [one.holds for one in pinches] == [True, False]
        problems += [cases.problem_of(finger, check)]
        problems += [cases.problem_of(finger, check, SPEC.opening_load)]
        motions += [there_and_back(END)] * 2
        for one in pinches:
            place = 23.0 + one.place
            thing = cases.touching(BODY, one.pip, place, cases.PINCH_RADIUS)
            problems.append(cases.problem_of(finger, thing))
            motions.append(loading(finger, one))
        free += close_all([cases.problem_of(finger, None)], there_and_back(END)[None])
    paths = iter(close_all(problems, np.array(motions)))
    return {
        (name, way): free.pop(0) if way == "free" else next(paths)
        for name in FINGERS
        for way in CLOSINGS
    }


@pytest.mark.parametrize("way", CLOSINGS)
@pytest.mark.parametrize("name", FINGERS)
def test_closing_goes_as_finger_grasp_says(name, way):
    path = closings()[name, way]
    finger = path.problem.finger if name == "design B" else designed()
    agree(path, simulate(path, grasp_mjcf(finger, object_of(path))))


@pytest.mark.nightly
def test_every_closing_of_the_study_goes_as_it_says():
    found = analyze(DESIGN_B, SPEC, polygon=False)
    paths = found.paths()
    assert len(paths) == 24
    for path in paths.values():
        simulated = simulate(path, grasp_mjcf(DESIGN_B, object_of(path)))
        agree(path, simulated)
        assert (np.abs(simulated.joints - path.joints).max(axis=0) < FOUND).all()
        assert simulated.gap < PINS


@pytest.mark.slow
def test_stiffer_loops_come_nearer():
    """At the pinch that tells most: about to give way at PIP 60°."""
    pinch = predict(DESIGN_B, [(math.radians(60.0), 16.0)])[0]
    thing = cases.touching(BODY, pinch.pip, 23.0 + pinch.place, cases.PINCH_RADIUS)
    problem = cases.problem_of(DESIGN_B, thing)
    path = close_all([problem] * 2, np.array([loading(DESIGN_B, pinch)] * 2))[0]
    text, errors = grasp_mjcf(DESIGN_B, thing), []
    for solref in ("-1e6 -2e3", "-1e8 -2e4", "-1e10 -2e5"):
        changed = text.replace("-1e8 -2e4", solref)
        errors.append(np.abs(simulate(path, changed).joints - path.joints).max())
    # As above.
    np.testing.assert_allclose(np.degrees(errors), [0.045, 0.0153, 0.0132], rtol=0.1)


def test_pads_are_those_that_finger_grasp_closes_and_the_camera_sees():
    model = Simulated(grasp_mjcf(DESIGN_B))
    grasped = dict(zip(("intermediate", "distal"), pads(BODY, jnp.zeros(2)), strict=True))
    seen = dict(zip(PHALANGES, np.asarray(bare_finger().pads()), strict=True))
    for name in ("proximal", "intermediate", "distal"):
        site = model.model.site(f"{name} pad")
        assert model.model.geom(f"{name} pad").pos.tolist() == site.pos.tolist()
        data = model.data.site(f"{name} pad")
        frame = 1e3 * data.xpos, data.xmat.reshape(3, 3)
        half = 1e3 * site.size[:2]
        ends = [(frame[0] + frame[1] @ [sign * half[0], -half[1], 0])[:2] for sign in (-1, 1)]
        if name in grasped:
            pad = grasped[name]
            start = np.array([float(pad.start.x), float(pad.start.y)])
            np.testing.assert_allclose(ends[0], start, atol=1e-9)
            np.testing.assert_allclose(ends[1] - ends[0], [float(pad.length), 0.0], atol=1e-9)
        np.testing.assert_allclose(sorted(map(tuple, ends)), sorted(seen[name].tolist()), atol=1e-9)


def test_both_studies_export_the_finger(tmp_path):
    made = {}
    for study in ("finger", "finger-grasp"):
        out = tmp_path / study
        assert cli.run(["export", study, "--to", "mjcf", "--out", str(out)]) == 0
        (made[study],) = out.glob("*.xml")
    for study, finger in (("finger", designed()), ("finger-grasp", DESIGN_B)):
        root = ElementTree.fromstring(made[study].read_text(encoding="utf-8"))
        wanted = ElementTree.fromstring(grasp_mjcf(finger))
        for element, other in zip(root.iter(), wanted.iter(), strict=True):
            if element.tag not in ("mujoco", ElementTree.Comment):
                assert element.attrib == other.attrib


def test_the_settings_of_the_finger_are_in_its_model():
    spec = FingerSpec.model_validate(
        {"body": {"range_deg": 80}, "spring": {"stiffness": 12, "preload": 0.5, "servo": 200}}
    )
    body = replace(designed().body, flexion=np.deg2rad(spec.body.range_deg))
    finger = replace(designed(), body=body, spring=spring_from(spec.spring))
    simulated = Simulated(grasp_mjcf(finger))
    model, data = simulated.model, simulated.data
    for joint in ("intermediate on world", "distal on intermediate"):
        np.testing.assert_allclose(np.degrees(model.joint(joint).range), [-80, 0], atol=1e-9)
    assert model.nu == 1
    simulated.look([model.joint("crank on world").qpos0[0] + 0.1])
    np.testing.assert_allclose(data.actuator(MOTOR).force, 200e-3 * 0.1)
    # The plate hangs on the distal phalanx or the other way round: the spring's moment is on it.
    moments = np.abs(data.qfrc_spring)
    np.testing.assert_allclose(sorted(moments)[-2:], [0.0, 12e-3 * 0.5], atol=1e-12)


@pytest.mark.parametrize(("part", "words"), [("pins", "no linkage"), ("spring", "no spring")])
def test_a_finger_without_a_linkage_or_a_spring_has_no_model(part, words):
    with pytest.raises(UserError, match=rf"^finger: it has {words}; add \[{part}\]$"):
        grasp_mjcf(replace(designed(), **{part: None}))


def touching(simulated: Simulated) -> list[tuple[str, str]]:
    """Pairs of geoms that overlap."""
    model = simulated.model
    return [
        (model.geom(contact.geom1).name, model.geom(contact.geom2).name)
        for contact in simulated.data.contact
        if contact.dist < 0
    ]


SHARING = {
    *(("proximal", "intermediate"), ("proximal", "crank"), ("proximal", "driver")),
    *(("intermediate", "distal"), ("intermediate", "bar"), ("distal", "plate")),
    *(("plate", "rod"), ("rod", "crank"), ("crank", "coupler"), ("coupler", "driver")),
    ("plate", "bar"),
}
"""Pairs of bodies that share a pin, which alone may touch."""


def test_the_finger_closes_without_touching_itself():
    """Over all of both joints: the motor closes, and a moment bends DIP in between."""
    text = grasp_mjcf(designed())
    excluded = {
        frozenset((pair.get("body1"), pair.get("body2")))
        for pair in ElementTree.fromstring(text).iter("exclude")
    }
    assert excluded == {frozenset(pair) for pair in SHARING}
    simulated = Simulated(text)
    straight = simulated.coordinate("crank on world")
    reached = []
    for moment in (0.0, -0.02, -0.06):
        simulated.data.joint(JOINTS[1]).qfrc_applied[0] = moment
        for command in np.deg2rad(np.linspace(0.0, 110.0, 12)):
            simulated.settle([straight - command])
            assert touching(simulated) == []
            reached.append([-simulated.coordinate(name) for name in JOINTS])
    reached = np.rad2deg(reached)
    assert reached.max(axis=0) == pytest.approx([90.0, 90.0], abs=0.1)
    assert reached.min(axis=0) == pytest.approx([0.0, 0.0], abs=0.1)


def test_a_coupled_finger_closes_along_its_curve_without_touching_itself():
    finger = finger_of_kind("coupled")
    text = grasp_mjcf(finger)
    excluded = {
        frozenset((pair.get("body1"), pair.get("body2")))
        for pair in ElementTree.fromstring(text).iter("exclude")
    }
    assert excluded == {
        frozenset(pair)
        for pair in (
            *(("proximal", "intermediate"), ("intermediate", "distal"), ("proximal", "coupling")),
            *(("distal", "coupling"), ("intermediate", "coupler"), ("coupler", "driver")),
            ("driver", "proximal"),
        )
    }
    simulated = Simulated(text)
    straight = simulated.coordinate("intermediate on world")
    for command in np.deg2rad(np.linspace(0.0, 90.0, 7)):
        simulated.settle([straight - command])
        assert touching(simulated) == []
        assert simulated.gap() < PINS
        pip = -simulated.coordinate("intermediate on world")
        assert pip == pytest.approx(command, abs=ANGLE)
        dip = -simulated.coordinate("distal on intermediate")
        wanted = find_coupled_postures(finger, jnp.array([pip])).dip[0]
        assert dip == pytest.approx(float(wanted), abs=FOUND[1])


def test_parts_that_run_into_each_other_touch():
    """With axles 10 mm thick the bar G-G' runs into that of the PIP joint."""
    finger = designed()
    thick = replace(finger, links=replace(links_of(finger), axle_diameter=jnp.asarray(10.0)))
    simulated = Simulated(grasp_mjcf(thick))
    simulated.data.joint(JOINTS[1]).qfrc_applied[0] = -0.06
    simulated.run(0.5)  # held by what it touches it does not come to rest
    pairs = {frozenset(name.split(",")[0] for name in pair) for pair in touching(simulated)}
    assert frozenset(("bar", "axle A of proximal")) in pairs


@pytest.mark.parametrize("kind", [*KINDS])
def test_sensors_read_the_joints_and_the_camera_looks_at_the_pads(kind):
    finger = finger_of_kind(kind)
    model = mujoco.MjModel.from_xml_string(grasp_mjcf(finger))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    start = data.ctrl[0]
    for step in range(3000):
        data.ctrl[0] = start - min(step, 1000) * 1e-3
        mujoco.mj_step(model, data)
    assert np.all(np.isfinite(data.qpos))
    assert not np.any(data.warning.number)
    pip, dip, theta = (data.sensor(name).data[0] for name in ("pip", "dip", "theta pos"))
    # By the turns of the bodies themselves; flexion is clockwise.
    turns = [_turn(data, body) for body in ("intermediate", "distal")]
    np.testing.assert_allclose([pip, dip], [-turns[0], turns[0] - turns[1]], atol=1e-6)
    assert pip > 0.99
    assert theta == pytest.approx(start - 1.0, abs=0.1)
    # The camera is where the scene has it, turned with its phalanx, and looks along its axis.
    camera, scene = data.camera("camera"), finger.scene().camera
    turned = np.exp(1j * turns[0])
    x, y = (float(part) * 1e-3 for part in scene.position)
    wanted = turned * complex(x, y)
    np.testing.assert_allclose(camera.xpos, [wanted.real, wanted.imag, 0], atol=1e-6)
    ahead = turned * np.exp(1j * float(scene.direction))
    np.testing.assert_allclose(-camera.xmat[2::3], [ahead.real, ahead.imag, 0], atol=1e-6)
    assert 0 < model.cam_fovy[0] <= 120


def _turn(data, body):
    """Of a body about +z, rad."""
    matrix = data.body(body).xmat.reshape(3, 3)
    return np.arctan2(matrix[1, 0], matrix[0, 0])
