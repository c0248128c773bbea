"""What the main job, the study ``finger`` with its default settings, has written.

The environment variable FINGER_RESULT names the folder of the result; without it the study is run.
"""

import json
import os
import tomllib
from pathlib import Path

import pytest

from designopt.cli import run as command
from studies.finger.run import finger_design
from studies.finger.spec import FingerSpec
from studies.models import packaged_finger
from studies.models.linkage_design.judging import judged as judge_linkage
from studies.models.linkage_design.spec import MotorSpec
from studies.models.mirror_design.judging import judged as judge_mirrors
from tests.studies.quick import quick_run

pytestmark = pytest.mark.as_users


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    if "FINGER_RESULT" in os.environ:
        return Path(os.environ["FINGER_RESULT"])
    out = tmp_path_factory.mktemp("main-job") / "finger"
    assert command(["run", "finger", "--out", str(out)]) == 0
    return out


@pytest.fixture(scope="module")
def metrics(result):
    document = json.loads((result / "results.json").read_text(encoding="utf-8"))
    return {name: metric["value"] for name, metric in document["metrics"].items()}


def test_every_requirement_is_met(result, metrics):
    assert metrics["requirements_missed"] == 0
    assert metrics["min_transmission_angle_deg"] > 42  # 44.5 degrees before walls of 1.2 mm
    for name in ("finger", "linkage", "linkage-crank", "scene"):
        assert tomllib.loads((result / "specs" / f"{name}.toml").read_text(encoding="utf-8"))


def test_the_packaged_finger_is_as_good(result, metrics):
    """The search for mirrors follows rounding, so that another machine finds another finger."""
    for finger in (finger_design(FingerSpec(), result / "specs"), packaged_finger()):
        least = judge_linkage(finger, FingerSpec().linkage.limits, MotorSpec()).least_deg
        assert least == pytest.approx(metrics["min_transmission_angle_deg"], abs=0.05)
        verdict = judge_mirrors(finger)
        assert verdict.meets(FingerSpec().mirrors.floor)
        assert verdict.worst_px_per_mm == pytest.approx(metrics["worst_px_per_mm"], rel=0.2)


def test_the_finger_is_found_on_its_images(result, tmp_path):
    """Designs follow rounding from machine to machine; whichever comes out must be found.

    Three by three pixels of the sensor are read as one.
    """
    scene, text = tmp_path / "scene.toml", (result / "specs" / "scene.toml").read_text()
    assert "pixels = [3280, 2464]" in text
    scene.write_text(text.replace("pixels = [3280, 2464]", "pixels = [1093, 821]"))
    alone = ("independent=0", "corrupted=0", "sizes=[]")  # parts that these numbers do not need
    measured = quick_run("tactile-images", tmp_path, f"scene={scene}", *alone).measured
    assert measured["found_at_gain_1"] >= 0.95
    assert measured["corner_p90_px"] <= 5
    assert measured["unwarp_p90_mm"] <= 0.3
