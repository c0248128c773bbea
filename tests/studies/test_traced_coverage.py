"""Coverage by a path tracer's rays, from a finger's file: against Snell's law and the library."""

from __future__ import annotations

import importlib.util
import math
from dataclasses import replace
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

from optics import find_coverage
from optics.scene.layers import EndKind
from studies.models.finger import Finger
from studies.models.finger_file import bare_finger, packaged_finger, read_finger, write_finger
from studies.models.pad_layers import PadLayers
from studies.oracles.finger_tables import field_of_view
from studies.oracles.traced_coverage import traced_coverage

needs_mitsuba = pytest.mark.skipif(
    importlib.util.find_spec("mitsuba") is None,
    reason="Mitsuba is not installed; the extra 'judge' brings it",
)

FINE = 2e-5
"""Of a pad. A ray goes on 2e-4 mm behind a face, by which it misses so much of a clear end."""

ROUGH = 3e-4
"""Of a pad, where a float32 decides: Fresnel's formulas are right to 1e-6, and the light that comes
through changes by that along 1e-4 of a pad; 1e-8 rad shift rays that enter beside a membrane's end.
"""

POSES_DEG = np.vstack([[(0.0, 0.0)], np.random.default_rng(3).uniform(0, 89, (7, 2))])


def finger(
    thickness: tuple[float, ...] = (),
    ends: EndKind = "black",
    fov_deg: float = 120.0,
    reach: tuple[float, float] = (0.3, 0.6),
) -> Finger:
    """The bare finger with a narrower lens, which does not see all, and layers."""
    made = bare_finger()
    assert made.camera is not None
    made = replace(made, camera=replace(made.camera, field_of_view=math.radians(fov_deg)))
    if not thickness:
        return made
    shares, index = np.tile(reach, (len(thickness), 1)), np.array([1.49, 1.41])[: len(thickness)]
    return replace(made, layers=PadLayers(np.array(thickness), index, shares, shares, ends=ends))


def by_library(path: Path) -> np.ndarray:
    """Coverage of a file's finger."""
    return np.asarray(find_coverage(read_finger(path).scene(), jnp.deg2rad(POSES_DEG)).value)


@needs_mitsuba
@pytest.mark.parametrize(
    ("thickness", "ends"),
    [
        ((), "black"),
        ((2.0,), "black"),
        ((3.0,), "black"),
        ((2.0,), "clear"),
        ((3.0,), "clear"),
        ((2.0, 1.0), "black"),
        pytest.param((1.0, 2.0), "clear", marks=pytest.mark.slow),
    ],
)
def test_the_library_s_coverage_is_that_of_traced_rays(thickness, ends, tmp_path):
    path = tmp_path / "finger.toml"
    write_finger(finger(thickness, ends), path)
    traced, found = traced_coverage(path, POSES_DEG), by_library(path)
    np.testing.assert_allclose(found, traced, rtol=0, atol=ROUGH)
    assert np.mean(np.abs(found - traced) < FINE) >= 0.9
    assert np.sum(found < 0.99) >= 3


@needs_mitsuba
@pytest.mark.parametrize("made", [bare_finger, packaged_finger])
def test_fingers_of_the_package_are_seen_whole(made, tmp_path):
    write_finger(made(), tmp_path / "finger.toml")
    assert traced_coverage(tmp_path / "finger.toml", POSES_DEG) == pytest.approx(1, abs=FINE)


@needs_mitsuba
def test_a_black_end_hides_what_snells_law_says(tmp_path):
    """Of the proximal pad of the straight finger, 3 mm flush and no mirrors."""
    made = replace(finger((3.0,), fov_deg=170.0, reach=(0.0, 0.0)), mirrors=())
    path = tmp_path / "finger.toml"
    write_finger(made, path)
    assert made.camera is not None
    gap, height = 4.0, 25.0 - float(made.camera.depth) - 3.0
    sine = math.sin(math.atan((float(made.camera.along) + gap) / height)) / 1.49
    strip = 3.0 * math.tan(math.asin(sine))
    [[proximal, *_]] = traced_coverage(path, POSES_DEG[:1])
    assert proximal == pytest.approx(1 - strip / (35.0 - gap - 1.5), abs=1e-5)


@needs_mitsuba
@pytest.mark.parametrize(
    ("right", "wrong"),
    [
        ("index = 1.49", "index = 1.44"),
        ("reach = [0.3, 0.6]", "reach = [0.6, 0.3]"),
        ('ends = "black"', 'ends = "clear"'),
        ("fov_deg = 120.0", "fov_deg = 119.5"),
        ("to = [-29.768", "to = [-30.268"),
        ("tilt_deg = -3.8", "tilt_deg = -4.3"),
        ("min_transmission = 0.3", "min_transmission = 0.8"),
    ],
)
def test_a_wrong_finger_is_noticed(right, wrong, tmp_path):
    path = tmp_path / "finger.toml"
    write_finger(finger((3.0,)), path)
    found, text = by_library(path), path.read_text(encoding="utf-8")
    assert right in text
    path.write_text(text.replace(right, wrong), encoding="utf-8")
    assert np.max(np.abs(traced_coverage(path, POSES_DEG) - found)) > 5 * ROUGH


@pytest.mark.parametrize(
    ("camera", "degrees"),
    [
        ({"fov_deg": 150}, 150.0),
        ({"model": "imx219-200", "format": {"section_axis": "long"}}, 200.0),
        ({"model": "imx219-200", "format": {"section_axis": "short"}}, math.degrees(2.76 / 0.87)),
        ({"model": "ov5647-160", "format": {"section_axis": "long"}}, 128.0),
        ({"model": "raspberry-pi-2", "format": {"section_axis": "long"}}, 62.4),
        (
            {"model": "ov5647-160", "projection": "equisolid", "format": {"section_axis": "long"}},
            4 * math.degrees(math.asin(0.8 * math.sin(math.radians(40)))),
        ),
    ],
)
def test_the_field_of_view_of_a_lens_as_sold(camera, degrees):
    assert field_of_view(camera) == pytest.approx(degrees, abs=0.05)
