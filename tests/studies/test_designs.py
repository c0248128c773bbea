"""What every study designs: found without a search, and what the study says of it."""

import json
import math
from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock

import jax.numpy as jnp
import numpy as np
import pytest

from designopt import Study, UserError
from designopt.designs import load_design
from designopt.study.settings import spec_of
from designopt.study.study import installed_studies, load_study
from kinematics.io.designed import DesignedLinkage
from optics import Chamber, find_coverage
from optics.chamber.designed import DesignedChamber
from optics.scene.designed import DesignedScene
from studies.finger.run import finger_design
from studies.finger.spec import FingerSpec
from studies.finger_linkage.run import design as linkage_design
from studies.finger_mirrors.run import design as mirrors_design
from studies.models import Finger, bare_finger, packaged_finger, write_finger
from studies.models.body import BodySpec
from studies.models.linkage_design.judging import everywhere
from studies.models.linkage_design.spec import FingerLinkageSpec
from studies.models.mirror_design.spec import FingerMirrorsSpec
from studies.models.soft_finger import paper
from studies.models.soft_finger.finger import SoftFinger
from studies.models.soft_finger.spec import ChamberImagesSpec
from studies.models.spec_files import scene_file
from studies.table1 import Table1Spec
from tests.studies.fingers import OLD, finger_of, seeing_finger

KINDS = {
    "bending-direction": DesignedChamber,
    "bending-posture": DesignedChamber,
    "finger": Finger,
    "finger-grasp": DesignedLinkage,
    "finger-linkage": DesignedLinkage,
    "finger-mirrors": DesignedScene,
    "object-size": DesignedChamber,
    "proprioception": DesignedScene,
    "surface-profile": DesignedChamber,
    "table1": DesignedChamber,
    "tactile-images": DesignedScene,
}
SOFT = ("bending-direction", "bending-posture", "object-size", "surface-profile")
IMAGED = ("proprioception", "tactile-images")


@pytest.fixture
def unsearched(monkeypatch):
    """Lets no search run."""

    def refused(*arguments):
        raise AssertionError("a search was begun")

    for place in (
        "studies.finger_linkage.run.search_linkage",
        "studies.models.linkage_design.analysis.search_linkage",
        "studies.finger_mirrors.run.design_mirrors",
        "studies.finger.designing.design_mirrors",
    ):
        monkeypatch.setattr(place, refused)


def test_these_studies_design_something():
    offered = {
        name
        for name, study in installed_studies()
        if isinstance(study, Study) and study.design is not None
    }
    assert offered == set(KINDS)


@pytest.mark.parametrize("name", KINDS)
def test_every_design_is_there_without_a_search(unsearched, name):
    design = load_design(name)
    assert isinstance(design.model, KINDS[name])
    chamber = KINDS[name] is DesignedChamber
    assert design.name.startswith(name if chamber else "finger")


@pytest.mark.parametrize("name", KINDS)
def test_settings_come_back_from_a_result(name):
    spec = load_study(name).spec()
    tables = json.loads(json.dumps(spec.model_dump(mode="json")))
    assert spec_of(type(spec), tables, source=name) == spec


def designed(name: str, *settings: str) -> Any:
    return load_design(name, settings).model


def chamber_of(name: str, *settings: str) -> Chamber:
    return designed(name, *settings).chamber


# --- linkages


def test_the_packaged_linkage_has_the_transmission_angle_that_is_told(unsearched):
    """42.32°, as the READMEs have it, by the general solver on the 1° grid."""
    linkage = designed("finger-linkage").linkage
    flexion = np.deg2rad(np.arange(0.0, 91.0))
    square = np.stack(np.meshgrid(flexion, flexion, indexing="ij"), axis=-1)
    poses, angles = everywhere(linkage, -jnp.asarray(square))
    assert bool(jnp.all(poses.ok))
    least = min(float(jnp.min(angle)) for angle in angles.values())
    assert round(math.degrees(least), 2) == 42.32


def test_settings_that_only_judge_the_linkage_leave_it(unsearched):
    default = designed("finger-linkage")
    same = designed("finger-linkage", "precision=false", "front=[]", "draws=10", "tolerance=0.2")
    assert same.sketch == default.sketch
    tables = designed("finger").linkage_tables()
    assert tables["joints"]["E"] == list(default.sketch.joints["E"])


def test_another_body_is_searched_for(monkeypatch):
    seen = []

    def search(spec, seed):
        seen.append((spec.body.thickness, seed))
        return SimpleNamespace(finger=finger_of(None, distal=spec.body.distal))

    monkeypatch.setattr("studies.finger_linkage.run.search_linkage", search)
    design = designed("finger-linkage", "body.thickness=22", "body.distal=30")
    assert seen == [(22.0, 0)]
    assert design.sketch.joints["E"] == pytest.approx((-21.27, 14.06))
    assert design.sketch.joints["T"] == (53.0, 0.0)
    assert design.linkage.input_names == ("pip", "dip")


def test_the_linkage_of_an_earlier_result_is_its_file(unsearched, tmp_path):
    text = (OLD / "linkage.toml").read_text(encoding="utf-8")
    spec = FingerLinkageSpec(body=BodySpec(thickness=22.0))
    with pytest.raises(UserError, match=r"linkage\.toml: cannot be read"):
        linkage_design(spec, tmp_path)
    (tmp_path / "linkage.toml").write_text(text.replace("-7.77, -1.98", "-7.5, -2.0"))
    assert linkage_design(spec, tmp_path).model.sketch.joints["F"] == (-7.5, -2.0)


def test_the_grasping_finger_is_driven_by_its_crank_and_has_its_spring():
    linkage = designed("finger-grasp", "spring_stiffness=12", "pins.G=[11.0, 2.0]").linkage
    assert linkage.input_names == ("theta", "gamma")
    (spring,) = linkage.springs
    assert (float(spring.stiffness), float(spring.preload)) == (12.0, 0.3)
    crank = math.hypot(21.27 - 7.75, 14.06 + 2.0)  # design B's |EF|
    assert float(linkage.links["crank"].length) == pytest.approx(crank, rel=1e-12)
    bar = math.hypot(15.0 - 11.0, 19.0 - 2.0)
    assert float(linkage.links["bar"].length) == pytest.approx(bar, rel=1e-12)


# --- scenes


@pytest.mark.parametrize("name", ["finger-mirrors", *IMAGED])
def test_the_packaged_scene_shows_every_pad(unsearched, name):
    scene = designed(name).scene
    angles = jnp.asarray(np.deg2rad([[0.0, 0.0], [30.0, 60.0], [90.0, 90.0]]))
    np.testing.assert_allclose(find_coverage(scene, angles).value, 1.0, atol=1e-9)
    finger = bare_finger() if name in IMAGED else packaged_finger()
    np.testing.assert_array_equal(scene.mirrors, finger.scene().mirrors)


def test_settings_that_only_judge_the_mirrors_leave_them(unsearched):
    same = designed("finger-mirrors", "thin=20", "draws=10", "solvers=none")
    assert same.file == designed("finger-mirrors").file


def test_other_mirrors_are_searched_for(monkeypatch):
    def search(finger, spec, context):
        assert (float(finger.body.thickness), spec.floor, context.seed) == (25.0, 3.0, 0)
        return SimpleNamespace(finger=seeing_finger())

    monkeypatch.setattr("studies.finger_mirrors.run.design_mirrors", search)
    design = designed("finger-mirrors", "floor=3.0")
    assert [mirror.name for mirror in design.file.mirrors] == ["distal", "proximal"]
    np.testing.assert_allclose(design.file.camera.position, [15.75, 16.99])


def test_another_finger_is_searched_for(monkeypatch):
    made = seeing_finger(distal=30.0)
    designer = Mock()
    designer.parts.return_value = (None, SimpleNamespace(finger=made), None)
    monkeypatch.setattr("studies.finger.run.Designer", Mock(return_value=designer))
    spec = FingerSpec(body=BodySpec(distal=30.0))
    design = finger_design(spec, None)
    designer.parts.assert_called_once_with(spec)
    assert design.linkage_tables()["joints"]["T"] == [53.0, 0.0]
    np.testing.assert_allclose(design.scene().camera.position, [15.75, 16.99])


def test_the_mirrors_of_an_earlier_result_are_its_file(unsearched, tmp_path):
    spec = FingerMirrorsSpec(floor=3.0)
    with pytest.raises(UserError, match=r"scene\.toml: cannot be read"):
        mirrors_design(spec, tmp_path)
    file = scene_file(seeing_finger())
    (tmp_path / file.name).write_text(str(file.content), encoding="utf-8")
    found = mirrors_design(spec, tmp_path).model
    np.testing.assert_allclose(found.file.camera.position, [15.75, 16.99])
    np.testing.assert_allclose(found.scene.mirrors[1], [[4.16, 18.5], [-28.35, 9.3]])


@pytest.mark.parametrize("name", IMAGED)
def test_the_scene_that_is_imaged_may_be_a_file(tmp_path, name):
    path = tmp_path / "mine.toml"
    text = (OLD / "scene.toml").read_text(encoding="utf-8")
    path.write_text(text.replace("fov_deg = 160.0", "fov_deg = 150.0"), encoding="utf-8")
    assert designed(name, f"scene={path}").file.camera.fov_deg == 150.0
    write_finger(seeing_finger(), path)
    assert designed(name, f"scene={path}").file.camera.fov_deg == 160.0
    with pytest.raises(UserError, match=r"none\.toml: cannot be read"):
        load_design(name, [f"scene={tmp_path / 'none.toml'}"])


# --- chambers


@pytest.mark.parametrize("clearance", [1.5, 2.0])
def test_table1s_chamber_leaves_its_clearance(clearance):
    chamber = chamber_of("table1", f"clearance={clearance}")
    assert float(chamber.offset_d) == pytest.approx(4.1 - clearance, rel=1e-9)
    assert float(chamber.reference_height) == pytest.approx(8.616, abs=0.001)
    assert float(chamber.pinhole_offset) == pytest.approx(0.844, abs=0.001)
    # The table's line, 12.591 η − 5.004 mm.
    ratio = (4.1 - clearance + 5.004) / 12.591
    assert float(chamber.imaging_ratio().value) == pytest.approx(ratio, abs=2e-4)


def test_a_result_of_table1_is_its_chamber(tmp_path):
    spec = Table1Spec(clearance=2.0).model_dump(mode="json")
    (tmp_path / "results.json").write_text(json.dumps({"study": "table1", "spec": spec}))
    assert float(chamber_of(str(tmp_path)).offset_d) == pytest.approx(2.1, rel=1e-9)


def test_a_chamber_that_cannot_be_chosen_is_refused():
    settings = ["chamber.wall_angle_bc_deg=30", "clearance=0.0005"]
    with pytest.raises(UserError, match=r"^--set chamber: no η could be chosen: "):
        load_design("table1", settings)
    with pytest.raises(UserError, match=r"^--set chamber: no camera constants bring this chamber"):
        load_design("table1", ["chamber.length_ab=1000"])


@pytest.mark.parametrize("name", SOFT)
@pytest.mark.parametrize("row", [0, 2, 4])
def test_soft_fingers_are_rows_of_table_i(name, row):
    chamber = chamber_of(name, f"eta={paper.ETA[row]}")
    assert float(chamber.offset_d) == pytest.approx(10 * paper.DELTA_L_D_CM[row], abs=0.005)
    angle = math.degrees(float(chamber.wall_angle_cd))
    assert angle == pytest.approx(paper.THETA_CD_DEG[row], abs=0.0005)


def test_a_soft_finger_is_the_one_whose_images_are_made():
    chamber = chamber_of("object-size")
    expected = SoftFinger.of(ChamberImagesSpec()).chamber
    assert float(chamber.offset_d) == float(expected.offset_d)
    with pytest.raises(UserError, match=r"^--set eta=1\.2: no chamber"):
        load_design("object-size", ["eta=1.2"])
