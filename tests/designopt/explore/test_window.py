"""A window's sliders and buttons under a mouse, with a bench known by heart."""

import itertools
import time
import tomllib
import xml.etree.ElementTree as ElementTree
from typing import Any

import numpy as np
import pytest
from matplotlib.backend_bases import ResizeEvent
from PIL import Image

from designopt.explore.face import COLUMN, DPI, FOOT, HEIGHT, TRACK, WIDTH, round_step, stops
from designopt.explore.window import OPTIMISE, PICTURE, RESET, SPEC, STOP
from designopt.explore.words import number_text
from designopt.plot.ruling import Ruling
from tests.designopt.explore import toy
from tests.designopt.explore.hands import Hands, on_button
from tests.designopt.explore.toy import ASKED, KNOBS, LOCKED, SliderCrank, place


@pytest.fixture
def hands(tmp_path):
    return Hands(SliderCrank(), tmp_path)


def readings(hands):
    return {each.name: each.value for each in hands.window.readings}


@pytest.mark.parametrize("knob", KNOBS, ids=lambda knob: knob.name)
def test_each_slider_shows_what_the_bench_computes(hands, knob):
    before, first = hands.canvas.pixels(), hands.window.values
    hands.drag(knob.name, 0.5, 0.4, 0.3)
    values = hands.window.values
    wanted = knob.low + 0.3 * (knob.high - knob.low)
    assert values[knob.name] == pytest.approx(wanted, abs=(knob.high - knob.low) / 150)
    assert {k: v for k, v in values.items() if k != knob.name} == {
        k: v for k, v in first.items() if k != knob.name
    }
    assert readings(hands)["slider's place"] == place(values)
    assert hands.told[-1] == ([place(values), values["rod"] / values["radius"]], "")
    assert (hands.canvas.pixels() != before).any()


def test_each_slider_has_its_number_beside_it(hands):
    for row in hands.window.rows:
        _, low, right, top = row.patch.box.extents.astype(int)
        beside = np.s_[HEIGHT - top : HEIGHT - low, TRACK[1] + 9 : right]
        before = hands.canvas.pixels()
        hands.drag(row.knob.name, 0.3)
        now = hands.canvas.pixels()
        assert (now[beside] != before[beside]).any()
        rows = np.flatnonzero((now[beside] != now[0, 0]).any(axis=(1, 2)))
        assert 0 < rows[0] < rows[-1] < top - low - 1  # it is whole


def test_what_is_painted_is_what_would_be_drawn(hands):
    for name, fraction in (("crank", 0.8), ("radius", 0.9), ("rod", 0.1), ("crank", 0.2)):
        hands.drag(name, fraction)
        draws = hands.canvas.draws
        painted = hands.canvas.pixels()
        np.testing.assert_array_equal(painted, hands.redrawn())
        assert hands.canvas.draws == draws + 1


def test_a_slider_paints_and_draws_nothing_anew(hands):
    draws, blits = hands.canvas.draws, hands.canvas.blits
    hands.drag("crank", 0.3)
    assert (hands.canvas.draws, hands.canvas.blits) == (draws, blits + 1)


def test_the_folder_is_made_when_something_is_saved(tmp_path):
    folder = tmp_path / "new" / "pictures"
    hands = Hands(SliderCrank(), folder)
    assert not list(tmp_path.iterdir())
    hands.press(PICTURE)
    hands.press(SPEC)
    names = sorted(path.name for path in folder.iterdir())
    assert names == ["crank-1.toml", "raw-1.bin", "toy-1.png", "toy-1.svg"]


def test_limits_may_change(hands):
    """In a picture that is painted, with ticks that are."""
    bench: Any = hands.bench
    limits = bench.axes.get_xlim()
    hands.drag("rod", 0.95)
    assert bench.axes.get_xlim() != limits
    np.testing.assert_array_equal(hands.canvas.pixels(), hands.redrawn())


@pytest.mark.parametrize("visible", [False, True])
def test_ticks_may_be_hidden_and_shown(hands, visible):
    for ruling in hands.bench.rulings:
        ruling.set_visible(not visible)
    hands.drag("crank", 0.3)
    hands.bench.rulings[0].set_visible(visible)
    hands.drag("crank", 0.4)
    np.testing.assert_array_equal(hands.canvas.pixels(), hands.redrawn())


def test_ticks_are_drawn_only_when_limits_change(hands, monkeypatch):
    drawn = []
    draw = Ruling.draw
    monkeypatch.setattr(
        Ruling, "draw", lambda self, renderer: (drawn.append(self), draw(self, renderer))
    )
    hands.drag("crank", 0.3)
    assert not drawn
    hands.drag("rod", 0.95)
    assert drawn == hands.bench.rulings


def test_in_a_window_of_another_shape_circles_stay_round(hands):
    bench: Any = hands.bench
    resized: Any = ResizeEvent("resize_event", hands.canvas)
    for size in ((WIDTH / DPI, HEIGHT / DPI), (9, 6), (8, 9)):
        hands.canvas.figure.set_size_inches(*size)
        resized._process()
        hands.redrawn()
        scales = np.diff(bench.axes.transData.transform([(0, 0), (1, 1)]), axis=0)[0]
        assert scales[0] == pytest.approx(scales[1], rel=1e-9)
        hands.window.present()
        np.testing.assert_array_equal(hands.canvas.pixels(), hands.redrawn())


@pytest.mark.parametrize(("count", "lines"), [(5, 1), (40, 2), (400, 2)])
def test_a_message_fills_a_line_or_two(hands, monkeypatch, count, lines):
    """None beyond the foot of the window, whose last word says that there are more."""
    blank = hands.canvas.pixels()[-FOOT:]
    monkeypatch.setattr(toy, "LOCKED", " ".join(["inked"] * count))
    hands.drag("rod", 0.0)
    foot = (hands.canvas.pixels()[-FOOT:] != blank).any(axis=(1, 2))
    starts = np.count_nonzero(foot[1:] & ~foot[:-1])
    assert starts == lines
    assert not foot[[0, -1]].any()
    np.testing.assert_array_equal(hands.canvas.pixels(), hands.redrawn())
    hands.drag("rod", 0.9)
    np.testing.assert_array_equal(hands.canvas.pixels()[-FOOT:], blank)


@pytest.mark.parametrize("gap", ["\n", "\x85", "\u2029", "\x1c", "\v", "  "])
def test_a_message_takes_any_line_break_for_a_space(hands, monkeypatch, gap):
    drawn = []
    for between in (" ", gap):
        monkeypatch.setattr(toy, "LOCKED", f"12°{between}$μ$ – η")
        hands.drag("rod", 0.0)
        drawn.append(hands.canvas.pixels())
        hands.drag("rod", 0.9)
    np.testing.assert_array_equal(*drawn)


def test_of_moves_that_come_together_the_last_is_shown(tmp_path):
    bench = SliderCrank()
    hands = Hands(bench, tmp_path)
    shows = bench.shows
    hands.hold("crank", *np.linspace(0.1, 0.9, 30))
    assert bench.shows == shows
    hands.run_until_still()
    assert bench.shows == shows + 1
    assert readings(hands)["slider's place"] == place(hands.window.values)


@pytest.mark.parametrize("seed", range(6))
def test_in_a_window_of_any_size_nothing_of_the_last_move_is_left(tmp_path, seed):
    draw = np.random.default_rng(seed)
    hands = Hands(SliderCrank(more_knobs=14), tmp_path)
    hands.canvas.figure.set_size_inches(*draw.integers((600, 350), (2000, 1400)) / DPI)
    resized: Any = ResizeEvent("resize_event", hands.canvas)
    resized._process()
    hands.redrawn()
    for row in hands.window.rows * 2:
        row.slider.set_val(draw.uniform(row.knob.low, row.knob.high))
        hands.run_until_still()
    np.testing.assert_array_equal(hands.canvas.pixels(), hands.redrawn())


@pytest.mark.parametrize("size", [(9, 5), (12.8, 7.6), (12.8, 15.2)])
def test_in_a_window_of_any_size_numbers_stand_beside_their_names(hands, size):
    hands.canvas.figure.set_size_inches(*size)
    hands.redrawn()
    wide, tall = hands.canvas.get_width_height()
    name, number = (
        np.s_[:, int(left / WIDTH * wide) : int(right / WIDTH * wide)]
        for left, right in ((COLUMN + 2, TRACK[0] - 12), (TRACK[1] + 12, WIDTH))
    )
    ink = (hands.canvas.pixels()[:, :, :3] < 128).any(axis=-1)
    for row in hands.window.rows:
        _, low, _, high = row.patch.box.extents.astype(int)
        rows = [
            np.flatnonzero(ink[part][tall - high : tall - low].any(1)) for part in (name, number)
        ]
        middle = (high - low) / 2
        assert rows[0][0] < middle < rows[0][-1]
        # Digits are as high as the highest letters, and stand on the same line.
        assert rows[1][0] == pytest.approx(rows[0][0], abs=2)
        assert np.mean(rows[1][[0, -1]]) == pytest.approx(middle, abs=2)


def test_a_fault_is_said_and_goes_away(hands):
    hands.drag("crank", 0.25)
    hands.drag("radius", 1.0)
    assert hands.told[-1][0][0] is None
    assert hands.window.message == LOCKED
    hands.press(RESET)
    assert hands.window.message == ""


def test_reset_puts_all_sliders_back(hands):
    before = hands.canvas.pixels()
    for knob in KNOBS:
        hands.drag(knob.name, 0.3)
    hands.press(RESET)
    assert hands.window.values == {knob.name: knob.value for knob in KNOBS}
    assert readings(hands)["slider's place"] == place(hands.window.values)
    hands.mouse("motion_notify", 5.0, 755.0, None)  # off the button, which is lit up
    hands.run()
    np.testing.assert_array_equal(hands.canvas.pixels(), before)


def test_a_button_lights_up_under_the_mouse(hands):
    before, shown = hands.canvas.pixels(), len(hands.told)
    hands.mouse("motion_notify", *on_button(hands.window, RESET), None)
    hands.run()
    assert (hands.canvas.pixels() != before).any()
    hands.mouse("motion_notify", 5.0, 755.0, None)
    hands.run()
    np.testing.assert_array_equal(hands.canvas.pixels(), before)
    assert len(hands.told) == shown


def test_pictures_are_numbered_and_never_replaced(hands, tmp_path):
    (tmp_path / "toy-2.svg").write_text("mine")
    before = hands.canvas.pixels()
    hands.press(PICTURE)
    assert hands.window.message == f"Saved toy-1.png and toy-1.svg in {tmp_path}."
    hands.drag("crank", 0.7)
    hands.press(PICTURE)
    names = sorted(path.name for path in tmp_path.iterdir())
    assert names == ["toy-1.png", "toy-1.svg", "toy-2.svg", "toy-3.png", "toy-3.svg"]
    assert (tmp_path / "toy-2.svg").read_text() == "mine"
    first, second = (np.array(Image.open(tmp_path / f"toy-{n}.png")) for n in (1, 3))
    assert first.shape == second.shape == (1520, 2560, 4)
    assert (first != second).any()
    for number in (1, 3):
        root = ElementTree.parse(tmp_path / f"toy-{number}.svg").getroot()
        assert root.tag.endswith("svg")
    # The picture is the window without its buttons: the drawing, the knobs and the readings.
    small = np.array(Image.open(tmp_path / "toy-1.png").resize((1280, 760)), dtype=float)
    rows, columns = slice(10, 600), slice(10, 1270)
    alike = np.abs(small[rows, columns, :3] - before[rows, columns, :3]).mean()
    assert alike < 3.0  # of 255: lines of another width alone
    x, y = on_button(hands.window, RESET)
    assert small[round(760 - y), round(x), :3].min() == 255


def test_saving_leaves_the_window_as_it_was(hands):
    hands.drag("crank", 0.7)
    hands.press(PICTURE)
    np.testing.assert_array_equal(hands.canvas.pixels(), hands.redrawn())
    hands.drag("crank", 0.1)
    np.testing.assert_array_equal(hands.canvas.pixels(), hands.redrawn())


def test_specs_share_a_number_and_read_back(hands, tmp_path):
    (tmp_path / "raw-1.bin").write_bytes(b"mine")
    hands.drag("rod", 0.61)
    hands.press(SPEC)
    assert (
        hands.window.message == f"Saved crank-2.toml and raw-2.bin in {tmp_path}: the slider-crank."
    )
    read = tomllib.loads((tmp_path / "crank-2.toml").read_text(encoding="utf-8"))
    assert read == hands.window.values
    assert (tmp_path / "raw-2.bin").read_bytes() == b"\x00"
    assert (tmp_path / "raw-1.bin").read_bytes() == b"mine"


def test_what_cannot_be_saved_is_said(tmp_path):
    hands = Hands(SliderCrank(), tmp_path / "new")
    hands.drag("radius", 1.0)
    hands.drag("crank", 0.25)
    hands.press(SPEC)
    assert hands.window.message.startswith("slider-crank: a locked one is not saved")
    (tmp_path / "new").touch()
    hands.press(PICTURE)
    assert "new: cannot be made (File exists); name another" in hands.window.message
    np.testing.assert_array_equal(hands.canvas.pixels(), hands.redrawn())


def label(hands):
    return hands.window.buttons[OPTIMISE].button.label.get_text()


def test_optimising_draws_each_iteration(hands):
    hands.press(OPTIMISE)
    assert label(hands) == STOP
    assert hands.window.optimising
    rods, pictures = [], []
    for _ in range(3):  # after the first, which came with the button
        hands.run()
        rods.append(hands.window.values["rod"])
        pictures.append(hands.canvas.pixels())
        assert readings(hands)["slider's place"] == place(hands.window.values)
    assert len(set(rods)) == 3
    assert all((a != b).any() for a, b in itertools.pairwise(pictures))
    assert hands.window.message == f"rod {rods[-1]:.2f} mm"
    hands.run_until_still()
    assert readings(hands)["slider's place"] == pytest.approx(ASKED, abs=0.02)
    assert (label(hands), hands.window.optimising) == (OPTIMISE, False)
    assert "rod" in hands.window.message
    np.testing.assert_array_equal(hands.canvas.pixels(), hands.redrawn())


def test_optimising_can_be_stopped(hands):
    hands.press(OPTIMISE)
    hands.run()
    hands.press(OPTIMISE)
    stopped = hands.window.values
    hands.run_until_still()
    assert hands.window.values == stopped
    assert (label(hands), hands.window.optimising) == (OPTIMISE, False)
    assert "Stopped after" in hands.window.message
    hands.press(OPTIMISE)  # and taken up again
    hands.run_until_still()
    assert readings(hands)["slider's place"] == pytest.approx(ASKED, abs=0.02)


@pytest.mark.parametrize("act", [lambda h: h.drag("crank", 0.1), lambda h: h.press(RESET)])
def test_whoever_moves_a_slider_stops_it(hands, act):
    hands.press(OPTIMISE)
    hands.run()
    act(hands)
    mine = hands.window.values
    hands.run_until_still()
    assert hands.window.values == mine
    assert label(hands) == OPTIMISE


@pytest.mark.parametrize(
    ("knobs", "words"),
    [
        ({"radius": 1.0, "crank": 0.25}, "optimise: it cannot start locked"),
        ({"offset": 1.0}, "This failed: ZeroDivisionError: on purpose"),
    ],
)
def test_an_optimisation_that_fails_says_why(hands, knobs, words):
    for name, fraction in knobs.items():
        hands.drag(name, fraction)
    hands.press(OPTIMISE)
    hands.run_until_still()
    assert hands.window.message.startswith(words)
    assert (label(hands), hands.window.optimising) == (OPTIMISE, False)


@pytest.mark.parametrize(
    ("method", "act"),
    [
        ("show", lambda h: h.drag("crank", 0.7)),
        ("specs", lambda h: h.press(SPEC)),
        ("optimise", lambda h: h.press(OPTIMISE)),
    ],
)
def test_a_bench_that_fails_is_told_of_and_the_window_goes_on(hands, monkeypatch, method, act):
    def failing(values):
        raise ZeroDivisionError("on purpose")

    with monkeypatch.context() as during:
        during.setattr(hands.window._bench, method, failing)
        act(hands)
        hands.run_until_still()
    assert hands.window.message == "This failed: ZeroDivisionError: on purpose"
    assert label(hands) == OPTIMISE
    hands.drag("crank", 0.2)
    assert hands.window.message == ""
    assert readings(hands)["slider's place"] == place(hands.window.values)
    np.testing.assert_array_equal(hands.canvas.pixels(), hands.redrawn())


def test_a_picture_shows_where_the_sliders_are(hands, tmp_path, monkeypatch):
    saved = []

    def saving(*_):
        saved.append(readings(hands)["slider's place"])
        return [tmp_path / "toy.png"]

    monkeypatch.setattr("designopt.explore.window.save_picture", saving)
    hands.row("crank").slider.set_val(200.0)
    before = readings(hands)["slider's place"]  # nothing has been drawn yet
    hands.press(PICTURE)
    assert saved == [place(hands.window.values)]
    assert saved != [before]


def test_without_an_aim_there_is_no_button(tmp_path):
    bench = SliderCrank()
    bench.aim = ""
    assert list(Hands(bench, tmp_path).window.buttons) == [RESET, PICTURE, SPEC]


def test_painting_is_far_quicker_than_drawing(tmp_path):
    hands = Hands(SliderCrank(lines=30, more_knobs=18), tmp_path)
    painting, drawing = [], []
    for i in range(5):
        start = time.perf_counter()
        hands.drag("crank", 0.1 + 0.05 * i)
        middle = time.perf_counter()
        hands.redrawn()
        painting.append(middle - start)
        drawing.append(time.perf_counter() - middle)
    assert np.median(painting) < 0.5 * np.median(drawing)


def test_round_steps():
    assert [round_step(span, 154) for span in (360.0, 70.0, 1.0, 154.0)] == [5.0, 0.5, 0.01, 1.0]
    for knob in KNOBS:
        found = stops(knob, round_step(knob.high - knob.low, 154))
        assert {knob.low, knob.high, knob.value} <= set(found)
        assert np.ptp(found) == knob.high - knob.low
        assert len(found) <= 154 + 3
        assert all(len(f"{value!r}") <= 5 for value in found.tolist())  # no 0.30000000000000004


@pytest.mark.parametrize(
    ("value", "text"),
    [(1.23456789, "1.23457"), (-0.5, "-0.5"), (1e-9, "1e-09"), (None, "–"), (float("nan"), "–")],
)
def test_numbers_have_six_digits(value, text):
    assert number_text(value) == text
