"""The finger's explorer shows linkage and scene in one pose, as their own solvers compute it."""

from __future__ import annotations

import math
import tomllib
from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest

from designopt.explore.explorer import Chart, View
from kinematics.io.reading import parse_linkage
from kinematics.solve.poses import solve_poses
from optics.scene.reading import parse_scene
from optics.visibility.coverage import find_coverage
from studies.finger.explorer import FingerExplorer
from studies.finger.run import design as designed_by_study
from studies.finger.spec import FingerSpec
from studies.models.finger import Finger
from studies.models.finger_file import packaged_finger
from studies.models.finger_parametric.design import FingerParametric
from studies.models.linkage_design.coupling.postures import find_coupled_postures
from studies.models.linkage_design.transmission import finger_transmission
from studies.models.pins import pin_name
from tests.designopt.explore.whole import show
from tests.studies.fingers import coupled_finger

MOVED = {"pip": 50.0, "dip": 35.0, "pins.E.x": -20.0, "camera.tilt": 5.0, "camera.along": 12.0}


def explored(finger: Finger) -> FingerExplorer:
    return FingerExplorer(FingerParametric(finger))


def panels(shown, kind):
    return {one.name: one for one in shown.panels if isinstance(one, kind)}


@pytest.fixture(scope="module")
def finger():
    explorer = explored(packaged_finger())
    return explorer, explorer.values()


def test_flexion_turns_and_the_body_is_a_dimension(finger):
    explorer, values = finger
    assert [(one.name, one.low, one.value, one.high, one.unit) for one in explorer.joints] == [
        ("pip", 0, 0, 90, "°"),
        ("dip", 0, 0, 90, "°"),
    ]
    assert values.keys() >= {*MOVED, "body.thickness"}
    assert explorer.presets["half closed"] == {"pip": 45.0, "dip": 45.0}


def test_the_study_explores_with_what_its_settings_ask_for():
    spec = FingerSpec.model_validate({"linkage": {"limits": {"transmission_deg": 42.0}}})
    # The folder would be that of a result: its design is not asked for.
    kind = designed_by_study(FingerSpec(), None).kind
    assert kind.parametric is not None
    design = kind.parametric(packaged_finger(), {})
    assert {
        bound.value for bound in design.requirements if bound.measure == "min_transmission"
    } == {40.0}
    other = FingerParametric(packaged_finger(), spec.linkage.limits)
    assert {b.value for b in other.requirements if b.measure == "min_transmission"} == {42.0}


def test_the_sketch_is_the_straight_finger(finger):
    explorer, _ = finger
    linkage, scene = explorer.sketch()
    assert (linkage.name, scene.name) == ("linkage", "what the camera sees")
    tables = packaged_finger().linkage_tables()
    for handle in linkage.handles:
        joint = handle.name.removeprefix("pin ")
        np.testing.assert_allclose(handle.place, tables["joints"][joint], atol=1e-12)
    camera = np.asarray(packaged_finger().scene().camera.position)
    places = {handle.name: handle.place for handle in scene.handles}
    np.testing.assert_allclose(places["camera"], camera, atol=1e-9)
    assert len(scene.handles) == 6


@pytest.mark.slow
def test_both_are_shown_in_one_pose(finger):
    explorer, values = finger
    values = values | MOVED
    shown = show(explorer, values)
    found = {one.name: one.value for one in shown.readouts}
    assert len(found) == len(shown.readouts)
    assert (found["pip"], found["dip"]) == pytest.approx((50.0, 35.0), abs=1e-12)
    files = {file.name: str(file.content) for file in explorer.design.files(values)}
    flexion = np.radians([50.0, 35.0])

    linkage = parse_linkage(tomllib.loads(files["linkage.toml"]))
    poses = solve_poses(linkage, jnp.asarray(-flexion))
    assert found["from lock-up"] == pytest.approx(float(poses.margin), abs=1e-6)
    angles = finger_transmission(poses.value)
    assert found["μ_D1"] == pytest.approx(np.degrees(angles["D1"]), abs=1e-6)
    assert found["μ_G'"] == pytest.approx(np.degrees(angles["H"]), abs=1e-6)
    views = panels(shown, View)
    for handle in views["linkage"].handles:
        joint = handle.name.removeprefix("pin ")
        np.testing.assert_allclose(handle.place, poses.value.position(joint), atol=1e-6)
        [circle] = {c.center for c in views["linkage"].drawing.circles if c.name == joint}
        assert circle == pytest.approx(handle.place, abs=1e-9)

    scene = parse_scene(tomllib.loads(files["scene.toml"]))
    covered = find_coverage(scene, jnp.asarray(flexion)).value
    for part, wanted in zip(scene.layout.pads, covered, strict=True):
        assert found[f"{part.name}: coverage"] == pytest.approx(100 * float(wanted), abs=1e-6)
    charts = panels(shown, Chart)
    (curve,) = [s for s in charts["coverage"].series if s.name == "distal"]
    at = jnp.array([math.radians(curve.x[7]), flexion[1]])
    assert curve.y[7] == pytest.approx(100 * float(find_coverage(scene, at).value[2]), abs=1e-6)
    assert charts["transmission angles"].at == 50.0
    assert shown.message == "" or "pad" in shown.message


@pytest.mark.slow
def test_what_is_dragged_goes_there(finger):
    """Pins and mirror ends end where they are dropped, in a pose in which everything is turned."""
    explorer, values = finger
    values = values | {"pip": 40.0, "dip": 25.0}
    shown = show(explorer, values)
    moved = 0
    for view in panels(shown, View).values():
        for handle in view.handles:
            assert explorer.drag(values, handle.name, handle.place) == pytest.approx(
                values, abs=1e-8
            )
            x, y = handle.place
            wanted = (x + 0.02, y - 0.01)
            after = explorer.drag(values, handle.name, wanted)
            assert {n for n in after if after[n] != values[n]} <= {*handle.parameters}
            if handle.name in ("camera axis", "camera"):
                continue
            again = panels(show(explorer, after), View)[view.name]
            [place] = [one.place for one in again.handles if one.name == handle.name]
            # Pins of bars turn with these: what the bars do then is of second order.
            near = 0.02 if handle.name.startswith("pin ") else 1e-9
            assert math.dist(place, wanted) <= near
            moved += 1
    assert moved == 7 + 4
    far = explorer.drag(values, "pin F", (1e3, 1e3))
    ends = {one.name: one.high for one in explorer.design.parameters}
    assert (far["pins.F.x"], far["pins.F.y"]) == (ends["pins.F.x"], ends["pins.F.y"])


def test_a_pin_is_dragged_from_any_values():
    """Also from some that are not shown, or no longer: a drag may begin from an older picture."""
    explorer = explored(replace(packaged_finger(), camera=None, mirrors=(), layers=None))
    bent = explorer.values() | {"pip": 30.0}
    found = explorer.drag(bent, "pin E", (-20.0, 13.0))
    assert found["pins.E.x"] != bent["pins.E.x"]
    for other in (31.0, 32.0, 33.0):
        assert explorer.drag(bent, "pin E", (-20.0, 13.0)) == pytest.approx(found, abs=1e-9)
        show(explorer, bent | {"pip": other})


def test_a_linkage_that_cannot_be_assembled_is_told():
    finger = replace(packaged_finger(), camera=None, mirrors=(), layers=None)
    explorer = explored(finger)
    # A crank of 1 mm cannot follow.
    at = explorer.values()
    values = at | {"pip": 80.0, "pins.E.x": at["pins.F.x"] + 1.0, "pins.E.y": at["pins.F.y"]}
    shown = show(explorer, values)
    assert shown.message.startswith("the linkage cannot be assembled at PIP 80°, DIP 0°: ")
    found = {one.name: one.value for one in shown.readouts}
    assert found["μ_E"] is None
    (chart,) = panels(shown, Chart).values()
    assert any(math.isnan(value) for value in chart.series[0].y)
    assert [one.name for one in shown.panels] == ["linkage", "transmission angles"]
    assert show(explorer, at).message == ""


def test_dip_follows_pip_in_a_coupled_finger():
    finger = replace(coupled_finger(), camera=None, mirrors=(), layers=None)
    explorer = explored(finger)
    assert [joint.name for joint in explorer.joints] == ["pip"]
    shown = show(explorer, explorer.values() | {"pip": 50.0})
    found = {one.name: one.value for one in shown.readouts}
    dip = find_coupled_postures(finger, jnp.deg2rad(jnp.array([50.0]))).dip
    assert found["dip"] == pytest.approx(float(jnp.rad2deg(dip[0])), abs=1e-9)
    (view,) = panels(shown, View).values()
    assert [one.name for one in view.handles] == [f"pin {pin_name(pin)}" for pin in "PQK"]
    for handle in view.handles:
        values = explorer.values() | {"pip": 50.0}
        assert explorer.drag(values, handle.name, handle.place) == pytest.approx(values, abs=1e-8)
