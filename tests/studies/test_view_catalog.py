"""What fabricated fingers hide of a pad: shares of fingers against the normal distribution."""

import dataclasses
from statistics import NormalDist

import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array

from optics import Fabrication, Imaging, parse_scene
from perception.matching import ViewCatalog
from studies.models.sensor.catalog import MADE, catalog_of
from studies.models.sensor.finger_sensor import lens_of

FIELD_DEG = 100.0
HIGH_DEG, LOW_DEG = 49.5, -45.0
"""Where the upper pad's upper end and the lower pad's lower one are seen: near the image's border
half a degree away, and far from it."""

AWAY, HALF_WAY = 20.0, 10.0


def tables(long: float, lens: dict) -> dict:
    """Two pads that stay in a plane before the camera; a post before the lower one; one that moves.

    The line of sight to the lower pad's lower end passes 0.1 mm above the post; that pad is so
    long, mm.
    """
    low = AWAY * np.tan(np.radians(LOW_DEG))
    ends = {"upper": (5.0, AWAY * np.tan(np.radians(HIGH_DEG))), "lower": (low, low + long)}
    pads = [
        {"name": name, "from": [AWAY, first], "to": [AWAY, second], "side": "left"}
        for name, (first, second) in ends.items()
    ]
    pads.append({"name": "tip", "from": [30.0, -2.0], "to": [30.0, 2.0], "side": "left"})
    pads[-1]["body"] = "tip"
    post = {"name": "post", "from": [HALF_WAY, -30.0], "to": [HALF_WAY, low / 2 - 0.1]}
    return {
        "scene": {"name": "two pads", "format": 1, "bounces": 0},
        "camera": {
            "position": [0.0, 0.0],
            "direction_deg": 0.0,
            "projection": "equidistant",
        }
        | lens,
        "pads": pads,
        "blockers": [post],
        "frames": {"tip": {"hinge": [30.0, 0.0], "angle": "dip"}},
    }


PIXELS = 540
NARROW, WIDE = ({"fov_deg": part * FIELD_DEG, "pixels": round(part * PIXELS)} for part in (1, 1.2))
"""Two sizes of one image."""


def catalog_made(
    long: float = 8.0, layers: tuple = (), lens: dict = NARROW, **deviations: Array
) -> ViewCatalog:
    """Of fingers with such errors only, and such layers on the upper pad."""
    own = tables(long, lens)
    if layers:
        own["pads"][0]["layers"] = list(layers)
    scene = parse_scene(own, "two pads")
    errors = dataclasses.replace(Fabrication.none(scene.layout), **deviations)
    imaging = Imaging.of(scene.camera)
    return catalog_of(scene, imaging, lens_of(imaging), 10.0, errors, ())


OF_33 = 3 * np.sqrt(0.25 / (MADE + 1))
"""Three standard deviations of a share of 33 fingers."""

UP_AND_DOWN = jnp.array([0.0, 2 * 0.1 / 0.4])
"""Of the camera, mm: 0.4 of it brings the lower end behind the post, as its line of sight falls
there by half as much."""


TILT = jnp.asarray(np.radians(2 * (FIELD_DEG / 2 - HIGH_DEG)))
"""Half of it brings the upper end to the end of the field of view."""


def test_what_the_images_border_cuts_is_not_hidden():
    upper, lower, _ = catalog_made(tilt=TILT).families
    assert upper.complete[0] == pytest.approx(NormalDist().cdf(0.5), abs=OF_33)
    assert (upper.unhidden[0], upper.ends[0].tolist()) == (1, [True, True])
    assert (lower.complete[0], lower.unhidden[0], lower.ends[0].all()) == (1, 1, True)


def test_what_an_image_circle_within_the_image_cuts_is_hidden():
    focal = 2.0
    long = 1.2 * np.radians(FIELD_DEG) * focal
    sensor = {"sensor_mm": [long, 0.75 * long], "pixels": [648, 486], "section_axis": "long"}
    circle = np.radians(FIELD_DEG) * focal
    lens = {"format": sensor, "focal_length": focal, "image_circle_mm": circle}
    upper = catalog_made(lens=lens, tilt=TILT).families[0]
    assert upper.complete[0] == pytest.approx(NormalDist().cdf(0.5), abs=OF_33)
    assert (upper.unhidden[0], upper.ends[0].tolist()) == (upper.complete[0], [True, False])


def test_what_is_behind_something_in_some_fingers_is_hidden_in_as_many():
    lower = catalog_made(camera=UP_AND_DOWN).families[1]
    assert lower.complete[0] == pytest.approx(NormalDist().cdf(0.4), abs=OF_33)
    assert lower.unhidden[0] == lower.complete[0]
    assert lower.ends[0].tolist() == [False, True]


def test_a_view_that_some_fingers_do_not_show_may_be_hidden_in_part_and_has_no_sure_end():
    """A pad of 0.01 mm is behind the post as a whole, or not at all."""
    lower = catalog_made(0.01, camera=UP_AND_DOWN).families[1]
    shown = round(lower.complete[0] * (MADE + 1))
    assert 0 < shown < MADE + 1
    assert lower.unhidden[0] == pytest.approx(1 - 1 / shown)
    assert not lower.ends[0].any()


@pytest.mark.parametrize("end", ["black", "clear"])
def test_a_view_that_adjoins_one_through_a_clear_end_has_no_end(end):
    thick, index, beyond, start = 3.0, 1.49, 2.0, 5.0
    # Snell's law at the lower end face, which lies below the pad and faces down: light that enters
    # near its outer edge reaches the membrane, if the end is clear.
    inwards = 0.9 * thick
    along = (AWAY - inwards) / np.hypot(AWAY - inwards, start - beyond)
    assert beyond < inwards * np.sqrt(index**2 - along**2) / along
    sides = {"from": end, "to": "black", "beside": "black"}
    plate = {"thickness": thick, "index": index, "overhang": [beyond, 1.0], "sides": sides}
    upper = catalog_made(layers=(plate,)).families[0]
    alone = end == "black"
    assert (upper.unhidden[0], upper.ends[0].tolist()) == (alone, [alone, alone])


def test_what_corners_and_length_a_view_has_does_not_depend_on_where_the_image_ends():
    """The upper pad, behind a layer, is cut by the border of the smaller of two images."""
    plate = {"thickness": 3.0, "index": 1.49}
    cut, whole = (catalog_made(layers=(plate,), lens=lens).families[0] for lens in (NARROW, WIDE))
    assert (cut.complete[0], whole.complete[0]) == (0, 1)
    assert np.abs(whole.bend).max() > 0.01
    np.testing.assert_allclose(cut.bend, whole.bend, atol=1e-9)
    np.testing.assert_allclose(cut.extent, whole.extent, atol=1e-9)
