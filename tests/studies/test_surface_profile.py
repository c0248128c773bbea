"""The study ``surface-profile``: a quick run end to end, and its pieces."""

import dataclasses
import math

import jax.numpy as jnp
import numpy as np
import pytest

from designopt import Records, Report, UserError
from optics.chamber import bend_center_line
from perception.chamber import ChamberMap, Heights, SurfaceKind, compute_movements
from studies.models.soft_finger.finger import SoftFinger
from studies.models.soft_finger.robustness import DISTURBANCES
from studies.surface_profile import SurfaceProfileSpec, run, surfaces
from studies.surface_profile.sensor import UP, bends_at, designed_map, highest, postures_on
from studies.surface_profile.slides import Slide, SlidingTest, up_to_a_constant, view_points
from studies.surface_profile.surfaces import KINDS, Surface, sample_surface
from tests.studies.quick import quick_run

STATED = SurfaceProfileSpec()


@pytest.mark.slow
def test_a_quick_run_tells_surfaces_apart(tmp_path):
    done = quick_run("surface-profile", tmp_path)
    measured = done.measured
    assert measured["told_apart"] == 1
    assert measured["heights_unknown"] == measured["odd_failures"] == 0
    # A third of a pixel, where a pixel is a sixth of a millimetre.
    assert measured["profile_median_mm"] <= 0.05
    assert measured["profile_p90_mm"] <= 0.1
    assert measured["profile_median_mm"] < measured["whole_median_mm"]
    assert measured["profile_p90_mm"] < measured["bare_p90_mm"]
    assert measured["curved_from_mm"] == 4
    assert measured["rough_from_mm"] is None
    confusion = np.array(list(done.table("confusion").values())[1:])
    np.testing.assert_array_equal(confusion, np.eye(5, 4))
    assert done.table("calibration")["frames"] == [0, 5]
    # The second finger has no slides.
    assert done.table("fingers")["finger"] == [1]
    assert [row[:5] for row in done.rows("sizes")] == [
        ("sagitta", 1.2, 4.0, 2, 1.0),
        ("roughness", 0.15, 0.05, 2, 0.0),
    ]
    assert done.table("odd_frames")["frames"] == [3] * len(DISTURBANCES)
    known = {row[1]: row[4] for row in done.rows("bends") if row[0] == 0}
    assert known[0.01] == known[15.0] == 1
    assert known[20.0] == known[120.0] == 0
    # What e alone is off by is the camera's shaking.
    severities = done.table("severities")
    assert (severities["severity"], severities["slides"]) == ([0, 1], [4, 4])
    perfect, usual = severities["e_p90_mm"]
    assert perfect < usual


@pytest.fixture(scope="module")
def finger():
    return SoftFinger.of(STATED)


def test_bends_are_those_of_the_deflection():
    deflections = np.linspace(0.0, 14.0, 15)
    bends = bends_at(deflections, 90.0, 101.0)
    assert bends[0] == 0
    contact, length = jnp.asarray(90.0), jnp.asarray(101.0)
    across = [bend_center_line(contact, jnp.asarray(bend), length).across for bend in bends]
    np.testing.assert_allclose(across, deflections, atol=1e-10)
    # The circle itself: across is R (1 − cos), R = length / bend.
    radius = 101.0 / bends[1:]
    np.testing.assert_allclose(radius * (1 - np.cos(90.0 / radius)), deflections[1:], rtol=1e-9)


def test_the_designed_map_is_what_a_perfect_camera_sees(finger):
    chamber, truth = designed_map(finger, STATED), np.linspace(0.5, 11.5, 6)
    rest = view_points(finger, finger.postures(np.zeros(1), np.full(1, UP)), 0.0, 0, 0)
    postures = postures_on(finger, STATED, truth, np.full(6, UP))
    seen = compute_movements(view_points(finger, postures, 0.0, 0, 0), rest)
    for number, name in enumerate("beg"):
        heights = chamber.height(seen, use=name)
        assert heights.known.all()
        # Three tenths of a pixel: pictures are painted on half pixels.
        assert (np.abs(heights.mm - truth) < 0.3 * chamber.resolution(truth)[:, number]).all()


def test_a_press_is_on_the_side_away_from_the_bend(finger):
    spec = STATED
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
        surface = sample_surface(kind, 60.0, generator)
        bare, sharp, blunt = surface.height(x), surface.ridden(x, 0.5), surface.ridden(x, 8.0)
        assert (sharp >= bare - 1e-12).all()
        assert (blunt >= sharp - 1e-3).all()


def test_drawn_surfaces_are_of_their_kind():
    generator = np.random.default_rng(6)
    x = np.linspace(-30, 30, 2001)
    for _ in range(40):
        flat, concave, convex, rough = (sample_surface(kind, 60.0, generator) for kind in KINDS)
        waves = flat.height(x) - flat.slope * x
        assert waves.std() <= surfaces.FLAT_RMS[1] + 1e-9
        roughness = (rough.height(x) - rough.slope * x).std()
        assert surfaces.ROUGH_RMS[0] - 1e-9 <= roughness <= surfaces.ROUGH_RMS[1] + 1e-9
        for surface, sign in ((concave, -1), (convex, 1)):
            assert surfaces.SAGITTA[0] <= sign * surface.sagitta <= surfaces.SAGITTA[1]
            level = surface.height(x) - surface.slope * x
            at = np.argmin(np.abs(x - surface.middle))
            assert level[at] * sign >= surfaces.SAGITTA[0] - 4 * surfaces.FLAT_RMS[1]
            assert abs(level[0]) < 1 + abs(surface.sagitta) / 3
        assert abs(math.degrees(math.atan(flat.slope))) <= surfaces.TILT_DEG


@pytest.fixture(scope="module")
def chamber():
    heights = np.linspace(0.0, 12.0, 49)
    return ChamberMap(heights, np.array([3.7, 6.1, 3.8]) * heights[:, None])


def reported(chamber, confused=0, taken_for="rough", unknown=0, failed=0):
    """Metrics of 200 slides, of which some flat ones are taken for another kind."""
    out, test = Report(STATED, package="studies.surface_profile"), SlidingTest(STATED, 0, chamber)
    number, shapes = np.arange(4 * STATED.trials), test.shapes
    surface = np.array([kind.name.lower() for kind in KINDS])[number % 4]
    called = np.where((number % 4 == 0) & (number // 4 < confused), taken_for, surface)
    told = {f"{way}told": called == surface for way in ("", "whole_")}
    shape = {"sagitta_mm": np.zeros(200), "roughness_mm": np.zeros(200)}
    shapes.add(surface=surface, called=called, **told, **shape)
    off = np.where(number < unknown, np.nan, 0.1 * (number % 3))
    errors = [f"{way}error_mm" for way in ("", "e_", "whole_", "full_", "pad_", "bare_")]
    rows = {"slide": number, "surface": surface, "unknown": np.isnan(off)}
    test.heights.add(frames=STATED.calibration, **rows, **dict.fromkeys(errors, off))
    test.fingers.add(shake_px=[0.4, 0.5, 0.7], noise_px=0.1)
    run.add_numbers(out, test, run.summarize_heights(test.heights, "frames"), Records())
    disturbed = {"kind": "black", "expected_sight": "", "usable": False, "in_view": False}
    disturbed |= {"sight": "", "given": False, "failed": np.arange(3) < failed}
    bends = {"severity": 1.0, "bend_deg": 1.0, "deflection_mm": 1.0, "known": True, "off_mm": 0.1}
    run.add_robustness(out, test, Records(disturbed), Records(bends | {"failed": [failed > 3]}))
    results = out.results()
    return {one.name: one for one in results.metrics}, results.findings


def test_targets_are_missed_by_what_they_forbid(chamber):
    def unmet(**changes):
        return [name for name, one in reported(chamber, **changes)[0].items() if one.met is False]

    asked = {name for name, one in reported(chamber)[0].items() if one.target}
    assert asked == {"told_apart", "heights_unknown", "odd_failures"}
    assert unmet(confused=10) == []  # 95 %
    assert unmet(confused=11) == ["told_apart"]
    # What is not known is not told.
    assert unmet(confused=11, taken_for="undefined") == ["told_apart"]
    assert unmet(unknown=1) == ["heights_unknown"]
    assert unmet(failed=1) == ["odd_failures"]
    metrics, findings = reported(chamber, failed=4)
    assert metrics["odd_failures"].value == 4
    assert findings[-1].endswith("have 4 wrong answers.")
    # Off are 0, 0.1 and 0.2 mm in turn.
    assert metrics["profile_median_mm"].value == pytest.approx(0.1)


def test_errors_are_up_to_a_constant_and_unknown_ones_stay():
    off = up_to_a_constant(np.array([1.0, np.nan, 2.0]))
    np.testing.assert_array_equal(off, [-0.5, np.nan, 0.5])
    assert np.isnan(up_to_a_constant(np.full(2, np.nan))).all()


def test_sizes_from_which_on_surfaces_are_told():
    sizes = Records({"size_mm": [0.3, 0.1, 0.5, 0.2, 0.4], "told": [0.5, 0.0, 1.0, 0.0, 1.0]})
    sizes = run.sort_rows(sizes, "size_mm")
    assert run.find_limits(sizes, "told") == (0.2, 0.4)
    assert np.isnan(run.find_limits(sizes.where(sizes["size_mm"] > 0.2), "told")[0])
    assert np.isnan(run.find_limits(sizes.where(sizes["size_mm"] < 0.4), "told")[1])


def test_surfaces_of_a_size_have_it():
    x = np.linspace(-30.0, 30.0, 2001)
    for size in (0.1, 0.4):
        surface = Slide.sample(STATED, 3, 1, "rough", size).surface
        assert surface.kind is SurfaceKind.ROUGH
        assert (surface.height(x) - surface.slope * x).std() == pytest.approx(size)
    for size in (0.5, 2.0):
        for kind, sign in (("convex", 1), ("concave", -1)):
            surface = Slide.sample(STATED, 3, 1, kind, size).surface
            bare = dataclasses.replace(surface, amplitudes=0 * surface.amplitudes, slope=0.0)
            ends, middle = bare.height(np.array([-30.0, 30.0])), bare.height(np.zeros(1))
            np.testing.assert_allclose(middle - ends, sign * size)
    same, other = (Slide.sample(STATED, 3, 1, "concave", size) for size in (0.5, 2.0))
    assert same.direction == other.direction
    np.testing.assert_array_equal(same.surface.phases, other.surface.phases)


def test_what_is_to_be_answered_of_a_height(chamber):
    far, near = 1.1 * run.WITHIN, 0.9 * run.WITHIN
    truth = np.array([6.0, 6.0, 6.0, 6.0, 12 + near, 12 + near, 40.0, 40.0, near])
    mm = np.array([6 + near, 6 + far, 0.0, np.nan, 12.0, 0.0, 0.0, 12.0, 0.0])
    known = np.array([1, 1, 0, 1, 1, 0, 0, 1, 0], bool)
    expected = np.array([0, 1, 1, 1, 0, 0, 0, 1, 0], bool)
    np.testing.assert_array_equal(run.is_wrong(chamber, Heights(mm, known), truth), expected)


def test_slides_do_not_depend_on_how_many_there_are():
    few = STATED.model_copy(update={"trials": 2})
    one, again = (Slide.sample(each, 6, 3) for each in (STATED, few))
    np.testing.assert_array_equal(one.ridden, again.ridden)
    assert one.surface.kind is SurfaceKind.CONVEX
    assert one.ridden.min() == 0
    assert (one.bare <= one.ridden).all()
    assert one.ridden.max() + STATED.preload <= highest(STATED)


def test_a_finger_that_bends_out_of_view_is_refused(finger):
    with pytest.raises(UserError, match="contact=50") as raised:
        designed_map(finger, SurfaceProfileSpec(contact=50.0))
    assert "\n" not in str(raised.value)
