"""What the main job, the study ``finger`` with its default settings, has written.

The environment variable FINGER_RESULT names the folder of the result; without it the study is run.
"""

import json
import math
import os
import tomllib
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

from designopt.cli import run as command
from optics import find_views
from optics.visibility.sharpness import find_sharpness
from studies.finger import FingerSpec
from studies.finger.run import finger_design
from studies.models.linkage_design.judging import everywhere
from tests.studies.test_tactile_images import run as make_images

pytestmark = pytest.mark.as_users


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    if "FINGER_RESULT" in os.environ:
        return Path(os.environ["FINGER_RESULT"])
    out = tmp_path_factory.mktemp("main-job") / "finger"
    assert command(["run", "finger", "--out", str(out)]) == 0
    return out


def test_every_requirement_is_met(result):
    document = json.loads((result / "results.json").read_text(encoding="utf-8"))
    metrics = {name: metric["value"] for name, metric in document["metrics"].items()}
    assert metrics["requirements_missed"] == 0
    assert metrics["worst_coverage"] == 1
    assert metrics["min_transmission_angle_deg"] > 45
    assert not any(metric["met"] is False for metric in document["metrics"].values())
    for name in document["specs"]:
        assert tomllib.loads((result / name).read_text(encoding="utf-8"))


def least_transmission_deg(linkage) -> float:
    flexion = np.deg2rad(np.arange(0.0, 91.0, 5.0))
    square = np.stack(np.meshgrid(flexion, flexion, indexing="ij"), axis=-1)
    _, angles = everywhere(linkage, -jnp.asarray(square))
    return math.degrees(min(float(jnp.min(angle)) for angle in angles.values()))


def seen(scene) -> tuple[float, float]:
    """The least coverage, and the least resolution, px/mm, over postures with both joints alike."""
    angles = np.deg2rad(np.repeat(np.arange(0.0, 91.0, 2.0)[:, None], 2, axis=1))
    views = find_views(scene, jnp.asarray(angles)).value
    sharpness = find_sharpness(scene, angles, views, bounces=scene.layout.bounces)
    return float(jnp.min(views.coverage())), float(np.min(sharpness.px_per_mm[..., 0]))


def test_the_packaged_finger_is_as_good(result):
    """The search for mirrors follows rounding, so that another machine finds another finger."""
    found, packaged = (finger_design(FingerSpec(), folder) for folder in (result / "specs", None))
    one, other = (least_transmission_deg(each.linkage()) for each in (found, packaged))
    assert one == pytest.approx(other, abs=0.05)
    (coverage, resolution), (packaged_coverage, packaged_resolution) = (
        seen(each.scene()) for each in (found, packaged)
    )
    np.testing.assert_allclose([coverage, packaged_coverage], 1, atol=1e-6)
    assert min(resolution, packaged_resolution) >= FingerSpec().mirrors.floor
    assert resolution == pytest.approx(packaged_resolution, rel=0.2)


def test_the_finger_is_found_on_its_images(result, tmp_path):
    """Designs follow rounding from machine to machine; whichever comes out must be found."""
    _, document = make_images(tmp_path / "images", f"scene={result / 'specs' / 'scene.toml'}")
    measured = {name: metric["value"] for name, metric in document["metrics"].items()}
    assert measured["found_at_gain_1"] >= 0.95
    assert measured["corner_p90_px"] <= 5
    assert measured["unwarp_p90_mm"] <= 0.3
