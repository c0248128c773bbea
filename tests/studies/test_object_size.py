"""The study ``object-size``: grasps against brute force, and a quick run end to end."""

import csv
import json

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import brentq

from designopt import find_root
from designopt.cli import run as command
from studies.chamber_images.making import SoftFinger
from studies.object_size import tables
from studies.object_size.grasp import CLOSED, Hand, bend_around, diameter_of, touched
from studies.object_size.spec import ObjectSizeSpec
from studies.object_size.trials import Measured, designed, drawn
from tests.helpers import central_differences

LENGTH = 100.0
HANDS = [(68.0, 0.0, 12.75), (66.0, 20.0, 14.0), (75.0, -5.0, 10.0), (90.0, 30.0, 14.0)]

POINTS = 200_001  # along the centre line: 0.5 µm apart, which the distance feels squared
BRUTE = 1e-7  # mm
GRADIENT = 1e-6  # mm per radian and the like, of some 1e2; what central differences can tell


around = jax.jit(bend_around)
around_all = jax.jit(jax.vmap(bend_around, in_axes=(None, 0)))
touch_all = jax.jit(jax.vmap(touched, in_axes=(None, 0)))


def hand_of(values: tuple[float, float, float]) -> Hand:
    return Hand(*(jnp.asarray(value) for value in (*values, LENGTH)))


def line(bend: float) -> tuple[np.ndarray, np.ndarray]:
    """A dense centre line, by the circle's own equation."""
    arcs = np.linspace(0, LENGTH, POINTS)
    curvature = bend / LENGTH
    turned = curvature * arcs
    return (1 - np.cos(turned)) / curvature, np.sin(turned) / curvature


def clearance(hand: Hand, bend: float, diameter: float) -> tuple[float, float]:
    """From the finger's skin to the bottle, the least over the centre line, and where, mm."""
    x, z = line(bend)
    centre = float(hand.palm), float(hand.gap) + diameter / 2
    distance = np.hypot(x - centre[0], z - centre[1])
    nearest = int(np.argmin(distance))
    least = float(distance[nearest]) - diameter / 2 - float(hand.radius)
    return least, nearest * LENGTH / (POINTS - 1)


@pytest.mark.parametrize("values", HANDS)
def test_the_bend_is_the_first_that_touches_by_brute_force(values):
    hand = hand_of(values)
    diameters = jnp.asarray([40.0, 48.0, 62.0, 75.0, 82.0, 92.0, 100.0])
    solved = around_all(hand, diameters)
    touches = touch_all(hand, solved.value)
    assert solved.ok.all()
    for diameter, bend, arc in zip(diameters, solved.value, touches.arc, strict=True):
        size = float(diameter)
        wanted = brentq(lambda b, size=size: clearance(hand, b, size)[0], 1e-3, CLOSED, xtol=1e-10)
        assert float(bend) == pytest.approx(wanted, abs=1e-8)
        least, place = clearance(hand, float(bend), size)
        assert least == pytest.approx(0, abs=BRUTE)
        assert float(arc) == pytest.approx(place, abs=0.01)
        # Opened a little the finger is clear, closed a little it is in the bottle.
        assert clearance(hand, float(bend) - 1e-3, size)[0] > 0
        assert clearance(hand, float(bend) + 1e-3, size)[0] < 0


def test_bottles_touch_the_finger_and_its_tip():
    hand = hand_of(HANDS[0])
    arcs = [
        float(touched(hand, around(hand, jnp.asarray(size)).value).arc) for size in (48.0, 92.0)
    ]
    assert arcs[0] == LENGTH
    assert 50 < arcs[1] < 90


def test_the_closed_form_is_what_an_iteration_finds():
    hand = hand_of(HANDS[0])

    def off(bend: jax.Array, size: jax.Array) -> jax.Array:
        return (touched(hand, bend).diameter - size) / LENGTH

    for size in (45.0, 62.0, 92.0):
        bracket = (jnp.asarray(0.0), jnp.asarray(CLOSED))
        root = find_root(
            off, jnp.asarray(1.0), jnp.asarray(size), method="bisection", bracket=bracket
        )
        bend = around(hand, jnp.asarray(size)).value
        assert float(bend) == pytest.approx(float(root.value), abs=1e-10)


@pytest.mark.parametrize("values", HANDS)
def test_the_diameter_comes_back_and_falls_with_the_bend(values):
    hand = hand_of(values)
    diameters = jnp.linspace(40.0, 100.0, 121)
    bends = around_all(hand, diameters).value
    back = jax.jit(jax.vmap(diameter_of, in_axes=(None, 0)))(hand, bends)
    assert back.ok.all()
    np.testing.assert_allclose(back.value, diameters, atol=1e-9)
    assert np.all(np.diff(bends) < 0)


def test_a_straight_finger_touches_what_fills_the_hand():
    hand = hand_of(HANDS[0])
    touch = touched(hand, jnp.asarray(0.0))
    assert float(touch.diameter) == pytest.approx(2 * (68 - 12.75), rel=1e-14)
    assert float(touch.arc) == pytest.approx(68 - 12.75, rel=1e-14)
    nearly = touched(hand, jnp.asarray(1e-9))
    assert float(nearly.arc) == pytest.approx(float(touch.arc), rel=1e-6)


@pytest.mark.parametrize("bend", [0.3, 0.8, 1.2])
def test_the_imprint_is_that_of_the_bottle_on_the_bent_finger(bend):
    """Distances from the bottle's centre grow as from a cylinder of the relative radius."""
    hand = hand_of(HANDS[0])
    touch = touched(hand, jnp.asarray(bend))
    x, z = line(bend)
    distance = np.hypot(x - 68.0, z - float(touch.diameter) / 2)
    arcs = np.linspace(0, LENGTH, POINTS) - float(touch.arc)
    near = np.abs(arcs) < 1
    curvature = 2 * np.polyfit(arcs[near], distance[near], 2)[0]
    assert 1 / curvature == pytest.approx(float(touch.relative_radius), rel=1e-3)


@pytest.mark.parametrize(
    ("size", "words"), [(111.0, "too wide"), (150.0, "too wide"), (20.0, "too narrow")]
)
def test_bottles_that_are_not_touched_are_said_to_be_so(size, words):
    hand = hand_of(HANDS[0])
    solved = around(hand, jnp.asarray(size))
    assert not bool(solved.ok)
    assert words in solved.messages()[0]
    assert float(solved.margin) < 0
    slopes = jax.grad(lambda size: bend_around(hand, size).value)(jnp.asarray(size))
    assert np.isfinite(float(solved.value))
    assert np.isfinite(float(slopes))


@pytest.mark.parametrize(("bend", "words"), [(-0.1, "away"), (CLOSED + 0.1, "farther")])
def test_bends_that_hold_nothing_are_said_to_do_so(bend, words):
    solved = diameter_of(hand_of(HANDS[0]), jnp.asarray(bend))
    assert words in solved.messages()[0]
    assert np.isfinite(float(solved.value))


@pytest.mark.parametrize("size", [48.0, 82.0])
def test_gradients_are_central_differences(size):
    hand = hand_of(HANDS[0])

    def bend(design: tuple[Hand, jax.Array]) -> jax.Array:
        return bend_around(*design).value

    def diameter(design: tuple[Hand, jax.Array]) -> jax.Array:
        return diameter_of(*design).value

    for function, last in ((bend, size), (diameter, float(bend((hand, jnp.asarray(size)))))):
        design = (hand, jnp.asarray(last))
        batch = jax.tree.map(lambda leaf: jnp.stack([leaf, leaf]), design)
        slopes = jax.jit(jax.vmap(jax.grad(function)))(batch)
        wanted = central_differences(jax.jit(function), design)
        got = [float(leaf[0]) for leaf in jax.tree.leaves(slopes)]
        np.testing.assert_allclose(got, wanted, atol=GRADIENT, rtol=GRADIENT)


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    out = tmp_path_factory.mktemp("quick") / "out"
    quick = ["samples=300", "epochs=25", "grasps=8", "random_grasps=24", "columns=48", "rows=36"]
    sets = [part for setting in quick for part in ("--set", setting)]
    code = command(["run", "object-size", *sets, "--out", str(out)])
    return code, json.loads((out / "results.json").read_text(encoding="utf-8")), out


def test_a_quick_run_tells_bottles_apart(done):
    code, document, out = done
    measured = {name: metric["value"] for name, metric in document["metrics"].items()}
    assert code == 0
    assert measured["undefined"] == 0
    assert measured["told_apart"] >= 0.9
    # Who always says 70 mm is off by 15 mm, and the grasp alone by about 1 mm.
    assert 0.5 < measured["grasp_error_mm"] < 2
    assert measured["mean_absolute_error_mm"] < 4
    assert measured["tip_error_mm"] < 4
    assert 0.5 < measured["least_mm_per_deg"] < measured["largest_mm_per_deg"] < 1
    assert all(metric["target"] is None for metric in document["metrics"].values())
    for name in ("grasps", "pictures", "estimates", "confusion", "curve"):
        assert (out / "figures" / f"{name}.png").stat().st_size > 5000


def test_tables_of_the_quick_run_agree(done):
    _, document, out = done

    def rows(name: str) -> list[dict[str, str]]:
        text = (out / "tables" / f"{name}.csv").read_text(encoding="utf-8")
        return list(csv.DictReader(text.splitlines()))

    confusion = [list(row.values()) for row in rows("confusion")]
    assert [sum(map(int, row[1:])) for row in confusion] == [8] * 4
    right = sum(int(row[number + 1]) for number, row in enumerate(confusion))
    assert document["metrics"]["told_apart"]["value"] == pytest.approx(right / 32)
    bends = [float(row["bend_deg"]) for row in rows("bottles")]
    assert bends == sorted(bends, reverse=True)
    assert len(rows("budget")) == 6


def test_grasps_are_off_as_the_settings_say():
    spec = ObjectSizeSpec()
    finger = SoftFinger.of(spec)
    diameters = np.full(2000, 82.0)
    grasps = drawn(spec, finger, diameters, np.random.default_rng(3))
    mean = designed(spec, finger.length)
    assert grasps.held.all()
    for off in (grasps.hands.palm - mean.palm, grasps.hands.gap - mean.gap):
        assert float(off.std()) == pytest.approx(spec.place, rel=0.1)
    assert grasps.depths.min() >= spec.squeeze_least
    assert grasps.depths.max() <= spec.squeeze_most
    # The wall is pressed in to that depth where the bottle touches; rings are up to 2 mm apart.
    pressed = np.asarray(grasps.postures.pressed)
    np.testing.assert_allclose(pressed.max(axis=1), grasps.depths, atol=1 / (2 * 60))
    np.testing.assert_allclose(
        finger.arc[np.argmax(pressed, axis=1)], grasps.arcs, atol=float(np.diff(finger.arc).max())
    )


def test_no_answer_is_no_right_answer():
    spec = ObjectSizeSpec(bottles=[48.0, 92.0], grasps=2)
    finger = SoftFinger.of(spec)
    grasps = drawn(spec, finger, np.repeat(spec.bottles, 2), np.random.default_rng(0))
    said = np.array([50.0, 0.0, 91.0, 49.0])
    one = Measured(
        grasps,
        np.zeros((4, 1, 1), np.float32),
        np.zeros((4, 3, 2)),
        np.zeros((4, 3, 2)),
        grasps.bends,
        np.zeros(4),
        np.array([True, False, True, True]),
        said,
        said,
        said,
    )
    assert one.told(spec.bottles).tolist() == [0, 2, 1, 0]
    assert tables.told_apart(spec, one) == 0.5
    np.testing.assert_allclose(one.errors(said), [2.0, -1.0, -43.0])


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        (["palm=50"], "leaves room for 72 mm"),
        (["squeeze_most=0.2"], "must not be less than squeeze_least"),
        (["bottles=[62, 48]"], "from the least to the largest"),
        (["least=100"], "must be more than least"),
        (["bottles=[20, 48]"], "too narrow"),
    ],
)
def test_nonsense_is_refused_in_one_line(tmp_path, capsys, settings, words):
    out = tmp_path / "out"
    sets = [part for setting in settings for part in ("--set", setting)]
    assert command(["run", "object-size", *sets, "--out", str(out)]) == 2
    error = capsys.readouterr().err
    assert words in " ".join(error.split())
    assert "Traceback" not in error


def test_float32_is_refused(tmp_path, capsys):
    out = tmp_path / "out"
    assert command(["run", "object-size", "--dtype", "float32", "--out", str(out)]) == 2
    assert "float64" in capsys.readouterr().err
