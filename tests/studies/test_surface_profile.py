"""The study ``surface-profile``: a quick run end to end, and its pieces."""

import dataclasses
import json
import math

import jax.numpy as jnp
import numpy as np
import pydantic
import pytest

from designopt.errors import UserError
from designopt.study import runner
from designopt.study.study import Context
from optics.chamber import bend_center_line
from perception.chamber import (
    ChamberMap,
    Heights,
    Movements,
    Shape,
    SurfaceKind,
    compute_movements,
    find_points,
    find_regions,
)
from studies.models.soft_finger.finger import SoftFinger
from studies.models.soft_finger.odd import KINDS as ODD_KINDS
from studies.surface_profile import STUDY
from studies.surface_profile.drawings import limits_figure
from studies.surface_profile.found import Found
from studies.surface_profile.limits import Sized, all_from, none_up_to
from studies.surface_profile.limits import slides as sized_slides
from studies.surface_profile.odd import WITHIN, AtBend, Odd, wrong
from studies.surface_profile.sensor import UP, bends_at, designed_map, highest, postures_on
from studies.surface_profile.spec import SurfaceProfileSpec
from studies.surface_profile.statements import findings, metrics
from studies.surface_profile.surfaces import (
    FLAT_RMS,
    KINDS,
    ROUGH_RMS,
    SAGITTA,
    TILT_DEG,
    Surface,
    drawn,
)
from studies.surface_profile.trials import WAYS, Slide, Touching, Trial

QUICK = SurfaceProfileSpec(
    trials=1,
    fingers=2,
    frames=21,
    calibration=5,
    calibrations=[0],
    severities=[0.0],
    severity_trials=1,
    rest_frames=6,
    sagittas=[4.0],
    roughnesses=[0.05],
    size_slides=2,
)


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    out = tmp_path_factory.mktemp("quick") / "out"
    results = runner.run(STUDY, QUICK, seed=0, dtype="float64", out=out, force=False)
    return results, json.loads((out / "results.json").read_text(encoding="utf-8")), out


@pytest.mark.slow
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
    assert measured["odd_failures"] == 0
    assert measured["curved_from_mm"] == 4
    assert measured["rough_from_mm"] is None
    assert not results.unmet
    for name in ("profiles", "pictures", "kinds", "errors", "limits"):
        assert (out / "figures" / f"{name}.png").stat().st_size > 5000


@pytest.mark.slow
def test_only_the_stated_finger_has_a_target(done):
    results, _, _ = done
    # Fewer frames are another slide than the stated one.
    assert all(metric.target is None for metric in results.metrics)


@pytest.mark.slow
def test_tables_count_every_slide(done):
    results, _, _ = done
    tables = {table.name: table for table in results.tables}
    confusion = np.array([row[1:] for row in tables["confusion"].rows])
    assert confusion.sum() == 4 * QUICK.trials
    np.testing.assert_array_equal(np.diag(confusion), QUICK.trials)
    assert [row[0] for row in tables["calibration"].rows] == [0, 5]
    assert [row[:2] for row in tables["severities"].rows] == [(0.0, 4), (1.0, 4)]
    # The second finger has no slides.
    assert [row[0] for row in tables["fingers"].rows] == [1]
    assert [row[:5] for row in tables["sizes"].rows] == [
        ("sagitta", 1.2, 4.0, 2, 1.0),
        ("roughness", 0.15, 0.05, 2, 0.0),
    ]
    assert [row[1] for row in tables["odd_frames"].rows] == [3] * len(ODD_KINDS)
    known = {row[1]: row[4] for row in tables["bends"].rows if row[0] == 0}
    assert known[0.01] == known[15.0] == 1
    assert known[20.0] == known[120.0] == 0
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
    across = [bend_center_line(contact, jnp.asarray(bend), length).across for bend in bends]
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
    seen = compute_movements(found(postures_on(finger, spec, truth, np.full(6, UP))), rest)
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


@pytest.fixture(scope="module")
def chamber():
    heights = np.linspace(0.0, 12.0, 49)
    return ChamberMap(heights, np.array([3.7, 6.1, 3.8]) * heights[:, None])


STATED = SurfaceProfileSpec()


def trial(kind: SurfaceKind, found: SurfaceKind, number: int, chamber: ChamberMap) -> Trial:
    """Made up: a level slide that is taken for some kind."""
    x = np.linspace(-30.0, 30.0, STATED.frames)
    level, shown = np.zeros(len(x)), np.ones(len(x), bool)
    px = np.stack([np.interp(level + 3, chamber.heights, row) for row in chamber.moved.T], axis=1)
    moved = Movements(px, np.ones(px.shape, bool))
    shapes = {
        SurfaceKind.FLAT: Shape(0.0, 0.0),
        SurfaceKind.CONCAVE: Shape(-3.0, 0.0),
        SurfaceKind.CONVEX: Shape(3.0, 0.0),
        SurfaceKind.ROUGH: Shape(0.0, 0.5),
        SurfaceKind.UNDEFINED: None,
    }
    surface = dataclasses.replace(plain(), kind=kind)
    slide = Slide(number, surface, x, level, level, UP)
    heights = {way: Heights(level, shown.copy()) for way in WAYS}
    told: dict[str, Shape | None] = dict.fromkeys(WAYS, shapes[found])
    return Trial(slide, 1.0, 0, moved, moved, heights, told)


def made_up(
    chamber: ChamberMap, confused: int = 0, taken_for: SurfaceKind = SurfaceKind.ROUGH
) -> Found:
    """200 slides on five fingers, of which some flat ones are taken for another kind."""
    trials = []
    for number in range(4 * STATED.trials):
        kind = KINDS[number % 4]
        is_confused = kind is SurfaceKind.FLAT and number // 4 < confused
        trials.append(trial(kind, taken_for if is_confused else kind, number, chamber))
    maps = dict.fromkeys((STATED.calibration, 0), (chamber, chamber))
    fingers = [
        Touching(number, 1.0, 0.5, 0.1, maps, trials[40 * number : 40 * number + 40])
        for number in range(STATED.fingers)
    ]
    return Found(chamber, fingers, [], [], [], [], 1e-3, [])


def unmet(found: Found, spec: SurfaceProfileSpec = STATED) -> list[str]:
    return [one.name for one in metrics(spec, found) if one.met is False]


def test_targets_can_be_missed(chamber):
    assert unmet(made_up(chamber, 10)) == []  # 95 %
    assert unmet(made_up(chamber, 11)) == ["told_apart"]
    # What is not known is not told.
    assert unmet(made_up(chamber, 11, SurfaceKind.UNDEFINED)) == ["told_apart"]


def test_unknown_heights_and_failures_miss_targets(chamber):
    found = made_up(chamber)
    found.trials[0].heights[WAYS[0]].known[3] = False
    assert unmet(found) == ["heights_unknown"]
    good, bad = (Odd(ODD_KINDS[0], ODD_KINDS[0].status, failed) for failed in (False, True))
    found = dataclasses.replace(made_up(chamber), odd=[good, good])
    assert unmet(found) == []
    assert unmet(dataclasses.replace(found, odd=[good, bad])) == ["odd_failures"]
    bend = AtBend(0.1, 1.0, 0.1, Heights(np.zeros(4), np.zeros(4, bool)), 1)
    assert unmet(dataclasses.replace(found, bends=[bend])) == ["odd_failures"]
    assert "have 1 wrong answer." in findings(STATED, dataclasses.replace(found, odd=[bad]))[-1]


@pytest.mark.parametrize(
    ("change", "asked"),
    [
        ({}, True),
        ({"trials": 51, "fingers": 6}, True),
        ({"severities": [], "sagittas": [], "roughnesses": [], "size_slides": 1}, True),
        ({"trials": 49}, False),
        ({"trials": 1}, False),
        ({"fingers": 4}, False),
        ({"severity": 0.5}, False),
        ({"calibration": 33}, False),
    ],
)
def test_targets_are_asked_of_the_stated_run_and_larger_ones(chamber, change, asked):
    spec = SurfaceProfileSpec(**change)
    found = made_up(chamber)
    for finger in found.fingers:
        finger.calibrations.setdefault(spec.calibration, (chamber, chamber))
    targets = {one.name for one in metrics(spec, found) if one.target}
    assert targets == ({"told_apart", "heights_unknown", "odd_failures"} if asked else set())


def test_sizes_from_which_on_surfaces_are_told(chamber):
    def sized(size: float, told: int, of: int = 4) -> Sized:
        kinds = [SurfaceKind.ROUGH if i < told else SurfaceKind.FLAT for i in range(of)]
        trials = [trial(SurfaceKind.ROUGH, kind, i, chamber) for i, kind in enumerate(kinds)]
        return Sized("roughness", size, trials)

    steps = [sized(0.1, 0), sized(0.2, 0), sized(0.3, 2), sized(0.4, 4), sized(0.5, 4)]
    assert [one.told() for one in steps] == [0, 0, 0.5, 1, 1]
    assert (none_up_to(steps), all_from(steps)) == (0.2, 0.4)
    assert (none_up_to(steps[2:]), all_from(steps[:3])) == (None, None)
    # It is the true profile, level here, by which none is rough.
    assert steps[4].told_exactly() == 0
    assert steps[4].found() == 0.5
    assert math.isnan(Sized("roughness", 1.0, []).found())
    undefined = trial(SurfaceKind.ROUGH, SurfaceKind.UNDEFINED, 0, chamber)
    assert Sized("roughness", 1.0, [undefined]).told() == 0


def test_without_sizes_there_is_no_figure_of_them(chamber):
    assert limits_figure(made_up(chamber)) == []


def test_surfaces_of_a_size_have_it():
    spec = STATED.model_copy(update={"size_slides": 4})
    x = np.linspace(-30.0, 30.0, 2001)
    for size in (0.1, 0.4):
        for slide in sized_slides(spec, "roughness", size, 1):
            surface = slide.surface
            assert surface.kind is SurfaceKind.ROUGH
            assert (surface.height(x) - surface.slope * x).std() == pytest.approx(size)
    for size in (0.5, 2.0):
        for number, slide in enumerate(sized_slides(spec, "sagitta", size, 1)):
            surface = slide.surface
            sign = 1 if number % 2 == 0 else -1
            bare = dataclasses.replace(surface, amplitudes=0 * surface.amplitudes, slope=0.0)
            ends, middle = bare.height(np.array([-30.0, 30.0])), bare.height(np.zeros(1))
            np.testing.assert_allclose(middle - ends, sign * size)
    same, other = (sized_slides(spec, "sagitta", size, 1)[3] for size in (0.5, 2.0))
    assert same.direction == other.direction
    np.testing.assert_array_equal(same.surface.phases, other.surface.phases)


def test_what_is_to_be_answered_of_a_height(chamber):
    far, near = 1.1 * WITHIN, 0.9 * WITHIN
    truth = np.array([6.0, 6.0, 6.0, 6.0, 12 + near, 12 + near, 40.0, 40.0, near])
    mm = np.array([6 + near, 6 + far, 0.0, np.nan, 12.0, 0.0, 0.0, 12.0, 0.0])
    known = np.array([1, 1, 0, 1, 1, 0, 0, 1, 0], bool)
    expected = np.array([0, 1, 1, 1, 0, 0, 0, 1, 0], bool)
    np.testing.assert_array_equal(wrong(chamber, Heights(mm, known), truth), expected)


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
        ("sagittas", [1.0, 1.0], "differ from each other"),
        ("roughnesses", [0.0], "greater than 0"),
        ("size_slides", 0, "greater than or equal to 1"),
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
