"""A lens's file: what is read is what was written, and faults are one line."""

import numpy as np
import pytest

from designopt import UserError
from optics.calibration import CalibratedLens, read_lens, write_lens
from optics.calibration.bundle import lens_of, parameters_of
from optics.calibration.calibrated import format_lens
from tests.optics.calibration.pictures import LENS, TRUTH

SHAPE = np.random.default_rng(0).normal(size=(9, 9))
CALIBRATED = CalibratedLens(
    lens_of(TRUTH),
    LENS.size,
    1e-4 * SHAPE @ SHAPE.T,
    0.04,
    0.05,
    1.4,
    (18.5, 44.0),
    12,
    "my camera",
)


def test_a_lens_is_read_as_it_was_written(tmp_path):
    write_lens(CALIBRATED, tmp_path / "lens.toml")
    found = read_lens(tmp_path / "lens.toml")
    assert parameters_of(found.lens).tolist() == parameters_of(CALIBRATED.lens).tolist()
    assert found.covariance.tolist() == CALIBRATED.covariance.tolist()
    same = ("size", "noise", "held_out", "widest", "distances", "pictures", "name")
    assert [getattr(found, name) for name in same] == [getattr(CALIBRATED, name) for name in same]
    np.testing.assert_allclose(found.deviations, np.sqrt(np.diagonal(CALIBRATED.covariance)))


@pytest.mark.parametrize(
    ("old", "new", "line"),
    [
        ("focal_px = 350.0", "focal_px = -350.0", "lens.focal_px: a length must be positive"),
        ("pixels = [1280, 960]", "pixels = [1280]", "lens.pixels"),
        ("widest_deg = ", "widest = ", "no such key; did you mean 'widest_deg'?"),
        ("widest_deg = 80", "widest_deg = 170", "the image grows only up to"),
        ("covariance = [[", "covariance = [[1e9, ", "'covariance' needs 9 rows of 9 numbers"),
        ("covariance = [[", "covariance = [[-", "'covariance' is none"),
        ("format = 1", "format = 2", "reads format 1 and not 2"),
    ],
)
def test_a_fault_is_one_line_with_its_cure(tmp_path, old, new, line):
    text = format_lens(CALIBRATED)
    if "170" in new:
        text = text.replace("projection = [", "projection = [-0.2, 0.0, 0.0, 0.0] #")
        old, new = (
            next(row for row in text.splitlines() if row.startswith("widest_deg")),
            "widest_deg = 120",
        )
    assert old in text
    path = tmp_path / "lens.toml"
    path.write_text(text.replace(old, new), encoding="utf-8")
    with pytest.raises(UserError) as fault:
        read_lens(path)
    assert line in str(fault.value)
    assert "\n" not in str(fault.value)
