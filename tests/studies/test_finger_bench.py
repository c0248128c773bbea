"""The finger's bench is the linkage's and the scene's, turned by the same flexion."""

import tomllib
from itertools import pairwise

import jax.numpy as jnp
import numpy as np
import pytest

from designopt.errors import UserError
from kinematics.io.reading import parse_linkage
from kinematics.solve.poses import solve_poses
from kinematics.solve.transmission import solve_transmission
from optics.scene.reading import parse_scene
from optics.visibility.coverage import find_coverage
from studies.finger import FingerSpec
from studies.finger.bench import FingerBench
from studies.finger.run import finger_design
from studies.models.linkage_design.coupling.postures import find_coupled_postures
from tests.helpers import figure_of, readings
from tests.studies.fingers import coupled_finger


@pytest.fixture(scope="module")
def finger():
    """A bench drawn into a figure, the values it begins with, and the figure's canvas."""
    bench = FingerBench(finger_design(FingerSpec(), None))
    figure = figure_of(bench)
    values = {knob.name: knob.value for knob in bench.knobs}
    bench.show(values)
    return bench, values, figure.canvas


MOVED = {"pip": 50.0, "dip": 35.0, "crank F-E": 17.5, "camera tilt": 5.0, "camera x": 12.0}


def test_flexion_comes_first_and_the_body_has_no_knobs(finger):
    bench, values, _ = finger
    assert [(knob.name, knob.low, knob.value, knob.high) for knob in bench.knobs[:2]] == [
        ("pip", 0, 0, 90),
        ("dip", 0, 0, 90),
    ]
    assert len(values) == len(bench.knobs)
    assert set(MOVED) <= set(values)
    assert not {"proximal O-A", "intermediate A-B", "distal B-T"} & set(values)
    assert "transmission" in bench.aim
    assert "mirrors" in bench.aim


def test_both_are_true_to_scale_in_a_window_of_any_shape(finger):
    bench, values, canvas = finger
    left, right = canvas.figure.subfigs[0].subfigs
    for size in ((8, 9), (12, 6)):
        canvas.figure.set_size_inches(*size)
        bench.show(values)
        for axes in (left.axes[0], right.axes[-1]):
            across, up = np.diff(axes.transData.transform([(0, 0), (1, 1)]), axis=0)[0]
            assert across == pytest.approx(up, rel=1e-9)


def test_both_are_shown_in_one_pose(finger):
    bench, values, canvas = finger
    values = values | MOVED
    shown = bench.show(values)
    found = readings(shown)
    assert len(found) == len(shown.readings)
    assert (found["pip"], found["dip"]) == (50.0, 35.0)
    files = {file.name: tomllib.loads(file.content) for file in bench.specs(values)}
    assert set(files) == {"linkage.toml", "scene.toml"}
    flexion = np.radians([50.0, 35.0])

    linkage = parse_linkage(files["linkage.toml"])
    inputs = jnp.asarray(-flexion)
    poses = solve_poses(linkage, inputs)
    assert bool(poses.ok)
    assert found["linkage: margin"] == pytest.approx(float(poses.margin), abs=1e-6)
    for pin, angle in solve_transmission(linkage, inputs).angles.items():
        assert found[f"linkage: μ at {pin}"] == pytest.approx(np.degrees(angle), abs=1e-6)

    scene = parse_scene(files["scene.toml"])
    covered = find_coverage(scene, jnp.asarray(flexion)).value
    for part, wanted in zip(scene.layout.pads, covered, strict=True):
        assert found[f"{part.name}: coverage"] == pytest.approx(100 * float(wanted), abs=1e-9)

    # Left and right of the middle, nothing twice.
    middle = canvas.figure.bbox.width / 2
    sides = {artist.axes.bbox.x0 < middle for artist in shown.artists if artist.axes}
    assert sides == {True, False}
    assert len({id(artist) for artist in shown.artists}) == len(shown.artists)


def test_dip_follows_pip_in_a_coupled_finger():
    finger = coupled_finger()
    bench = FingerBench(finger)
    figure_of(bench)
    values = {knob.name: knob.value for knob in bench.knobs}
    assert "dip" not in values
    assert {"pip", "coupling P-Q"} <= {*values}
    values["pip"] = 50.0
    found, flexion = readings(bench.show(values)), jnp.deg2rad(jnp.array([50.0]))
    dip = find_coupled_postures(finger, flexion).dip
    assert found["dip"] == pytest.approx(float(jnp.rad2deg(dip[0])), abs=1e-9)
    scene, posture = finger.scene(), jnp.concatenate([flexion, dip])
    covered = find_coverage(scene, posture).value
    for part, wanted in zip(scene.layout.pads, covered, strict=True):
        assert found[f"{part.name}: coverage"] == pytest.approx(100 * float(wanted), abs=1e-9)
    files = {file.name: tomllib.loads(str(file.content)) for file in bench.specs(values)}
    assert [one["name"] for one in files["linkage.toml"]["inputs"]] == ["pip"]
    # Too long a bar holds it in no posture, and optics are those of straight DIP.
    broken = bench.show(values | {"coupling P-Q": 30.0})
    assert broken.message
    assert readings(broken)["dip"] == 0.0
    step = next(iter(bench.optimise(values)))
    assert {*step.values} == {*values}


def test_the_saved_linkage_is_straight(finger):
    bench, values, _ = finger
    for file in bench.specs(values | {"pip": 50.0, "dip": 35.0}):
        if file.name == "linkage.toml":
            home = parse_linkage(tomllib.loads(file.content)).reference
            np.testing.assert_allclose(home.inputs, 0, atol=1e-9)


def test_messages_of_both_are_told(finger):
    bench, values, _ = finger
    assert bench.show(values).message == ""
    # The plate's other sides are 25.7 and 6 mm long.
    message = bench.show(values | {"plate C-G'": 10.0, "camera tilt": 45.0}).message
    linkage, scene = message.split("; pad ")
    assert "plate" in linkage
    assert scene.startswith("'proximal': ")


def refusing(fault):
    """In place of the steps of a bench: why there are none."""

    def steps(_):
        yield from ()
        raise UserError(fault)

    return steps


def test_the_linkage_is_improved_before_camera_and_mirrors(finger, monkeypatch):
    from designopt.explore.bench import Step

    bench, values, _ = finger

    def longer(given):
        assert (given["pip"], given["dip"]) == (20.0, values["dip"])
        for length in (18.0, 17.5):
            yield Step({**given, "crank F-E": length}, f"crank {length:g}")

    def turned(given):
        yield Step({**given, "camera tilt": 0.0}, "turned")

    monkeypatch.setattr(bench._linkage, "optimise", longer)
    monkeypatch.setattr(bench._scene, "optimise", turned)
    values = values | {"pip": 20.0}
    steps = list(bench.optimise(values))
    assert [step.message for step in steps] == [
        "linkage: crank 18",
        "linkage: crank 17.5",
        "camera and mirrors: turned",
    ]
    assert all(step.values.keys() == values.keys() for step in steps)
    last = steps[-1].values
    assert (last["crank F-E"], last["camera tilt"]) == (17.5, 0.0)
    changed = [
        {k for k in one if one[k] != two[k]} for one, two in pairwise(s.values for s in steps)
    ]
    assert changed == [{"crank F-E"}, {"camera tilt"}]

    monkeypatch.setattr(bench._linkage, "optimise", refusing("it locks"))
    first, second = bench.optimise(values)
    assert (first.message, second.message) == ("linkage: it locks", "camera and mirrors: turned")
    monkeypatch.setattr(bench._scene, "optimise", refusing("it is bent"))
    with pytest.raises(UserError, match="linkage: it locks; camera and mirrors: it is bent"):
        list(bench.optimise(values))


@pytest.mark.nightly
def test_the_finger_is_improved(finger):
    bench, values, _ = finger
    values = values | {"camera tilt": values["camera tilt"] + 15}
    *_, last = bench.optimise(values)
    grid = np.stack(np.meshgrid(*[np.radians(np.linspace(0, 90, 7))] * 2), axis=-1).reshape(-1, 2)

    def worst(at):
        scene = next(f for f in bench.specs(at) if f.name == "scene.toml")
        found = find_coverage(parse_scene(tomllib.loads(scene.content)), jnp.asarray(grid))
        return float(np.min(found.value))

    assert worst(last.values) > worst(values) + 0.05
