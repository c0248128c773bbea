"""The posture in one frame is that of its parts, and there is none where no chamber is seen."""

from dataclasses import replace

import numpy as np
import pytest

from designopt.errors import UserError
from perception.chamber import ChamberStatus, find_regions
from perception.posture import Training, find_posture, make_boundary_image, shrink, train
from tests.perception.chamber.drawn import HALF

SIZE = (32, 24)
STRAIGHT = HALF


@pytest.fixture(scope="module")
def estimator():
    generator = np.random.default_rng(0)
    images, markers = [], []
    for down in np.linspace(0, 40, 24):
        regions = find_regions(STRAIGHT.moved(0, down).image())
        images.append(shrink(make_boundary_image(regions.nested()), SIZE))
        markers.append(np.full((3, 2), down) + generator.normal(0, 0.1, (3, 2)))
    return train(np.stack(images), np.stack(markers), Training(epochs=60, batch=8))


def test_what_is_drawn_farther_down_is_read_farther_down(estimator):
    read = []
    for down in (5.0, 20.0, 35.0):
        seen = find_posture(STRAIGHT.moved(0, down).image(), estimator)
        assert seen.status is ChamberStatus.CHAMBER
        assert seen.markers is not None
        read.append(float(seen.markers.mean()))
    np.testing.assert_allclose(read, [5, 20, 35], atol=4)


SWAPPED = np.ascontiguousarray(STRAIGHT.image()[..., ::-1])


@pytest.mark.parametrize(
    ("image", "status"),
    [(0, "TOO_DARK"), (255, "TOO_BRIGHT"), (120, "NO_CHAMBER"), (SWAPPED, "SWAPPED")],
)
def test_without_a_chamber_there_is_no_posture(estimator, image, status):
    seen = find_posture(np.broadcast_to(np.uint8(image), SWAPPED.shape), estimator)
    assert seen.status is ChamberStatus[status]
    assert seen.markers is None


def test_a_frame_smaller_than_the_networks_images_is_refused(estimator):
    large = replace(estimator, record=replace(estimator.record, image_size=(640, 480)))
    with pytest.raises(UserError, match="320x240 px cannot be shrunk to 640x480 px; give"):
        find_posture(STRAIGHT.image(), large)
