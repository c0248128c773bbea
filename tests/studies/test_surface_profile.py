"""The study ``surface-profile``: a quick run end to end, and its pieces."""

import json
import math

import jax.numpy as jnp
import numpy as np
import pydantic
import pytest

from designopt import runner
from designopt.errors import UserError
from designopt.study import Context
from optics.soft_finger import bent
from perception.chamber.points import find_points
from perception.chamber.profile import SurfaceKind, movements
from perception.chamber.regions import find_regions
from studies.chamber_images.making import SoftFinger
from studies.surface_profile import STUDY
from studies.surface_profile.sensor import UP, bends_at, designed_map, highest, postures_on
from studies.surface_profile.spec import SurfaceProfileSpec
from studies.surface_profile.surfaces import (
    FLAT_RMS,
    KINDS,
    ROUGH_RMS,
    SAGITTA,
    TILT_DEG,
    Surface,
    drawn,
)
from studies.surface_profile.trials import Slide

QUICK = SurfaceProfileSpec(
    trials=1,
    fingers=1,
    frames=21,
    calibration=5,
    calibrations=[0],
    severities=[0.0],
    severity_trials=1,
    rest_frames=6,
)


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    out = tmp_path_factory.mktemp("quick") / "out"
    results = runner.run(STUDY, QUICK, seed=0, dtype="float64", out=out, force=False)
    return results, json.loads((out / "results.json").read_text(encoding="utf-8")), out


def test_a_quick_run_tells_surfaces_apart(done):
    results, document, out = done
    measured = {name: metric["value"] for name, metric in document["metrics"].items()}
    assert measured["told_apart"] == 1
    assert measured["heights_unknown"] == 0
    # A third of a pixel, where a pixel is a sixth of a millimetre.
    assert measured["profile_median_mm"] <= 0.05
    assert measured["profile_p90_mm"] <= 0.1
    assert measured["profile_median_mm"] < measured["whole_median_mm"]
    assert measured["profile_p90_mm"] < measured["bare_p90_mm"]
    assert not results.unmet
    for name in ("profiles", "pictures", "kinds", "errors"):
        assert (out / "figures" / f"{name}.png").stat().st_size > 5000


def test_only_the_stated_finger_has_a_target(done):
    results, _, _ = done
    # Fewer frames are another slide than the stated one.
    assert all(metric.target is None for metric in results.metrics)


def test_tables_count_every_slide(done):
    results, _, _ = done
    tables = {table.name: table for table in results.tables}
    confusion = np.array([row[1:] for row in tables["confusion"].rows])
    assert confusion.sum() == 4 * QUICK.trials
    np.testing.assert_array_equal(np.diag(confusion), QUICK.trials)
    assert [row[0] for row in tables["calibration"].rows] == [0, 5]
    assert [row[:2] for row in tables["severities"].rows] == [(0.0, 4), (1.0, 4)]
    # What e alone is off by is the camera's shaking.
    assert tables["severities"].rows[0][5] < tables["severities"].rows[1][5]


@pytest.fixture(scope="module")
def finger():
    return SoftFinger.of(SurfaceProfileSpec())


def test_bends_are_those_of_the_deflection():
    deflections = np.linspace(0.0, 14.0, 15)
    bends = bends_at(deflections, 90.0, 101.0)
    assert bends[0] == 0
    contact, length = jnp.asarray(90.0), jnp.asarray(101.0)
    across = [bent(contact, jnp.asarray(bend), length).across for bend in bends]
    np.testing.assert_allclose(across, deflections, atol=1e-10)
    # The circle itself: across is R (1 − cos), R = length / bend.
    radius = 101.0 / bends[1:]
    np.testing.assert_allclose(radius * (1 - np.cos(90.0 / radius)), deflections[1:], rtol=1e-9)


def test_the_designed_map_is_what_a_perfect_camera_sees(finger):
    spec = SurfaceProfileSpec()
    chamber = designed_map(finger, spec)
    truth = np.linspace(0.5, 11.5, 6)
    renderer = finger.renderer(0, severity=0.0)

    def found(postures):
        images = renderer.render(postures)
        return [find_points(image.pixels, find_regions(image.pixels)) for image in images]

    rest = found(finger.postures(np.zeros(1), np.full(1, UP)))
    seen = movements(found(postures_on(finger, spec, truth, np.full(6, UP))), rest)
    for number, name in enumerate("beg"):
        heights = chamber.height(seen, use=name)
        assert heights.known.all()
        # Three tenths of a pixel: pictures are painted on half pixels.
        assert (np.abs(heights.mm - truth) < 0.3 * chamber.resolution(truth)[:, number]).all()


def test_a_press_is_on_the_side_away_from_the_bend(finger):
    spec = SurfaceProfileSpec()
    postures = postures_on(finger, spec, np.array([3.0, 9.0]), np.full(2, UP))
    pressed = np.asarray(postures.pressed)
    assert (pressed <= 0).all()
    deepest = [spec.pressed + spec.pressed_more * each for each in (3.0, 9.0)]
    # Rings are 1.5 mm apart, one of them within 0.75 mm of the contact.
    np.testing.assert_allclose(-pressed.min(axis=1), deepest, atol=0.75**2 / 80 + 1e-12)
    assert abs(finger.arc[np.argmin(pressed[1])] - spec.contact) <= 0.75


def plain(sagitta: float = 0.0, width: float = 60.0, slope: float = 0.0) -> Surface:
    nothing = np.zeros(1)
    return Surface(
        SurfaceKind.FLAT, sagitta, width, 0.0, False, nothing, np.ones(1), nothing, slope
    )


@pytest.mark.parametrize("sagitta", [5.0, -5.0])
def test_on_a_circle_the_pad_rides_one_of_another_radius(sagitta):
    x = np.linspace(-20, 20, 9)
    surface = plain(sagitta)
    radius = (30.0**2 + 5.0**2) / 10.0
    np.testing.assert_allclose(
        surface.height(x), np.sign(sagitta) * (np.sqrt(radius**2 - x**2) - radius + 5)
    )
    middle = radius + 5.0 if sagitta > 0 else radius - 5.0
    expected = sagitta + np.sign(sagitta) * (np.sqrt(middle**2 - x**2) - middle)
    # The contact is sought on a grid: too low by less than its step squared over 4 mm.
    np.testing.assert_allclose(surface.ridden(x, 5.0), expected, atol=1e-4)


def test_on_a_slope_the_pad_rides_higher():
    tilt = math.radians(10.0)
    x = np.array([-3.0, 0.0, 8.0])
    expected = x * math.tan(tilt) + 5.0 * (1 / math.cos(tilt) - 1)
    np.testing.assert_allclose(plain(slope=math.tan(tilt)).ridden(x, 5.0), expected, atol=1e-4)


def test_the_pad_is_never_below_the_surface_and_is_blunt():
    generator = np.random.default_rng(5)
    x = np.linspace(-30, 30, 61)
    for kind in KINDS:
        surface = drawn(kind, 60.0, generator)
        bare, sharp, blunt = surface.height(x), surface.ridden(x, 0.5), surface.ridden(x, 8.0)
        assert (sharp >= bare - 1e-12).all()
        assert (blunt >= sharp - 1e-3).all()


def test_drawn_surfaces_are_of_their_kind():
    generator = np.random.default_rng(6)
    x = np.linspace(-30, 30, 2001)
    for _ in range(40):
        flat, concave, convex, rough = (drawn(kind, 60.0, generator) for kind in KINDS)
        waves = flat.height(x) - flat.slope * x
        assert waves.std() <= FLAT_RMS[1] + 1e-9
        roughness = (rough.height(x) - rough.slope * x).std()
        assert ROUGH_RMS[0] - 1e-9 <= roughness <= ROUGH_RMS[1] + 1e-9
        for surface, sign in ((concave, -1), (convex, 1)):
            assert SAGITTA[0] <= sign * surface.sagitta <= SAGITTA[1]
            level = surface.height(x) - surface.slope * x
            at = np.argmin(np.abs(x - surface.middle))
            assert level[at] * sign >= SAGITTA[0] - 4 * FLAT_RMS[1]
            assert abs(level[0]) < 1 + abs(surface.sagitta) / 3
        assert abs(math.degrees(math.atan(flat.slope))) <= TILT_DEG


def test_slides_do_not_depend_on_how_many_there_are():
    spec = SurfaceProfileSpec()
    one, again = (Slide.drawn(each, 6, 3) for each in (spec, spec.model_copy(update={"trials": 2})))
    np.testing.assert_array_equal(one.ridden, again.ridden)
    assert one.surface.kind is SurfaceKind.CONVEX
    assert one.ridden.min() == 0
    assert (one.bare <= one.ridden).all()
    assert one.ridden.max() + spec.preload <= highest(spec)


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("severity", 3.0, "less than or equal to 2"),
        ("frames", 5, "greater than or equal to 15"),
        ("trials", 0, "greater than or equal to 1"),
        ("tip_radius", -1.0, "greater than or equal to 0.5"),
        ("calibrations", [3, 3], "differ from each other"),
        ("severities", [2.5], "less than or equal to 2"),
        ("surface", "soap", "Extra inputs"),
    ],
)
def test_nonsense_is_refused(name, value, words):
    with pytest.raises(pydantic.ValidationError, match=words):
        SurfaceProfileSpec(**{name: value})


def test_a_finger_that_bends_out_of_view_is_refused(finger):
    with pytest.raises(UserError, match="contact=50") as raised:
        designed_map(finger, SurfaceProfileSpec(contact=50.0))
    assert "\n" not in str(raised.value)


def test_float32_is_refused():
    with pytest.raises(UserError, match="float64"):
        STUDY.run(QUICK, Context(0, "float32", lambda _: pytest.fail("nothing is done")))
